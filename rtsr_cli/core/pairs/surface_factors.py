"""Surfaces whose material at one size is a multiple of that at the other.

Around a sample, over those of its surface in the 5 x 5,

    m_lr = rho m_hr,    rho = sum m_lr m_hr / sum m_hr^2

is fitted, with m_hr(q) of the HR pixel in which q lies. There is a factor where rho is further from
1 than storage and textures of two sizes make it, and explains the difference:

    n (sum (m_lr - m)^2 - left) > SURE left,    left = sum (m_lr - rho m_hr)^2

for both m that right samples have: m_hr, and the mean of the pixels of their block, which a filter
leaves. The quotient is that of F tests, of one parameter: noise of textures, sampled elsewhere,
is as good as never so. Where LR material is filtered samples of mixed blocks tell nothing: it is no
mean of material, but material of means.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.guided_kernel import REACH
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.pairs.material_agreement import (
    MOST,
    TOLERANCE,
    HeldSamples,
    average_blocks,
    count_around,
    find_mixed,
    gather_around,
    has_like,
    hold_samples,
    is_alike,
    is_filtered,
    keep_own_surface,
    leave_bare,
    leave_undivided,
)
from rtsr_cli.core.pairs.surface_reach import LOST_REACH, mark_surfaces
from rtsr_cli.core.shapes import Color, Mask, Plane

FACTOR = 1.21
"""Least factor: twice what 8 bits, coarser textures and normals of half leave of material."""

SURE = 100.0
"""The quotient's bound: 10 standard errors of rho."""

LEAST = 4
"""Samples of a surface that tell a factor."""

LEAST_OF_HEIGHT = 0.2
"""Samples that count at least, as a share of the frame's height: strips that no pixel shows lie
along edges of right things, too; right frames of `rtsr synth` had 0.04 of it at most."""

LIKE = 1.5
LEVEL = 1.0 / 255.0
LOGF = math.log(FACTOR)
APART = 0.02
"""Difference of depth between samples of one surface, as a share of it."""

AT_ONCE = 1 << 14
"""Samples whose surroundings are held in memory."""

SCALED = "material differs by a factor between LR and HR (base colour changed at one size?)"
"""What is said of those samples."""


def leave_scaled(lr: Frame, hr: Frame, scale: int) -> tuple[Frame, Frame]:
    """Take material out of both frames where it differs by a factor, and lighting with it.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided; normal and depth
            where they are there.
        hr: with sky and material; normal and depth where they are there.
        scale: S.

    Returns:
        The frames; the very ones where there is no factor.
    """
    scaled = find_scaled(lr, hr, scale)
    if scaled is None:
        return lr, hr
    held = _hold_all(hold_samples(lr, hr, scale))
    whole, lost = _follow_far(held, scaled), scaled
    left = leave_undivided(lr, whole)
    lost = mark_surfaces(left, hr, held.placed, scaled, scale)
    lost |= _mark_far(left, hr, held, scaled, scale)
    return left, leave_bare(lr, hr, lost, scale)


def _follow_far(held: HeldSamples, found: Mask) -> Mask:
    """Add samples of the same material that are not of HR's: at edges, and of the same elsewhere."""
    lr = held.lr.gbuffer
    own, placed = held.material, held.placed
    strays = ((own > FACTOR * placed) | (placed > FACTOR * own)).any(1, keepdim=True)
    strays |= held.place(held.hr.gbuffer[Buffer.SKY]) > 0.5
    strays &= lr[Buffer.SKY] < 0.5
    like = strays & is_within(own, found) & (is_within(placed, found) | _spread(found, LOST_REACH))
    return found | like


def _mark_far(lr: Frame, hr: Frame, held: HeldSamples, found: Mask, scale: int) -> Mask:
    """True at HR pixels of the same material beside which no sample agrees with HR."""
    own, placed = held.material, held.placed
    agrees = ~((own > FACTOR * placed) | (placed > FACTOR * own)).any(1, keepdim=True)
    agrees &= is_within(placed, found) & held.told
    beside = upsample_nearest(_spread(agrees, REACH), scale)
    return is_within_of(hr.gbuffer[Buffer.MATERIAL], placed, found) & (hr.gbuffer[Buffer.SKY] < 0.5) & ~beside


def is_within(material: Color, groups: Mask) -> Mask:
    return is_within_of(material, material, groups)


def is_within_of(material: Color, known: Color, groups: Mask) -> Mask:
    """True where a material is within what most of the groups' are."""
    values = known[groups.expand_as(known)].view(3, -1).sort(1).values
    last = values.shape[1] - 1
    least, most = (values[:, int(part * last)].view(1, 3, 1, 1) for part in (1 - MOST, MOST))
    return ((material * TOLERANCE >= least) & (material <= most * TOLERANCE)).all(1, keepdim=True)


def _spread(mask: Mask, reach: int) -> Mask:
    return F.max_pool2d(mask.float(), 2 * reach + 1, 1, reach) > 0.5


def find_scaled(lr: Frame, hr: Frame, scale: int) -> Mask | None:
    """True at LR samples whose surface has a multiple of HR's material; None where none has."""
    held = _hold_all(hold_samples(lr, hr, scale))
    picked = _pick_groups(held)
    # the pixels at their places tell all of most frames
    if not bool(picked.any()):
        return None
    held = keep_own_surface(held)
    means = average_blocks(hr, scale).clamp(min=LEVEL)
    if is_filtered(held, means):
        held = replace(held, told=held.told & ~find_mixed(hr, scale, FACTOR))
    found = torch.zeros_like(held.told)
    alone = torch.zeros_like(held.told)
    factors = torch.ones_like(held.placed)
    where = (picked & held.told)[0, 0].nonzero()
    for some in torch.split(where, AT_ONCE):
        rho, sure, lone = _fit(held, means, some)
        rows, columns = some[sure].T
        found[0, 0, rows, columns] = True
        factors[0, :, rows, columns] = rho[sure].T
        rows, columns = some[lone].T
        alone[0, 0, rows, columns] = True
    found &= alone | (count_around(found, REACH) >= LEAST)
    if int(found.sum()) < LEAST_OF_HEIGHT * found.shape[-2]:
        return None
    return _follow(held, found, factors)


def _hold_all(held: HeldSamples) -> HeldSamples:
    """The samples with material up from `LEVEL`, those with a channel below it as well."""
    lr, sky = held.lr.gbuffer, held.place(held.hr.gbuffer[Buffer.SKY])
    told = (lr[Buffer.SKY] < 0.5) & (sky < 0.5)
    for material in (held.material, held.placed):
        told &= (material > LEVEL).any(1, keepdim=True)
    if Buffer.LIGHTING_MASK in lr:
        told &= lr[Buffer.LIGHTING_MASK] > 0.5
    material = {Buffer.MATERIAL: held.material.clamp(min=LEVEL)}
    small = replace(held.lr, gbuffer=lr.with_buffers(material))
    return replace(held, lr=small, placed=held.placed.clamp(min=LEVEL), told=told)


def _pick_groups(held: HeldSamples) -> Mask:
    """Samples in groups that have more than HR, or less, by `FACTOR` at least, in a channel."""
    own, placed = held.material, held.placed
    more, less = held.told & (own > FACTOR * placed), held.told & (placed > FACTOR * own)
    if not bool(more.any() | less.any()):
        return torch.zeros_like(held.told)
    at_more, at_less = (count_around(way, REACH) for way in (more, less))
    picked = more & (at_more >= LEAST) & (at_more > at_less)
    picked |= less & (at_less >= LEAST) & (at_less > at_more)
    return picked.any(1, keepdim=True)


def _fit(held: HeldSamples, means: Color, picked: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Factor of each picked sample's surface in every channel, and whether there is one for sure."""
    own, placed, mean = (
        gather_around(image, picked, REACH, 1) for image in (held.material, held.placed, means)
    )
    surface = gather_around(held.told, picked, REACH, 1) > 0.5
    if held.guides is not None:
        around = gather_around(held.guides, picked, REACH, 1)
        middle = around.shape[2] // 2
        surface &= is_alike(around, around[:, :, middle : middle + 1], APART)
    factor, sure = _fit_surface(own, placed, mean, surface)
    alone = sure & ~_seems_like(own, placed, surface)
    alone[alone.clone()] = ~has_like(held, picked[alone])
    return factor, sure, alone


def _seems_like(own: Tensor, placed: Tensor, surface: Tensor) -> Tensor:
    """Whether a sample around is of the material that the middle one's pixel has at HR."""
    middle = own.shape[2] // 2
    here = placed[:, :, middle : middle + 1]
    like = surface & ((own <= LIKE * here) & (here <= LIKE * own)).all(1, keepdim=True)
    return like.any(2)[:, 0]


def _list_alike(own: Tensor, placed: Tensor) -> Iterator[Tensor]:
    """Of what samples around may be: what is of one material at HR, or at LR."""
    middle = own.shape[2] // 2
    for image in (placed, own):
        here = image[:, :, middle : middle + 1]
        yield ((image <= LIKE * here) & (here <= LIKE * image)).all(1, keepdim=True)


def _fit_surface(own: Tensor, placed: Tensor, mean: Tensor, surface: Tensor) -> tuple[Tensor, Tensor]:
    weight = surface.to(own)
    count = weight.sum(2)

    def add_up(values: Tensor) -> Tensor:
        return (weight * values).sum(2)

    squares = add_up(placed * placed)
    rho = add_up(own * placed) / squares
    left = add_up((own - rho.unsqueeze(2) * placed) ** 2)
    least = torch.minimum(add_up((own - placed) ** 2), add_up((own - mean) ** 2))
    # sums tell what is so of all of them, not of the brightest
    bias = add_up(own) / add_up(placed)
    far = (torch.minimum(rho, bias) > FACTOR) | (torch.maximum(rho, bias) * FACTOR < 1.0)
    sure = far & (count * (least - left) > SURE * left)
    # and of a surface whose texture is another: the ratio's mean, beside what it varies by
    logs = [(own / other.clamp(min=LEVEL)).log() for other in (placed, mean)]
    middles = [add_up(log) / count for log in logs]
    spreads = [add_up((log - middle.unsqueeze(2)) ** 2) / count for log, middle in zip(logs, middles, strict=True)]
    other = middles[0] * middles[1] > 0.0
    for middle, spread in zip(middles, spreads, strict=True):
        other &= (middle.abs() > LOGF) & (count * middle ** 2 > SURE * spread)
    factor = torch.where(other, middles[0].exp(), rho)
    return factor, ((sure | other) & (count >= LEAST)).any(1)


def _follow(held: HeldSamples, found: Mask, factors: Color) -> Mask:
    """Add samples beside, which the factor there explains better than none: an edge."""
    count = count_around(found, REACH)
    rho = count_around(factors * found, REACH) / count.clamp(min=1)
    own, placed = held.material, held.placed
    better = ((own - rho * placed) ** 2).sum(1, keepdim=True) < ((own - placed) ** 2).sum(
        1, keepdim=True
    )
    return found | (held.told & better & (count > 0))
