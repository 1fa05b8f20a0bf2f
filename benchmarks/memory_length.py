"""Peak memory of a long run against a short one: frames stream, so that both are alike.

    python benchmarks/memory_length.py [--short 10] [--long 100]

Six 1080p captures lie on disk; the other frames are hard links to them under other numbers. Each
run is a process of its own; its peak resident memory is what the kernel counted.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

import click
import numpy as np

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data"
SIZE, REPEAT, FILES = (1080, 1920), 4, 6

COMMANDS = {
    "demodulate": ["demodulate", "IN", "OUT"],
    "upscale taau": ["upscale", "IN", "OUT", "--simulate-lr", "2", "--system", "taau"],
    "evaluate": [
        "evaluate", "IN", "IN", "--metric", "psnr,ssim,flip,temporal",
        "--output", "OUT/report.html",
    ],
}  # fmt: skip
"""Commands; IN and OUT stand for the folders."""


def make_frames(count: int, folder: Path) -> None:
    """Write captures, and links to them up to `count`."""
    for number in range(1, count + 1):
        path = folder / f"frame.{number:04d}.exr"
        if number > FILES:
            os.link(folder / f"frame.{1 + (number - 1) % FILES:04d}.exr", path)
            continue
        header = read_header(SAMPLE / "hr" / path.name)
        planes = read_channels(SAMPLE / "hr" / path.name, header.channels)
        planes |= read_channels(SAMPLE / "reference" / path.name, "RGB")
        large = {
            name: np.ascontiguousarray(
                plane.repeat(REPEAT, 0).repeat(REPEAT, 1)[: SIZE[0], : SIZE[1]]
            )
            for name, plane in planes.items()
        }
        write_exr(path, large, attributes=header.attributes)


def peak_mib(command: list[str], captures: Path, out: Path) -> float:
    """Run a command to its end; return its peak resident memory."""
    named = [a.replace("IN", str(captures)).replace("OUT", str(out)) for a in command]
    arguments = [sys.executable, "-m", "rtsr_cli", *named, "-q"]
    process = os.posix_spawn(sys.executable, arguments, os.environ)
    _, status, usage = os.wait4(process, 0)
    if os.waitstatus_to_exitcode(status):
        raise click.ClickException(f"{' '.join(arguments)} failed")
    shutil.rmtree(out)
    return usage.ru_maxrss / 1024


@click.command()
@click.option("--short", default=10, show_default=True, type=click.IntRange(1))
@click.option("--long", "many", default=100, show_default=True, type=click.IntRange(2))
def main(short: int, many: int) -> None:
    """Print both peaks and their ratio for each command."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for count in (short, many):
            make_frames(count, folder / str(count))
        for kind, command in COMMANDS.items():
            few, lots = (peak_mib(command, folder / str(n), folder / "out") for n in (short, many))
            print(
                f"{kind}: {few:.0f} MiB over {short} frames, {lots:.0f} MiB over {many}, "
                f"{100 * (lots / few - 1):+.1f} %"
            )


if __name__ == "__main__":
    main()
