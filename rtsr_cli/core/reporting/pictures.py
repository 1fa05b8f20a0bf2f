"""What a report shows: pictures of single frames, their worst region, and strips over time."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """An encoded picture.

    Args:
        data: the bytes of the file.
        mime: what they are, `image/png`, `image/jpeg` or `image/webp`.
        width: columns.
        height: rows.
    """

    data: bytes
    mime: str
    width: int
    height: int

    def uri(self) -> str:
        """The picture as a data URI."""
        return f"data:{self.mime};base64,{base64.b64encode(self.data).decode('ascii')}"


@dataclass(frozen=True)
class Crop:
    """A cut-out of a moment, a pixel of the frame a pixel of the picture.

    Args:
        box: left, top, width, height in pixels of the frame.
        reference: the cut-out of the reference.
        tests: that of every method, by its name.
        heat: that of the methods' FLIP maps.
    """

    box: tuple[int, int, int, int]
    reference: Picture
    tests: Mapping[str, Picture]
    heat: Mapping[str, Picture]


@dataclass(frozen=True)
class Moment:
    """The pictures of one frame.

    Args:
        shot: name of the shot, "" where there is only one.
        frame: number of the frame.
        why: why it is shown, in words.
        reference: the reference; it may hold fewer pixels than the frame.
        tests: every method's picture, by its name; one may be missing.
        heat: the methods' FLIP maps, 0 to 1 through the colours of `metrics.heat_map`.
        crop: the worst region, or None.
        size: width and height of the frame in pixels; None = those of `reference`.
    """

    shot: str
    frame: int
    why: str
    reference: Picture
    tests: Mapping[str, Picture]
    heat: Mapping[str, Picture]
    crop: Crop | None = None
    size: tuple[int, int] | None = None


@dataclass(frozen=True)
class Strip:
    """One row of pixels over all frames: x to the right, time downwards, a frame a row.

    Args:
        shot: name of the shot, "" where there is only one.
        row: which row of the frame it is, counted from the top.
        reference: the strip of the reference.
        tests: that of every method, by its name.
    """

    shot: str
    row: int
    reference: Picture
    tests: Mapping[str, Picture]
