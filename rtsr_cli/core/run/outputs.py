"""Output frames: their names, their state on disk, and writing them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import OutputWindows
from rtsr_cli.core.errors import FrameFolderError, NonfiniteError, OutputError
from rtsr_cli.core.files.exr import Plane, read_channels, read_header, write_exr
from rtsr_cli.core.files.exr_checksum import is_unchanged
from rtsr_cli.core.files.exr_chunks import ends_in_header
from rtsr_cli.core.files.ownership import is_empty_file, is_own
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.files.png import is_whole_png, write_png
from rtsr_cli.core.files.provenance import holds_stamp
from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.frames.storage import MAX_HALF, largest_magnitude, split_image
from rtsr_cli.core.imaging.preview import encode_preview
from rtsr_cli.core.shapes import Color, Image

PREVIEW_SUFFIX = ".png"

DEBUG_FOLDER = "debug"
"""Beside the outputs: what was seen and decided."""

HALF_BYTES, FLOAT_BYTES, HEADER_BYTES = 2, 4, 1 << 14
"""Sizes for estimates: of samples, and of all that is no pixel in a file, generously."""


class OutputState(StrEnum):
    """What is there before a frame is computed."""

    ABSENT = "absent"
    EMPTY = "empty"
    DONE = "done"
    DAMAGED = "damaged"
    FOREIGN = "foreign"


SEPARATORS = (".", "_", "-", " ", "")
"""Between a base name and a frame number."""


def name_output(reader: FrameReader, number: int) -> str:
    """Return the name of a frame's output: the input's, with its separator and digits."""
    return "".join((*split_frame_name(reader.named_like(number), reader.base, number), ".exr"))


def find_output(folder: Path, reader: FrameReader, number: int) -> Path:
    """Return the file of a frame's output, which is called as the input is.

    Where one is there with another separator, as earlier versions wrote, it is the frame's: two
    files of one frame could be read by nobody.
    """
    path = folder / name_output(reader, number)
    if not reader.base or os.path.lexists(path):
        return path
    _, digits = split_frame_name(reader.named_like(number), reader.base, number)
    others = (folder / f"{reader.base}{separator}{digits}.exr" for separator in SEPARATORS)
    return next(filter(os.path.lexists, others), path)


def split_frame_name(source: Path, base: str, number: int) -> tuple[str, str]:
    """Return what stands before the number in the name of a frame's file, and the number.

    Args:
        source: the file, or that of the frame that stands in.
        base: base name of the sequence.
        number: of the frame.
    """
    after = source.name[len(base) : -len(source.suffix)]
    numbered = after.lstrip("._- ")
    separator = after[: len(after) - len(numbered)]
    # what stands behind the number is a word for channels
    count = len(numbered.partition(".")[0])
    digits = f"{'-' if number < 0 else ''}{abs(number):0{count}d}"
    # the dash of a number below 0 is no separator
    signed = number < 0 or not base or (separator.endswith("-") and len(separator) > 1)
    return base + (separator.removesuffix("-") if signed else separator), digits


def name_debug_file(path: Path) -> Path:
    """Return the file of an output's debug pictures."""
    return path.parent / DEBUG_FOLDER / path.name


def read_output_state(path: Path, stamp: str) -> OutputState:
    """Tell whether a file is there, whole, and the one that would be written."""

    def judge(content: bytes) -> OutputState:
        if not holds_stamp(content, stamp):
            # what was cut behind its mark and before its stamp holds no pixel of other settings
            cut = ends_in_header(content) and is_own(path)
            return OutputState.DAMAGED if cut else OutputState.FOREIGN
        unchanged = is_unchanged(content)
        if unchanged is None:
            # of a version that wrote no checksum
            unchanged = _can_be_decoded(path)
        return OutputState.DONE if unchanged else OutputState.DAMAGED

    return _judge_file(path, judge)


def read_picture_state(path: Path) -> OutputState:
    """Tell whether a PNG is there, whole, and rtsr's."""

    def judge(content: bytes) -> OutputState:
        if not is_own(path):
            return OutputState.FOREIGN
        return OutputState.DONE if is_whole_png(content) else OutputState.DAMAGED

    return _judge_file(path, judge)


def read_debug_state(path: Path, stamp: str) -> OutputState:
    """Tell whether an output's debug file is there, and the one that would be written.

    One that rtsr wrote from other inputs may be replaced, as the output that it belongs to may.
    """
    state = read_output_state(path, stamp)
    stale = state is OutputState.FOREIGN and is_own(path) and not path.is_symlink()
    return OutputState.ABSENT if stale else state


def _judge_file(path: Path, judge: Callable[[bytes], OutputState]) -> OutputState:
    """Judge a file that is there by its bytes; a link may stay, and is never replaced."""
    if not os.path.lexists(path):
        return OutputState.ABSENT
    if is_empty_file(path):
        return OutputState.EMPTY
    state = judge(_read_content(path))
    if path.is_symlink() and state is not OutputState.DONE:
        return OutputState.FOREIGN
    return state


def _can_be_decoded(path: Path) -> bool:
    try:
        read_channels(path, read_header(path).channels)
    except FrameFolderError:
        return False
    return True


def _read_content(path: Path) -> bytes:
    """The bytes of a file; none of what is no file, or cannot be read."""
    with suppress(OSError):
        if path.is_file():
            return path.read_bytes()
    return b""


def refuse_inputs(outputs: Sequence[Path], readers: Iterable[FrameReader]) -> None:
    """Raise if an output would replace any file of the shots that are read, needed or not.

    Raises:
        OutputError: names the file.
    """
    there = [path for path in outputs if path.exists()]
    if not there:
        # what is not there is no input
        return
    resolve = _PathResolver()
    inputs = {
        resolve.of(path)
        for reader in readers
        for stream in reader.frames.streams.values()
        for path in stream.files.values()
    }
    for path in there:
        if resolve.of(path) in inputs:
            raise OutputError(
                f"{path}: the output would replace its own input; choose another output folder"
            )


class _PathResolver:
    """Resolves paths of many files in few folders, each folder once."""

    def __init__(self) -> None:
        self._folder = cache(Path.resolve)

    def of(self, path: Path) -> Path:
        """Return the path without links."""
        return path.resolve() if path.is_symlink() else self._folder(path.parent) / path.name


def check_output(made: Tensor, what: str, remedy: str) -> float:
    """Refuse an output that holds NaN or Inf; return its largest magnitude.

    Args:
        made: pixels or tiles.
        what: names the frame and what made it, for the message.
        remedy: what to try.

    Raises:
        NonfiniteError: says how many; the frame fails, and nothing is written of it.
    """
    largest = largest_magnitude(made)
    if math.isfinite(largest):
        return largest
    count = int((~torch.isfinite(made)).sum())
    raise NonfiniteError(
        f"{what} gave {count} NaN or Inf values, and nothing is written; try {remedy}", count
    )


@dataclass(frozen=True, kw_only=True)
class OutputFrame:
    """One frame to write.

    Attributes:
        path: the EXR; a preview goes beside it.
        color: linear radiance.
        alpha: coverage, written as `A`, or None.
        as_float: write `color` and `alpha` as float, since half cannot hold them.
        passed: channels written as they are.
        attributes: of the header.
        windows: where the pixels lie.
        colorspace: primaries of `color`, for pictures.
        previews: also write a PNG.
        debug: named pictures for a second EXR in `debug/`.
    """

    path: Path
    color: Color
    alpha: Image | None
    as_float: bool = False
    passed: Mapping[str, Plane] = field(default_factory=dict)
    attributes: Mapping[str, Any]
    windows: OutputWindows
    colorspace: ColorSpace | None = None
    previews: bool = False
    debug: Mapping[str, Image] | None = None

    def write(self) -> None:
        """Write EXR, picture and debug file; the EXR last, since it marks the frame as done.

        Raises:
            OutputError: a file cannot be written.
        """
        if self.previews:
            picture = encode_preview(self.color, self.colorspace)
            write_png(self.path.with_suffix(PREVIEW_SUFFIX), self.windows.blacken(picture))
        if self.debug:
            self._write_debug(split_debug_pictures(self.debug))
        channels = split_image("", self.color, "RGB", full=self.as_float)
        if self.alpha is not None:
            channels |= split_image("", self.alpha, "A", full=self.as_float)
        write_exr(
            self.path,
            self.windows.crop({**channels, **self.passed}),
            attributes=self.attributes,
            data_window=self.windows.kept,
            display_window=self.windows.display,
        )

    def _write_debug(self, channels: Mapping[str, NDArray[Any]]) -> None:
        """Write pictures of all that was computed; those of another size are a picture alone."""
        height, width = next(iter(channels.values())).shape
        data, display = self.windows.region, self.windows.display
        if (height, width) != (data.height, data.width):
            data = display = PixelWindow(left=0, top=0, width=width, height=height)
        path = name_debug_file(self.path)
        write_exr(
            path, channels, attributes=self.attributes, data_window=data, display_window=display
        )


def split_debug_pictures(pictures: Mapping[str, Image]) -> dict[str, NDArray[Any]]:
    """Lay pictures of the largest size out as layers; smaller ones are repeated up to it."""
    height = max(image.shape[-2] for image in pictures.values())
    channels: dict[str, NDArray[Any]] = {}
    for name, image in pictures.items():
        factor = height // image.shape[-2]
        large = image.repeat_interleave(factor, -2).repeat_interleave(factor, -1)
        letters = {1: "Y", 2: "XY", 3: "RGB", 4: "RGBA"}.get(large.shape[1])
        names = letters or "".join(chr(ord("a") + i) for i in range(large.shape[1]))
        full = large.is_floating_point() and largest_magnitude(large) > MAX_HALF
        channels |= split_image(name, large, names, full=full)
    return channels
