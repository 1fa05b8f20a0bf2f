"""Surfaces whose material at one size is another than that at the other, in some channel.

Around a sample, over those of its surface in the 5 x 5, a factor is fitted in every channel,

    m_lr = rho m_hr,    rho = sum m_lr m_hr / sum m_hr^2

with m_hr(q) of the HR pixel in which q lies. There is one where rho is further from 1 than storage
and textures of two sizes make it, and explains the difference:

    n (sum (m_lr - m)^2 - left) > sure(n) left,    left = sum (m_lr - rho m_hr)^2

for both m that right samples have: m_hr, and the mean of the pixels of their block, which a filter
leaves. The quotient is that of F tests, of one parameter: noise of textures, sampled elsewhere,
is as good as never so. Where one size has another texture, or none, no factor explains much, but
the ratio's logarithm l is far from 0 beside what it varies by:

    |mean l| > log FACTOR,    n (mean l)^2 > sure(n) (mean l^2 - (mean l)^2)

Both quotients are squares of Student's t, whose tail beyond x of n - 1 degrees of freedom is about
(1 + x^2 / (n - 1))^(-(n - 1) / 2): few samples of a fine texture agree on a factor by chance.

    sure(n) = max(SURE, (n - 1) (CHANCE^(-2 / (n - 1)) - 1))

Where LR material is filtered samples of mixed blocks tell nothing: it is no mean of material, but
material of means.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.guided_kernel import REACH
from rtsr_cli.core.imaging.mask_groups import count_around
from rtsr_cli.core.pairs.alike_material import LEVEL, hold_all
from rtsr_cli.core.pairs.held_samples import (
    LIKE,
    HeldSamples,
    find_mixed,
    gather_around,
    has_like,
    hold_samples,
    is_alike,
    is_filtered,
    is_near,
    keep_own_surface,
)
from rtsr_cli.core.pairs.material_removal import leave_bare, leave_undivided
from rtsr_cli.core.pairs.surface_reach import mark_surfaces
from rtsr_cli.core.shapes import Color, Mask

FACTOR = 1.21
"""Least factor: twice what 8 bits, coarser textures and normals of half leave of material."""

SURE = 100.0
"""The quotient's bound: 10 standard errors of rho, or of the mean of l."""

CHANCE = 1e-5
"""Of such an agreement, at most."""

LEAST = 4
"""Samples of a surface that tell a factor."""

LEAST_WIDE = 2 * REACH + 2
"""The same of what is more than a line: slats and edges of right things stray in lines."""

LEAST_OF_HEIGHT = 0.2
"""Samples that count at least, as a share of the frame's height: strips that no pixel shows lie
along edges of right things, too; right frames of `rtsr synth` had 0.04 of it at most."""

APART = 0.02
"""Difference of depth between samples of one surface, as a share of it."""

AT_ONCE = 1 << 14
"""Samples whose surroundings are held in memory."""


class Fit(NamedTuple):
    """What the samples around each of some tell.

    Attributes:
        factors: of their surface, k x 3.
        sure: whether it has one.
        alone: and no sample is like its HR pixels, no pixel like it: things that are thin have few.
        wide: whether its samples are more than a line.
    """

    factors: Tensor
    sure: Tensor
    alone: Tensor
    wide: Tensor


def leave_scaled(
    lr: Frame,
    hr: Frame,
    scale: int,
    held: HeldSamples | None = None,
    *,
    lines: bool = False,
) -> tuple[Frame, Frame]:
    """Take material out of both frames where it differs by a factor, and lighting with it.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided; normal and depth
            where they are there.
        hr: with sky and material; normal and depth where they are there.
        scale: S.
        held: what `hold_samples` finds of these frames, if that is known.
        lines: whether lines of samples tell by themselves: where something else contradicts.

    Returns:
        The frames; the very ones where there is no factor.
    """
    held = held or hold_samples(lr, hr, scale)
    scaled = find_scaled(lr, hr, scale, held, lines=lines)
    if scaled is None:
        return lr, hr
    lost = mark_surfaces(lr, hr, held.placed, scaled, scale)
    return leave_undivided(lr, scaled), leave_bare(lr, hr, lost, scale)


def find_scaled(
    lr: Frame,
    hr: Frame,
    scale: int,
    held: HeldSamples | None = None,
    *,
    lines: bool = False,
) -> Mask | None:
    """True at LR samples whose surface has another material at HR; None where none has."""
    samples = held or hold_samples(lr, hr, scale)
    held = hold_all(samples)
    picked = _pick_groups(held)
    # the pixels at their places tell all of most frames
    if not bool(picked.any()):
        return None
    held = keep_own_surface(held)
    means = samples.means.clamp(min=LEVEL)
    filtered = is_filtered(held, means)
    if filtered:
        held = replace(held, told=held.told & ~find_mixed(held.hr, held.scale, FACTOR))
    found, alone, wide = (torch.zeros_like(held.told) for _ in range(3))
    factors = torch.ones_like(held.placed)
    where = (picked & held.told)[0, 0].nonzero()
    for some in torch.split(where, AT_ONCE):
        fit = _fit(held, means, some, LEAST_WIDE if filtered else LEAST)
        rows, columns = some.T
        found[0, 0, rows, columns] = fit.sure
        wide[0, 0, rows, columns] = fit.wide
        alone[0, 0, rows, columns] = fit.alone
        factors[0, :, rows, columns] = fit.factors.T
    if not lines:
        found &= alone | wide
    least = LEAST if lines else LEAST_WIDE
    found &= alone | (count_around(found, REACH) >= least)
    if int(found.sum()) < LEAST_OF_HEIGHT * found.shape[-2]:
        return None
    return _follow(held, found, factors)


def _pick_groups(held: HeldSamples) -> Mask:
    """Samples in groups that have more than HR, or less, by `FACTOR` at least, in a channel."""
    own, placed = held.material, held.placed
    more, less = held.told & (own > FACTOR * placed), held.told & (placed > FACTOR * own)
    if not bool((more | less).any()):
        return torch.zeros_like(held.told)
    at_more, at_less = (count_around(way, REACH) for way in (more, less))
    picked = more & (at_more >= LEAST) & (at_more > at_less)
    picked |= less & (at_less >= LEAST) & (at_less > at_more)
    return picked.any(1, keepdim=True)


def _fit(held: HeldSamples, means: Color, picked: Tensor, least: int) -> Fit:
    """Fit the surface of each picked sample (rows and columns, k 2), of so many at least."""
    own, placed, mean = (
        gather_around(image, picked, REACH, 1) for image in (held.material, held.placed, means)
    )
    surface = gather_around(held.told, picked, REACH, 1) > 0.5
    if held.guides is not None:
        around = gather_around(held.guides, picked, REACH, 1)
        middle = around.shape[2] // 2
        surface &= is_alike(around, around[:, :, middle : middle + 1], APART)
    factors, sure = _fit_factors(own, (placed, mean), surface)
    ratios, other = _fit_ratios(own, (placed, mean), surface)
    certain = (sure | other) & (surface.sum(2) >= least)
    found = torch.where(other, ratios, factors)
    alike = found.log().abs().amax(1).div(2.0).exp().clamp(max=LIKE).view(-1, 1, 1)
    alone = certain.any(1) & ~_has_like_beside(own, placed, surface, alike)
    alone[alone.clone()] = ~has_like(held, picked[alone], alike[alone])
    wide = surface.sum((1, 2)) >= LEAST_WIDE
    return Fit(found, certain.any(1), alone, wide)


def _fit_factors(
    own: Tensor, known: tuple[Tensor, Tensor], surface: Tensor
) -> tuple[Tensor, Tensor]:
    """rho of each channel, and whether it explains the difference."""

    def add_up(values: Tensor) -> Tensor:
        return (values * surface).sum(2)

    placed = known[0]
    rho = add_up(own * placed) / add_up(placed * placed)
    left = add_up((own - rho.unsqueeze(2) * placed) ** 2)
    least = torch.minimum(*(add_up((own - image) ** 2) for image in known))
    # sums tell what is so of all of them, not of the brightest
    bias = add_up(own) / add_up(placed)
    far = (torch.minimum(rho, bias) > FACTOR) | (torch.maximum(rho, bias) * FACTOR < 1.0)
    count = surface.sum(2)
    return rho, far & (count * (least - left) > bound_quotients(count) * left)


def _fit_ratios(
    own: Tensor, known: tuple[Tensor, Tensor], surface: Tensor
) -> tuple[Tensor, Tensor]:
    """exp(mean l) of each channel, and whether it is sure, beside both that right samples have."""
    count = surface.sum(2)
    middles, sure = [], []
    for image in known:
        log = (own / image.clamp(min=LEVEL)).log() * surface
        middle = log.sum(2) / count
        spread = (log**2).sum(2) / count - middle**2
        middles.append(middle)
        far = middle.abs() > math.log(FACTOR)
        sure.append(far & (count * middle**2 > bound_quotients(count) * spread))
    one_way = middles[0] * middles[1] > 0.0
    return middles[0].exp(), one_way & sure[0] & sure[1]


def bound_quotients(count: Tensor) -> Tensor:
    """sure(n)."""
    freedom = (count - 1).clamp(min=1).double()
    return (freedom * (CHANCE ** (-2.0 / freedom) - 1.0)).clamp(min=SURE).float()


def _has_like_beside(own: Tensor, placed: Tensor, surface: Tensor, ratio: Tensor) -> Tensor:
    """Whether a sample around is of the material that the middle one's pixel has at HR."""
    middle = own.shape[2] // 2
    here = placed[:, :, middle : middle + 1]
    return (is_near(own, here, ratio) & surface).any(2)[:, 0]


def _follow(held: HeldSamples, found: Mask, factors: Color) -> Mask:
    """Add samples beside, which the factor there explains better than none: an edge."""
    count = count_around(found, REACH)
    rho = count_around(factors * found, REACH) / count.clamp(min=1)
    own, placed = held.material, held.placed
    better = ((own - rho * placed) ** 2).sum(1, keepdim=True) < ((own - placed) ** 2).sum(
        1, keepdim=True
    )
    return found | (held.told & better & (count > 0))
