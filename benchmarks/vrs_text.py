"""The tables of `docs/vrs.md` out of the figures that `benchmarks/vrs.py` measured.

    python benchmarks/vrs_text.py docs/results [--output docs/vrs.md]

One table a question. `vrs-accuracy.csv` holds every set of weights, sequence and kind of tile,
`vrs-savings.csv` what rates save at the same true error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click
from sections import replace_section
from tables import Row, markdown, read_csv

ACCURACY, SAVINGS = "vrs-accuracy.csv", "vrs-savings.csv"

FIGURES = {
    "r2": ("network", "r2"),
    "mae": ("network", "mae"),
    "under": ("network", "under"),
    "seen_r2": ("network, seen", "r2"),
    "seen_mae": ("network, seen", "mae"),
    "unseen_r2": ("network, unseen", "r2"),
    "unseen_mae": ("network, unseen", "mae"),
    "proxy_r2": ("proxy", "r2"),
    "proxy_mae": ("proxy", "mae"),
    "derived_r2": ("extrapolated", "r2"),
    "derived_mae": ("extrapolated", "mae"),
}
"""Column -> kind of prediction and of tile, and what is said of it."""

ESTIMATORS = ("network", "analytic", "hybrid")
ACCURACY_COLUMNS = ("weights", "metric", "tile", "sequence", "scene", *FIGURES)
SAVINGS_COLUMNS = ("weights", "metric", "true_error", *ESTIMATORS)

THIRD = 100.0 / 3.0
"""What the analytic estimate saves, in per cent, where the estimators are held together."""

HEAD = f"""## How well are errors predicted?

Predicted against true errors of reduced shading rates, tile by tile, in transformed space (0..1),
on sequences that no network was trained on: R2 and mean absolute error (MAE) of each predicted
rate, then their mean over rates; `under` is the mean underestimation. The proxy is the exact metric
on the frame before, moved to this one. Predictions are the network's, without the safety margin
that `predict-vrs` adds.

`python benchmarks/vrs.py DATA` measures and writes every figure of every sequence to
[results/{ACCURACY}](results/{ACCURACY}) and
[results/{SAVINGS}](results/{SAVINGS}), and these tables from them; do not edit.
"""


def is_mean(row: Row) -> bool:
    """Whether a row is the mean over sequences."""
    return row["sequence"].startswith("mean of ")


def mean_table(rows: Sequence[Row], titles: Mapping[str, str]) -> str:
    """Means over sequences, a row a set of weights; columns by name, with their titles."""
    lines = [[f"`{r['weights']}`", *(r[column] for column in titles)] for r in rows if is_mean(r)]
    return markdown(["weights", *titles.values()], lines)


def sequence_table(rows: Sequence[Row], column: str) -> str:
    """One figure by sequence, a column a set of weights."""
    values = {(r["sequence"], r["weights"]): r[column] for r in rows}
    scenes = {r["sequence"]: r["scene"] for r in rows if not is_mean(r)}
    weights = list(dict.fromkeys(r["weights"] for r in rows))
    lines = [
        [name, scene, *(values.get((name, w), "-") for w in weights)]
        for name, scene in scenes.items()
    ]
    return markdown(["sequence", "scene", *(f"`{w}`" for w in weights)], lines, texts=2)


def percent(value: str) -> str:
    """A share as the tables show it."""
    return f"{value} %" if value else "-"


def third_table(rows: Sequence[Row]) -> str:
    """What each estimator saves where the analytic one saves about a third, by weights."""
    lines = []
    for weights in dict.fromkeys(r["weights"] for r in rows):
        own = [r for r in rows if r["weights"] == weights]
        row = min(own, key=lambda r: abs(float(r["analytic"]) - THIRD))
        shares = (percent(row[name]) for name in ESTIMATORS)
        lines.append([f"`{weights}`", f"{row['true_error']} ({row['metric']})", *shares])
    head = ["weights", "true error", *(f"{name} saves" for name in ESTIMATORS)]
    return markdown(head, lines, texts=2)


def saving_table(rows: Sequence[Row]) -> str:
    """What each estimator saves, a row a true error."""
    lines = [[r["true_error"], *(percent(r[name]) for name in ESTIMATORS)] for r in rows]
    return markdown(["true error", *(f"{name} saves" for name in ESTIMATORS)], lines, texts=0)


def questions(accuracy: Sequence[Row], savings: Sequence[Row]) -> Iterator[str]:
    """The text: a table a question."""
    yield HEAD
    titles = {"r2": "R2", "mae": "MAE", "under": "under"}
    yield mean_table(accuracy, titles | {"proxy_r2": "proxy R2", "proxy_mae": "proxy MAE"})
    yield "\nR2 by sequence:\n"
    yield sequence_table(accuracy, "r2")
    yield "\n## And where the frame before does not show the tile?\n"
    yield "Tiles count as seen if the frame before shows at least half of their pixels.\n"
    kinds = ("seen", "unseen")
    seen = {f"{kind}_{key}": f"{kind} {titles[key]}" for kind in kinds for key in ("r2", "mae")}
    yield mean_table(accuracy, seen)
    yield "\n## How good are 2x2 and 4x4, derived by eq. 10 from what is predicted?\n"
    yield mean_table(accuracy, {"derived_r2": "R2", "derived_mae": "MAE"})
    if savings:
        yield "\n## What do rates by predicted errors save?\n"
        yield "Share of invocations, at the true error where `analytic` saves about a third:\n"
        yield third_table(savings)
    for weights in dict.fromkeys(r["weights"] for r in savings):
        own = [r for r in savings if r["weights"] == weights]
        yield f"\n### {weights}: saved against true error ({own[0]['metric']})\n"
        yield f"![saved against true error](vrs-{weights}.svg)\n"
        yield saving_table(own)


def write_text(folder: Path, document: Path) -> None:
    """Write the section of the document."""
    accuracy = read_csv(folder / ACCURACY)
    savings = read_csv(folder / SAVINGS)
    replace_section(document, "vrs", "\n".join(questions(accuracy, savings)))


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/vrs.md"))
def main(folder: Path, output: Path) -> None:
    """Write the tables."""
    write_text(folder, output)
    click.echo(f"{output}: written")


if __name__ == "__main__":
    main()
