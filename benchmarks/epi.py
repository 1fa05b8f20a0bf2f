"""One row of pixels over time, for several result folders: what flickers draws combs.

    python benchmarks/epi.py OUT.png --row 150 --left 100 --width 320 \\
        "demod-bicubic=out_demod/" "nsrd=out_nsrd/" "reference=reference/"

Each argument is LABEL=FOLDER; every frame is a line `--tall` pixels high, time runs downwards.
"""

from __future__ import annotations

import re
from pathlib import Path

import click
import numpy as np
import torch
from numpy.typing import NDArray
from pictures import GAP_PX, labelled

from rtsr_cli.core.files.exr import read_channels
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.imaging.preview import encode_preview
from rtsr_cli.core.metrics.temporal import stack_rows


def frame_number(path: Path) -> int:
    """Last number of a file's name."""
    return int(re.findall(r"\d+", path.stem)[-1])


def strip(folder: Path, row: int, columns: slice) -> NDArray[np.uint8]:
    """Display values of a row of every frame, in order."""
    rows = []
    for path in sorted(folder.glob("*.exr"), key=frame_number):
        planes = read_channels(path, "RGB")
        color = np.stack([planes[c][row : row + 1, columns].astype(np.float32) for c in "RGB"])
        rows.append(torch.from_numpy(color)[None])
    return encode_preview(stack_rows(rows))


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.argument("labels", nargs=-1, required=True)
@click.option("--row", type=int, required=True)
@click.option("--left", type=int, default=0, show_default=True)
@click.option("--width", type=int, default=320, show_default=True)
@click.option("--wide", type=int, default=2, show_default=True, help="Pixels of a column.")
@click.option("--tall", type=int, default=4, show_default=True, help="Pixels of a frame.")
def main(
    *, out: Path, labels: tuple[str, ...], row: int, left: int, width: int, wide: int, tall: int
) -> None:
    """Write OUT: one strip for each LABEL=FOLDER, below each other."""
    parts = []
    for label, folder in (item.split("=", 1) for item in labels):
        image = strip(Path(folder), row, slice(left, left + width))
        parts.append(labelled(image.repeat(tall, axis=0).repeat(wide, axis=1), label))
        parts.append(np.full((GAP_PX, parts[0].shape[1], 3), 255, np.uint8))
    write_png(out, np.concatenate(parts[:-1]))


if __name__ == "__main__":
    main()
