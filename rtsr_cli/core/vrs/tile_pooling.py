"""Pooling pixels into tiles; a tile that reaches beyond the frame holds what lies within."""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import Pool
from rtsr_cli.core.shapes import Image, Size, TileMap


def pad_to_tiles(image: Image, side: int, value: float = 0.0) -> Image:
    """Fill the frame up to whole tiles."""
    height, width = image.shape[-2:]
    return F.pad(image, (0, -width % side, 0, -height % side), value=value)


def tile_max(image: Image, side: int) -> TileMap:
    """Largest value of each tile; values are at least 0."""
    return F.max_pool2d(pad_to_tiles(image, side), side)


def tile_mean(image: Image, side: int) -> TileMap:
    """Mean of each tile."""
    total = F.avg_pool2d(pad_to_tiles(image, side), side)
    share = F.avg_pool2d(pad_to_tiles(image.new_ones(1, 1, *image.shape[-2:]), side), side)
    return total / share


def pixel_shares(size: Size, side: int, like: Tensor) -> TileMap:
    """Share of the frame's pixels that each tile holds: those at the border may hold fewer."""
    inside = F.avg_pool2d(pad_to_tiles(like.new_ones(1, 1, *size), side), side)
    return inside / inside.sum()


def pool_tiles(image: Image, side: int, pool: Pool) -> TileMap:
    """Pool by name."""
    return tile_max(image, side) if pool is Pool.MAX else tile_mean(image, side)
