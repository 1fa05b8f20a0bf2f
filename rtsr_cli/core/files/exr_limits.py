"""What an EXR file's header asks for, measured before the library reads it and takes memory.

The library reads all attributes and channels of a file at once: 200,000 channels take it minutes,
an attribute four times its size.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from rtsr_cli.core.files.exr_chunks import (
    FIXED_BYTES,
    MULTIPART,
    FileBytes,
    RawAttribute,
    list_attributes,
)
from rtsr_cli.core.limits import (
    MIB,
    MOST_CHANNELS,
    MOST_HEADER_BYTES,
    MOST_PARTS,
    MOST_UNPACKED_BYTES,
    MOST_UNPACKED_RATIO,
    are_files_limited,
)

CHANNELS, DATA_WINDOW = b"channels", b"dataWindow"

SAMPLE_BYTES = {0: 4, 1: 2, 2: 4}
"""Of the types of channels: uint, half, float."""

MAX_RATIO, MAX_RATIO_BLOCKS = 1100, 1 << 14
"""Pixels may take this many times the bytes of their file. Deflate reaches 1032:1 and what is
older less; DWA, HTJ2K and zstd were measured at up to 15900:1 on flat frames of 18 channels."""

SMALL_BYTES, SMALL_BYTES_BLOCKS = 1 << 24, 448 << 20
"""Less is never taken for a damaged header: black 4K frames in HTJ2K are 51000:1."""

CHANNEL_FACTS = struct.Struct("<iIii")
"""Behind a channel's name: type, linearity and reserved bytes, sampling in x and y."""

LIFTING = "rtsr --unlimited COMMAND ... reads it all the same, if you know where it comes from"


def find_header_excess(path: Path) -> str:
    """Say which limit a file's header exceeds; empty if none, or if it is laid out otherwise.

    Raises:
        OSError: the file cannot be read.
    """
    return _ask_limited(path, _measure_headers)


def find_unpacked_excess(path: Path) -> str:
    """Say whether a file unpacks to far more than rendered frames do; empty if it does not.

    Raises:
        OSError: the file cannot be read.
    """
    return _ask_limited(path, _measure_pixels)


def find_false_promise(path: Path, samples: int, *, known: bool) -> str:
    """Say whether a file holds fewer bytes than so many samples can be compressed to.

    Args:
        path: of the file.
        samples: pixels times channels, of all parts.
        known: whether `MAX_RATIO` holds for its compressions.

    Raises:
        OSError: the file cannot be read.
    """
    small, ratio = (SMALL_BYTES, MAX_RATIO) if known else (SMALL_BYTES_BLOCKS, MAX_RATIO_BLOCKS)
    size, promised = path.stat().st_size, samples * min(SAMPLE_BYTES.values())
    if promised <= max(small, size * ratio):
        return ""
    return f"its header promises {promised >> 20} MiB of pixels in {size} bytes"


def _ask_limited(path: Path, measure: Callable[[FileBytes], str]) -> str:
    if not are_files_limited():
        return ""
    with path.open("rb", buffering=0) as file:
        excess = measure(FileBytes(file))
    return f"{excess}; {LIFTING}" if excess else ""


def _measure_headers(content: FileBytes) -> str:
    channels = 0
    for number, attributes in enumerate(_list_headers(content)):
        last = attributes[-1]
        if last.position + last.size > MOST_HEADER_BYTES:
            return f"its header takes more than {MOST_HEADER_BYTES // MIB} MiB"
        channels += len(_list_types(content, attributes))
        if channels > MOST_CHANNELS:
            return f"it has more than {MOST_CHANNELS} channels"
        if number >= MOST_PARTS:
            return f"it has more than {MOST_PARTS} parts"
    return ""


def _measure_pixels(content: FileBytes) -> str:
    unpacked = sum(
        _count_pixels(content, attributes)
        * sum(map(_sample_bytes, _list_types(content, attributes)))
        for attributes in _list_headers(content)
    )
    if unpacked > max(MOST_UNPACKED_BYTES, content.size * MOST_UNPACKED_RATIO):
        return f"its {content.size / MIB:.1f} MiB unpack to {unpacked // MIB} MiB"
    return ""


def _list_headers(content: FileBytes) -> Iterator[list[RawAttribute]]:
    """Attributes of each part."""
    position = FIXED_BYTES
    while True:
        attributes, end = list_attributes(content, position)
        if attributes:
            yield attributes
        if end is None or end == position + 1 or not content.flags & MULTIPART:
            return
        position = end


def _sample_bytes(kind: int) -> int:
    return SAMPLE_BYTES.get(kind, max(SAMPLE_BYTES.values()))


def _list_types(content: FileBytes, attributes: list[RawAttribute]) -> list[int]:
    """Types of a part's channels; no more of them than exceed the limit."""
    value = _read_value(content, attributes, CHANNELS)
    types: list[int] = []
    position = 0
    while len(types) <= MOST_CHANNELS:
        end = value.find(b"\0", position)
        if end <= position or end + 1 + CHANNEL_FACTS.size > len(value):
            break
        types.append(int(CHANNEL_FACTS.unpack_from(value, end + 1)[0]))
        position = end + 1 + CHANNEL_FACTS.size
    return types


def _count_pixels(content: FileBytes, attributes: list[RawAttribute]) -> int:
    window = _read_value(content, attributes, DATA_WINDOW)
    if len(window) != struct.calcsize("<iiii"):
        return 0
    left, top, right, bottom = (int(corner) for corner in struct.unpack("<iiii", window))
    return max(0, right - left + 1) * max(0, bottom - top + 1)


def _read_value(content: FileBytes, attributes: list[RawAttribute], name: bytes) -> bytes:
    found = next((a for a in attributes if a.name == name), None)
    return b"" if found is None else content.at(found.position, found.size)
