"""Which pixels of the image plane are read: one rule for every command.

Pixels lie where a file's data window lies in its display window, so that an autocropped frame and
the same frame uncropped are the same picture; where a file has no pixels, there is nothing: 0, and
depth is infinite. What is read of every frame is the image plane, and what a data window holds
beyond it (overscan). That depends on no other frame.

Display windows of one size at different origins hold the same picture if the data windows lie
alike in them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.files.pixel_window import PixelWindow


class RegionRule(StrEnum):
    """`region` of capture.toml: what is read of frames whose data and display windows differ."""

    DISPLAY = "display"
    DATA = "data"


@dataclass(frozen=True, kw_only=True)
class FilePlaces:
    """Where one file's pixels lie.

    Attributes:
        who: the file, for messages.
        display: its display window.
        places: of its channels, seen from the display window's first pixel.
    """

    who: str
    display: PixelWindow
    places: frozenset[PixelWindow]

    def at_scale(self, scale: int) -> FilePlaces:
        """Return the same places at `scale` times the resolution."""
        ratio = Fraction(scale)
        return FilePlaces(
            who=f"{self.who} (enlarged)",
            display=self.display.at_ratio(ratio),
            places=frozenset(place.at_ratio(ratio) for place in self.places),
        )

    def describe(self) -> str:
        """Name the file and both windows."""
        data = ", ".join(
            str(place.moved(self.display.left, self.display.top)) for place in self.places
        )
        return f"{self.who} has data window {data} in display window {self.display}"


def list_places(
    headers: Mapping[str, Mapping[int, ExrHeader]], binding: Binding
) -> list[FilePlaces]:
    """Say where the pixels of files lie, one file for all that are laid out alike.

    Args:
        headers: per file sequence and frame number.
        binding: channels that are read.
    """
    channels: dict[str, set[str]] = {}
    for component in (c for components in binding.values() for c in components):
        channels.setdefault(component.stream, set()).add(component.channel)
    alike: dict[tuple[PixelWindow, frozenset[PixelWindow]], FilePlaces] = {}
    for key, by_number in headers.items():
        for number, header in by_number.items():
            whole = not header.part_windows
            places = frozenset(
                [header.data_window.seen_from(header.display_window)]
                if whole
                else map(header.place_of, channels[key] & header.channels)
            )
            known = alike.get((header.display_window, places))
            if known is None:
                alike[header.display_window, places] = FilePlaces(
                    who=f"'{key}' frame {number}", display=header.display_window, places=places
                )
    return list(alike.values())


def find_region(files: Iterable[FilePlaces], root: str, rule: RegionRule | None) -> PixelWindow:
    """Return what is read of every frame, seen from the image plane's first pixel.

    Args:
        files: of a sequence.
        root: its folder, for messages.
        rule: as declared.

    Raises:
        FrameFolderError: display windows have several sizes, or origins that leave open where the
            pixels lie; frames differ in their overscan, or, where the data window is to be read,
            in that.
    """
    listed = list(files)
    _check_sizes(listed, root)
    check_origins(listed, root)
    plane = listed[0].display.seen_from(listed[0].display)
    if rule is RegionRule.DISPLAY:
        return plane
    regions = {_join(file, plane if rule is None else None): file for file in listed}
    if len(regions) > 1:
        one, other = list(regions.values())[:2]
        what = "hold different overscan" if rule is None else "have different data windows"
        raise FrameFolderError(
            f"{root}: files {what}: {one.describe()}, {other.describe()}; render them alike, or "
            'leave out what lies outside of the display window (capture.toml: region = "display")'
        )
    return next(iter(regions))


def describe_crop(files: Iterable[FilePlaces], region: PixelWindow) -> tuple[str, ...]:
    """Say that frames hold less than what is read, if one does: outputs hold no more than they."""
    for file in files:
        held = _join(file, None)
        if held != region:
            return (
                f"{file.describe()}: outputs hold those pixels, enlarged; what an enlargement "
                "spreads beyond them is cut off",
            )
    return ()


def _join(file: FilePlaces, plane: PixelWindow | None) -> PixelWindow:
    """Smallest rectangle around a file's pixels, and the image plane if it is given."""
    places = [*file.places, *([] if plane is None else [plane])]
    joined = places[0]
    for place in places[1:]:
        joined = joined.joined(place)
    return joined


def _check_sizes(files: list[FilePlaces], root: str) -> None:
    sizes = {(file.display.width, file.display.height): file for file in files}
    if len(sizes) > 1:
        names = ", ".join(f"{file.who} is {w} x {h}" for (w, h), file in sizes.items())
        raise FrameFolderError(
            f"{root}: sizes differ: {names}; all buffers and frames of one resolution need one size"
        )


def check_origins(files: Iterable[FilePlaces], root: str) -> None:
    """Raise where display windows have different origins, and data windows do not lie alike.

    Raises:
        FrameFolderError: names two files and their windows.
    """
    by_origin: dict[tuple[int, int], dict[PixelWindow, FilePlaces]] = {}
    for file in files:
        there = by_origin.setdefault((file.display.left, file.display.top), {})
        there.update(dict.fromkeys(file.places, file))
    first = next(iter(by_origin.values()), {})
    for there in by_origin.values():
        odd = next(iter(first.keys() ^ there.keys()), None)
        if odd is not None:
            one, other = next(iter(first.values())), next(iter(there.values()))
            raise FrameFolderError(
                f"{root}: it cannot be told where the pixels lie: {one.describe()}, but "
                f"{other.describe()}; give all files one display window, and data windows in it"
            )


@dataclass(frozen=True, kw_only=True)
class OutputWindows:
    """Where an output's pixels lie.

    Attributes:
        region: what is computed.
        display: the output's display window.
        kept: the part of `region` that the input frame has pixels for: the output's data window.
    """

    region: PixelWindow
    display: PixelWindow
    kept: PixelWindow

    def crop(self, planes: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Cut what is kept out of planes of the region's size."""
        return {name: plane[self._kept_slices] for name, plane in planes.items()}

    def blacken(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Blacken what is not kept in a picture of the region's size, which has no windows."""
        if self.kept == self.region:
            return picture
        shown = np.zeros_like(picture)
        shown[self._kept_slices] = picture[self._kept_slices]
        return shown

    @property
    def _kept_slices(self) -> tuple[slice, slice]:
        """Rows and columns of what is kept."""
        inside = self.kept.seen_from(self.region)
        return (
            slice(inside.top, inside.top + inside.height),
            slice(inside.left, inside.left + inside.width),
        )


def place_output(
    header: ExrHeader,
    channel: str,
    region: PixelWindow,
    ratio: Fraction,
    display: PixelWindow | None = None,
) -> OutputWindows:
    """Say where the output of a frame lies.

    Args:
        header: of the frame's own file.
        channel: of that file, whose data window the output's follows.
        region: what is read of it, seen from the image plane's first pixel.
        ratio: output pixels per pixel of the file.
        display: the output's display window; the file's own, at `ratio`, if None.
    """
    plane = display or header.display_window.at_ratio(ratio)
    place = header.place_of(channel)
    whole = region.at_ratio(ratio)
    kept = whole.common(place.at_ratio(ratio)) or whole
    return OutputWindows(
        region=whole.moved(plane.left, plane.top),
        display=plane,
        kept=kept.moved(plane.left, plane.top),
    )
