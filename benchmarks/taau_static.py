"""Gain of `taau` and `cgts` over `bicubic` on a static camera with jitter, frame by frame.

    python benchmarks/taau_static.py ../shared/data [--frames 16] [--weights FILE]

One frame of each sequence is written eight times with its motion set to zero. Output: 2 x 2 capture
pixels a pixel, LR: one of each 4 x 4 by a Halton sequence (`--simulate-lr 2 --samples-per-pixel 2
--jitter halton`). Reference: the mean of the 2 x 2 block. PSNR after c/(1+c), 8 px border left out.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

SYSTEMS = ("bicubic", "taau", "cgts")
SAMPLES, SCALE = 2, 2
BORDER_PX = 8
CHOSEN_FRAME = 3


def radiance(path: Path) -> NDArray[np.float64]:
    """Load R, G, B."""
    planes = read_channels(path, "RGB")
    return np.stack([planes[c].astype(np.float64) for c in "RGB"])


def still_sequence(source: Path, folder: Path, count: int) -> NDArray[np.float64]:
    """Write a frame `count` times without motion; return the reference."""
    header = read_header(source)
    planes = read_channels(source, header.channels)
    for name in ("motion.X", "motion.Y"):
        planes[name] = np.zeros_like(planes[name])
    for number in range(1, count + 1):
        path = folder / f"still.{number:04d}.exr"
        write_exr(path, planes, attributes=header.attributes, compression="none")
    color = radiance(source)
    c, h, w = color.shape
    return color.reshape(c, h // SAMPLES, SAMPLES, w // SAMPLES, SAMPLES).mean(axis=(2, 4))


def psnr(test: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """PSNR in dB of c/(1+c), border left out."""
    inner = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))
    difference = (test / (1 + test) - reference / (1 + reference))[inner]
    return float(-10 * np.log10(np.mean(difference**2)))


def scores(source: Path, count: int, weights: Path | None) -> Iterator[tuple[str, list[float]]]:
    """Yield each system's PSNR by frame."""
    with tempfile.TemporaryDirectory() as scratch:
        reference = still_sequence(source, Path(scratch) / "in", count)
        for system in SYSTEMS:
            out = Path(scratch) / system
            options = ["--simulate-lr", SCALE, "--samples-per-pixel", SAMPLES, "--jitter", "halton"]
            named = ["--weights", weights] if weights and system == "cgts" else ["--system", system]
            arguments = ["upscale", Path(scratch) / "in", out, *named, *options]
            result = CliRunner().invoke(group, [str(a) for a in arguments])
            if result.exit_code:
                raise click.ClickException(result.output)
            yield system, [psnr(radiance(path), reference) for path in sorted(out.glob("*.exr"))]


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--frames", "count", default=8, show_default=True)
@click.option("--weights", type=click.Path(path_type=Path, exists=True), help="Of cgts.")
def main(data: Path, count: int, weights: Path | None) -> None:
    """Print a line a sequence, and the mean gains after the last frame."""
    gains: dict[str, list[float]] = {system: [] for system in SYSTEMS[1:]}
    name = f"frame.{CHOSEN_FRAME:04d}.exr"
    sources = [p for p in data.glob(f"*/*/{name}") if p.parts[-3] != "dumps"]
    print(f"| sequence | {' | '.join(SYSTEMS)} |", " | ".join(f"{s}, by frame" for s in gains), "|")
    print("|---" * (1 + len(SYSTEMS) + len(gains)) + "|")
    for source in sorted(sources):
        by_system = dict(scores(source, count, weights))
        cells = [f"{by_system[system][-1]:.2f}" for system in SYSTEMS]
        for system, known in gains.items():
            gain = [a - b for a, b in zip(by_system[system], by_system["bicubic"], strict=True)]
            known.append(gain[-1])
            cells.append(" ".join(f"{g:+.1f}" for g in gain))
        print(f"| {source.parent.relative_to(data)} |", " | ".join(cells), "|", flush=True)
    for system, known in gains.items():
        print(f"mean gain of {system} over bicubic after {count} frames: "
              f"{statistics.fmean(known):+.2f} dB, lowest {min(known):+.2f} dB")  # fmt: skip


if __name__ == "__main__":
    main()
