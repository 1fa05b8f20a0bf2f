"""Moving pixels from where a file holds them to the region that is read."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.files.exr import Plane
from rtsr_cli.core.files.pixel_window import PixelWindow


def find_common(region: PixelWindow, places: Iterable[PixelWindow]) -> PixelWindow | None:
    """Part of a region that all files have pixels for; None if there is none."""
    common: PixelWindow | None = region
    for place in places:
        common = None if common is None else common.common(place)
    return common


def _cut_out(region: PixelWindow, part: PixelWindow) -> tuple[slice, slice]:
    """Rows and columns of a part of a region."""
    inside = part.seen_from(region)
    return (
        slice(inside.top, inside.top + inside.height),
        slice(inside.left, inside.left + inside.width),
    )


def place_pixels(plane: Plane, place: PixelWindow, region: PixelWindow) -> Plane:
    """Move pixels from where they lie to the region that is read; 0 where none are."""
    if place == region:
        return plane
    placed = np.zeros((region.height, region.width), plane.dtype)
    common = region.common(place)
    if common is not None:
        placed[_cut_out(region, common)] = plane[_cut_out(place, common)]
    return placed


def clear_outside(
    image: Tensor, held: PixelWindow | None, region: PixelWindow, nothing: float
) -> Tensor:
    """Return an image that is `nothing` wherever no file has pixels."""
    if held == region:
        return image
    cleared = torch.full_like(image, nothing)
    if held is not None:
        rows, columns = _cut_out(region, held)
        cleared[..., rows, columns] = image[..., rows, columns]
    return cleared
