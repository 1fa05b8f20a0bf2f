"""OpenEXR's file layout as bytes: headers, and the table of chunks that follows them.

A frame that is still being rendered or copied, or that was cut off, has an intact header. After
the headers a file lists where each chunk of pixels begins, 8 bytes a chunk [OpenEXR file layout];
a chunk that begins behind the file's end shows the cut without a pixel being read.
"""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from io import FileIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

MULTIPART = 0x1000
"""Bit of the version field: several headers, an empty one at the end."""

MAGIC = b"\x76\x2f\x31\x01"
"""First bytes of every OpenEXR file."""

FIXED_BYTES = 8
"""Magic number and version field."""

OFFSET_BYTES = 8
SIZE_BYTES = 4
NAME_BYTES = 256
"""Longer than any name may be."""

FIRST_BYTES = 1 << 13
"""Read of a file at once."""


class RawAttribute(NamedTuple):
    """An attribute of a header: its name, the name of its type, where its value's bytes are."""

    name: bytes
    kind: bytes
    position: int
    size: int


class FileBytes:
    """Bytes of a file by their place; the first ones, where most headers end, are read at once."""

    def __init__(self, file: FileIO | io.BytesIO) -> None:
        """Read the first bytes."""
        self._file = file
        self.size = file.seek(0, os.SEEK_END)
        file.seek(0)
        self._first = file.read(FIRST_BYTES) or b""

    def around(self, position: int, count: int) -> tuple[bytes, int]:
        """Return bytes that hold those at a position, and where in them they begin."""
        if position + count <= len(self._first):
            return self._first, position
        return self.at(position, count), 0

    def at(self, position: int, count: int) -> bytes:
        """Return the bytes at a position; fewer where the file ends."""
        if position + count <= len(self._first):
            return self._first[position : position + count]
        self._file.seek(position)
        return self._file.read(count) or b""

    @property
    def flags(self) -> int:
        """Version field of the file."""
        return int.from_bytes(self.at(0, FIXED_BYTES)[4:], "little")

    def chunk_lies_behind(self, table_start: int, chunks: int) -> bool:
        """Tell whether a chunk of a table begins at or behind the end of the file."""
        if table_start + chunks * OFFSET_BYTES > self.size:
            return True
        table = np.frombuffer(self.at(table_start, chunks * OFFSET_BYTES), "<u8")
        return bool((table >= self.size).any())


def ends_too_early(path: Path, chunks: int) -> bool:
    """Tell whether a chunk begins at or behind the end of the file.

    Args:
        path: a file whose headers are intact.
        chunks: number of chunks of all parts.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb", buffering=0) as file:
        content = FileBytes(file)
        start = _find_table_start(content)
        return start is not None and content.chunk_lies_behind(start, chunks)


def ends_in_header(content: bytes) -> bool:
    """Tell whether a file is the beginning of an OpenEXR file, and holds no pixel.

    Args:
        content: all of the file.
    """
    if len(content) >= FIRST_BYTES or content[: len(MAGIC)] != MAGIC[: len(content)]:
        return False
    _, end = list_attributes(FileBytes(io.BytesIO(content)), FIXED_BYTES)
    return end is None or end > len(content)


def _find_table_start(file: FileBytes) -> int | None:
    """Skip the headers; None where they are not laid out as expected."""
    position = FIXED_BYTES
    while True:
        _, end = list_attributes(file, position)
        if end is None:
            return None
        if not file.flags & MULTIPART or end == position + 1:
            return end
        position = end


def list_headers(path: Path) -> list[dict[bytes, bytes]]:
    """Read the headers of a file: for each part, attribute name -> bytes of its value.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb", buffering=0) as file:
        content = FileBytes(file)
        headers: list[dict[bytes, bytes]] = []
        position = FIXED_BYTES
        while True:
            attributes, end = list_attributes(content, position)
            if end is None or not attributes:
                return headers
            headers.append({a.name: content.at(a.position, a.size) for a in attributes})
            if not content.flags & MULTIPART:
                return headers
            position = end


def put_first(content: io.BytesIO, names: Sequence[str]) -> None:
    """Let attributes of a file's first header stand before the others, in place.

    The library sorts them by name; readers take any order [OpenEXR file layout].
    """
    file = FileBytes(content)
    attributes, end = list_attributes(file, FIXED_BYTES)
    if end is None:
        return
    wanted = [name.encode() for name in names]
    # stable, so that the others keep their order
    attributes.sort(key=lambda a: wanted.index(a.name) if a.name in wanted else len(wanted))
    header = b"".join(
        b"%b\0%b\0" % (a.name, a.kind) + file.at(a.position - SIZE_BYTES, SIZE_BYTES + a.size)
        for a in attributes
    )
    content.getbuffer()[FIXED_BYTES : FIXED_BYTES + len(header)] = header


def list_attributes(file: FileBytes, position: int) -> tuple[list[RawAttribute], int | None]:
    """Read the attributes of one header.

    Returns:
        Them, and the position behind the empty name that ends the header; None in place of the
        position where it is not laid out as expected.
    """
    attributes: list[RawAttribute] = []
    while position < file.size:
        # name, type, and 4 bytes that tell the value's size
        block, start = file.around(position, 2 * NAME_BYTES + SIZE_BYTES)
        if block[start : start + 1] in (b"\0", b""):
            return attributes, position + 1
        name = block.find(b"\0", start, start + NAME_BYTES)
        kind = block.find(b"\0", name + 1, name + 1 + NAME_BYTES)
        value = kind + 1 + SIZE_BYTES
        if name < 0 or kind < 0 or value > len(block):
            break
        size = int.from_bytes(block[kind + 1 : value], "little", signed=True)
        if size < 0:
            break
        position += value - start
        attributes.append(RawAttribute(block[start:name], block[name + 1 : kind], position, size))
        position += size
    return attributes, None
