"""Deviation of a shard of a recurrent system from the whole run.

    python benchmarks/shards.py [--system taau] [--scale 2]

A shard replays a stated number of frames before its first output. The sequence is one sample frame
held still under Halton jitter, where history reaches furthest back: the worst case.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import click
import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.models import load_system

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data"
SHARDS = 2


def still_capture(folder: Path, count: int) -> None:
    """Write one frame of the sample `count` times, as an HR capture without motion."""
    name = "frame.0003.exr"
    header = read_header(SAMPLE / "hr" / name)
    planes = read_channels(SAMPLE / "hr" / name, header.channels)
    planes |= read_channels(SAMPLE / "reference" / name, "RGB")
    for channel in ("motion.X", "motion.Y"):
        planes[channel] = np.zeros_like(planes[channel])
    for number in range(1, count + 1):
        path = folder / f"still.{number:04d}.exr"
        write_exr(path, planes, attributes=header.attributes, compression="none")


def upscale(folder: Path, out: Path, *given: str) -> dict[str, NDArray[np.float64]]:
    """Run the command; return tone-mapped outputs by file name."""
    options = ["--jitter", "halton", *given]
    result = CliRunner().invoke(group, ["upscale", str(folder), str(out), *options])
    if result.exit_code:
        raise click.ClickException(result.output)
    images = {}
    for path in sorted(out.glob("*.exr")):
        planes = read_channels(path, "RGB")
        color = np.stack([planes[c].astype(np.float64) for c in "RGB"])
        images[path.name] = color / (1 + color)
    return images


@click.command()
@click.option("--system", default="taau", show_default=True)
@click.option("--scale", default=2, show_default=True)
@click.option("--frames", "count", default=48, show_default=True)
def main(system: str, scale: int, count: int) -> None:
    """Print the PSNR between shard and whole run, first and last frame of the last shard."""
    with tempfile.TemporaryDirectory() as scratch:
        still_capture(Path(scratch) / "in", count)
        given = ("--system", system, "--simulate-lr", str(scale))
        whole = upscale(Path(scratch) / "in", Path(scratch) / "whole", *given)
        last = ("--shard", f"{SHARDS}/{SHARDS}")
        part = upscale(Path(scratch) / "in", Path(scratch) / "part", *given, *last)
    preroll = load_system(system).preroll_frames
    for label, name in (("first", min(part)), ("last", max(part))):
        error = float(np.mean((part[name] - whole[name]) ** 2))
        value = math.inf if error == 0 else -10 * math.log10(error)
        print(f"{system} {scale}x, pre-roll {preroll}: {label} frame of the shard {value:.1f} dB")


if __name__ == "__main__":
    main()
