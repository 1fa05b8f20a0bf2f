"""8-bit PNG pictures, written with nothing but zlib, so that a machine that trains needs no more.

Source: [W3C, "Portable Network Graphics (PNG) Specification"], third edition.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.files.atomic_write import write_atomically
from rtsr_cli.core.marks import MARKED

SIGNATURE = b"\x89PNG\r\n\x1a\n"
"""First bytes of every PNG."""

COLOR_TYPES = {1: 0, 3: 2}
"""PNG's code for grey and for RGB, by the number of channels."""

SUB_FILTER, UP_FILTER = 1, 2
"""Rows stored as differences to the pixel at the left, and to the row above."""

COMPRESSION_LEVEL = 6
"""zlib's default: higher levels take several times as long for a few per cent."""


MAX_TEXT_BYTES = 1 << 16
"""Longer texts are not looked at."""

LENGTH_BYTES, KIND_BYTES, SUM_BYTES = 4, 4, 4
"""Of a chunk, around its content."""


def write_png(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write (height, width, 1 or 3) values as a PNG with rtsr's mark, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    data = encode_png(pixels, MARKED)

    def write(part: Path) -> None:
        part.write_bytes(data)

    write_atomically(path, write)


def encode_png(pixels: NDArray[np.uint8], texts: Mapping[str, str] | None = None) -> bytes:
    """Return (height, width, 1 or 3) values as the bytes of a PNG file, with texts by keyword."""
    height, width, channels = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8, COLOR_TYPES[channels], 0, 0, 0)
    rows = zlib.compress(_filter_rows(pixels).tobytes(), COMPRESSION_LEVEL)
    return (
        SIGNATURE
        + _make_chunk(b"IHDR", header)
        + b"".join(_make_text(name, value) for name, value in (texts or {}).items())
        + _make_chunk(b"IDAT", rows)
        + _make_chunk(b"IEND", b"")
    )


def _make_chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def _make_text(name: str, value: str) -> bytes:
    return _make_chunk(b"tEXt", name.encode("latin-1") + b"\0" + value.encode("latin-1"))


def read_png_texts(path: Path) -> dict[str, str]:
    """Return the texts before a PNG's pixels by keyword; none of what is no PNG.

    Raises:
        OSError: the file cannot be read.
    """
    texts = {}
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            return {}
        while len(head := file.read(LENGTH_BYTES + KIND_BYTES)) == LENGTH_BYTES + KIND_BYTES:
            size, kind = int.from_bytes(head[:LENGTH_BYTES], "big"), head[LENGTH_BYTES:]
            if kind in (b"IDAT", b"IEND"):
                break
            if kind == b"tEXt" and size <= MAX_TEXT_BYTES:
                name, _, value = file.read(size).partition(b"\0")
                texts[name.decode("latin-1")] = value.decode("latin-1")
                size = 0
            file.seek(size + SUM_BYTES, os.SEEK_CUR)
    return texts


def is_whole_png(content: bytes) -> bool:
    """Tell whether the bytes of a PNG are all there: every chunk with its checksum, up to IEND."""
    kinds = list(_list_whole_chunks(content)) if content.startswith(SIGNATURE) else []
    return kinds[-1:] == [b"IEND"]


def _list_whole_chunks(content: bytes) -> Iterator[bytes]:
    """Kinds of the chunks, up to the first that is cut or damaged."""
    view, position = memoryview(content), len(SIGNATURE)
    while position + LENGTH_BYTES + KIND_BYTES <= len(content):
        begin = position + LENGTH_BYTES
        end = begin + KIND_BYTES + int.from_bytes(view[position:begin], "big")
        position = end + SUM_BYTES
        if zlib.crc32(view[begin:end]) != int.from_bytes(view[end:position], "big"):
            return
        yield bytes(view[begin : begin + KIND_BYTES])


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
