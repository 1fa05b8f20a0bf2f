"""The tables of `docs/results.md` out of the figures that `benchmarks/results.py` measured.

    python benchmarks/results_text.py docs/results/systems.csv [--output docs/results.md]

One table a question. The CSV file holds every system, sequence, metric and kind of LR frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import click
from sections import replace_section
from tables import Row, markdown, read_csv

BORDER, SKIP_FIRST = 16, 2
STRAIGHT = ("bicubic", "demod-bicubic")
"""Baselines that systems are held against, the better one of each sequence."""

METRICS = {
    "psnr": "PSNR dB",
    "ssim": "SSIM",
    "flip": "FLIP",
    "lpips": "LPIPS",
    "temporal": "temporal",
}
GAINS = {
    "psnr_gain": "PSNR dB",
    "flip_gain": "FLIP lower by",
    "lpips_gain": "LPIPS lower by",
    "temporal_gain": "temporal lower by",
}
COLUMNS = ("scale", "jitter", "lr_filter", "sequence", "scene", "split", "system", *METRICS, *GAINS)

SCALES = ("4", "2")
SETTINGS = {
    ("none", "none"): "decimated",
    ("halton", "none"): "jittered",
    ("none", "blackman-harris"): "filtered",
}
"""Jitter and pixel filter of the LR frames -> what the tables call them."""

PLAIN, JITTERED, FILTERED = SETTINGS
SEEN, UNSEEN = "seen in training", "unseen"

BASELINES = " and ".join(f"`{name}`" for name in STRAIGHT)

HEAD = f"""## What was measured

Systems with the weights that come with rtsr, and baselines, on the rendered sequences that rtsr is
developed on (480 x 288 captures, one sample a pixel), by protocol `rtsr`: PSNR on c/(1+c), the
others on c/(1+c) then sRGB, border {BORDER} pixels, first {SKIP_FIRST} frames of each
sequence left out. Temporal is the change of (test - reference) along motion: 0 is perfect. Means
over frames, then over sequences.

LR frames are decimated; or decimated with Halton jitter; or decimated from radiance that a
Blackman-Harris pixel filter went over. A gain is over the better of {BASELINES}
of each sequence, on the sequences that no network was trained on; *seen in training*: another
sequence of its scene was.

`python benchmarks/results.py DATA` measures and writes every figure of every sequence to
[results/systems.csv](results/systems.csv), and these tables from it; do not edit.
"""


def number_of(sequence: str) -> int:
    """How many sequences a row is the mean of; 0 where it is of one sequence."""
    return int(sequence.removeprefix("mean of ")) if sequence.startswith("mean of ") else 0


def select(rows: Sequence[Row], scale: str, setting: tuple[str, str]) -> list[Row]:
    """Rows of a scale and a kind of LR frames."""
    return [r for r in rows if (r["scale"], r["jitter"], r["lr_filter"]) == (scale, *setting)]


def systems_of(rows: Sequence[Row], column: str) -> list[str]:
    """Systems that have a figure, in their order."""
    return list(dict.fromkeys(r["system"] for r in rows if r[column]))


def gain_table(rows: Sequence[Row], scale: str, setting: tuple[str, str]) -> str:
    """PSNR gain by sequence, a column a system."""
    known = [r for r in select(rows, scale, setting) if r["psnr_gain"]]
    systems = systems_of(known, "psnr_gain")
    values = {(r["sequence"], r["system"]): r["psnr_gain"] for r in known}
    scenes = {r["sequence"]: r["scene"] for r in known}
    titles = {s: f"**{s}**" if number_of(s) else s for s in scenes}
    lines = [
        [titles[name], scene, *(values[name, system] for system in systems)]
        for name, scene in scenes.items()
    ]
    return markdown(["sequence", "scene", *(f"`{s}`" for s in systems)], lines, texts=2)


def mean_gain_table(rows: Sequence[Row]) -> str:
    """Every gain, mean over sequences, a row a system and kind of LR frames."""
    lines = [
        [f"{scale}x", name, f"`{r['system']}`", *(r[column] for column in GAINS)]
        for scale, (setting, name) in product(SCALES, SETTINGS.items())
        for r in select(rows, scale, setting)
        if number_of(r["sequence"]) and r["psnr_gain"]
    ]
    return markdown(["scale", "LR frames", "system", *GAINS.values()], lines, texts=3)


def score_table(rows: Sequence[Row]) -> str:
    """Every metric itself, mean over sequences, a row a system; decimated LR frames."""
    lines = [
        [f"{scale}x", f"{scene} ({number_of(r['sequence'])})", f"`{r['system']}`"]
        + [r[metric] for metric in METRICS]
        for scale, scene in product(SCALES, (UNSEEN, SEEN))
        for r in select(rows, scale, PLAIN)
        if r["scene"] == scene and number_of(r["sequence"])
    ]
    head = ["scale", "scenes", "system", *METRICS.values()]
    return markdown(head, lines, texts=3)


def psnr_table(rows: Sequence[Row], setting: tuple[str, str]) -> str:
    """PSNR of decimated LR frames beside that of another kind, mean over sequences."""
    kinds = list(product(SCALES, (PLAIN, setting)))
    titles = [f"{scale}x {SETTINGS[kind]}" for scale, kind in kinds]
    means = {
        (r["scene"], r["system"], scale, kind): r["psnr"]
        for scale, kind in kinds
        for r in select(rows, scale, kind)
        if number_of(r["sequence"]) and r["psnr"]
    }
    lines = [
        [scene, f"`{system}`", *(means.get((scene, system, *kind), "-") for kind in kinds)]
        for scene, system in product((UNSEEN, SEEN), systems_of(rows, "psnr"))
    ]
    return markdown(["scenes", "system", *titles], lines, texts=2)


def questions(rows: Sequence[Row]) -> Iterator[str]:
    """The text: a table a question."""
    yield HEAD
    yield "## Which system at 4x?\n\nPSNR gain, dB.\n"
    yield gain_table(rows, "4", PLAIN)
    yield "\n## Which system at 2x?\n\nPSNR gain, dB.\n"
    yield gain_table(rows, "2", PLAIN)
    for setting, title in ((JITTERED, "jitter"), (FILTERED, "filtered LR frames")):
        yield f"\n## What changes with {title}?\n"
        for scale in SCALES:
            yield f"PSNR gain at {scale}x, dB:\n"
            yield gain_table(rows, scale, setting) + "\n"
        yield "PSNR itself, dB, mean over sequences; `taau` is among the systems here:\n"
        yield psnr_table(rows, setting)
    yield "\n## What do FLIP, LPIPS and temporal change say?\n\nMean gains.\n"
    yield mean_gain_table(rows)
    yield "\n## What are the figures themselves?\n"
    yield "Decimated LR frames; in brackets how many sequences the mean is over.\n"
    yield score_table(rows)


def write_text(table: Path, document: Path) -> None:
    """Write the section of the document."""
    replace_section(document, "results", "\n".join(questions(read_csv(table))))


@click.command()
@click.argument("table", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/results.md"))
def main(table: Path, output: Path) -> None:
    """Write the tables."""
    write_text(table, output)
    click.echo(f"{output}: written")


if __name__ == "__main__":
    main()
