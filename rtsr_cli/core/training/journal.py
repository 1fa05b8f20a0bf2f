"""What a training run leaves for people: a table, its curves, pictures, and TensorBoard's files.

Runs where no image library is installed.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.files.atomic_write import write_atomically
from rtsr_cli.core.files.folders import is_file
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.metrics.flip import ldr_flip
from rtsr_cli.core.metrics.heat_map import heat_map
from rtsr_cli.core.shapes import Color
from rtsr_cli.core.training.curves import PlottedCurve, add_label, plot_curves

LOG_FILE = "log.csv"
CURVES_FILE = "curves.png"
PICTURES_FOLDER = "pictures"

PICTURE_FILES = "step-*.png"
"""In that folder: the steps done, and the frame."""

COLUMNS = ("step", "learning_rate", "steps_per_s")
"""Columns that every table of a run has, beside losses and scores."""

EMPTY = ("step",)
"""The only one before the first row."""

GAP_PX = 4
"""Between the panels of a picture."""


class Journal:
    """Keeps the files of a run up to date."""

    def __init__(self, folder: Path, *, resume_step: int | None, score: str = "psnr") -> None:
        """Start anew, or keep the rows up to a step and go on after them.

        Args:
            folder: RUN.
            resume_step: last step whose row is kept; None starts anew.
            score: column that is drawn beside the loss.
        """
        self._folder, self._score = folder, score
        kept = 0 if resume_step is None else resume_step
        self._rows = [row for row in _read_rows(folder / LOG_FILE) if int(row["step"]) <= kept]
        self._board = _open_board(folder)
        self._write()

    def log(self, step: int, values: Mapping[str, float | None]) -> None:
        """Add a row and draw the curves again; None has a column, but no value yet."""
        known = {name: value for name, value in values.items() if value is not None}
        row = {name: f"{known[name]:.6g}" if name in known else "" for name in values}
        self._rows.append({"step": str(step), **row})
        self._write()
        curves = [c for c in (self._curve("loss"), self._curve(self._score)) if len(c.points)]
        if curves:
            write_png(self._folder / CURVES_FILE, plot_curves(curves))
        if self._board is not None:
            for name, value in known.items():
                self._board.add_scalar(name, value, step)

    def picture(self, step: int, name: str, panels: Mapping[str, Color]) -> None:
        """Write one strip: the panels, and FLIP of `output` against `reference`.

        Args:
            step: steps done.
            name: of the fixed crop.
            panels: label -> linear radiance, all of one size.
        """
        strip = _join_panels(panels)
        write_png(self._folder / PICTURES_FOLDER / f"step-{step:06d}-{name}.png", strip)
        if self._board is not None:
            self._board.add_image(name, strip, step, dataformats="HWC")

    def close(self) -> None:
        """Finish TensorBoard's files."""
        if self._board is not None:
            self._board.close()

    def _curve(self, name: str) -> PlottedCurve:
        points = [(float(r["step"]), float(r[name])) for r in self._rows if r.get(name)]
        return PlottedCurve(name, np.array(points).reshape(-1, 2))

    def _write(self) -> None:
        """The table is small: written whole, it is never half there."""
        text = io.StringIO(newline="")
        columns = dict.fromkeys(name for row in self._rows for name in row)
        table = csv.DictWriter(text, tuple(columns) or EMPTY, restval="")
        table.writeheader()
        table.writerows(self._rows)
        content = text.getvalue().encode()
        write_atomically(self._folder / LOG_FILE, lambda part: _write_file(part, content))


def is_log(path: Path) -> bool:
    """Tell by its columns whether a table is that of a run."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = list(csv.reader(file)) or [[]]
            return set(COLUMNS) <= set(head) or (tuple(head) == EMPTY and not rows)
    except (OSError, ValueError, csv.Error):
        return False


def _write_file(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _read_rows(path: Path) -> list[dict[str, str]]:
    if not is_file(path):
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if (row.get("step") or "").isdigit()]


def _open_board(folder: Path) -> Any:
    """TensorBoard's writer, None where it is not installed."""
    if find_spec("tensorboard") is None:
        return None
    from torch.utils.tensorboard import SummaryWriter

    return SummaryWriter(str(folder / "tensorboard"))


def _join_panels(panels: Mapping[str, Color]) -> NDArray[np.uint8]:
    shown = {name: encode_srgb(encode_reinhard(image.float())) for name, image in panels.items()}
    if {"output", "reference"} <= shown.keys():
        shown["FLIP"] = heat_map(ldr_flip(shown["output"], shown["reference"]))
    images = [add_label(_to_bytes(image), name) for name, image in shown.items()]
    gap = np.full((images[0].shape[0], GAP_PX, 3), 255, np.uint8)
    parts = [part for image in images for part in (image, gap)]
    return np.concatenate(parts[:-1], axis=1)


def _to_bytes(image: Color) -> NDArray[np.uint8]:
    pixels = (image[0].clamp(0.0, 1.0) * 255.0 + 0.5).to(torch.uint8)
    array: NDArray[np.uint8] = pixels.permute(1, 2, 0).cpu().numpy()
    return array
