"""OpenEXR files as named channels: the only importer of OpenEXR.

Channels are 2-D arrays (height, width) of float16, float32 or uint32; the array's type is the
channel's type in the file. Writes go to a hidden file beside the target and are renamed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.io.atomic import write_atomically

Plane: TypeAlias = NDArray[Any]
"""One channel: (height, width)."""

STRUCTURAL_ATTRIBUTES = frozenset(
    {
        "channels", "compression", "dataWindow", "displayWindow", "lineOrder", "type", "tiles",
        "chunkCount", "name", "version", "maxSamplesPerPixel", "preview", "view",
    }
)  # fmt: skip
"""Attributes that describe how pixels are stored; everything else survives a copy."""

MAX_PIXELS = 1 << 29
"""A window of more pixels than this is taken for a damaged header (32k x 16k)."""

COMPRESSIONS = {
    "none": OpenEXR.NO_COMPRESSION,
    "zip": OpenEXR.ZIP_COMPRESSION,
    "zips": OpenEXR.ZIPS_COMPRESSION,
    "piz": OpenEXR.PIZ_COMPRESSION,
    "dwaa": OpenEXR.DWAA_COMPRESSION,
}
"""Compressions by the name users type."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """A rectangle of pixels: first pixel (`left`, `top`), size (`width`, `height`)."""

    left: int
    top: int
    width: int
    height: int

    def scaled(self, scale: int) -> Window:
        """Return the same rectangle at `scale` times the resolution."""
        return Window(
            left=self.left * scale,
            top=self.top * scale,
            width=self.width * scale,
            height=self.height * scale,
        )

    def contains(self, other: Window) -> bool:
        """Tell whether another rectangle lies inside this one."""
        return (
            self.left <= other.left
            and self.top <= other.top
            and self.left + self.width >= other.left + other.width
            and self.top + self.height >= other.top + other.height
        )


@dataclass(frozen=True, kw_only=True)
class ExrHeader:
    """What a file says of itself before any pixel is read.

    Attributes:
        channels: names as `read_channels` takes them, over all parts.
        data_window: pixels that the file holds.
        display_window: pixels of the image plane.
        attributes: everything else, of the first part.
        subsampled: channels with fewer samples than pixels, which rtsr does not read.
    """

    channels: frozenset[str]
    data_window: Window
    display_window: Window
    attributes: Mapping[str, Any]
    subsampled: frozenset[str] = frozenset()


def _window(box: tuple[NDArray[Any], NDArray[Any]]) -> Window:
    (left, top), (right, bottom) = ((int(v) for v in corner) for corner in box)
    return Window(left=left, top=top, width=right - left + 1, height=bottom - top + 1)


def _part_prefixes(names: list[tuple[str, list[str]]]) -> list[dict[str, str]]:
    """For each part, channel name in the file -> name for the user.

    A channel that is unique over all parts keeps its name; one that is not is `part.channel`.
    """
    counts = Counter(channel for _, channels in names for channel in channels)
    return [
        {c: c if counts[c] == 1 or not part else f"{part}.{c}" for c in channels}
        for part, channels in names
    ]


def _unreadable(path: Path, why: str) -> FrameFolderError:
    return FrameFolderError(
        f"{path}: cannot be read as OpenEXR ({why}); copy or render this frame again"
    )


def _open(path: Path, *, header_only: bool) -> OpenEXR.File:
    if not path.is_file():
        raise FrameFolderError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise _unreadable(path, "the file is empty")
    try:
        return OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
    except (RuntimeError, ValueError, TypeError, MemoryError) as error:
        raise _unreadable(path, str(error).strip() or type(error).__name__) from error


def read_header(path: Path) -> ExrHeader:
    """Read the header of a file.

    Raises:
        FrameFolderError: not an EXR, damaged, deep, or with an absurd window; names the file.
    """
    file = _open(path, header_only=True)
    headers = [file.header(i) for i in range(len(file.parts))]
    if not headers or not headers[0].get("channels"):
        raise _unreadable(path, "it has no channels")
    first = headers[0]
    data_window, display_window = _window(first["dataWindow"]), _window(first["displayWindow"])
    for window in (data_window, display_window):
        if window.width < 1 or window.height < 1 or window.width * window.height > MAX_PIXELS:
            raise _unreadable(path, f"its window is {window.width} x {window.height} pixels")
    if any(_window(h["dataWindow"]) != data_window for h in headers):
        raise _unreadable(path, "its parts have different data windows")
    try:
        names = [(str(h.get("name", "")), [c.name for c in h["channels"]]) for h in headers]
    except UnicodeDecodeError as error:
        raise _unreadable(path, "the name of a channel is not UTF-8") from error
    renamed = _part_prefixes(names)
    return ExrHeader(
        channels=frozenset(name for part in renamed for name in part.values()),
        data_window=data_window,
        display_window=display_window,
        attributes={k: v for k, v in first.items() if k not in STRUCTURAL_ATTRIBUTES},
        subsampled=frozenset(
            part[c.name]
            for part, header in zip(renamed, headers, strict=True)
            for c in header["channels"]
            if (c.xSampling, c.ySampling) != (1, 1)
        ),
    )


def read_channels(path: Path, wanted: Collection[str]) -> dict[str, Plane]:
    """Read the named channels of a file, over all its parts, in their stored types.

    Args:
        path: the file.
        wanted: names as in `ExrHeader.channels`; channels that are not wanted are not returned.

    Raises:
        FrameFolderError: the file cannot be read, or lacks a channel; names file and channel.
    """
    file = _open(path, header_only=False)
    try:
        parts = [(part.name(), dict(file.channels(i))) for i, part in enumerate(file.parts)]
    except (RuntimeError, ValueError) as error:
        raise _unreadable(path, "its pixels are damaged or cut off") from error
    if not parts:
        raise _unreadable(path, "its pixels are damaged or cut off")
    renamed = _part_prefixes([(name, list(channels)) for name, channels in parts])
    found = {
        user: channels[stored].pixels
        for names, (_, channels) in zip(renamed, parts, strict=True)
        for stored, user in names.items()
        if user in wanted
    }
    lacking = sorted(set(wanted) - set(found))
    if lacking:
        raise FrameFolderError(f"{path}: channel {', '.join(map(repr, lacking))} is missing")
    return found


def write_exr(
    path: Path,
    channels: Mapping[str, Plane],
    *,
    attributes: Mapping[str, Any] | None = None,
    data_window: Window | None = None,
    display_window: Window | None = None,
    compression: str = "zip",
) -> None:
    """Write 2-D arrays as the channels of a scan-line file, whole or not at all.

    Args:
        path: target; replaced in one step if it is there.
        channels: float16, float32 or uint32 arrays of one size.
        attributes: header attributes; structural ones are ignored.
        data_window: where the arrays lie; the display window or (0, 0) by default.
        display_window: image plane; the data window by default.
        compression: a key of `COMPRESSIONS`.

    Raises:
        OutputError: the file cannot be written; names it.
    """
    height, width = next(iter(channels.values())).shape
    data = data_window or display_window or Window(left=0, top=0, width=width, height=height)
    header = {k: v for k, v in (attributes or {}).items() if k not in STRUCTURAL_ATTRIBUTES}
    header |= {
        "compression": COMPRESSIONS[compression],
        "type": OpenEXR.scanlineimage,
        "dataWindow": _box(data),
        "displayWindow": _box(display_window or data),
    }
    contiguous = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    write_atomically(path, lambda part: OpenEXR.File(header, contiguous).write(str(part)))


def _box(window: Window) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    first = (window.left, window.top)
    last = (window.left + window.width - 1, window.top + window.height - 1)
    return np.array(first, dtype=np.int32), np.array(last, dtype=np.int32)
