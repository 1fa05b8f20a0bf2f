"""HR pixels of the surfaces that LR samples lie on.

    p belongs to samples Q  <=>  near <= z(p) <= far  and  least <= m(p) <= most in all channels

with the least and largest depth z(q), and HR material m(q), of the q of Q within `LOST_REACH` of p,
wider by APART and LIKE, and depth by a share of its range. Normals turn at the very edges, where a
thing's pixels have no sample of their own: they tell nothing here. So it is the thing and its edge
that are found, not what is behind it.
"""

from __future__ import annotations

from itertools import product

import torch
import torch.nn.functional as F

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.guided_kernel import REACH as KERNEL_REACH
from rtsr_cli.core.imaging.mask_groups import spread_mask
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.shapes import Color, Image, Mask, Plane

LOST_REACH = 2 * KERNEL_REACH
"""LR pixels to each side of a sample in which HR pixels are looked at."""

APART, LIKE = 0.1, 1.5
"""Difference of depth within one surface that is seen at a slant, as a share of it, and ratio of
materials."""

BEYOND = 1.0 / (2 * LOST_REACH)
"""How much further a slope goes on than the samples: to the next one, of those across."""


def mark_surfaces(lr: Frame, hr: Frame, placed: Color, samples: Mask, scale: int) -> Mask:
    """True at HR pixels whose light cannot be had without some samples of their surface.

    Those are the pixels of the samples' surface, and those beside them that have no other lit
    sample of theirs within the kernel's reach; where a size stores no depth, all around.

    Args:
        lr: with sky; depth, and the mask of its lighting, where they are there.
        hr: with sky and material; depth where it is there.
        placed: HR material at the LR samples.
        samples: LR, True at those whose material is of no use.
        scale: S.
    """
    around = upsample_nearest(spread_mask(samples, LOST_REACH), scale)
    if Buffer.DEPTH not in lr.gbuffer or Buffer.DEPTH not in hr.gbuffer:
        return around
    depth, small = hr.gbuffer[Buffer.DEPTH], lr.gbuffer[Buffer.DEPTH]
    own = _lies_between(depth, small, samples, LOST_REACH, scale)
    own &= _is_like(hr.gbuffer[Buffer.MATERIAL], placed, samples, scale)
    others = (lr.gbuffer[Buffer.SKY] < 0.5) & ~samples
    if Buffer.LIGHTING_MASK in lr.gbuffer:
        others &= lr.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    around &= hr.gbuffer[Buffer.SKY] < 0.5
    return own & around | _find_alone(depth, small, others, around & ~own, scale)


def _find_alone(depth: Plane, small: Plane, samples: Mask, pixels: Mask, scale: int) -> Mask:
    """True at those of the pixels that no sample within the kernel's reach is as deep as."""
    rows, columns = pixels[0, 0].nonzero().T
    own = depth[0, 0, rows, columns]
    alone = torch.ones_like(own, dtype=torch.bool)
    height, width = small.shape[-2:]
    steps = range(-KERNEL_REACH, KERNEL_REACH + 1)
    for down, across in product(steps, steps):
        y = (rows // scale + down).clamp(0, height - 1)
        x = (columns // scale + across).clamp(0, width - 1)
        other = small[0, 0, y, x]
        near = (other - own).abs() <= APART * torch.minimum(other, own)
        alone &= ~(near & samples[0, 0, y, x])
    found = torch.zeros_like(pixels)
    found[0, 0, rows, columns] = alone
    return found


def _lies_between(depth: Plane, small: Plane, samples: Mask, reach: int, scale: int) -> Mask:
    """True at pixels whose depth is within those of the samples around; nowhere without any."""
    near, far = _find_range(small, samples, reach)
    beyond = BEYOND * (far - near).nan_to_num(0.0, 0.0, 0.0)
    near, far = (near - beyond) * (1.0 - APART), (far + beyond) * (1.0 + APART)
    return (depth >= upsample_nearest(near, scale)) & (depth <= upsample_nearest(far, scale))


def _is_like(material: Color, placed: Color, samples: Mask, scale: int) -> Mask:
    """True at pixels whose material is within those of HR at the samples around."""
    least, most = _find_range(placed, samples, LOST_REACH)
    least, most = upsample_nearest(least / LIKE, scale), upsample_nearest(most * LIKE, scale)
    return ((material >= least) & (material <= most)).all(1, keepdim=True)


def _find_range(values: Image, samples: Mask, reach: int) -> tuple[Image, Image]:
    """Least and largest value of the samples around; infinite and its negative without any."""
    least, most = (
        sign
        * F.max_pool2d((sign * values).masked_fill(~samples, -torch.inf), 2 * reach + 1, 1, reach)
        for sign in (-1.0, 1.0)
    )
    return least, most
