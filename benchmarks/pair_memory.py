"""Peak memory of `rtsr upscale`, the whole command, on a rendered pair: system by system.

    python benchmarks/pair_memory.py [--system gather ...] [--scale 4] [--size 1920x1080]
        [--frames 4]

The pair is one of `rtsr synth`. Each run is a process of its own; its peak resident memory is what
the kernel counted.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import click
from memory_length import peak_mib
from results import rtsr


@click.command()
@click.option("--system", "systems", multiple=True, default=("gather", "fusesr", "demod-guided"))
@click.option("--scale", default=4, show_default=True, type=click.IntRange(2))
@click.option("--size", default="1920x1080", show_default=True, help="Of the pictures written.")
@click.option("--frames", "count", default=4, show_default=True, type=click.IntRange(1))
def main(*, systems: tuple[str, ...], scale: int, size: str, count: int) -> None:
    """Print each system's peak."""
    with tempfile.TemporaryDirectory() as name:
        pair = Path(name) / "pair"
        frames = ("--size", size, "--frames", f"1-{count}", "--scale", str(scale))
        rtsr("synth", pair, *frames, "--jitter", "halton", "-q")
        for system in systems:
            command = ["upscale", "IN", "OUT", "--hr", str(pair / "hr"), "--system", system]
            peak = peak_mib(command, pair / "lr", Path(name) / "out")
            click.echo(f"{system} {scale}x to {size}: peak {peak / 1024:.2f} GiB, {count} frames")


if __name__ == "__main__":
    main()
