"""Material that no surface reflects, and the rest of the surface that shows it.

    seeds: samples q of groups with  m(q) >= 2  in a channel (`MOST_MATERIAL`)
    b(q) = cov(log m, log r) / var(log m)   of the samples around q, all channels

with the material m, the lighting L and r = L m, radiance less emission. Where m is what light was
multiplied by b is about 1, and where radiance hardly follows it about 0: Mitsuba's `albedo` of a
conductor is the BRDF along the normal, 8 where a sphere faces the camera and 0 at its rim, which
looks the same. Samples that hang together with seeds go with them while b is below `LEAST_SLOPE`.
Of other surfaces b says little: light, too, is brighter here and darker there, by chance against
the texture.
"""

from __future__ import annotations

import math
from itertools import product

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MOST_MATERIAL
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.mask_groups import keep_groups, spread_mask
from rtsr_cli.core.pairs.held_samples import hold_samples
from rtsr_cli.core.pairs.material_removal import leave_bare, leave_undivided
from rtsr_cli.core.pairs.surface_reach import APART, mark_surfaces
from rtsr_cli.core.shapes import Mask

EXCESSIVE = "material is above 2, which no surface reflects (a pass that holds reflections?)"
"""What is said of those surfaces."""

LEAST_SLOPE = 0.5
"""Of radiance over material, below which it does not follow it."""

REACH = 2
"""Samples to each side of one that tell its slope, and in which samples hang together."""

MOST_STEPS = 32
"""How often what hangs together is followed."""

LEAST_SHARE = 0.3
"""Of the samples around one that are divided, to tell anything."""

LEAST_VARIANCE = 3 * math.log(1.1) ** 2
"""Of log m, all channels: flat material tells no slope."""

LEAST = 1e-3
"""Materials and radiance below are as good as this much."""


def leave_excessive(lr: Frame, hr: Frame, scale: int) -> tuple[Frame, Frame, Mask | None]:
    """Take material out of both frames where it is more than surfaces reflect, and beside it.

    Args:
        lr: with sky, material, lighting and its mask.
        hr: with sky and material.
        scale: S.

    Returns:
        The frames, and True at those samples; the very frames and None where there are none.
    """
    found = find_excessive(lr)
    if found is None:
        return lr, hr, None
    left = leave_undivided(lr, found)
    lost = mark_surfaces(left, hr, hold_samples(lr, hr, scale).placed, found, scale)
    return left, leave_bare(left, hr, lost, scale), found


def find_excessive(lr: Frame) -> Mask | None:
    """True at samples of surfaces whose material is above what any reflects; None of none."""
    material, divided = lr.gbuffer[Buffer.MATERIAL], lr.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    seeds = keep_groups((material >= MOST_MATERIAL).any(1, keepdim=True) & divided)
    if not bool(seeds.any()):
        return None
    alike = seeds | (divided & _does_not_follow(lr, divided))
    found = seeds
    for _ in range(MOST_STEPS):
        before, found = found, found | (alike & spread_mask(found, REACH))
        if torch.equal(before, found):
            break
    return found


def _does_not_follow(lr: Frame, divided: Mask) -> Mask:
    """True where b is below `LEAST_SLOPE`, of the samples around that are as deep."""
    material = lr.gbuffer[Buffer.MATERIAL].clamp(min=LEAST)
    x = material.log()
    y = (material * lr.gbuffer[Buffer.LIGHTING]).clamp(min=LEAST).log()
    depth = lr.gbuffer.buffers.get(Buffer.DEPTH, torch.ones_like(x[:, :1]))
    weight, one, other, square, both = (torch.zeros_like(x) for _ in range(5))
    around = (F.pad(image, (REACH,) * 4) for image in (x, y, depth, divided.to(x)))
    padded = torch.cat(list(around), 1)
    height, width = x.shape[-2:]
    side = 2 * REACH + 1
    for down, across in product(range(side), range(side)):
        there = padded[..., down : down + height, across : across + width]
        xs, ys, zs, lit = there[:, :3], there[:, 3:6], there[:, 6:7], there[:, 7:]
        w = lit * ((zs - depth).abs() <= APART * torch.minimum(zs, depth))
        weight, one, other = weight + w, one + w * xs, other + w * ys
        square, both = square + w * xs * xs, both + w * xs * ys
    count = weight.clamp(min=1.0)
    variance = (square / count - (one / count).square()).sum(1, keepdim=True)
    covariance = (both / count - one * other / count.square()).sum(1, keepdim=True)
    told = (weight[:, :1] >= LEAST_SHARE * side**2) & (variance > LEAST_VARIANCE)
    return told & (covariance < LEAST_SLOPE * variance)
