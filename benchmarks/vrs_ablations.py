"""What each choice of the visual-error network is worth: small trainings that differ in one.

    python benchmarks/vrs_ablations.py DATA [MORE ...] [--steps 400] [--work FOLDER]

Trains `rt-percept` on the `train` sequences of DATA (and on MORE) from the same seed with the same
frames, once a row, and judges it on the `val` and `test` sequences as `benchmarks/vrs.py` does.
Writes a section of docs/vrs.md. `--work` keeps runs and goes on with those that are there.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from dataclasses import replace
from pathlib import Path

import click
from results import rtsr
from sections import replace_section
from vrs import SYSTEM, frames_of, tallies

from rtsr_cli.core.networks import load_network
from rtsr_cli.core.vrs.accuracy import accuracy, together
from rtsr_cli.models import load_system
from rtsr_cli.models.rt_percept.config import Transform

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

KINDS = ("network", "network, seen", "network, unseen", "proxy", "extrapolated")

HEAD = (
    """# Choices of the visual-error network

`rt-percept`, tiles of 16, after {steps} steps of {batch} frames, one choice changed a row, the
same seed and frames in each. Short trainings: rows compare with each other, not with the shipped
weights. Means over the `val` and `test` sequences, all in the clamped space (a network that learned
logistic values is held against the same errors as the others); the last columns hold 2x2 and 4x4
by eq. 10, or as predicted, against true ones.

| | R2 | MAE | seen R2 | MAE | unseen R2 | MAE | proxy R2 | MAE | 2x2, 4x4 R2 | MAE |
| --- |"""
    + " ---: |" * 10
)


def line(title: str, data: Path, weights: Path) -> str:
    """One row of the table."""
    loaded = load_network(load_system(SYSTEM), 1, "cpu", weights)
    loaded.network.config = replace(loaded.config, margin=0.0)
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    space = replace(loaded.config, transform=Transform.CLAMPED)
    rows = []
    for shot in (s for s in manifest["sequences"] if s["split"] != "train"):
        folder = data / shot["scene"] / shot["sequence"]
        each = [tallies(frame, loaded, space) for frame in frames_of(folder, loaded)]
        rows.append({k: accuracy(together(one.get(k, {}) for one in each)) for k in KINDS})
    cells = []
    for kind in KINDS:
        for name in ("r2", "mae"):
            values = [row[kind][name] for row in rows if row[kind]]
            cells.append(f"{statistics.fmean(values):.3f}" if values else "-")
    return f"| {title} | " + " | ".join(cells) + " |"


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("more", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("--steps", default=400, show_default=True)
@click.option("--batch", default=4, show_default=True)
@click.option("--work", type=click.Path(path_type=Path), help="Keep runs here.")
@click.option("--cache", type=click.Path(path_type=Path), help="Keep decoded frames here.")
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/vrs.md"))
def main(
    *,
    data: Path,
    more: tuple[Path, ...],
    steps: int,
    batch: int,
    work: Path | None,
    cache: Path | None,
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
        lines = [HEAD.format(steps=steps, batch=batch)]
        for number, (title, own) in enumerate(ROWS.items()):
            run = folder / str(number)
            given = [part for setting in (*common, *own) for part in ("--set", setting)]
            where = ("--out", run, "--cache", cache or folder / "cache")
            rtsr("train", SYSTEM, data, *more, *where, *given, "-q")
            lines.append(line(title, data, run / "last.safetensors"))
            click.echo(lines[-1])
    replace_section(output, "vrs-ablations", "\n".join(lines))


if __name__ == "__main__":
    main()
