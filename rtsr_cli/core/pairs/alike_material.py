"""What else is of a material that differs between the sizes, once some samples of it are found.

Samples at edges of a thing lie in HR pixels of what is behind it, and tell nothing by themselves;
of leaves and wires a few tell, and most do not. So samples go with those found that are not as HR
is at their places, are of their material, and lie near them, or in pixels that are of theirs, or
where no HR pixel around is of it. HR pixels go with them that are of their pixels' material, and
have no sample beside that is as HR is there, and like them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.mask_groups import spread_mask
from rtsr_cli.core.pairs.held_samples import (
    LIKE,
    TOLERANCE,
    HeldSamples,
    has_like,
    is_filtered,
    is_near,
    keep_own_surface,
)
from rtsr_cli.core.pairs.material_removal import leave_bare, leave_undivided
from rtsr_cli.core.pairs.straying_groups import REACH
from rtsr_cli.core.pairs.surface_reach import LOST_REACH, mark_surfaces
from rtsr_cli.core.shapes import Color, Image, Mask

LEVEL = 1.0 / 255.0
"""What 8 bits tell apart: material below it is held to be it."""

AT_ONCE = 1 << 14
"""Pixels that are held against the found samples at once."""


def leave_alike(
    held: HeldSamples, left: Frame, bare: Frame, found: Mask, scale: int
) -> tuple[Frame, Frame, Mask]:
    """Take material out of what is like samples that were found.

    Args:
        held: the samples of the frames before any was taken out; of `hold_all`.
        left, bare: LR and HR frames, without that of the samples found.
        found: True at those.
        scale: S.

    Returns:
        The frames, and True at all samples that are left undivided.
    """
    if is_filtered(held, held.means):
        return left, bare, found
    differs = find_differing(held.material, held.placed, TOLERANCE)
    like, known = _find_samples(held, found, differs)
    agrees = held.told & ~find_differing(held.material, held.placed, LIKE) & ~like
    if bool((like & ~found).any()):
        left = leave_undivided(left, like & ~found)
    lost = _find_pixels(held, bare, known, agrees, scale)
    if bool((known & ~found).any()):
        lost |= mark_surfaces(left, held.hr, held.placed, known & ~found, scale)
    if bool(lost.any()):
        bare = leave_bare(left, bare, lost, scale)
    return left, bare, found | like


def hold_all(held: HeldSamples) -> HeldSamples:
    """Hold samples against pixels up from `LEVEL`, those with a channel below it as well."""
    lr = held.lr.gbuffer
    own, placed = (image.clamp(min=LEVEL) for image in (held.material, held.placed))
    told = (lr[Buffer.SKY] < 0.5) & (held.place(held.hr.gbuffer[Buffer.SKY]) < 0.5)
    told &= (own.amax(1, keepdim=True) > LEVEL) & (placed.amax(1, keepdim=True) > LEVEL)
    if Buffer.LIGHTING_MASK in lr:
        told &= lr[Buffer.LIGHTING_MASK] > 0.5
    clamped = replace(held.lr, gbuffer=lr.with_buffers({Buffer.MATERIAL: own}))
    return replace(held, lr=clamped, placed=placed, told=told)


def find_differing(one: Color, other: Color, ratio: float) -> Mask:
    """True where a channel of materials is further apart than a ratio."""
    return ~is_near(one, other, ratio)


def _find_samples(held: HeldSamples, found: Mask, differs: Mask) -> tuple[Mask, Mask]:
    """Samples of found ones' material that are not as HR is at their places, or in their blocks.

    And those among them whose pixels are of their thing: at edges they are of what is behind it.
    """
    lr, own, placed = held.lr.gbuffer, held.material, held.placed
    strays = differs & find_differing(own, held.means, TOLERANCE)
    strays |= held.place(held.hr.gbuffer[Buffer.SKY]) > 0.5
    strays &= (lr[Buffer.SKY] < 0.5) & ~found
    if Buffer.LIGHTING_MASK in lr:
        # the material of what is not divided is 1
        strays &= lr[Buffer.LIGHTING_MASK] > 0.5
    like = _is_near_some(own, strays, own, found)
    both = torch.cat([own, placed], 1)
    near = spread_mask(found, LOST_REACH)
    alone = _is_near_some(both, like, both, found)
    # and what is so nowhere around at HR
    picked = (like & ~alone)[0, 0].nonzero()
    rows, columns = picked[~has_like(held, picked, TOLERANCE)].T if len(picked) else picked.T
    alone[0, 0, rows, columns] = True
    return found | (like & near) | alone, found | (alone & keep_own_surface(held).told)


def _find_pixels(held: HeldSamples, hr: Frame, found: Mask, agrees: Mask, scale: int) -> Mask:
    """HR pixels of found ones' material that no sample beside agrees with."""
    material = hr.gbuffer[Buffer.MATERIAL]
    like = (hr.gbuffer[Buffer.SKY] < 0.5) & (material > 0.0).any(1, keepdim=True)
    material = material.clamp(min=LEVEL)
    like = _is_near_some(material, like, held.placed, found)
    rows, columns = like[0, 0].nonzero().T
    own = material[:, :, rows, columns]
    height, width = found.shape[-2:]
    alone = torch.ones_like(rows, dtype=torch.bool)
    for down, across in product(range(-REACH, REACH + 1), repeat=2):
        y = (rows // scale + down).clamp(0, height - 1)
        x = (columns // scale + across).clamp(0, width - 1)
        near = is_near(own, held.placed[:, :, y, x], TOLERANCE)[0, 0]
        alone &= ~(near & agrees[0, 0, y, x])
    like[0, 0, rows, columns] = alone
    return like


def _is_near_some(image: Image, where: Mask, known: Image, found: Mask) -> Mask:
    """True, of where that is asked, where `known` of found samples is as materials of one surface
    are: within a ratio in every channel."""
    step = math.log(TOLERANCE)
    values = (known[0][:, found[0, 0]].log().T * (2.0 / step)).round()
    values = torch.from_numpy(np.unique(values.numpy(), axis=0)) / 2.0
    rows, columns = where[0, 0].nonzero().T
    own = image[0][:, rows, columns].log().div(step).T
    near = torch.zeros_like(rows, dtype=torch.bool)
    for part in torch.split(torch.arange(len(rows)), AT_ONCE):
        for some in torch.split(values, 64):
            apart = (own[part, None] - some[None]).abs().amax(2)
            near[part] |= (apart <= 1.0).any(1)
    marked = torch.zeros_like(where)
    marked[0, 0, rows, columns] = near
    return marked
