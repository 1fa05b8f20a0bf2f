"""Channels whose numbers a file's compression alters.

Pictures bear it; normals, vectors, depths and ids are numbers, and do not. What each compression
does follows from a channel's type and, of DWA, from its name: the last part of it says whether it
is taken for a colour [OpenEXR, classification rules of the DWA compressor].
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

from rtsr_cli.core.files.channel_names import NamedPart, guess_views, name_channels
from rtsr_cli.core.files.exr_chunks import list_headers


class PixelType(IntEnum):
    """Types of a channel, as a header holds them."""

    UINT = 0
    HALF = 1
    FLOAT = 2


COMPRESSION_NAMES: Mapping[int, str] = {5: "PXR24", 6: "B44", 7: "B44A", 8: "DWAA", 9: "DWAB"}
"""Compressions that alter numbers, as a header holds them."""

ALTERED_TYPES: Mapping[str, frozenset[PixelType]] = {
    "PXR24": frozenset({PixelType.FLOAT}),
    "B44": frozenset({PixelType.HALF}),
    "B44A": frozenset({PixelType.HALF}),
    "DWAA": frozenset({PixelType.HALF, PixelType.FLOAT}),
    "DWAB": frozenset({PixelType.HALF, PixelType.FLOAT}),
}
"""Types that each alters; others come through."""

COLOUR_SUFFIXES = frozenset({"R", "G", "B", "Y", "RY", "BY"})
"""Ends of names that DWA takes for colours; channels of other names come through."""

CHANNEL_FIELDS = 16
"""Bytes behind a channel's name: its type, 4 that say nothing here, and its sampling."""


LENGTH_BYTES = 4
"""Of a string in a list."""


@dataclass(frozen=True, kw_only=True)
class ChannelCompression:
    """A channel in a part with a compression that alters numbers of its type.

    Attributes:
        compression: its name.
        altered: False where the channel's name keeps its numbers out of it.
    """

    compression: str
    altered: bool


def find_lossy_channels(path: Path) -> dict[str, ChannelCompression]:
    """Return the channels of a file, by the names that users see, that are compressed so.

    Raises:
        OSError: the file cannot be read.
    """
    headers = list_headers(path)
    if not headers:
        return {}
    channels = [dict(_list_channels(header)) for header in headers]
    renamed = name_channels([_name_part(h, c) for h, c in zip(headers, channels, strict=True)])
    found: dict[str, ChannelCompression] = {}
    for header, names, types in zip(headers, renamed, channels, strict=True):
        compression = COMPRESSION_NAMES.get(header.get(b"compression", b"\0")[0], "")
        for stored, kind in types.items():
            if kind in ALTERED_TYPES.get(compression, ()):
                spared = compression.startswith("DWA") and not _is_colour(stored)
                found[names[stored]] = ChannelCompression(
                    compression=compression, altered=not spared
                )
    return found


def _name_part(header: Mapping[bytes, bytes], channels: Iterable[str]) -> NamedPart:
    name, view = (header.get(key, b"").decode(errors="replace") for key in (b"name", b"view"))
    stored = tuple(channels)
    views = tuple(_list_strings(header.get(b"multiView", b"")))
    return NamedPart(name=name, channels=stored, view=view, views=views or guess_views(stored))


def _list_strings(content: bytes) -> Iterator[str]:
    """Strings of a list of them, each behind its length."""
    position = 0
    while position + LENGTH_BYTES <= len(content):
        end = position + LENGTH_BYTES
        length = int.from_bytes(content[position:end], "little")
        yield content[end : end + length].decode(errors="replace")
        position = end + length


def _is_colour(channel: str) -> bool:
    return channel.rpartition(".")[2] in COLOUR_SUFFIXES


def _list_channels(header: Mapping[bytes, bytes]) -> Iterator[tuple[str, int]]:
    """Name and type of each channel of a part; what is no channel list has none."""
    content, position = header.get(b"channels", b""), 0
    while (end := content.find(b"\0", position)) > position:
        kind = int.from_bytes(content[end + 1 : end + 5], "little")
        yield content[position:end].decode(errors="replace"), kind
        position = end + 1 + CHANNEL_FIELDS
