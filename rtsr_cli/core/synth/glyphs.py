"""Letters for text-like textures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_FONT = {
    "A": "010101111101101", "B": "110101110101110", "C": "011100100100011",
    "D": "110101101101110", "E": "111100110100111", "F": "111100110100100",
    "G": "011100101101011", "H": "101101111101101", "I": "111010010010111",
    "J": "001001001101010", "K": "101101110101101", "L": "100100100100111",
    "M": "101111111101101", "N": "110101101101101", "O": "010101101101010",
    "P": "110101110100100", "R": "110101110101101", "S": "011100010001110",
    "T": "111010010010010", "Q": "010101101110011", "U": "101101101101111",
    "V": "101101101101010", "W": "101101111111101", "Z": "111001010100111",
    "X": "101101010101101", "Y": "101101010010010", "0": "111101101101111",
    "1": "010110010010111", "2": "110001010100111", "3": "110001010001110",
    "4": "101101111001001", "5": "111100110001110", "6": "011100111101111",
    "7": "111001010010010", "8": "111101111101111", "9": "111101111001110",
    "-": "000000111000000", " ": "000000000000000",
}  # fmt: skip
"""Three columns and five rows a letter, row by row."""

_LINES = (
    (4, "NOISE"),
    (2, "PIXEL 2047"),
    (1, "THE QUIET RIVER RUNS PAST"),
    (1, "STONE HOUSES AND THE OLD"),
    (2, "GATE 31 - C"),
    (1, "0123 4710 2231 0174 3342"),
    (1, "A SHARP EDGE IS A PROMISE"),
    (1, "THAT FEW SAMPLES CAN HOLD"),
    (4, "EXIT 7"),
    (1, "LIGHT AND SHADE TRADE"),
    (1, "THEIR PLACES EACH MORNING"),
    (2, "RADIANCE"),
    (1, "IN FRONT OF THE LENS"),
)
"""Size of the letters in units, and the line."""


def letter(character: str) -> NDArray[np.float32]:
    """5 x 3 bitmap of a letter; unknown ones are blank."""
    bits = _FONT.get(character, _FONT[" "])
    return np.array([float(b) for b in bits], dtype=np.float32).reshape(5, 3)


def poster(units: int) -> NDArray[np.float32]:
    """A square of lines in several sizes; 1 = ink."""
    page = np.zeros((units, units), dtype=np.float32)
    top = 3
    for size, line in _LINES:
        left = 4
        for character in line:
            glyph = np.kron(letter(character), np.ones((size, size), dtype=np.float32))
            height, width = glyph.shape
            if left + width < units - 2 and top + height < units - 2:
                page[top : top + height, left : left + width] = glyph
            left += width + size
        top += 5 * size + 2 + size // 2
    return page
