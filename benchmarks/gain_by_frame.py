"""What frames after a start or a cut gain, frame by frame: a plot.

    python benchmarks/gain_by_frame.py DATA [--system nsrd --system fusesr] [--least-frames 16]

Upscales the `val` and `test` sequences of DATA at 4x without jitter from their first frame on, and
prints and draws the PSNR gain over the better of `bicubic` and `demod-bicubic` of each sequence, by
the frame's number since the start, a mean over the sequences that last so many frames, as long as
the shortest of them does. Every frame counts.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path

import click
from ablations import judged_sequences
from curves import Curve, drawn
from results import BORDER, STRAIGHT, rtsr

SCALE = 4


def gains(
    data: Path, systems: tuple[str, ...], work: Path, least: int
) -> dict[str, list[list[float]]]:
    """System -> for each frame since the start, the gain of every sequence that has it."""
    shots = judged_sequences(data, work / "data")
    outputs = [work / name for name in dict.fromkeys((*STRAIGHT, *systems))]
    for output in outputs:
        made = ("--simulate-lr", SCALE, "--jitter", "none", "--system", output.name, "-q")
        rtsr("upscale", work / "data", output, *made)
    report = work / "report.json"
    rtsr(
        "evaluate", *outputs, "--ref", work / "data", "--metric", "psnr", "--border", BORDER,
        "--output", report, "-q",
    )  # fmt: skip
    tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    found: dict[str, list[list[float]]] = {name: [] for name in systems}
    for shot in shots:
        base = max(STRAIGHT, key=lambda name: tests[f"{name}/{shot}"]["mean"]["psnr"])
        for name in systems:
            frames = tests[f"{name}/{shot}"]["frames"]
            if len(frames) < least:
                continue
            for age, number in enumerate(sorted(frames, key=int)):
                over = tests[f"{base}/{shot}"]["frames"][number]["psnr"]
                while len(found[name]) <= age:
                    found[name].append([])
                found[name][age].append(frames[number]["psnr"] - over)
    return found


def means(found: dict[str, list[list[float]]]) -> dict[str, list[float]]:
    """Mean gain by frame, as long as every sequence lasts: a mean of the same ones throughout."""
    return {
        name: [statistics.fmean(values) for values in ages if len(values) == len(ages[0])]
        for name, ages in found.items()
    }


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option(
    "--system", "systems", multiple=True, default=("nsrd", "fusesr", "fusesr-fast", "demod-guided")
)
@click.option("--least-frames", type=click.IntRange(1), default=1, show_default=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/gain-by-frame.svg"))
def main(*, data: Path, systems: tuple[str, ...], least_frames: int, output: Path) -> None:
    """Print and draw."""
    with tempfile.TemporaryDirectory() as work:
        curves = means(gains(data, systems, Path(work), least_frames))
    for name, values in curves.items():
        click.echo(f"{name}: " + " ".join(f"{value:+.2f}" for value in values))
    lines = [Curve(name, list(enumerate(values, start=1))) for name, values in curves.items()]
    plot = drawn(lines, across="frame since the start", up="PSNR gain, dB")
    output.write_text(plot, encoding="utf-8")


if __name__ == "__main__":
    main()
