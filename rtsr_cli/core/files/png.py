"""8-bit PNG pictures, written with nothing but zlib, so that a machine that trains needs no more.

Source: [W3C, "Portable Network Graphics (PNG) Specification"], third edition.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.files.atomic_write import write_atomically

SIGNATURE = b"\x89PNG\r\n\x1a\n"
"""First bytes of every PNG."""

COLOR_TYPES = {1: 0, 3: 2}
"""PNG's code for grey and for RGB, by the number of channels."""

SUB_FILTER, UP_FILTER = 1, 2
"""Rows stored as differences to the pixel at the left, and to the row above."""

COMPRESSION_LEVEL = 6
"""zlib's default: higher levels take several times as long for a few per cent."""


def write_png(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write (height, width, 1 or 3) values as a PNG, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    data = encode_png(pixels)

    def write(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, write)


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return (height, width, 1 or 3) values as the bytes of a PNG file."""
    height, width, channels = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, COLOR_TYPES[channels], 0, 0, 0)
    rows = zlib.compress(_filter_rows(pixels).tobytes(), COMPRESSION_LEVEL)
    return (
        SIGNATURE
        + _make_chunk(b"IHDR", header)
        + _make_chunk(b"IDAT", rows)
        + _make_chunk(b"IEND", b"")
    )


def _make_chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def _filter_rows(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Rows as differences, a filter's number before each: that of the smaller sum (section 12.7).

    Sub(x) = p(x, y) - p(x - 1, y),   Up(x) = p(x, y) - p(x, y - 1)              (modulo 256)
    """
    height = pixels.shape[0]
    sub, up = pixels.copy(), pixels.copy()
    sub[:, 1:] -= pixels[:, :-1]
    up[1:] -= pixels[:-1]
    costs = [np.abs(rows.view(np.int8).astype(np.int16)).sum(axis=(1, 2)) for rows in (sub, up)]
    by_left = (costs[0] < costs[1])[:, None]
    filtered = np.empty((height, 1 + pixels[0].size), dtype=np.uint8)
    filtered[:, :1] = np.where(by_left, SUB_FILTER, UP_FILTER)
    filtered[:, 1:] = np.where(by_left, sub.reshape(height, -1), up.reshape(height, -1))
    return filtered
