"""Marked pixels that lie together."""

from __future__ import annotations

import torch.nn.functional as F

from rtsr_cli.core.shapes import Mask

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
