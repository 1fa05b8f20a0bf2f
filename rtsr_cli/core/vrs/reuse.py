"""Keeping a pixel of the frame before, moved to this one, instead of shading it again.

Cardoso et al. 2022 predict the error of that as they predict those of rates.
"""

from __future__ import annotations

from rtsr_cli.core.shapes import Color, TileMap
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.core.vrs.reprojection import encode_display, reproject
from rtsr_cli.core.vrs.shading_error import ErrorConfig, tile_errors
from rtsr_cli.core.vrs.tile_pooling import tile_mean


def reuse_errors(window: FrameWindow, color: Color, config: ErrorConfig) -> TileMap:
    """True error of keeping the frame before; what it does not show is black.

    Args:
        window: the frame, and the one before.
        color: radiance of the frame.
        config: metric and tiles.
    """
    return tile_errors(reproject(window).picture, encode_display(color), config)


def seen_share(window: FrameWindow, tile: int) -> TileMap:
    """Share of a tile's pixels that the frame before shows."""
    return tile_mean(reproject(window).seen, tile)
