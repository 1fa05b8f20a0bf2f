"""Marked pixels that lie together, and what lies around them."""

from __future__ import annotations

import torch.nn.functional as F

from rtsr_cli.core.shapes import Mask, Plane

SIDE = 2
"""Pixels to each side of the smallest group: single ones are none, nor are rows and columns."""


def keep_groups(mask: Mask) -> Mask:
    """Keep what is part of 2 x 2 pixels that are all marked: a morphological opening.

    Args:
        mask: n 1 h w, booleans; h and w of 2 at least, else nothing is kept.

    Returns:
        The same size; never more than `mask` holds.
    """
    if min(mask.shape[-2:]) < SIDE:
        return mask & False
    whole = F.pad(-F.max_pool2d(-mask.float(), SIDE, 1), (SIDE - 1,) * 4)
    return F.max_pool2d(whole, SIDE, 1) > 0.5


def count_around(mask: Mask, reach: int) -> Plane:
    """How many pixels of the square around are marked."""
    side = 2 * reach + 1
    rows = F.avg_pool2d(mask.float(), (side, 1), 1, (reach, 0), divisor_override=1)
    return F.avg_pool2d(rows, (1, side), 1, (0, reach), divisor_override=1)


def spread_mask(mask: Mask, reach: int) -> Mask:
    """Mark the square around every marked pixel: a morphological dilation."""
    return F.max_pool2d(mask.float(), 2 * reach + 1, 1, reach) > 0.5
