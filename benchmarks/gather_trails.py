"""How long what was shown before is seen where light has changed: trails, frame by frame.

    python benchmarks/gather_trails.py DATA [--scale 4] [--system gather ...] [--keep FOLDER]

The third frame of each `val` and `test` sequence is written 14 times without motion; LR frames keep
one of each S x S pixels by a Halton sequence. From frame 9 on a round shadow lies on it and stays
(`jump`: all of it is new in frame 9) or goes on by 8 pixels a frame (`move`). Printed is PSNR after
c / (1 + c) within what the shadow has covered so far, less that of `demod-guided`, which knows no
history: below 0 is a trail. `cut` declares a cut before frame 9: the largest difference of that
frame from a run that begins there.
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np
from ablations import judged_sequences
from numpy.typing import NDArray
from results import rtsr
from taau_static import radiance

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Image = NDArray[np.float64]

SYSTEMS = ("demod-temporal", "gather")
BASE = "demod-guided"

CHOSEN_FRAME, COUNT, CHANGED = 3, 14, 9
"""Frame of a sequence, frames that are written of it, the first with another light."""

RADIUS_PX, SOFT_PX, DARK = 60.0, 4.0, 0.3
"""Of the shadow: radius, width of its edge, factor of radiance inside."""

STEP_PX = {"jump": 0.0, "move": 8.0}
"""How far the shadow goes in a frame."""

SHADE_SEEN = 0.9
"""Factor below which a pixel counts as covered."""


def make_shade(size: tuple[int, int], steps: int, step_px: float) -> Image:
    """Factor of radiance at every pixel after so many steps."""
    height, width = size
    y, x = np.mgrid[:height, :width] + 0.5
    distance = np.hypot(x - 0.4 * width - steps * step_px, y - 0.5 * height) - RADIUS_PX
    inside = np.clip(0.5 - distance / SOFT_PX, 0.0, 1.0)
    return np.asarray(1.0 + (DARK - 1.0) * inside)


def write_sequence(source: Path, folder: Path, step_px: float) -> dict[int, Image]:
    """Write the frames; return the factor of radiance by frame."""
    header = read_header(source)
    planes = read_channels(source, header.channels)
    planes |= {name: np.zeros_like(planes[name]) for name in ("motion.X", "motion.Y")}
    size, shades = planes["R"].shape, {}
    folder.mkdir(parents=True)
    for number in range(1, COUNT + 1):
        shades[number] = np.ones(size)
        if number >= CHANGED:
            shades[number] = make_shade(size, number - CHANGED, step_px)
        dark = {c: (planes[c] * shades[number]).astype(planes[c].dtype) for c in "RGB"}
        path = folder / f"still.{number:04d}.exr"
        write_exr(path, planes | dark, attributes=header.attributes, compression="none")
    return shades


def judge(test: Path, reference: Path, covered: NDArray[np.bool_]) -> float:
    """PSNR in dB of c / (1 + c) where something was covered."""
    ours, theirs = (radiance(path)[:, covered] for path in (test, reference))
    difference = ours / (1.0 + ours) - theirs / (1.0 + theirs)
    return float(-10.0 * np.log10(np.mean(difference**2)))


def judge_frames(test: Path, reference: Path, shades: Mapping[int, Image]) -> list[float]:
    """PSNR of each frame from the change on, within what was covered so far."""
    scores, covered = [], np.zeros(shades[1].shape, bool)
    for number in range(CHANGED, COUNT + 1):
        covered = covered | (shades[number] < SHADE_SEEN)
        name = f"still.{number:04d}.exr"
        scores.append(judge(test / name, reference / name, covered))
    return scores


def upscale(folder: Path, out: Path, scale: int, system: str) -> None:
    """Run the command."""
    options = ("--simulate-lr", scale, "--jitter", "halton", "--system", system, "-q")
    rtsr("upscale", folder, out, *options)


def find_cut_difference(frames: Path, work: Path, scale: int, system: str) -> float:
    """Largest difference of the frame after a declared cut from a run that begins with it."""
    cut, alone = work / "cut", work / "alone"
    for folder in (cut, alone):
        folder.mkdir(parents=True)
        for path in sorted(frames.glob("*.exr"))[CHANGED - 1 if folder is alone else 0 :]:
            shutil.copy(path, folder)
    (cut / "capture.toml").write_text(f"camera_cuts = [{CHANGED}]\n", encoding="utf-8")
    name = f"still.{CHANGED:04d}.exr"
    for folder in (cut, alone):
        upscale(folder, work / f"{folder.name}-out", scale, system)
    first, second = (radiance(work / f"{f.name}-out" / name) for f in (cut, alone))
    return float(np.abs(first - second).max())


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--scale", type=int, default=4, show_default=True)
@click.option("--system", "systems", multiple=True, default=SYSTEMS, show_default=True)
@click.option("--keep", type=click.Path(path_type=Path), help="Keep frames and results there.")
def main(data: Path, scale: int, systems: tuple[str, ...], keep: Path | None) -> None:
    """Print a row a sequence, kind of change and system; then means."""
    numbers = range(CHANGED, COUNT + 1)
    click.echo("| sequence | light | system | " + " | ".join(map(str, numbers)) + " |")
    found: dict[tuple[str, str], list[list[float]]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        work = keep or Path(scratch)
        for shot in judged_sequences(data, Path(scratch) / "data"):
            source = sorted((Path(scratch) / "data" / shot).glob("*.exr"))[CHOSEN_FRAME - 1]
            for light, step_px in STEP_PX.items():
                frames = work / "frames" / light / shot
                shades = write_sequence(source, frames, step_px)
                scores = {}
                for system in (BASE, *systems):
                    out = work / system / light / shot
                    upscale(frames, out, scale, system)
                    scores[system] = judge_frames(out, frames, shades)
                for system in systems:
                    pairs = zip(scores[system], scores[BASE], strict=True)
                    gains = [ours - theirs for ours, theirs in pairs]
                    found.setdefault((light, system), []).append(gains)
                    cells = " | ".join(f"{gain:+.2f}" for gain in gains)
                    click.echo(f"| {shot} | {light} | {system} | {cells} |")
            for system in systems:
                place = work / "cuts" / system / shot
                most = find_cut_difference(work / "frames/jump" / shot, place, scale, system)
                click.echo(f"| {shot} | cut | {system} | largest difference {most:.2g} |")
    for (light, system), rows in found.items():
        means = " | ".join(f"{statistics.mean(column):+.2f}" for column in zip(*rows, strict=True))
        click.echo(f"| mean | {light} | {system} | {means} |")


if __name__ == "__main__":
    main()
