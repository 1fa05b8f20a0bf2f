"""The baselines on every sequence of a data set, as a table: `docs/results.md`.

    python benchmarks/results.py DATA [--output docs/results.md] [--keep FOLDER]

Upscales every sequence of DATA/manifest.json with every baseline at 2x and 4x from decimated
frames, without and with Halton jitter, and judges them by protocol `rtsr` with a border of 16
pixels, the first 2 frames of each sequence left out. Scenes that the `train` split holds and
scenes it does not are kept apart.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import click
from click.testing import CliRunner

from rtsr_cli.cli import group

BASELINES = ("bicubic", "demod-bicubic", "taau")
SCALES = (2, 4)
METRICS = {
    "psnr": "PSNR dB",
    "ssim": "SSIM",
    "flip": "FLIP",
    "lpips": "LPIPS",
    "temporal": "temporal",
}
BORDER, SKIP_FIRST = 16, 2
JITTERS = ("none", "halton")

HEAD = """# Results

Baselines on the rendered sequences that rtsr is developed on (480 x 288 captures, one sample a
pixel, LR frames by decimation), protocol `rtsr`: PSNR on c/(1+c), the others on
c/(1+c) then sRGB, border {border} pixels, first {skip} frames of each sequence left out. Temporal
is the change of (test - reference) along motion: 0 is perfect. Means over frames, then over
sequences.

Written by `python benchmarks/results.py DATA`; do not edit.
"""


def rtsr(*arguments: object) -> None:
    """Run a command in this process."""
    result = CliRunner().invoke(group, [str(a) for a in arguments])
    if result.exit_code:
        raise click.ClickException(result.output)


def judged(data: Path, work: Path, scale: int, jitter: str) -> dict[str, Any]:
    """Upscale and judge everything at one scale; return the result."""
    outputs = [work / f"{scale}x-{jitter}" / name for name in BASELINES]
    for name, output in zip(BASELINES, outputs, strict=True):
        made = ("--simulate-lr", scale, "--jitter", jitter, "--system", name)
        rtsr("upscale", data, output, *made, "-q")
    report = work / f"{scale}x-{jitter}.json"
    rtsr(
        "evaluate", *outputs, "--ref", data, "--metric", ",".join(METRICS), "--border", BORDER,
        "--skip-first", SKIP_FIRST, "--output", report, "-q",
    )  # fmt: skip
    found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return found


def cell(value: float | None, digits: int) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.{digits}f}"


def row(head: Iterable[str], means: dict[str, dict[str, float | None]]) -> str:
    """One line: each method's metrics."""
    cells = [
        cell(means[name].get(metric), 2 if metric == "psnr" else 4)
        for name in BASELINES
        for metric in METRICS
    ]
    return "| " + " | ".join([*head, *cells]) + " |"


def mean_of(rows: list[dict[str, dict[str, float | None]]]) -> dict[str, dict[str, float | None]]:
    def mean(name: str, metric: str) -> float | None:
        values = [v for r in rows if (v := r[name].get(metric)) is not None]
        return statistics.fmean(values) if values else None

    return {name: {metric: mean(name, metric) for metric in METRICS} for name in BASELINES}


def lines(result: dict[str, Any], sequences: list[dict[str, Any]], head: str) -> Iterator[str]:
    """The tables of one setting: every sequence, then means of seen and of unseen scenes."""
    heads = [f"{name} {title}" for name in BASELINES for title in METRICS.values()]
    for seen, title in ((True, "Scenes that `train` holds"), (False, "Scenes that `train` lacks")):
        chosen = [s for s in sequences if bool(s["seen_in_training"]) is seen]
        if not chosen:
            continue
        yield f"\n## {head}: {title}\n"
        yield "| sequence | split | " + " | ".join(heads) + " |"
        yield "| --- | --- |" + " ---: |" * len(heads)
        rows = []
        for s in chosen:
            shot = f"{s['scene']}/{s['sequence']}"
            means = {name: result["tests"][f"{name}/{shot}"]["mean"] for name in BASELINES}
            rows.append(means)
            yield row([shot, s["split"]], means)
        yield row([f"**mean of {len(rows)}**", ""], mean_of(rows))


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/results.md"))
@click.option("--keep", type=click.Path(path_type=Path), help="Keep the frames in this folder.")
def main(data: Path, output: Path, keep: Path | None) -> None:
    """Write the table."""
    sequences = json.loads((data / "manifest.json").read_text(encoding="utf-8"))["sequences"]
    text = [HEAD.format(border=BORDER, skip=SKIP_FIRST)]
    with tempfile.TemporaryDirectory() as name:
        work = keep or Path(name)
        tree = work / "data"
        tree.mkdir(parents=True, exist_ok=True)
        for s in sequences:
            link = tree / s["scene"] / s["sequence"]
            link.parent.mkdir(parents=True, exist_ok=True)
            if not link.exists():
                link.symlink_to((data / s["scene"] / s["sequence"]).resolve())
        for scale, jitter in itertools.product(SCALES, JITTERS):
            head = f"{scale}x, jitter {jitter}"
            text += lines(judged(tree, work, scale, jitter), sequences, head)
    output.write_text("\n".join(text) + "\n", encoding="utf-8")
    click.echo(f"{output}: written")


if __name__ == "__main__":
    main()
