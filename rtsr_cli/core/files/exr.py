"""OpenEXR files as named channels: the only importer of OpenEXR.

Channels are 2-D arrays (height, width) of float16, float32 or uint32; the array's type is the
channel's type in the file. Writes go to a hidden file beside the target and are renamed.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.atomic_write import write_atomically
from rtsr_cli.core.files.channel_names import (
    NamedPart,
    find_views,
    guess_part_views,
    guess_views,
    name_channels,
)
from rtsr_cli.core.files.exr_checksum import BLANK, CHECKSUM, seal
from rtsr_cli.core.files.exr_chunks import MAGIC, ends_too_early, put_first
from rtsr_cli.core.files.exr_limits import (
    find_false_promise,
    find_header_excess,
    find_unpacked_excess,
)
from rtsr_cli.core.files.library_output import silence_library
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.files.provenance import STAMP
from rtsr_cli.core.marks import MARK

T = TypeVar("T")

Plane: TypeAlias = NDArray[Any]
"""One channel: (height, width)."""

STRUCTURAL_ATTRIBUTES = frozenset(
    {
        "channels", "compression", "dataWindow", "displayWindow", "lineOrder", "type", "tiles",
        "chunkCount", "name", "version", "maxSamplesPerPixel", "preview", "view", "multiView",
        CHECKSUM,
    }
)  # fmt: skip
"""Attributes that describe how pixels are stored, or which views a file has of which a copy takes
one; everything else survives a copy."""

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

CHUNK_LINES = {
    OpenEXR.NO_COMPRESSION: 1,
    OpenEXR.RLE_COMPRESSION: 1,
    OpenEXR.ZIPS_COMPRESSION: 1,
    OpenEXR.ZIP_COMPRESSION: 16,
    OpenEXR.PXR24_COMPRESSION: 16,
    OpenEXR.PIZ_COMPRESSION: 32,
    OpenEXR.B44_COMPRESSION: 32,
    OpenEXR.B44A_COMPRESSION: 32,
}
"""Rows of a chunk, for the compressions that `MAX_RATIO` holds for."""


@dataclass(frozen=True, kw_only=True)
class PartHeader:
    """A part behind the first one: the channels that it holds, and its attributes."""

    channels: frozenset[str]
    attributes: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ExrHeader:
    """What a file says of itself before any pixel is read.

    Attributes:
        channels: names as `read_channels` takes them, over all parts.
        data_window: pixels that the file holds; of several parts, the first.
        display_window: pixels of the image plane.
        attributes: everything else, of the first part.
        subsampled: channels with fewer samples than pixels, which rtsr does not read.
        chunks: number of chunks of pixels, over all parts; 0 where it is not known.
        part_windows: data windows of the channels of parts whose window is not the first one's.
        views: channel -> the stereo view that it belongs to; channels of none are not there.
        later: the parts behind the first.
    """

    channels: frozenset[str]
    data_window: PixelWindow
    display_window: PixelWindow
    attributes: Mapping[str, Any]
    subsampled: frozenset[str] = frozenset()
    chunks: int = 0
    part_windows: Mapping[str, PixelWindow] = field(default_factory=dict)
    views: Mapping[str, str] = field(default_factory=dict)
    later: tuple[PartHeader, ...] = ()

    def place_of(self, channel: str) -> PixelWindow:
        """Where a channel's pixels lie in the image plane, whose first pixel is (0, 0)."""
        window = self.part_windows.get(channel, self.data_window)
        return window.seen_from(self.display_window)

    def attributes_of(self, channels: Collection[str]) -> dict[str, Any]:
        """Attributes of the parts that hold channels, over the first one's, which is the file's."""
        merged = dict(self.attributes)
        for part in self.later:
            if not part.channels.isdisjoint(channels):
                merged |= part.attributes
        return merged


def _read_box(box: tuple[NDArray[Any], NDArray[Any]]) -> PixelWindow:
    (left, top), (right, bottom) = box[0].tolist(), box[1].tolist()
    return PixelWindow(left=left, top=top, width=right - left + 1, height=bottom - top + 1)


def _make_unreadable_error(path: Path, why: str) -> FrameFolderError:
    return FrameFolderError(
        f"{path}: cannot be read as OpenEXR ({why}); copy or render this frame again"
    )


def _open(path: Path, *, header_only: bool) -> OpenEXR.File:
    if not _ask_file_system(path, path.is_file):
        raise FrameFolderError(f"{path}: no such file")
    excess = _ask_file_system(path, lambda: find_header_excess(path)) if header_only else ""
    if excess:
        raise FrameFolderError(f"{path}: {excess}")
    try:
        with silence_library():
            name = _name_for_library(path)
            return OpenEXR.File(name, separate_channels=True, header_only=header_only)
    except (RuntimeError, ValueError, TypeError, MemoryError) as error:
        raise _make_unreadable_error(path, _explain_unopened(path)) from error


def _name_for_library(path: Path) -> str | bytes:
    """A path as the library takes it: a name that is not UTF-8 can only be given as bytes."""
    return str(path) if os.name == "nt" else os.fsencode(path)


def _explain_unopened(path: Path) -> str:
    """Say what the first bytes tell; the library's own words are that it cannot."""
    with _ask_file_system(path, lambda: path.open("rb")) as file:
        start = file.read(len(MAGIC))
    if not start:
        return "the file is empty"
    return "its header is damaged" if start == MAGIC else "it is another kind of file"


def _ask_file_system(path: Path, ask: Callable[[], T]) -> T:
    """Ask the file system about a file."""
    try:
        return ask()
    except OSError as error:
        raise FrameFolderError(f"{path}: cannot be read ({error.strerror})") from error


def read_header(path: Path) -> ExrHeader:
    """Read the header of a file.

    Raises:
        FrameFolderError: not an EXR, damaged, deep, or with an absurd window or more pixels than
            so many bytes can hold; names the file.
    """
    file = _open(path, header_only=True)
    headers = [file.header(i) for i in range(len(file.parts))]
    if not headers or not headers[0].get("channels"):
        raise _make_unreadable_error(path, "it has no channels")
    _check_parts(path, headers)
    data_windows, display_window = _check_windows(path, headers)
    try:
        named = [_name_part(h, [c.name for c in h["channels"]]) for h in headers]
        parts = guess_part_views(named)
    except UnicodeDecodeError as error:
        raise _make_unreadable_error(path, "the name of a channel is not UTF-8") from error
    chunks = _count_all_chunks(headers)
    if chunks and _ask_file_system(path, lambda: ends_too_early(path, chunks)):
        raise _make_unreadable_error(path, "the file ends too early")
    renamed = name_channels(parts)
    first, *others = [
        PartHeader(channels=frozenset(names.values()), attributes=_select_attributes(header))
        for names, header in zip(renamed, headers, strict=True)
    ]
    return ExrHeader(
        channels=first.channels.union(*(part.channels for part in others)),
        data_window=data_windows[0],
        display_window=display_window,
        attributes=first.attributes,
        subsampled=frozenset(
            part[c.name]
            for part, header in zip(renamed, headers, strict=True)
            for c in header["channels"]
            if (c.xSampling, c.ySampling) != (1, 1)
        ),
        chunks=chunks,
        part_windows={
            name: window
            for part, window in zip(renamed, data_windows, strict=True)
            for name in part.values()
            if window != data_windows[0]
        },
        views=find_views(parts, renamed),
        later=tuple(others),
    )


def _name_part(header: Mapping[str, Any], channels: Sequence[str]) -> NamedPart:
    views = header.get("multiView")
    return NamedPart(
        name=str(header.get("name", "")),
        channels=tuple(channels),
        view=str(header.get("view", "")),
        views=tuple(map(str, views)) if isinstance(views, list) else guess_views(channels),
    )


def _select_attributes(header: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in header.items() if k not in STRUCTURAL_ATTRIBUTES}


def _check_parts(path: Path, headers: list[dict[str, Any]]) -> None:
    if any(h.get("type") in {OpenEXR.deepscanline, OpenEXR.deeptile} for h in headers):
        raise FrameFolderError(f"{path}: holds deep pixels; flatten them and name that file")


def _check_windows(
    path: Path, headers: list[dict[str, Any]]
) -> tuple[list[PixelWindow], PixelWindow]:
    """Return each part's data window, and the display window; no pixel has been allocated yet."""
    try:
        data = [_read_box(h["dataWindow"]) for h in headers]
        displays = [_read_box(h["displayWindow"]) for h in headers]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise _make_unreadable_error(path, "its windows are damaged") from error
    for window in (*data, *displays):
        if window.width < 1 or window.height < 1 or window.width * window.height > MAX_PIXELS:
            raise _make_unreadable_error(
                path, f"its window is {window.width} x {window.height} pixels"
            )
    if any(display != displays[0] for display in displays):
        other = next(display for display in displays if display != displays[0])
        raise FrameFolderError(
            f"{path}: its parts have different display windows ({displays[0]} and {other}); write "
            "them into one image plane"
        )
    _check_size(path, headers, data)
    return data, displays[0]


def _check_size(path: Path, headers: list[dict[str, Any]], data: list[PixelWindow]) -> None:
    samples = sum(
        _count_samples(header, window) for header, window in zip(headers, data, strict=True)
    )
    known = all(h.get("compression") in CHUNK_LINES for h in headers)
    promise = _ask_file_system(path, lambda: find_false_promise(path, samples, known=known))
    if promise:
        raise _make_unreadable_error(path, promise)
    excess = _ask_file_system(path, lambda: find_unpacked_excess(path))
    if excess:
        raise FrameFolderError(f"{path}: {excess}")


def _count_samples(header: dict[str, Any], data: PixelWindow) -> int:
    """Samples of a part; a tile is decoded whole, however little of it lies in the window."""
    tile = header["tiles"].xSize * header["tiles"].ySize if "tiles" in header else 0
    return max(data.width * data.height, tile) * len(header["channels"])


def _count_all_chunks(headers: list[dict[str, Any]]) -> int:
    """Number of chunks of all parts; 0 where that of one is not known."""
    counts = [_count_chunks(header) for header in headers]
    return sum(counts) if all(counts) else 0


def _count_chunks(header: dict[str, Any]) -> int:
    """Number of chunks of a part; 0 where it is not known."""
    if "chunkCount" in header:
        return max(0, int(header["chunkCount"]))
    lines = 0 if "tiles" in header else CHUNK_LINES.get(header["compression"], 0)
    if not lines:
        return 0
    (_, top), (_, bottom) = header["dataWindow"]
    return -(-(int(bottom) - int(top) + 1) // lines)


def read_channels(path: Path, wanted: Collection[str]) -> dict[str, Plane]:
    """Read the named channels of a file, over all its parts, in their stored types.

    Args:
        path: the file.
        wanted: names as in `ExrHeader.channels`; channels that are not wanted are not returned.

    Raises:
        FrameFolderError: the file cannot be read, or lacks a channel; names file and channel.
    """
    return read_pixels(path, wanted)[0]


def read_pixels(path: Path, wanted: Collection[str]) -> tuple[dict[str, Plane], ExrHeader]:
    """`read_channels`, and the header that tells where in the image plane the pixels lie."""
    header = read_header(path)
    lacking = sorted(set(wanted) - header.channels)
    if lacking:
        raise FrameFolderError(f"{path}: channel {', '.join(map(repr, lacking))} is missing")
    file = _open(path, header_only=False)
    try:
        parts = [(part.header, dict(file.channels(i))) for i, part in enumerate(file.parts)]
    except (RuntimeError, ValueError, TypeError, MemoryError) as error:
        raise _make_unreadable_error(path, str(error).strip() or type(error).__name__) from error
    named = [_name_part(header, list(channels)) for header, channels in parts]
    renamed = name_channels(guess_part_views(named))
    planes = {
        user: np.asarray(channels[stored].pixels)
        for names, (_, channels) in zip(renamed, parts, strict=True)
        for stored, user in names.items()
        if user in wanted
    }
    windows = {name: header.part_windows.get(name, header.data_window) for name in planes}
    whole = all(planes[name].shape == (w.height, w.width) for name, w in windows.items())
    # pixels that cannot be decoded end in a part without any, and in no exception
    if len(planes) < len(set(wanted)) or not whole:
        raise _make_unreadable_error(path, "its pixels are damaged, or the file ends too early")
    return planes, header


def write_exr(
    path: Path,
    channels: Mapping[str, Plane],
    *,
    attributes: Mapping[str, Any] | None = None,
    data_window: PixelWindow | None = None,
    display_window: PixelWindow | None = None,
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
    data = data_window or display_window or PixelWindow(left=0, top=0, width=width, height=height)
    kept = {k: v for k, v in (attributes or {}).items() if k not in STRUCTURAL_ATTRIBUTES}
    header = {name: _lay_out(value) for name, value in kept.items()}
    header |= {
        "compression": COMPRESSIONS[compression],
        "type": OpenEXR.scanlineimage,
        "dataWindow": _make_box(data),
        "displayWindow": _make_box(display_window or data),
        CHECKSUM: BLANK,
    }
    contiguous = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}

    def write(part: Path) -> None:
        # compressed in memory first: Python then says by number why a disk refuses the file
        encoded = io.BytesIO()
        OpenEXR.File(header, contiguous).write(encoded)
        # what is cut later tells by its first bytes whose it is
        put_first(encoded, (MARK, STAMP))
        content = encoded.getbuffer()
        seal(content)
        part.write_bytes(content)

    write_atomically(path, write)


def _lay_out(value: T) -> T | NDArray[Any]:
    """A value as the library takes it: of an array it reads the memory and no strides."""
    return np.ascontiguousarray(value) if isinstance(value, np.ndarray) else value


def _make_box(window: PixelWindow) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    first = (window.left, window.top)
    last = (window.left + window.width - 1, window.top + window.height - 1)
    return np.array(first, dtype=np.int32), np.array(last, dtype=np.int32)
