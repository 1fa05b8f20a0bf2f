"""Does an OpenEXR file reach as far as its own table of chunks says?

A frame that is still being rendered or copied, or that was cut off, has an intact header. After
the headers a file lists where each chunk of pixels begins, 8 bytes a chunk [OpenEXR file layout];
a chunk that begins behind the file's end shows the cut without a pixel being read.
"""

from __future__ import annotations

import os
import struct
from io import FileIO
from pathlib import Path

import numpy as np

MULTIPART = 0x1000
"""Bit of the version field: several headers, an empty one at the end."""

FIXED_BYTES = 8
"""Magic number and version field."""

OFFSET_BYTES = 8
NAME_BYTES = 256
"""Longer than any name may be."""

FIRST_BYTES = 1 << 13
"""Read of a file at once."""

MAX_HEADER_BYTES = 64 << 20
"""Headers hold previews and manifests; one larger than this is not looked into."""


def ends_too_early(path: Path, chunks: int) -> bool:
    """Tell whether a chunk begins at or behind the end of the file.

    Args:
        path: a file whose headers are intact.
        chunks: number of chunks of all parts.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb", buffering=0) as file:
        size = os.fstat(file.fileno()).st_size
        bytes_of = _Bytes(file)
        start = _find_table_start(bytes_of)
        if start is None:
            return False
        if start + chunks * OFFSET_BYTES > size:
            return True
        table = np.frombuffer(bytes_of.at(start, chunks * OFFSET_BYTES), "<u8")
    return bool((table >= size).any())


class _Bytes:
    """Bytes of a file by their place; the first ones, where most headers end, are read at once."""

    def __init__(self, file: FileIO) -> None:
        self._file = file
        self._first = file.read(FIRST_BYTES) or b""

    def at(self, position: int, count: int) -> bytes:
        """Return the bytes at a position; fewer where the file ends."""
        if position + count <= len(self._first):
            return self._first[position : position + count]
        self._file.seek(position)
        return self._file.read(count) or b""


def _find_table_start(file: _Bytes) -> int | None:
    """Skip the headers; None where they are not laid out as expected."""
    (flags,) = struct.unpack("<4xI", file.at(0, FIXED_BYTES).ljust(FIXED_BYTES, b"\0"))
    position = FIXED_BYTES
    while True:
        end = _find_header_end(file, position)
        if end is None:
            return None
        if not flags & MULTIPART:
            return end
        if end == position + 1:
            return end
        position = end


def _find_header_end(file: _Bytes, position: int) -> int | None:
    """Return the position behind the empty name that ends one header's attributes."""
    while position < MAX_HEADER_BYTES:
        # name, type, and 4 bytes that tell the value's size
        names = file.at(position, 2 * NAME_BYTES + 4).split(b"\0", 2)
        if not names[0]:
            return position + 1
        if len(names) < 3 or len(names[2]) < 4:
            return None
        (size,) = struct.unpack_from("<i", names[2])
        if size < 0:
            return None
        position += len(names[0]) + len(names[1]) + 2 + 4 + size
    return None
