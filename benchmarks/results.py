"""Every method that comes with weights, and the baselines, on a data set: `docs/results.md`.

    python benchmarks/results.py DATA [--output docs/results.md] [--keep FOLDER]

Upscales every sequence of DATA/manifest.json at 2x and 4x from decimated frames: as they are,
with Halton jitter, and with radiance that a Blackman-Harris pixel filter went over. Judges by
protocol `rtsr` with a border of 16 pixels, the first 2 frames of each sequence left out. Scenes
that the `train` split holds and scenes it does not are kept apart.
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
from sections import replace_section

from rtsr_cli.cli import group
from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.networks import has_weights
from rtsr_cli.models import load_system, trainable_names

BASELINES = ("bicubic", "demod-bicubic", "taau")
UNTRAINED = "demod-guided"
"""What the networks correct."""

STRAIGHT = ("bicubic", "demod-bicubic")
"""Baselines that networks are held against, the better one of each sequence."""

LOWER_IS_BETTER = ("flip", "lpips", "temporal")
SCALES = (4, 2)
METRICS = {
    "psnr": "PSNR dB",
    "ssim": "SSIM",
    "flip": "FLIP",
    "lpips": "LPIPS",
    "temporal": "temporal",
}
BORDER, SKIP_FIRST = 16, 2
SETTINGS = (("none", "none"), ("halton", "none"), ("none", "blackman-harris"))
"""Jitter and pixel filter of the LR frames."""

HEAD = """# Results

Networks with the weights that come with rtsr, and baselines, on the rendered sequences that rtsr
is developed on (480 x 288 captures, one sample a pixel, LR frames by decimation), protocol `rtsr`:
PSNR on c/(1+c), the others on c/(1+c) then sRGB, border {border} pixels, first {skip} frames of
each sequence left out. Temporal is the change of (test - reference) along motion: 0 is perfect.
Means over frames, then over sequences.

Written by `python benchmarks/results.py DATA`; do not edit.
"""


def rtsr(*arguments: object) -> None:
    """Run a command in this process."""
    result = CliRunner().invoke(group, [str(a) for a in arguments])
    if result.exit_code:
        raise click.ClickException(result.output)


def methods(scale: int) -> tuple[str, ...]:
    """Baselines, what needs no training, and networks with weights for a scale."""
    systems = [load_system(name) for name in trainable_names()]
    upscalers = [s for s in systems if s.task is SystemTask.UPSCALE and has_weights(s, scale)]
    return (*BASELINES, UNTRAINED, *(system.name for system in upscalers))


def judged(data: Path, work: Path, scale: int, jitter: str, lr_filter: str) -> dict[str, Any]:
    """Upscale and judge everything at one scale; return the result."""
    setting = f"{scale}x-{jitter}-{lr_filter}"
    outputs = [work / setting / name for name in methods(scale)]
    for name, output in zip(methods(scale), outputs, strict=True):
        made = ("--simulate-lr", scale, "--jitter", jitter, "--lr-filter", lr_filter)
        rtsr("upscale", data, output, *made, "--system", name, "-q")
    report = work / f"{setting}.json"
    rtsr(
        "evaluate", *outputs, "--ref", data, "--metric", ",".join(METRICS), "--border", BORDER,
        "--skip-first", SKIP_FIRST, "--output", report, "-q",
    )  # fmt: skip
    found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return found


def cell(value: float | None, digits: int) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.{digits}f}"


Means = dict[str, dict[str, float | None]]


def row(head: Iterable[str], means: Means) -> str:
    """One line: each method's metrics."""
    cells = [
        cell(means[name].get(metric), 2 if metric == "psnr" else 4)
        for name in means
        for metric in METRICS
    ]
    return "| " + " | ".join([*head, *cells]) + " |"


def mean_of(rows: list[Means]) -> Means:
    def mean(name: str, metric: str) -> float | None:
        values = [v for r in rows if (v := r[name].get(metric)) is not None]
        return statistics.fmean(values) if values else None

    return {name: {metric: mean(name, metric) for metric in METRICS} for name in rows[0]}


def gains(result: dict[str, Any], sequences: list[dict[str, Any]], head: str) -> Iterator[str]:
    """What networks gain over the better of two baselines, on sequences not trained on."""
    names = [name for name in methods(int(head[0])) if name not in BASELINES]
    if not names:
        return
    yield f"\n## {head}: gain over the better of {' and '.join(STRAIGHT)} of each sequence\n"
    titles = ["PSNR dB", *(f"{METRICS[m]} lower by" for m in LOWER_IS_BETTER)]
    yield "| sequence | scene | " + " | ".join(f"{n} {t}" for n in names for t in titles) + " |"
    yield "| --- | --- |" + " ---: |" * (len(names) * len(titles))
    rows = []
    for s in (s for s in sequences if s["split"] != "train"):
        shot = f"{s['scene']}/{s['sequence']}"
        means = {n: result["tests"][f"{n}/{shot}"]["mean"] for n in (*STRAIGHT, *names)}
        rows.append([value for n in names for value in gain(means, n)])
        seen = "seen in training" if s["seen_in_training"] else "unseen"
        yield f"| {shot} | {seen} | " + " | ".join(f"{v:+.3f}" for v in rows[-1]) + " |"
    mean = [statistics.fmean(column) for column in zip(*rows, strict=True)]
    yield f"| **mean of {len(rows)}** |  | " + " | ".join(f"{v:+.3f}" for v in mean) + " |"


def gain(means: dict[str, dict[str, float]], name: str) -> list[float]:
    """PSNR above the best baseline's, the others below the best baseline's."""
    best = max(means[b]["psnr"] for b in STRAIGHT)
    lower = [min(means[b][m] for b in STRAIGHT) - means[name][m] for m in LOWER_IS_BETTER]
    return [means[name]["psnr"] - best, *lower]


def lines(result: dict[str, Any], sequences: list[dict[str, Any]], head: str) -> Iterator[str]:
    """The tables of one setting: every sequence, then means of seen and of unseen scenes."""
    names = methods(int(head[0]))
    heads = [f"{name} {title}" for name in names for title in METRICS.values()]
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
            means = {name: result["tests"][f"{name}/{shot}"]["mean"] for name in names}
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
        for scale, (jitter, lr_filter) in itertools.product(SCALES, SETTINGS):
            head = f"{scale}x, jitter {jitter}, pixel filter {lr_filter}"
            result = judged(tree, work, scale, jitter, lr_filter)
            text += gains(result, sequences, head)
            text += lines(result, sequences, head)
    replace_section(output, "results", "\n".join(text))
    click.echo(f"{output}: written")


if __name__ == "__main__":
    main()
