"""The checksum that an EXR of rtsr carries: tells one that was cut or damaged after it was written.

It is over all bytes of the file, with zeros where it stands itself. Compressed chunks have sums of
their own, which only decoding finds; that takes ten times as long (`benchmarks/durability.py`).
"""

from __future__ import annotations

import re
import zlib

CHECKSUM = "rtsr:crc32"
"""Header attribute: CRC-32 of the file as eight hexadecimal digits."""

BLANK = "0" * 8
"""Its value while the file is made."""

FIELD = re.compile(rb"rtsr:crc32\0string\0\x08\0\0\0([0-9a-f]{8})")
"""The attribute in the bytes of a header: name, type, size, value."""


def seal(content: memoryview) -> None:
    """Put the checksum into the bytes of a file that was made with `BLANK` in its place."""
    found = FIELD.search(content)
    if found is not None:
        content[found.start(1) : found.end(1)] = b"%08x" % zlib.crc32(content)


def is_unchanged(content: bytes) -> bool | None:
    """Tell whether a file's bytes are those that were sealed; None where it has no checksum."""
    found = FIELD.search(content)
    if found is None:
        return None
    view = memoryview(content)
    summed = zlib.crc32(BLANK.encode(), zlib.crc32(view[: found.start(1)]))
    return b"%08x" % zlib.crc32(view[found.end(1) :], summed) == found[1]
