"""Wall time of `rtsr demodulate --jobs 2` on 1080p frames against OpenEXR alone on the same cores.

    python benchmarks/throughput.py [--frames 24] [--pairs 5]

The frames are `sample_data/` captures enlarged to 1920 x 1080, with grain on the radiance, all
channels, ZIP. OpenEXR alone reads the same files and writes arrays of the same output channels:
frame after frame with two threads of its own, and two frames at a time with one thread each. The
command is run in this process (imports and tables warm) and as a process of its own (start and
imports included). Every round runs all four; ratios are of one round, their median is printed.
On a machine with other work the processors' time says more than the clock.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
import numpy as np
import OpenEXR
from click.testing import CliRunner

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data"
SIZE = (1080, 1920)
REPEAT = 4
CORES = 2


def make_frame(number: int, folder: Path) -> None:
    """Write one 1080p capture: radiance and G-buffer, 17 channels and an object number."""
    random = np.random.default_rng(number)
    source = f"frame.{1 + (number - 1) % 6:04d}.exr"
    header = read_header(SAMPLE / "hr" / source)
    planes = read_channels(SAMPLE / "hr" / source, header.channels)
    planes |= read_channels(SAMPLE / "reference" / source, "RGB")
    large = {}
    for channel, plane in planes.items():
        wide = plane.repeat(REPEAT, axis=0).repeat(REPEAT, axis=1)[: SIZE[0], : SIZE[1]]
        if channel in "RGB":
            wide = (wide * (1 + 0.02 * random.normal(size=SIZE))).astype(plane.dtype)
        large[channel] = wide
    write_exr(folder / f"frame.{number:04d}.exr", large, attributes=header.attributes)


def copy_frame(source: Path, outputs: Path, target: Path, threads: int) -> None:
    """Read what demodulate reads, write what it writes, without a thought in between."""
    read = OpenEXR.File(str(source), separate_channels=True, num_threads=threads)
    assert read.channels()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, LOADED[outputs.name], num_threads=threads).write(str(target))


LOADED: dict[str, dict[str, np.ndarray]] = {}
"""Output channels by file name, in memory before the clock starts."""


def plain(captures: Path, outputs: Path, target: Path, *, at_once: int) -> None:
    """Copy every frame, `at_once` frames at a time, with two threads in all."""
    target.mkdir()
    threads = CORES if at_once == 1 else 0
    with ThreadPoolExecutor(at_once) as pool:
        jobs = [
            pool.submit(copy_frame, p, outputs / p.name, target / p.name, threads)
            for p in sorted(captures.iterdir())
        ]
        for job in jobs:
            job.result()


def command_here(captures: Path, target: Path) -> None:
    """Run the command in this process."""
    arguments = ["demodulate", str(captures), str(target), "--jobs", str(CORES)]
    result = CliRunner().invoke(group, arguments)
    if result.exit_code:
        raise click.ClickException(result.output)


def command_alone(captures: Path, target: Path) -> None:
    """Run the command in a process of its own."""
    command = [sys.executable, "-m", "rtsr_cli", "demodulate", "-q"]
    command += [str(captures), str(target), "--jobs", str(CORES)]
    subprocess.run(command, check=True)


def seconds(target: Path, run: Callable[[], None]) -> tuple[float, float]:
    """Time one run, wall and processors; what it wrote is removed outside the clock."""
    started, used = time.perf_counter(), sum(os.times()[:4])
    run()
    elapsed, used = time.perf_counter() - started, sum(os.times()[:4]) - used
    shutil.rmtree(target)
    return elapsed, used


@click.command()
@click.option("--frames", "count", default=24, show_default=True, type=click.IntRange(1))
@click.option("--pairs", default=5, show_default=True, type=click.IntRange(1))
def main(count: int, pairs: int) -> None:
    """Print medians a frame, and the ratios of the paired runs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        captures, outputs, target = folder / "captures", folder / "outputs", folder / "target"
        for number in range(1, count + 1):
            make_frame(number, captures)
        command_here(captures, outputs)
        for path in sorted(outputs.iterdir()):
            LOADED[path.name] = read_channels(path, read_header(path).channels)
        runs: dict[str, Callable[[], None]] = {
            "OpenEXR, 2 threads a frame": lambda: plain(captures, outputs, target, at_once=1),
            "OpenEXR, 2 frames at once": lambda: plain(captures, outputs, target, at_once=2),
            "rtsr in process": lambda: command_here(captures, target),
            "rtsr as a command": lambda: command_alone(captures, target),
        }
        times = {kind: [seconds(target, run)] for kind, run in runs.items()}
        for _ in range(pairs - 1):
            for kind, run in runs.items():
                times[kind].append(seconds(target, run))
    for kind, measured in times.items():
        wall, used = (statistics.median(column) / count for column in zip(*measured, strict=True))
        print(f"{kind}: {wall:.3f} s a frame, {used:.3f} s of processors")
    first, second, *ours = runs
    for kind in ours:
        for base in (first, second):
            pairs_of = list(zip(times[kind], times[base], strict=True))
            walls, cpus = ([a[i] / b[i] for a, b in pairs_of] for i in (0, 1))
            print(
                f"{kind} / {base}: median {statistics.median(walls):.2f}, "
                f"{min(walls):.2f} to {max(walls):.2f}; processors {statistics.median(cpus):.2f}"
            )


if __name__ == "__main__":
    main()
