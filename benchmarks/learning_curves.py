"""What more steps and more scenes bring: gains of validation over `demod-bicubic`.

    python benchmarks/learning_curves.py DATA MORE --run RUN [--run RUN ...] [--steps 600]

Two tables, a section of docs/results.md. Gain against steps: read from `RUN/log.csv` of trainings
that were validated on DATA. Gain against scenes: `fusesr-fast` 4x is trained anew on one sequence
of DATA, on all of its `train` split, and on that with a part and all of the shots of MORE, with
the same steps and batches. Every validation of the runs goes to a CSV file. `--work` keeps what is
trained and goes on with what is there.
"""

from __future__ import annotations

import csv
import json
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click
from click.testing import CliRunner
from sections import replace_section
from tables import Row, markdown, read_csv, write_csv

from rtsr_cli.cli import group

SYSTEM, SCALE = "fusesr-fast", 4
TABLE = Path("docs/results/learning-curves.csv")
BASELINE = re.compile(r"demod-bicubic: psnr ([\d.]+) dB")
SHARES = (0, 8, 1)
"""Shots of MORE that take part: none, one in eight, all."""

TITLE = "## What do more steps and scenes bring?"

STEPS_HEAD = """
Gain of validation PSNR over `demod-bicubic` ({baseline:.2f} dB on the same frames), dB, of the
moving average of the weights as training goes on; in brackets after how many steps. Every
validation of every run: [results/{file}](results/{file}), which
`python benchmarks/learning_curves.py DATA MORE --steps {steps} --run RUN ...` writes with these
tables.
"""

SCENES_HEAD = """
The same gain after {steps} steps of {batch} crops of {crop} x {crop} LR pixels of `{system}`
{scale}x, against the scenes that the crops come from.

| scenes | training frames | gain dB |
| --- | ---: | ---: |"""


def train_names(data: Path) -> list[str]:
    """Sequences of the `train` split."""
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    listed = manifest["sequences"]
    return [f"{s['scene']}/{s['sequence']}" for s in listed if s["split"] == "train"]


def part_of(more: Path, every: int, folder: Path) -> Path:
    """Link one shot in `every` into a folder of its own."""
    shots = sorted(p for p in more.iterdir() if p.is_dir())[::every]
    for shot in shots:
        link = folder / shot.name
        link.parent.mkdir(parents=True, exist_ok=True)
        if not link.exists():
            link.symlink_to(shot.resolve())
    return folder


def last_psnr(run: Path) -> float:
    """PSNR of the last validation."""
    return curve(run)[-1][1]


def curve(run: Path) -> list[tuple[int, float]]:
    """Step and PSNR of each validation."""
    with (run / "log.csv").open(encoding="utf-8", newline="") as file:
        return [(int(r["step"]), float(r["psnr"])) for r in csv.DictReader(file) if r.get("psnr")]


def train(data: Sequence[Path], run: Path, cache: Path, settings: Sequence[str]) -> tuple[str, str]:
    """Train, unless the run is there; return the baseline's PSNR and the training frames, said."""
    said = run / "said.txt"
    if not said.is_file():
        arguments = ["train", SYSTEM, *map(str, data), "--out", str(run), "--cache", str(cache)]
        arguments += ["--scale", str(SCALE)]
        for setting in settings:
            arguments += ["--set", setting]
        result = CliRunner().invoke(group, arguments)
        if result.exit_code:
            raise click.ClickException(result.output)
        said.write_text(result.output, encoding="utf-8")
    text = said.read_text(encoding="utf-8")
    baseline, frames = BASELINE.search(text), re.search(r"(\d+) frames of \d+ shots to train", text)
    if baseline is None or frames is None:
        raise click.ClickException(f"{run}: says neither baseline nor frames: {text}")
    return baseline.group(1), frames.group(1)


def curve_rows(runs: Sequence[Path], baseline: float) -> list[Row]:
    """Every validation of every run."""
    return [
        {"run": run.resolve().name, "step": str(step), "gain": f"{psnr - baseline:+.2f}"}
        for run in runs
        for step, psnr in curve(run)
    ]


def steps_table(rows: Sequence[Row]) -> str:
    """Gain against steps, a row a run: at first, where all runs were validated, and at last."""
    curves: dict[str, dict[int, str]] = {}
    for row in rows:
        curves.setdefault(row["run"], {})[int(row["step"])] = row["gain"]
    shared = max(set.intersection(*(set(points) for points in curves.values())), default=None)
    lines = []
    for run, points in curves.items():
        first, last = (f"{points[step]} ({step:,})" for step in (min(points), max(points)))
        middle = [points[shared]] if shared is not None else []
        lines.append([f"`{run}`", first, *middle, last])
    titles = [f"after {shared:,} steps"] if shared is not None else []
    return markdown(["run", "first validation", *titles, "last validation"], lines)


def steps_text(table: Path, baseline: float, steps: int) -> str:
    """The part on steps, out of the file that holds every validation."""
    head = STEPS_HEAD.format(baseline=baseline, file=table.name, steps=steps)
    return f"{head}\n{steps_table(read_csv(table))}"


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("more", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--run", "runs", multiple=True, type=click.Path(path_type=Path, exists=True))
@click.option("--steps", default=600, show_default=True)
@click.option("--batch", default=8, show_default=True)
@click.option("--crop", default=48, show_default=True)
@click.option("--work", type=click.Path(path_type=Path), help="Keep runs here.")
@click.option("--cache", type=click.Path(path_type=Path), default=None)
@click.option("--csv", "table", type=click.Path(path_type=Path), default=TABLE, show_default=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/results.md"))
def main(
    *,
    data: Path,
    more: Path,
    runs: tuple[Path, ...],
    steps: int,
    batch: int,
    crop: int,
    work: Path | None,
    cache: Path | None,
    table: Path,
    output: Path,
) -> None:
    """Write the section."""
    common = [
        f"training.steps={steps}", f"training.batch={batch}", f"training.crop={crop}",
        "training.warmup=50", "training.ema=0.99", f"training.validate_every={steps}",
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = work or Path(name)
        names = train_names(data)
        others = json.dumps(names[1:])
        rows: list[tuple[str, str, float]] = []
        first = folder / "one"
        said = train([data], first, cache or folder, [*common, f"data.exclude={others}"])
        rows.append((f"1 ({names[0]})", said[1], last_psnr(first)))
        for every in SHARES:
            run = folder / f"more-{every}"
            part = [] if not every else [part_of(more, every, folder / f"shots-{every}")]
            said = train([data, *part], run, cache or folder, common)
            count = len(names) + (len(list(part[0].iterdir())) if part else 0)
            title = f"{count} (all of the `train` split{', and synthetic ones' if part else ''})"
            rows.append((title, said[1], last_psnr(run)))
    baseline = float(said[0])
    if runs:
        write_csv(table, ("run", "step", "gain"), curve_rows(runs, baseline))
    parts = [TITLE, *([steps_text(table, baseline, steps)] if runs else [])]
    parts.append(
        SCENES_HEAD.format(steps=steps, batch=batch, crop=crop, system=SYSTEM, scale=SCALE)
    )
    parts += [f"| {title} | {frames} | {psnr - baseline:+.2f} |" for title, frames, psnr in rows]
    replace_section(output, "curves", "\n".join(parts))
    click.echo("\n".join(parts))


if __name__ == "__main__":
    main()
