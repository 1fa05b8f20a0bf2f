"""Every method that comes with weights, and the baselines, on a data set.

    python benchmarks/results.py DATA [--csv FILE] [--output docs/results.md] [--keep FOLDER]
    python benchmarks/results.py DATA --system NAME      # measured anew; the others' rows are kept

Upscales the `val` and `test` sequences of DATA/manifest.json, which no network was trained on, at
2x and 4x from decimated frames: as they are, with Halton jitter, and with radiance that a
Blackman-Harris pixel filter went over. Judges by protocol `rtsr` with a border of 16 pixels, the
first 2 frames of each sequence left out. Scenes of which the `train` split holds another sequence
and scenes it does not are kept apart. Every figure goes to the CSV file, the tables that
`benchmarks/results_text.py` makes of it to the document.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.testing import CliRunner
from results_text import (
    BORDER,
    COLUMNS,
    GAINS,
    METRICS,
    SCALES,
    SEEN,
    SETTINGS,
    SKIP_FIRST,
    STRAIGHT,
    UNSEEN,
    write_text,
)
from tables import Row, read_csv, write_csv

from rtsr_cli.cli import group
from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.models import list_trainable_names, load_system

BASELINES = ("bicubic", "demod-bicubic", "taau")
UNTRAINED = ("demod-temporal", "demod-guided")
"""What needs no training; the networks correct the last one."""

TABLE = Path("docs/results/systems.csv")

LOWER_IS_BETTER = ("flip", "lpips", "temporal")


def rtsr(*arguments: object) -> None:
    """Run a command in this process."""
    result = CliRunner().invoke(group, [str(a) for a in arguments])
    if result.exit_code:
        raise click.ClickException(result.output)


def methods(scale: int, only: Sequence[str] = ()) -> tuple[str, ...]:
    """Baselines, what needs no training, and networks with G-buffers and weights for a scale.

    Of some alone, they and what gains are over.
    """
    systems = [load_system(name) for name in list_trainable_names()]
    upscalers = [s for s in systems if s.task is SystemTask.UPSCALE and has_weights(s, scale)]
    networks = (system.name for system in upscalers if system.hr_inputs)
    every = (*BASELINES, *UNTRAINED, *networks)
    return tuple(name for name in every if not only or name in (*STRAIGHT, *only))


def judged(
    data: Path, work: Path, names: Sequence[str], scale: int, kind: tuple[str, str]
) -> dict[str, Any]:
    """Upscale and judge by some systems at one scale; return the result."""
    jitter, lr_filter = kind
    setting = f"{scale}x-{jitter}-{lr_filter}"
    outputs = [work / setting / name for name in names]
    for name, output in zip(names, outputs, strict=True):
        made = ("--simulate-lr", scale, "--jitter", jitter, "--lr-filter", lr_filter)
        rtsr("upscale", data, output, *made, "--system", name, "-q")
    report = work / f"{setting}.json"
    rtsr(
        "evaluate", *outputs, "--ref", data, "--metric", ",".join(METRICS), "--border", BORDER,
        "--skip-first", SKIP_FIRST, "--output", report, "-q",
    )  # fmt: skip
    result: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return result


def figure(value: float | None, form: str) -> str:
    """A figure as it is shown."""
    return "-" if value is None or math.isnan(value) else format(value, form)


def gain(means: Mapping[str, Mapping[str, float]], name: str) -> list[float]:
    """PSNR above the best baseline's, the others below the best baseline's."""
    best = max(means[b]["psnr"] for b in STRAIGHT)
    lower = [min(means[b][m] for b in STRAIGHT) - means[name][m] for m in LOWER_IS_BETTER]
    return [means[name]["psnr"] - best, *lower]


def score_cells(scores: Mapping[str, float | None]) -> dict[str, str]:
    """Columns of the metrics themselves."""
    return {m: figure(scores.get(m), ".2f" if m == "psnr" else ".4f") for m in METRICS}


def gain_cells(gains: Iterable[float]) -> dict[str, str]:
    """Columns of the gains."""
    return dict(zip(GAINS, (figure(g, "+.3f") for g in gains), strict=True))


Scores = Mapping[str, Mapping[str, float]]
"""System -> metric -> mean over the frames of a sequence."""


def sequence_rows(sequence: Mapping[str, Any], scores: Scores) -> Iterator[Row]:
    """Rows of one sequence: what each system reaches, and what it gains."""
    seen = SEEN if sequence["seen_in_training"] else UNSEEN
    for name in scores:
        yield {
            "sequence": f"{sequence['scene']}/{sequence['sequence']}",
            "scene": seen,
            "split": sequence["split"],
            "system": name,
            **score_cells(scores[name]),
            **({} if name in BASELINES else gain_cells(gain(scores, name))),
        }


def mean_score_rows(scene: str, each: Sequence[Scores]) -> Iterator[Row]:
    """Rows of the means over sequences, a metric over those that have it."""
    for name in each[0] if each else ():
        means: dict[str, float | None] = {}
        for metric in METRICS:
            values = [v for scores in each if (v := scores[name].get(metric)) is not None]
            means[metric] = statistics.fmean(values) if values else None
        title = {"sequence": f"mean of {len(each)}", "scene": scene, "system": name}
        yield title | score_cells(means)


def mean_gain_rows(each: Sequence[Scores]) -> Iterator[Row]:
    """Rows of the mean gains."""
    for name in [n for n in each[0] if n not in BASELINES] if each else ():
        gains = zip(*(gain(scores, name) for scores in each), strict=True)
        title = {"sequence": f"mean of {len(each)}", "system": name}
        yield title | gain_cells(map(statistics.fmean, gains))


def rows_of(
    result: Mapping[str, Any], sequences: list[dict[str, Any]], names: Sequence[str]
) -> list[Row]:
    """Rows of one scale and kind of LR frames: every sequence, then means."""
    rows: list[Row] = []
    every: list[Scores] = []
    for scene, seen in ((SEEN, True), (UNSEEN, False)):
        each: list[Scores] = []
        for s in (s for s in sequences if bool(s["seen_in_training"]) is seen):
            shot = f"{s['scene']}/{s['sequence']}"
            each.append({n: result["tests"][f"{n}/{shot}"]["mean"] for n in names})
            rows += sequence_rows(s, each[-1])
        every += each
        rows += mean_score_rows(scene, each)
    return rows + list(mean_gain_rows(every))


def find_place(row: Row) -> tuple[str, ...]:
    """Kind of LR frames, and sequence, of a row."""
    return tuple(row.get(c, "") for c in COLUMNS[: COLUMNS.index("split")])


def check_baselines(known: Sequence[Row], measured: Sequence[Row]) -> None:
    """Hold what gains are over to be what it was.

    Raises:
        click.ClickException: it is not: the table is of other frames, or of another version.
    """
    before = {(*find_place(row), row["system"]): row for row in known}
    for row in (r for r in measured if r["system"] in STRAIGHT):
        was = before.get((*find_place(row), row["system"]))
        if was is not None and was["psnr"] != row["psnr"]:
            raise click.ClickException(
                f"{row['sequence']}, {row['system']}: {row['psnr']} dB, and {was['psnr']} dB in "
                "the table: measure all systems anew"
            )


def merge_rows(known: Sequence[Row], measured: Sequence[Row]) -> list[Row]:
    """Rows that were measured in place of those of the same system, or behind their sequence's."""
    fresh = {(*find_place(row), row["system"]): row for row in measured}
    merged: list[Row] = []
    for i, row in enumerate(known):
        merged.append(fresh.pop((*find_place(row), row["system"]), row))
        if i + 1 == len(known) or find_place(known[i + 1]) != find_place(row):
            more = [key for key in fresh if key[:-1] == find_place(row)]
            merged += [fresh.pop(key) for key in more]
    return merged + list(fresh.values())


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--csv", "table", type=click.Path(path_type=Path), default=TABLE, show_default=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/results.md"))
@click.option("--keep", type=click.Path(path_type=Path), help="Keep the frames in this folder.")
@click.option("--system", "only", multiple=True, help="Measure it alone; repeatable.")
def main(data: Path, table: Path, output: Path, keep: Path | None, only: tuple[str, ...]) -> None:
    """Write the figures, and the tables."""
    every = json.loads((data / "manifest.json").read_text(encoding="utf-8"))["sequences"]
    sequences = [s for s in every if s["split"] != "train"]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        work = keep or Path(name)
        tree = work / "data"
        tree.mkdir(parents=True, exist_ok=True)
        for s in sequences:
            link = tree / s["scene"] / s["sequence"]
            link.parent.mkdir(parents=True, exist_ok=True)
            if not link.exists():
                link.symlink_to((data / s["scene"] / s["sequence"]).resolve())
        for scale, kind in itertools.product(map(int, SCALES), SETTINGS):
            title = {"scale": str(scale), "jitter": kind[0], "lr_filter": kind[1]}
            names = methods(scale, only)
            result = judged(tree, work, names, scale, kind)
            measured = [title | dict(row) for row in rows_of(result, sequences, names)]
            if only:
                check_baselines(read_csv(table), measured)
            rows += [row for row in measured if not only or row["system"] in only]
    write_csv(table, COLUMNS, merge_rows(read_csv(table), rows) if only else rows)
    write_text(table, output)
    click.echo(f"{table}, {output}: written")


if __name__ == "__main__":
    main()
