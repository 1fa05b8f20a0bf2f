"""What a static camera with jitter gains by history, frame by frame.

    python benchmarks/gather_static.py DATA [--scale 4] [--frames 16] [--system gather ...]

The third frame of each `val` and `test` sequence is written 16 times with its motion set to zero;
LR frames keep one of each S x S pixels by a Halton sequence. PSNR after c / (1 + c) of frames 1, 2,
4, 8, 16, 32 and 48, a border of 16 pixels left out, and the gain of the last over the first.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path

import click
from ablations import judged_sequences
from results import BORDER, rtsr
from taau_static import still_sequence

SYSTEMS = ("demod-temporal", "gather")

CHOSEN_FRAME = 3


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--scale", type=int, default=4, show_default=True)
@click.option("--frames", "count", type=int, default=16, show_default=True)
@click.option("--system", "systems", multiple=True, default=SYSTEMS, show_default=True)
def main(data: Path, scale: int, count: int, systems: tuple[str, ...]) -> None:
    """Print a row a system and sequence."""
    shown = [n for n in (1, 2, 4, 8, 16, 32, 48) if n <= count]
    click.echo("| sequence | system | " + " | ".join(map(str, shown)) + " | gain |")
    gains: dict[str, list[float]] = {name: [] for name in systems}
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for shot in judged_sequences(data, work / "data"):
            source = sorted((work / "data" / shot).glob("*.exr"))[CHOSEN_FRAME - 1]
            still = work / "still" / shot
            still.mkdir(parents=True)
            still_sequence(source, still, count)
            for name in systems:
                frames = judge(still, work / name / shot, scale, name)
                gains[name].append(frames[-1] - frames[0])
                cells = " | ".join(f"{frames[n - 1]:.2f}" for n in shown)
                click.echo(f"| {shot} | {name} | {cells} | {gains[name][-1]:+.2f} |")
    for name, found in gains.items():
        click.echo(f"{name}: mean {statistics.mean(found):+.2f} dB, least {min(found):+.2f}")


def judge(still: Path, output: Path, scale: int, name: str) -> list[float]:
    """PSNR of every frame."""
    made = ("--simulate-lr", scale, "--jitter", "halton", "--system", name, "-q")
    rtsr("upscale", still, output, *made)
    report = output.parent / f"{output.name}.json"
    judged = ("--metric", "psnr", "--border", BORDER, "--output", report, "-q")
    rtsr("evaluate", output, "--ref", still, *judged)
    (test,) = json.loads(report.read_text(encoding="utf-8"))["tests"].values()
    frames = test["frames"]
    return [frames[number]["psnr"] for number in sorted(frames, key=int)]


if __name__ == "__main__":
    main()
