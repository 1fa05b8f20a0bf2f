"""HR pixels of the surfaces that LR samples lie on.

    p belongs to samples Q  <=>  near <= z(p) <= far, with
    near, far = least and largest z(q) of the q of Q within REACH of p, wider by a share of both's
                difference, and of themselves

Depth alone tells: normals turn at the very edges, where a thing's pixels have no sample of their
own. So it is the thing and its edge that are found, not what is behind it.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.guided_kernel import REACH as KERNEL_REACH
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.shapes import Mask, Plane

LOST_REACH = 2 * KERNEL_REACH
"""LR pixels to each side of a sample in which HR pixels are looked at."""

APART = 0.02
"""Difference of depth within one surface, as a share of it: what the kernel lets pass."""

BEYOND = 1.0 / (2 * LOST_REACH)
"""How much further a slope goes on than the samples: to the next one, of those across."""


def mark_surfaces(lr: Frame, hr: Frame, samples: Mask, scale: int) -> Mask:
    """True at HR pixels whose light cannot be had without some samples of their surface.

    Those are the pixels of the samples' surface, and those beside them that have no other lit
    sample of theirs within the kernel's reach; where a size stores no depth, all around.

    Args:
        lr: with sky; depth, and the mask of its lighting, where they are there.
        hr: with sky; depth where it is there.
        samples: LR, True at those whose material is of no use.
        scale: S.
    """
    around = upsample_nearest(_spread(samples, LOST_REACH), scale)
    if Buffer.DEPTH not in lr.gbuffer or Buffer.DEPTH not in hr.gbuffer:
        return around
    depth, small = hr.gbuffer[Buffer.DEPTH], lr.gbuffer[Buffer.DEPTH]
    own = _lies_between(depth, small, samples, LOST_REACH, scale)
    others = (lr.gbuffer[Buffer.SKY] < 0.5) & ~samples
    if Buffer.LIGHTING_MASK in lr.gbuffer:
        others &= lr.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    lit = _lies_between(depth, small, others, KERNEL_REACH, scale)
    return around & (own | ~lit) & (hr.gbuffer[Buffer.SKY] < 0.5)


def _lies_between(depth: Plane, small: Plane, samples: Mask, reach: int, scale: int) -> Mask:
    """True at pixels whose depth is within those of the samples around."""
    side = 2 * reach + 1
    far, near = (
        sign * F.max_pool2d((sign * small).masked_fill(~samples, -torch.inf), side, 1, reach)
        for sign in (1.0, -1.0)
    )
    # where no sample is around far is below near, and nothing lies between
    beyond = BEYOND * (far - near)
    near, far = ((near - beyond) * (1.0 - APART), (far + beyond) * (1.0 + APART))
    none = ~_spread(samples, reach)
    near = near.masked_fill(none, torch.inf)
    return (depth >= upsample_nearest(near, scale)) & (depth <= upsample_nearest(far, scale))


def _spread(mask: Mask, reach: int) -> Mask:
    return F.max_pool2d(mask.float(), 2 * reach + 1, 1, reach) > 0.5
