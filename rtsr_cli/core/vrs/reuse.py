"""Keeping a pixel of the frame before, moved to this one, instead of shading it again.

Cardoso et al. 2022 predict the error of that as they predict those of rates.
"""

from __future__ import annotations

from rtsr_cli.core.shapes import Color, Mask, TileMap
from rtsr_cli.core.system import Window
from rtsr_cli.core.vrs.errors import ErrorConfig, tile_errors
from rtsr_cli.core.vrs.reprojection import displayed, reprojected
from rtsr_cli.core.vrs.tiles import tile_max


def reuse_errors(window: Window, color: Color, config: ErrorConfig) -> TileMap:
    """True error of keeping the frame before; what it does not show is black.

    Args:
        window: the frame, and the one before.
        color: radiance of the frame.
        config: metric and tiles.
    """
    picture, _ = reprojected(window)
    return tile_errors(picture, displayed(color), config)


def reusable(window: Window, tile: int) -> Mask:
    """1 where the frame before shows every pixel of a tile."""
    _, seen = reprojected(window)
    return 1.0 - tile_max(1.0 - seen, tile)
