"""Time of `rtsr evaluate` on 1080p frames, by jobs, and against the packages one after the other.

    python benchmarks/evaluate_speed.py [--frames 12] [--pairs 5]

The frames are noise over the enlarged sample. The packages (scikit-image's PSNR and SSIM by
Wang's definition, flip-evaluator's LDR-FLIP) judge the same files with one thread, reading and
tone mapping included; the command runs in this process, so that start and imports count nowhere.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import click
import flip_evaluator
import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, write_exr

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data" / "reference"
SIZE = (1080, 1920)
REPEAT = 4
METRICS = "psnr,ssim,flip"


def make(folder: Path, count: int) -> None:
    """Write `ref` and, with noise, `test`."""
    random = np.random.default_rng(0)
    for number in range(1, count + 1):
        planes = read_channels(SAMPLE / f"frame.{1 + (number - 1) % 6:04d}.exr", "RGB")
        for name, spread in (("ref", 0.0), ("test", 0.1)):
            large = {
                c: (
                    p.repeat(REPEAT, 0).repeat(REPEAT, 1)[: SIZE[0], : SIZE[1]]
                    * (1.0 + spread * random.uniform(-1.0, 1.0, SIZE))
                ).astype(np.float16)
                for c, p in planes.items()
            }
            write_exr(folder / name / f"frame.{number:04d}.exr", large)


def command(folder: Path, jobs: int) -> None:
    """Judge with the command."""
    arguments = ["evaluate", folder / "test", folder / "ref", "--metric", METRICS, "--jobs", jobs]
    result = CliRunner().invoke(group, [str(a) for a in arguments])
    if result.exit_code:
        raise click.ClickException(result.output)


def load(path: Path) -> NDArray[np.float32]:
    planes = read_channels(path, "RGB")
    linear = np.stack([planes[c].astype(np.float32) for c in "RGB"], axis=2)
    return linear / (1.0 + linear)


def srgb(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    curve = 1.055 * np.maximum(linear, 0.0031308) ** np.float32(1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve).astype(np.float32)


def packages(folder: Path) -> None:
    """Judge with scikit-image and flip-evaluator."""
    for path in sorted((folder / "test").iterdir()):
        test, ref = load(path), load(folder / "ref" / path.name)
        peak_signal_noise_ratio(ref, test, data_range=1.0)
        test, ref = srgb(test), srgb(ref)
        structural_similarity(
            ref, test, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5,
            use_sample_covariance=False,
        )  # fmt: skip
        flip_evaluator.evaluate(ref, test, "LDR", applyMagma=False)


def seconds(run: Callable[[], None]) -> tuple[float, float]:
    """Wall time, and time of the processors."""
    started, used = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - started, time.process_time() - used


@click.command()
@click.option("--frames", "count", default=12, show_default=True, type=click.IntRange(1))
@click.option("--pairs", default=5, show_default=True, type=click.IntRange(1))
def main(count: int, pairs: int) -> None:
    """Print medians a frame, and the ratios of the paired runs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make(folder, count)
        runs: dict[str, Callable[[], None]] = {
            "packages": lambda: packages(folder),
            "jobs 1": lambda: command(folder, 1),
            "jobs 2": lambda: command(folder, 2),
        }
        command(folder, 1)
        times = {kind: [seconds(run)] for kind, run in runs.items()}
        for _ in range(pairs - 1):
            for kind, run in runs.items():
                times[kind].append(seconds(run))
    for kind, measured in times.items():
        wall, used = (statistics.median(column) / count for column in zip(*measured, strict=True))
        print(f"{kind}: {wall:.3f} s a frame, {used:.3f} s of processors")
    for one, other in (("packages", "jobs 1"), ("packages", "jobs 2"), ("jobs 1", "jobs 2")):
        both = list(zip(times[one], times[other], strict=True))
        walls = [a[0] / b[0] for a, b in both]
        print(
            f"{one} / {other}: median {statistics.median(walls):.2f}, "
            f"{min(walls):.2f} to {max(walls):.2f}"
        )


if __name__ == "__main__":
    main()
