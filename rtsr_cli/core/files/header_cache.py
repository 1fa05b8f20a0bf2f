"""Headers of thousands of files, each opened once.

The frames of a sequence differ in a few attributes: cameras, times. What lays out their pixels is
the same bytes in all of them, which the library has to judge only once.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rtsr_cli.core.files.exr import ExrHeader, read_header
from rtsr_cli.core.files.exr_checksum import CHECKSUM
from rtsr_cli.core.files.exr_chunks import FIXED_BYTES, FileBytes, list_attributes

PLAIN_FLAGS = 0xFF | 0x400
"""Version, and long names: a file of one part of scan lines has no other bits."""


def _decode_floats(*shape: int) -> Callable[[bytes], Any]:
    """Return a reader of an array of floats; a size that is wrong raises ValueError."""
    return lambda value: np.frombuffer(value, "<f4").astype(np.float32).reshape(shape)


DECODERS: Mapping[bytes, Callable[[bytes], Any]] = {
    b"int": lambda value: struct.unpack("<i", value)[0],
    b"float": lambda value: struct.unpack("<f", value)[0],
    b"double": lambda value: struct.unpack("<d", value)[0],
    b"string": lambda value: value.decode(),
    b"v2f": _decode_floats(2),
    b"v3f": _decode_floats(3),
    b"m33f": _decode_floats(3, 3),
    b"m44f": _decode_floats(4, 4),
}
"""Types of what usually differs between frames, as the library gives them to Python."""


@dataclass(frozen=True, kw_only=True)
class _Value:
    """An attribute that may differ between files: its name, type, and place in the file."""

    name: str
    kind: bytes
    place: slice


@dataclass(frozen=True, kw_only=True)
class _Known:
    """What the library made of a file, and that file's bytes.

    Attributes:
        header: what the library made of it.
        head: bytes before the table of chunks.
        values: attributes that may differ.
        fixed: the bytes of `head` around their values, which may not.
        size: of the file; one that is smaller may promise more pixels than its bytes can hold.
    """

    header: ExrHeader
    head: bytes
    values: tuple[_Value, ...]
    fixed: tuple[slice, ...]
    size: int

    def decode(self, head: bytes) -> dict[str, Any] | None:
        """Attributes of another file as the library would give them; None if only it can."""
        if any(head[part] != self.head[part] for part in self.fixed):
            return None
        attributes = dict(self.header.attributes)
        for value in self.values:
            content = head[value.place]
            if content == self.head[value.place] or value.name == CHECKSUM:
                continue
            try:
                attributes[value.name] = DECODERS[value.kind](content)
            except (KeyError, ValueError, struct.error):
                return None
        return attributes


class HeaderCache:
    """Reads headers; what is the same as in a file before is not judged again."""

    def __init__(self) -> None:
        """Start with nothing known."""
        self._known: _Known | None = None

    def read(self, path: Path) -> ExrHeader:
        """Read the header of a file; equal to what `read_header` gives.

        Raises:
            FrameFolderError: as `read_header`.
        """
        try:
            with path.open("rb", buffering=0) as file:
                content = FileBytes(file)
                like = None if self._known is None else _read_like(content, self._known)
                if like is not None:
                    return like
                header = read_header(path)
                self._known = _learn(content, header) or self._known
        except OSError:
            return read_header(path)
        return header


def _read_like(content: FileBytes, known: _Known) -> ExrHeader | None:
    """Return the header of a file that is laid out as a known one; None if it is not."""
    if content.size < known.size:
        return None
    attributes = known.decode(content.at(0, len(known.head)))
    if attributes is None or content.chunk_lies_behind(len(known.head), known.header.chunks):
        return None
    return replace(known.header, attributes=attributes)


def _learn(content: FileBytes, header: ExrHeader) -> _Known | None:
    """Take a file as the one that others are like; None where it is no plain one."""
    attributes, end = list_attributes(content, FIXED_BYTES)
    names = [a.name.decode(errors="replace") for a in attributes]
    plain = not content.flags & ~PLAIN_FLAGS and len(set(names)) == len(names)
    if end is None or not plain or not header.chunks:
        return None
    values = tuple(
        _Value(name=name, kind=a.kind, place=slice(a.position, a.position + a.size))
        for name, a in zip(names, attributes, strict=True)
        if name in header.attributes or name == CHECKSUM
    )
    stops = [(v.place.start, v.place.stop) for v in values]
    fixed = zip(
        [0, *(stop for _, stop in stops)], [*(start for start, _ in stops), end], strict=True
    )
    return _Known(
        header=header,
        head=content.at(0, end),
        values=values,
        fixed=tuple(slice(start, stop) for start, stop in fixed),
        size=content.size,
    )
