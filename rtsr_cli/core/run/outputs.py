"""Output frames: their names, their state on disk, and writing them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
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
from rtsr_cli.core.errors import NonfiniteError, OutputError
from rtsr_cli.core.files.exr import PixelWindow, Plane, write_exr
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.files.provenance import read_stamp
from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.frames.storage import MAX_HALF, largest_magnitude, split_image
from rtsr_cli.core.imaging.preview import encode_preview
from rtsr_cli.core.shapes import Color, Image

PREVIEW_SUFFIX = ".png"

HALF_BYTES, FLOAT_BYTES, HEADER_BYTES = 2, 4, 1 << 14
"""Sizes for estimates: of samples, and of all that is no pixel in a file, generously."""


class OutputState(StrEnum):
    """What is there before a frame is computed."""

    ABSENT = "absent"
    DONE = "done"
    FOREIGN = "foreign"


def name_output(reader: FrameReader, number: int) -> str:
    """`<name>.<frame>.exr` with the input's base name and digits (`0005.exr` without a name)."""
    source = reader.path(number)
    stem = source.name[: -len(source.suffix)]
    width = len(stem[len(reader.base) :].lstrip("._- "))
    digits = f"{'-' if number < 0 else ''}{abs(number):0{width}d}"
    return f"{reader.base}.{digits}.exr" if reader.base else f"{digits}.exr"


def name_debug_file(path: Path) -> Path:
    """Return the file of an output's debug pictures."""
    return path.parent / "debug" / path.name


def read_output_state(path: Path, stamp: str) -> OutputState:
    """Tell whether a file is there, and whether it is the one that would be written."""
    if not path.exists():
        return OutputState.ABSENT
    return OutputState.DONE if read_stamp(path) == stamp else OutputState.FOREIGN


def refuse_foreign(paths: list[Path], command: str) -> None:
    """Raise if files stand in the way that this run would not have written.

    Raises:
        OutputError: names the first and counts them.
    """
    if not paths:
        return
    more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    raise OutputError(
        f"{paths[0]}{more}: {command} did not write this from these inputs and settings; "
        "choose another folder, or replace with --overwrite"
    )


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
            write_png(
                self.path.with_suffix(PREVIEW_SUFFIX), encode_preview(self.color, self.colorspace)
            )
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
