"""Base colours of 0 that one size alone stores: what is left is a specular term."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.mask_groups import keep_groups, spread_mask
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.pairs.held_samples import (
    APART_THERE,
    HeldSamples,
    hold_samples,
    is_alike,
    keep_own_surface,
    mark_samples,
)
from rtsr_cli.core.pairs.material_causes import DARKER_AT_HR, DARKER_AT_LR, UNSAID
from rtsr_cli.core.pairs.material_removal import leave_bare, leave_undivided
from rtsr_cli.core.pairs.straying_groups import REACH
from rtsr_cli.core.pairs.surface_reach import LOST_REACH
from rtsr_cli.core.shapes import Mask

CHANCE, LEAST_INSIDE = 1e-6, 4
"""Least probability of what may be chance, and the samples in bare pixels that it takes."""

BESIDE_PX = (1, 2, 3)
"""HR pixels to each side in which other parts of a surface are looked for."""


def leave_colourless(
    lr: Frame, hr: Frame, scale: int, held: HeldSamples | None = None
) -> tuple[Frame, Frame, dict[str, Mask]]:
    """Take material out where a base colour of 0 is stored at one size alone, however small it is.

    HR pixels without base colour beside which no sample is without, though some would be, are
    enlarged as radiance, unless others of their surface beside them have some: joints of bricks.
    Samples without one beside which no pixel of the 3 x 3 blocks lacks one are left out.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided.
        hr: with sky and material.
        scale: S.
        held: what `hold_samples` finds of these frames, if that is known.

    Returns:
        The frames, and where that was so, as LR masks by what is said of it, single ones by
        `UNSAID`; the very frames and nothing where a size stores no base colour, or both agree.
    """
    if Buffer.ALBEDO not in lr.gbuffer or Buffer.ALBEDO not in hr.gbuffer:
        return lr, hr, {}
    held = held or hold_samples(lr, hr, scale)
    if not any(bool(bare.any()) for bare in held.bare):
        return lr, hr, {}
    bare_lr, bare_hr = (
        bare & (frame.gbuffer[Buffer.SKY] < 0.5)
        for bare, frame in zip(held.bare, (lr, hr), strict=True)
    )
    if not bool(bare_hr.any()) and not bool(bare_lr.any()):
        return lr, hr, {}
    hidden = _find_hidden(held, bare_lr, bare_hr)
    in_block = F.max_pool2d(bare_hr.float(), scale) > 0.5
    alone = bare_lr & ~spread_mask(in_block, 1)
    material = hr.gbuffer[Buffer.MATERIAL]
    doubted: dict[str, Mask] = {}
    if bool((hidden & (material > MATERIAL_EPSILON).all(1, keepdim=True)).any()):
        hr = leave_bare(lr, hr, hidden, scale)
        doubted[DARKER_AT_HR] = F.max_pool2d(hidden.float(), scale) > 0.5
    if bool(alone.any()):
        lr = leave_undivided(lr, alone)
        doubted[DARKER_AT_LR] = alone
    return lr, hr, {_name_group(cause, mask): mask for cause, mask in doubted.items()}


def _name_group(cause: str, mask: Mask) -> str:
    """The cause; none of single ones, which lie on lines that no pixel's centre is on."""
    return cause if bool(keep_groups(mask).any()) else UNSAID


def _find_hidden(held: HeldSamples, bare_lr: Mask, bare_hr: Mask) -> Mask:
    """True at HR pixels without base colour of which samples would be, if it were so.

    Not every sample in such a pixel is: lines are finer. What tells is a sample with colour all
    around which pixels have none, or that too few of all the frame's samples have none for chance.
    """
    scale = held.scale
    coloured = (held.lr.gbuffer[Buffer.SKY] < 0.5) & ~bare_lr
    inside = held.place(bare_hr) & coloured
    if not bool(inside.any()):
        return torch.zeros_like(bare_hr)
    unseen = bare_hr & ~upsample_nearest(spread_mask(bare_lr, REACH), scale)
    whole = F.max_pool2d(-F.pad(bare_hr.float(), (1,) * 4), 3, 1) < -0.5
    sure = held.place(whole) & coloured & keep_own_surface(replace(held, told=inside)).told
    if _is_by_chance(float(bare_hr.sum()) / scale**2, int(bare_lr.sum()), int(inside.sum())):
        unseen &= upsample_nearest(spread_mask(sure, LOST_REACH), scale)
    return keep_whole_surfaces(held.hr.gbuffer, bare_hr, unseen)


def _is_by_chance(expected: float, seen: int, inside: int) -> bool:
    """Whether so few samples can be bare though so many of the HR pixels are [Chernoff].

        P(X <= x) <= exp(x - e - x ln(x / e)),    X of Poisson's distribution, with the mean e

    Where none even lies in such a pixel, grids of samples and of lines run side by side.
    """
    if seen >= expected or inside < LEAST_INSIDE:
        return True
    log_ratio = math.log(seen / expected) if seen else 0.0
    return seen - expected - seen * log_ratio > math.log(CHANCE)


def keep_whole_surfaces(gbuffer: GBuffer, bare: Mask, hidden: Mask) -> Mask:
    """Keep HR pixels beside which nothing of their surface has a base colour; none where surfaces
    cannot be told apart.
    """
    picked = hidden[0, 0].nonzero()
    parts = (Buffer.NORMAL, Buffer.DEPTH)
    if not len(picked) or any(part not in gbuffer for part in parts):
        return torch.zeros_like(hidden)
    guides = torch.cat([gbuffer[part] for part in parts], 1)
    last = torch.tensor(hidden.shape[-2:]) - 1
    own = guides[..., picked[:, 0], picked[:, 1]]
    coloured = torch.zeros(len(picked), dtype=torch.bool)
    for step, across, down in product(BESIDE_PX, (-1, 0, 1), (-1, 0, 1)):
        rows, columns = (picked + step * torch.tensor([down, across])).clamp(min=0).minimum(last).T
        alike = is_alike(own, guides[..., rows, columns], APART_THERE)[0, 0]
        coloured |= alike & ~bare[0, 0, rows, columns]
    return mark_samples(picked[~coloured], hidden)
