"""What it costs that outputs survive a crash, and that damage to them is found.

    python benchmarks/durability.py [--frames 12] [--pairs 3]

Upscales frames to 1920 x 1080 with `bicubic`, in turn as it is and without checksums and fsync, so
that another load on the machine falls on both; medians of the pairs, as wall and as CPU time. Then
what a check of a kept frame takes, by its checksum and by decoding it, as a share of the time that
making the frame takes.
"""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import click
import numpy as np

from rtsr_cli.api import UpscaleRequest, upscale
from rtsr_cli.core.files.exr import read_channels, write_exr
from rtsr_cli.core.files.exr_checksum import is_unchanged

HEIGHT, WIDTH, SCALE = 540, 960, 2
MS = 1e3


def write_inputs(folder: Path, frames: int) -> None:
    """Smooth waves that move, and a grain."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    for number in range(1, frames + 1):
        wave = 0.5 + 0.3 * np.sin((x + 3 * number) / 50) * np.cos(y / 40)
        planes = {c: wave + 0.02 * random.standard_normal(wave.shape) for c in "RGB"}
        half = {name: plane.astype(np.float16) for name, plane in planes.items()}
        write_exr(folder / f"frame.{number:04d}.exr", half)


def run(source: Path, out: Path) -> tuple[float, float]:
    """Wall and CPU time of a run."""
    wall, cpu = time.perf_counter(), time.process_time()
    request = UpscaleRequest(in_folder=source, out_folder=out, system="bicubic", scale=SCALE)
    for _ in upscale(request):
        pass
    return time.perf_counter() - wall, time.process_time() - cpu


def run_anew(source: Path, out: Path, *, safe: bool) -> tuple[float, float]:
    shutil.rmtree(out, ignore_errors=True)
    if safe:
        return run(source, out)
    with (
        mock.patch.object(os, "fsync", lambda number: None),
        mock.patch("rtsr_cli.core.files.exr.seal", lambda content: None),
    ):
        return run(source, out)


def time_each(paths: list[Path], check: Callable[[Path], object]) -> float:
    """Median milliseconds of a file."""
    taken = []
    for path in paths:
        start = time.perf_counter()
        assert check(path)
        taken.append((time.perf_counter() - start) * MS)
    return statistics.median(taken)


@click.command()
@click.option("--frames", default=12, show_default=True)
@click.option("--pairs", default=3, show_default=True)
def main(frames: int, pairs: int) -> None:
    """Print the costs."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "in", Path(folder) / "out"
        write_inputs(source, frames)
        run(source, out)
        times = {safe: [] for safe in (True, False)}
        for _ in range(pairs):
            for safe in (False, True):
                times[safe].append(run_anew(source, out, safe=safe))
        for place, name in enumerate(("wall", "CPU")):
            ratios = [a[place] / b[place] for a, b in zip(times[True], times[False], strict=True)]
            print(f"writing, {name} time: {100 * (statistics.median(ratios) - 1):+.1f} %")
        paths = sorted(out.glob("*.exr"))
        frame_ms = statistics.median(wall for wall, _ in times[True]) / frames * MS
        summed = time_each(paths, lambda path: is_unchanged(path.read_bytes()))
        decoded = time_each(paths, lambda path: read_channels(path, "RGB"))
        print(
            f"a kept frame of {paths[0].stat().st_size / 1e6:.1f} MB: checksum {summed:.1f} ms "
            f"({summed / frame_ms:.1%} of making it), decoding {decoded:.1f} ms "
            f"({decoded / frame_ms:.1%})"
        )


if __name__ == "__main__":
    main()
