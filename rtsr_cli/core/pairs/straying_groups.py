"""Samples that stray in groups from the material of the pixels in which they lie.

Right samples stray singly, or in lines, on what is finer than pixels, joints of bricks and edges:
see `material_agreement`. So a sample begins a group only if, of the samples of its surface in the
5 x 5 around it,

    LEAST and a SHARE stray with it, and the sums of their materials are BIAS apart     (`STRONG`),

if it is one of 2 x 2 that all stray, and if no HR pixel of its surface in the 3 x 3 blocks around
is like it, nor around most of the group. Where the darker material is what a base colour of 0
leaves, and the other one is not, less will do (`WEAK`). Once there is a group, what strays beside
pixels as dark as its own goes with it. Things as thin as samples lie apart hold no 2 x 2: lines of
samples that are alone at their depth will do where base colours are known (`THIN`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.mask_groups import count_around, keep_groups, spread_mask
from rtsr_cli.core.pairs.held_samples import (
    APARTS,
    LIKE,
    TOLERANCE,
    HeldSamples,
    find_colours,
    gather_around,
    has_like,
    hold_at_depths,
    is_alike,
    is_near,
    mark_samples,
)
from rtsr_cli.core.pairs.surface_reach import LOST_REACH
from rtsr_cli.core.shapes import Color, Mask

LEAST_TELLING = 6
"""Samples of a tile, or on thin things, that must tell."""

REACH = 2
"""Samples to each side that are held together."""

MOST = 0.95
"""Share of a group's samples whose material is at most, or at least, that of single ones beside."""

MOST_ALIKE = 0.9
"""Share of a group's pixels that are as dark as those which go with it at most."""


class Strictness(NamedTuple):
    """What samples around must be like for a sample to count.

    Attributes:
        least: of its surface, that stray as it does.
        share: of those of its surface.
        bias: ratio of the sums of their materials at both sizes.
    """

    least: int
    share: float
    bias: float


STRONG, WEAK, THIN = Strictness(4, 0.7, 2.5), Strictness(4, 0.5, 1.6), Strictness(2, 0.7, 2.5)

LEAST_OF_THIN = 0.1
"""Samples on thin things that must stray in a frame, as a share of its height, and `LEAST_TELLING`
at least: of right frames one did."""


def find_groups(held: HeldSamples, bare: tuple[Mask, Mask], brighter: Mask, darker: Mask) -> Mask:
    """True at samples that stray in groups, whichever size's material is the darker one."""
    bare_lr, bare_there = bare[0], held.place(bare[1])
    sides = (
        (held.material, held.placed, brighter, bare_there & ~bare_lr),
        (held.placed, held.material, darker, bare_lr & ~bare_there),
    )
    found = torch.zeros_like(brighter)
    for one, other, strays, gone in sides:
        found |= _find_group(held, one, other, strays & held.told, gone)
    return found


def find_thin(held: HeldSamples, brighter: Mask, darker: Mask) -> Mask:
    """True at samples on things that are as thin as they lie apart: wires, leaves.

    Their normals turn from pixel to pixel: what is of them is found by depth alone. All samples at
    that depth stray, and no HR pixel at that depth around is like them. Reflectance turns with the
    normals, too, so that base colours must be known, and differ.
    """
    found = torch.zeros_like(brighter)
    needed = {Buffer.ALBEDO, Buffer.DEPTH}
    if any(needed - frame.gbuffer.keys() for frame in (held.lr, held.hr)):
        return found
    colour, there = (image.sum(1, keepdim=True) for image in find_colours(held))
    sides = (
        (held.material, held.placed, brighter, colour > THIN.bias * there),
        (held.placed, held.material, darker, there > THIN.bias * colour),
    )
    held = hold_at_depths(held)
    for one, other, strays, far in sides:
        picked = strays & far & held.told
        if int(picked.sum()) >= count_least(strays):
            found |= _find_thin_of(held, (one, other), strays, picked)
    return found


def _find_thin_of(
    held: HeldSamples, materials: tuple[Color, Color], strays: Mask, picked: Mask
) -> Mask:
    strays = strays & held.told
    where = picked[0, 0].nonzero()
    where = where[_hold_against_surroundings(held, materials, strays, where)(THIN)]
    alone = where[~has_like(held, where, LIKE)] if len(where) else where
    # else it is a texture that both sizes have
    if len(alone) < count_least(strays) or 2 * len(alone) <= len(where):
        return torch.zeros_like(strays)
    where = alone
    found = mark_samples(where, strays)
    alike = reduce(torch.logical_and, (_is_within(m, found) for m in materials))
    found |= strays & alike & spread_mask(found, LOST_REACH)
    # at edges samples lie in pixels of what is behind
    colour, placed = find_colours(held)
    like = _is_within(colour, found) & (held.lr.gbuffer[Buffer.SKY] < 0.5)
    agrees = like & is_near(colour, placed, LIKE)
    return found | (like & ~spread_mask(agrees, LOST_REACH))


def count_least(samples: Mask) -> float:
    """How many samples on thin things must stray in a frame."""
    return max(LEAST_TELLING, LEAST_OF_THIN * samples.shape[-2])


def _find_group(held: HeldSamples, bright: Color, dim: Color, strays: Mask, bare: Mask) -> Mask:
    """Strays that hang together, of materials `bright` at one size and `dim` at the other."""
    picked = (strays & (count_around(strays, REACH) >= WEAK.least))[0, 0].nonzero()
    passes = _hold_against_surroundings(held, (bright, dim), strays, picked)
    wide, gone = (mask[0, 0][picked[:, 0], picked[:, 1]] for mask in (keep_groups(strays), bare))
    begins = (passes(STRONG) & wide) | (passes(WEAK) & gone)
    if bool(begins.any()):
        begins[begins.clone()] = ~has_like(held, picked[begins], LIKE)
    if not bool(begins.any()):
        return torch.zeros_like(strays)
    groups = strays & spread_mask(mark_samples(picked[begins], strays), REACH)
    dark = dim[groups.expand_as(dim)].view(3, -1).sort(1).values
    darkest = dark[:, int(MOST_ALIKE * dark.shape[1])].view(1, 3, 1, 1)
    alike = strays & (dim <= darkest * TOLERANCE).all(1, keepdim=True)
    groups |= alike & spread_mask(mark_samples(picked[passes(WEAK)], strays) & alike, REACH)
    # and single ones beside: what is seen of the surface between other things
    like = strays & _is_within(bright, groups) & _is_within(dim, groups)
    groups |= like & spread_mask(groups, LOST_REACH)
    # of a texture that both sizes have most samples are like pixels around, though few are not;
    # where one size has no base colour it is no texture
    where = groups[0, 0].nonzero()
    alone = ~has_like(held, where, LIKE) | bare[0, 0][where[:, 0], where[:, 1]]
    return groups if 2 * int(alone.sum()) > len(alone) else torch.zeros_like(groups)


def _is_within(material: Color, groups: Mask) -> Mask:
    """True where a material is within what most of the groups' are."""
    return is_between(material, *find_range(material, groups))


def find_range(material: Color, groups: Mask) -> tuple[Tensor, Tensor]:
    """Least and largest material of most of the groups, 1 3 1 1."""
    values = material[groups.expand_as(material)].view(3, -1).sort(1).values
    last = values.shape[1] - 1
    least, most = (values[:, int(part * last)].view(1, 3, 1, 1) for part in (1 - MOST, MOST))
    return least, most


def is_between(material: Color, least: Tensor, most: Tensor) -> Mask:
    """True where a material lies within a range, 8 bits apart at most."""
    return ((material * TOLERANCE >= least) & (material <= most * TOLERANCE)).all(1, keepdim=True)


def _hold_against_surroundings(
    held: HeldSamples, materials: tuple[Color, Color], strays: Mask, picked: Tensor
) -> Callable[[Strictness], Tensor]:
    """Return what tells which of the picked samples (rows and columns, k 2) are strict enough."""
    told, strayed = (gather_around(mask, picked, REACH, 1) > 0.5 for mask in (held.told, strays))
    light, dark = (gather_around(m, picked, REACH, 1).sum(1, keepdim=True) for m in materials)
    surfaces = [told]
    if held.guides is not None:
        around = gather_around(held.guides, picked, REACH, 1)
        middle = around.shape[2] // 2
        own = around[:, :, middle : middle + 1]
        surfaces = [told & is_alike(around, own, apart) for apart in APARTS]

    def passes(asked: Strictness) -> Tensor:
        def passes_among(surface: Tensor) -> Tensor:
            count, hits = surface.sum(2), (strayed & surface).sum(2)
            more, less = ((image * surface).sum(2) for image in (light, dark))
            return (
                (hits >= max(asked.least, 1))
                & (hits >= asked.share * count)
                & (more > asked.bias * less)
            )

        return reduce(torch.logical_or, map(passes_among, surfaces))[:, 0]

    return passes
