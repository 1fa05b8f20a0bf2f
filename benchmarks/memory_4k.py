"""Peak memory and time of `rtsr upscale` on 3840 x 2160 frames.

    python benchmarks/memory_4k.py [--system demod-bicubic]

The frames are made from `sample_data/`: every pixel repeated 8 times, cropped, with seeded noise,
so that files and memory have the size of a real 4K dump. The command runs in a process of its own.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import numpy as np

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data"
REPEAT = 8
SIZE = (2160, 3840)


def make_frame(number: int, out: Path) -> None:
    """Write one 4K capture."""
    random = np.random.default_rng(number)
    name = f"frame.{number:04d}.exr"
    header = read_header(SAMPLE / "hr" / name)
    planes = read_channels(SAMPLE / "hr" / name, header.channels)
    planes |= read_channels(SAMPLE / "reference" / name, "RGB")
    large = {}
    for channel, plane in planes.items():
        wide = plane.repeat(REPEAT, axis=0).repeat(REPEAT, axis=1)[: SIZE[0], : SIZE[1]]
        if plane.dtype != np.uint32:
            wide = (wide * (1 + 0.01 * random.random(SIZE, np.float32))).astype(plane.dtype)
        large[channel] = wide
    write_exr(out / name, large, attributes=header.attributes)


@click.command()
@click.option("--system", default="demod-bicubic", show_default=True)
@click.option("--frames", "count", default=4, show_default=True, type=click.IntRange(1, 6))
@click.option("--jobs", default=2, show_default=True)
def main(system: str, count: int, jobs: int) -> None:
    """Print peak resident memory and seconds a frame."""
    with tempfile.TemporaryDirectory() as folder:
        capture, out = Path(folder) / "capture", Path(folder) / "out"
        for number in range(1, count + 1):
            make_frame(number, capture)
        command = [sys.executable, "-m", "rtsr_cli", "upscale", str(capture), str(out)]
        command += ["--simulate-lr", "4", "--system", system, "--jobs", str(jobs)]
        started = time.perf_counter()
        subprocess.run(command, check=True)
        seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    print(f"{system}: peak {peak:.2f} GiB, {seconds / count:.1f} s a frame over {count} frames")


if __name__ == "__main__":
    main()
