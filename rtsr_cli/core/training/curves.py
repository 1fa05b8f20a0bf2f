"""Curves and labels as pixels, where no plotting library is installed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]

_FONT = {
    "0": "111101101101111", "1": "010110010010111", "2": "110001010100111",
    "3": "110001010001110", "4": "101101111001001", "5": "111100110001110",
    "6": "011100111101111", "7": "111001010010010", "8": "111101111101111",
    "9": "111101111001110", ".": "000000000000010", "-": "000000111000000",
    "a": "010101111101101", "b": "110101110101110", "c": "011100100100011",
    "d": "110101101101110", "e": "111100110100111", "f": "111100110100100",
    "g": "011100101101011", "h": "101101111101101", "i": "111010010010111",
    "k": "101101110101101", "l": "100100100100111", "m": "101111111101101",
    "n": "110101101101101", "o": "010101101101010", "p": "110101110100100",
    "r": "110101110101101", "s": "011100010001110", "t": "111010010010010",
    "u": "101101101101111", "v": "101101101101010", "w": "101101111111101",
    "x": "101101010101101", "y": "101101010010010",
}  # fmt: skip
"""Three columns and five rows a glyph, row by row; others are left blank."""

GLYPH = (5, 3)
ZOOM = 2
INK = 40
LABEL_PX = 16
WIDTH, HEIGHT = 640, 220
LEFT, RIGHT, TOP, BOTTOM = 70, 12, 24, 24
TICKS = 5
COLORS = ((31, 119, 180), (214, 96, 20))


@dataclass(frozen=True)
class PlottedCurve:
    """A name and (step, value) rows."""

    name: str
    points: NDArray[np.float64]


def write_text(image: Pixels, text: str, top: int, left: int) -> None:
    """Put a text into a picture, as far as it fits."""
    for letter in text.lower():
        bits = np.array([b == "1" for b in _FONT.get(letter, "0" * 15)]).reshape(GLYPH)
        glyph = bits.repeat(ZOOM, 0).repeat(ZOOM, 1)
        part = image[top : top + glyph.shape[0], left : left + glyph.shape[1]]
        part[glyph[: part.shape[0], : part.shape[1]]] = INK
        left += (GLYPH[1] + 1) * ZOOM


def add_label(image: Pixels, text: str) -> Pixels:
    """Put a line of text above a picture."""
    line = np.full((LABEL_PX, image.shape[1], 3), 255, np.uint8)
    write_text(line, text, 3, 2)
    return np.concatenate([line, image])


def plot_curves(curves: list[PlottedCurve]) -> Pixels:
    """One panel a curve, one above the other, over the same steps."""
    last = max(float(curve.points[-1, 0]) for curve in curves)
    return np.concatenate(
        [_plot_panel(curve, last, COLORS[i % len(COLORS)]) for i, curve in enumerate(curves)]
    )


def _plot_panel(curve: PlottedCurve, last: float, color: tuple[int, int, int]) -> Pixels:
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    steps, values = curve.points[:, 0], curve.points[:, 1]
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-9:
        low, high = low - 0.5, high + 0.5
    columns = LEFT + steps / max(last, 1.0) * (WIDTH - LEFT - RIGHT - 1)
    rows = TOP + (high - values) / (high - low) * (HEIGHT - TOP - BOTTOM - 1)
    for share in np.linspace(0.0, 1.0, TICKS):
        row = round(TOP + share * (HEIGHT - TOP - BOTTOM - 1))
        image[row, LEFT : WIDTH - RIGHT] = 225
        write_text(image, f"{high - share * (high - low):.4g}", row - 5, 4)
        column = round(LEFT + share * (WIDTH - LEFT - RIGHT - 1))
        image[TOP : HEIGHT - BOTTOM, column] = 225
        write_text(image, f"{share * last:.0f}", HEIGHT - BOTTOM + 6, min(column, WIDTH - 50))
    write_text(image, curve.name, 6, LEFT)
    for i in range(len(steps)):
        _draw_line(
            image, (columns[max(0, i - 1)], rows[max(0, i - 1)]), (columns[i], rows[i]), color
        )
    return image


def _draw_line(
    image: Pixels,
    start: tuple[float, float],
    end: tuple[float, float],
    color: tuple[int, int, int],
) -> None:
    """Two pixels thick, so that it is seen on large screens."""
    count = int(max(abs(end[0] - start[0]), abs(end[1] - start[1]))) + 2
    columns = np.linspace(start[0], end[0], count).round().astype(int)
    rows = np.linspace(start[1], end[1], count).round().astype(int)
    for offset in (0, 1):
        image[(rows + offset).clip(0, HEIGHT - 1), columns] = color
