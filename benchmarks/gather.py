"""What gathering over frames gains over the enlargement of single frames, sequence by sequence.

    python benchmarks/gather.py DATA [--scale 4] [--jitter none] [--lr-filter none]
        [--system demod-guided --system demod-temporal --system gather ...]

Upscales the `val` and `test` sequences of DATA, which no network was trained on, and prints PSNR
of each sequence, the means of the other metrics, and gains over the first system, over all pixels
and in parts of the picture. PSNR after c / (1 + c); a border of 16 pixels and the first two frames
are left out.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path
from typing import Any

import click
from ablations import judged_sequences
from results import BORDER, SKIP_FIRST, rtsr

SYSTEMS = ("demod-guided", "demod-temporal", "gather", "fusesr", "nsrd")

OTHERS = ("flip", "lpips", "temporal")
"""Metrics beside PSNR; less is better."""

REGIONS = ("disoccluded", "off-screen", "edges", "shadows-and-highlights")


def gain_in(region: str, ours: dict[str, Any], theirs: dict[str, Any]) -> float:
    """Mean over the judged frames of the gain in PSNR within a region, dB."""
    gains = [
        mine["psnr"] - other["psnr"]
        for number, frame in ours["frames"].items()
        if frame["counted"]
        and (mine := frame["regions"][region])
        and (other := theirs["frames"][number]["regions"][region])
        # null where nothing differs, or nothing is left of the region within the border
        and None not in (mine["psnr"], other["psnr"])
    ]
    return statistics.mean(gains)


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--scale", type=int, default=4, show_default=True)
@click.option("--jitter", type=click.Choice(["none", "halton"]), default="none", show_default=True)
@click.option("--lr-filter", default="none", show_default=True)
@click.option("--system", "systems", multiple=True, default=SYSTEMS, show_default=True)
def main(data: Path, scale: int, jitter: str, lr_filter: str, systems: tuple[str, ...]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        shots = judged_sequences(data, work / "data")
        outputs = [work / name for name in systems]
        made = ("--simulate-lr", scale, "--jitter", jitter, "--lr-filter", lr_filter)
        for output in outputs:
            rtsr("upscale", work / "data", output, *made, "--system", output.name, "-q")
        report = work / "report.json"
        rtsr(
            "evaluate", *outputs, "--ref", work / "data", "--metric", ",".join(("psnr", *OTHERS)),
            "--border", BORDER, "--skip-first", SKIP_FIRST, "--output", report, "-q",
        )  # fmt: skip
        tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    click.echo(f"{scale}x, jitter {jitter}, filter {lr_filter}: PSNR dB")
    click.echo("| | " + " | ".join(systems) + " |\n|---|" + "---:|" * len(systems))
    means = {s: [tests[f"{s}/{shot}"]["mean"] for shot in shots] for s in systems}
    psnr = {s: [mean["psnr"] for mean in of] for s, of in means.items()}
    for i, shot in enumerate(shots):
        click.echo(f"| {shot} | " + " | ".join(f"{psnr[s][i]:.2f}" for s in systems) + " |")
    gains = {s: [a - b for a, b in zip(psnr[s], psnr[systems[0]], strict=True)] for s in systems}
    shown = (f"{statistics.mean(g):+.2f} ({min(g):+.2f})" for g in gains.values())
    click.echo("| gain, mean (least) | " + " | ".join(shown) + " |")
    for region in REGIONS:
        base = [tests[f"{systems[0]}/{shot}"] for shot in shots]
        found = {
            s: [
                gain_in(region, tests[f"{s}/{shot}"], b)
                for shot, b in zip(shots, base, strict=True)
            ]
            for s in systems
        }
        shown = (f"{statistics.mean(g):+.2f} ({min(g):+.2f})" for g in found.values())
        click.echo(f"| gain, {region} | " + " | ".join(shown) + " |")
    for metric in OTHERS:
        columns = (statistics.mean(mean[metric] for mean in means[s]) for s in systems)
        click.echo(f"| {metric} | " + " | ".join(f"{value:.4f}" for value in columns) + " |")


if __name__ == "__main__":
    main()
