"""What each choice of the visual-error network is worth: small trainings that differ in one.

    python benchmarks/vrs_ablations.py DATA [MORE ...] [--steps 400] [--work FOLDER]

Trains `rt-percept` on the `train` sequences of DATA (and on MORE) from the same seed with the same
frames, once a row, and judges it on the `val` and `test` sequences as `benchmarks/vrs.py` does.
Writes a section of docs/vrs.md, and every figure to a CSV file. `--work` keeps runs and goes on
with those that are there.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import click
from results import rtsr
from sections import replace_section
from tables import Row, markdown, read_csv, write_csv
from vrs import SYSTEM, accuracy_cells, frames_of, mean_accuracy, tallies
from vrs_text import FIGURES

from rtsr_cli.core.network.load import load_network
from rtsr_cli.core.vrs.accuracy import average_accuracy, join_tallies
from rtsr_cli.models import load_system
from rtsr_cli.models.rt_percept.config import ErrorTransform

ROWS: dict[str, tuple[str, ...]] = {
    "JNFLIP, 4 inputs with luma, clamped": (),
    "4 inputs with red, as published": ("network.inputs=4",),
    "3 inputs (reprojected colour)": ("network.inputs=3",),
    "16 inputs (no reprojected colour)": ("network.inputs=16",),
    "19 inputs": ("network.inputs=19",),
    "groups of Table 3": ("network.groups=table-3",),
    "unseen tiles weigh 4 times": ("network.unseen_weight=4",),
    "predicts 2x2 and 4x4, too": ('network.rates=["1x2","2x1","2x2","2x4","4x2","4x4"]',),
    "FLIP, clamped": ("network.error.metric=flip",),
    "FLIP, logistic": ("network.error.metric=flip", "network.transform=logistic"),
    "JNYang": ("network.error.metric=jnyang",),
    "PSNR": ("network.error.metric=psnr",),
    "LPIPS": ("network.error.metric=lpips",),
}
"""Row -> settings that differ from the default."""

TABLE = Path("docs/results/vrs-ablations.csv")
COLUMNS = {key: figure for key, figure in FIGURES.items() if key != "under"}
"""What is written of a row: R2 and MAE of each kind of prediction and tile."""

SHOWN = {
    "r2": "R2",
    "mae": "MAE",
    "seen_r2": "seen R2",
    "unseen_r2": "unseen R2",
    "proxy_r2": "proxy R2",
    "derived_r2": "2x2, 4x4 R2",
}
"""What the document shows of it."""

HEAD = """## What is each choice of the network worth?

`rt-percept`, tiles of 16, after {steps} steps of {batch} frames, one choice changed a row, the
same seed and frames in each. Short trainings: rows compare with each other, not with the shipped
weights. Means over the `val` and `test` sequences, all in the clamped space (a network that learned
logistic values is held against the same errors as the others); the last column holds 2x2 and 4x4
by eq. 10, or as predicted, against true ones. With every MAE:
[results/{file}](results/{file}), which
`python benchmarks/vrs_ablations.py DATA [MORE ...] --steps {steps} --batch {batch}` writes with
this table.
"""


def figures_of(data: Path, weights: Path) -> Row:
    """What weights reach, mean over sequences."""
    loaded = load_network(load_system(SYSTEM), 1, "cpu", weights)
    loaded.network.config = replace(loaded.config, margin=0.0)
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    space = replace(loaded.config, transform=ErrorTransform.CLAMPED)
    kinds = {kind for kind, _ in COLUMNS.values()}
    each = []
    for shot in (s for s in manifest["sequences"] if s["split"] != "train"):
        folder = data / shot["scene"] / shot["sequence"]
        sums = [tallies(frame, loaded, space) for frame in frames_of(folder, loaded)]
        each.append(
            {k: average_accuracy(join_tallies(one.get(k, {}) for one in sums)) for k in kinds}
        )
    cells = accuracy_cells(mean_accuracy(each))
    return {column: cells[column] for column in COLUMNS}


def text_of(table: Path, steps: int, batch: int) -> str:
    """The section of the document, out of the file that holds every figure."""
    lines = [[row["choice"], *(row[column] for column in SHOWN)] for row in read_csv(table)]
    head = HEAD.format(steps=steps, batch=batch, file=table.name)
    return f"{head}\n{markdown(['choice', *SHOWN.values()], lines)}"


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("more", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("--steps", default=400, show_default=True)
@click.option("--batch", default=4, show_default=True)
@click.option("--work", type=click.Path(path_type=Path), help="Keep runs here.")
@click.option("--cache", type=click.Path(path_type=Path), help="Keep decoded frames here.")
@click.option("--csv", "table", type=click.Path(path_type=Path), default=TABLE, show_default=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/vrs.md"))
def main(
    *,
    data: Path,
    more: tuple[Path, ...],
    steps: int,
    batch: int,
    work: Path | None,
    cache: Path | None,
    table: Path,
    output: Path,
) -> None:
    """Write the section."""
    common = (
        f"training.steps={steps}", f"training.batch={batch}", "training.learning_rate=3e-3",
        "training.schedule=cosine", "training.optimiser=adam", "training.warmup=20",
        "training.ema=0.99", f"training.validate_every={steps}",
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = work or Path(name)
        rows: list[Row] = []
        for number, (title, own) in enumerate(ROWS.items()):
            run = folder / str(number)
            given = [part for setting in (*common, *own) for part in ("--set", setting)]
            where = ("--out", run, "--cache", cache or folder / "cache")
            rtsr("train", SYSTEM, data, *more, *where, *given, "-q")
            rows.append({"choice": title, **figures_of(data, run / "last.safetensors")})
            click.echo(f"{title}: judged")
    write_csv(table, ("choice", *COLUMNS), rows)
    replace_section(output, "vrs-ablations", text_of(table, steps, batch))


if __name__ == "__main__":
    main()
