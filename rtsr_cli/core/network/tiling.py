"""Predicting a large frame in tiles that agree with the whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import nn

from rtsr_cli.core.shapes import Color, Size
from rtsr_cli.core.system import FrameWindow, Prediction, State, System

MAX_UNTILED_PIXELS = 1920 * 1080
"""Outputs up to this size are predicted whole."""

TILE_PX = 256
"""Side of a tile in LR pixels: 1024 output pixels at 4x."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A tile of LR pixels, and the larger rectangle that it is predicted from."""

    top: int
    left: int
    size: Size
    outer_top: int
    outer_left: int
    outer_size: Size


def cut_tiles(size: Size, tile: int, halo: int) -> Iterator[Tile]:
    """Cut an LR frame into tiles; the halo ends at the frame's borders."""
    height, width = size
    for top in range(0, height, tile):
        for left in range(0, width, tile):
            h, w = min(tile, height - top), min(tile, width - left)
            outer_top, outer_left = max(0, top - halo), max(0, left - halo)
            bottom, right = min(height, top + h + halo), min(width, left + w + halo)
            yield Tile(
                top=top,
                left=left,
                size=(h, w),
                outer_top=outer_top,
                outer_left=outer_left,
                outer_size=(bottom - outer_top, right - outer_left),
            )


def crop_window(window: FrameWindow, tile: Tile) -> FrameWindow:
    """Return the part of a window that a tile is predicted from, at both resolutions."""
    scale = window.scale
    height, width = tile.outer_size
    hr = window.hr and window.hr.crop(
        tile.outer_top * scale, tile.outer_left * scale, (height * scale, width * scale)
    )
    lr = tuple(frame.crop(tile.outer_top, tile.outer_left, tile.outer_size) for frame in window.lr)
    return replace(window, lr=lr, hr=hr)


def choose_tile_side(system: System, size: Size, scale: int, requested: int | None) -> int | None:
    """Side of the tiles to use; None = the whole frame at once.

    Args:
        system: one with a state or an unbounded halo is never tiled.
        size: of the LR frame.
        scale: output pixels per LR pixel.
        requested: the user's choice, 0 = never tile, None = by the size.
    """
    if system.recurrent or system.halo_px is None or requested == 0:
        return None
    if requested is not None:
        return requested
    return TILE_PX if size[0] * size[1] * scale * scale > MAX_UNTILED_PIXELS else None


def predict_in_tiles(
    system: System, network: nn.Module, window: FrameWindow, state: State, tile: int | None
) -> Prediction:
    """Run a system on a window, in tiles if a side is given."""
    if tile is None or system.halo_px is None:
        return system.predict(network, window, state)
    scale = window.scale
    height, width = window.current.size
    image: Color | None = None
    for part in cut_tiles((height, width), tile, system.halo_px):
        predicted = system.predict(network, crop_window(window, part), None).image
        if predicted is None:
            return system.predict(network, window, state)
        if image is None:
            shape = (*predicted.shape[:2], height * scale, width * scale)
            image = torch.empty(shape, dtype=predicted.dtype, device=predicted.device)
        h, w = part.size
        top, left = (part.top - part.outer_top) * scale, (part.left - part.outer_left) * scale
        image[
            ...,
            part.top * scale : (part.top + h) * scale,
            part.left * scale : (part.left + w) * scale,
        ] = predicted[..., top : top + h * scale, left : left + w * scale]
    return Prediction(image=image)
