"""What frames after a start or a cut gain, frame by frame: a plot.

    python benchmarks/gain_by_frame.py DATA [--system nsrd --system fusesr --system fusesr-fast]

Upscales the `val` and `test` sequences of DATA at 4x without jitter from their first frame on, and
prints and draws the PSNR gain over the better of `bicubic` and `demod-bicubic` of each sequence, by
the frame's number since the start; a mean over the sequences that are as long. Every frame counts.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path

import click
from ablations import judged_sequences
from results import BORDER, STRAIGHT, rtsr

SCALE = 4
WIDTH, HEIGHT, LEFT, TOP, LOW = 640, 280, 60, 20, 40
COLORS = ("#1f77b4", "#d6601f", "#2ca02c", "#9467bd")
FEWEST = 2
"""Sequences from which a mean is drawn."""


def gains(data: Path, systems: tuple[str, ...], work: Path) -> dict[str, list[list[float]]]:
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
            for age, number in enumerate(sorted(frames, key=int)):
                over = tests[f"{base}/{shot}"]["frames"][number]["psnr"]
                while len(found[name]) <= age:
                    found[name].append([])
                found[name][age].append(frames[number]["psnr"] - over)
    return found


def means(found: dict[str, list[list[float]]]) -> dict[str, list[float]]:
    """Mean gain by frame, as long as enough sequences last."""
    return {
        name: [statistics.fmean(values) for values in ages if len(values) >= FEWEST]
        for name, ages in found.items()
    }


def drawn(curves: dict[str, list[float]]) -> str:
    """An SVG of one line a system."""
    longest = max(map(len, curves.values()))
    top = max(max(values) for values in curves.values()) * 1.1
    across, down = WIDTH - LEFT - 10, HEIGHT - TOP - LOW

    def place(age: int, value: float) -> str:
        x = LEFT + across * age / max(1, longest - 1)
        return f"{x:.1f},{TOP + down * (1.0 - max(0.0, value) / top):.1f}"

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
    ]
    for step in range(5):
        value = top * step / 4
        y = float(place(0, value).split(",")[1])
        parts.append(
            f'<path d="M{LEFT} {y:.1f}H{WIDTH - 10}" stroke="#ddd"/>'
            f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:.1f}</text>'
        )
    for age in range(longest):
        x = float(place(age, 0.0).split(",")[0])
        parts.append(
            f'<text x="{x:.1f}" y="{HEIGHT - LOW + 16}" text-anchor="middle">{age + 1}</text>'
        )
    for number, (name, values) in enumerate(curves.items()):
        points = " ".join(place(age, value) for age, value in enumerate(values))
        color = COLORS[number % len(COLORS)]
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>'
            f'<text x="{LEFT + 120 * number}" y="{HEIGHT - 6}" fill="{color}">{name}</text>'
        )
    parts.append(f'<text x="{LEFT}" y="14">PSNR gain, dB, by frame since the start</text></svg>')
    return "\n".join(parts) + "\n"


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--system", "systems", multiple=True, default=("nsrd", "fusesr", "fusesr-fast"))
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/gain-by-frame.svg"))
def main(*, data: Path, systems: tuple[str, ...], output: Path) -> None:
    """Print and draw."""
    with tempfile.TemporaryDirectory() as work:
        curves = means(gains(data, systems, Path(work)))
    for name, values in curves.items():
        click.echo(f"{name}: " + " ".join(f"{value:+.2f}" for value in values))
    output.write_text(drawn(curves), encoding="utf-8")


if __name__ == "__main__":
    main()
