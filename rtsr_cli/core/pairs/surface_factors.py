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

from dataclasses import replace

import torch
from torch import Tensor

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.guided_kernel import REACH
from rtsr_cli.core.pairs.material_agreement import (
    HeldSamples,
    count_around,
    find_mixed,
    gather_around,
    hold_samples,
    is_alike,
    is_filtered,
    leave_bare,
    leave_undivided,
)
from rtsr_cli.core.pairs.surface_reach import mark_surfaces
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

APART = 0.02
"""Difference of depth between samples of one surface, as a share of it."""

AT_ONCE = 1 << 14
"""Samples whose surroundings are held in memory."""

SCALED = "material differs by a factor between LR and HR (base colour changed at one size?)"
"""What is said of those samples."""


def leave_scaled(
    lr: Frame, hr: Frame, scale: int, held: HeldSamples | None = None
) -> tuple[Frame, Frame]:
    """Take material out of both frames where it differs by a factor, and lighting with it.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided; normal and depth
            where they are there.
        hr: with sky and material; normal and depth where they are there.
        scale: S.
        held: what `hold_samples` finds of these frames, if that is known.

    Returns:
        The frames; the very ones where there is no factor.
    """
    held = held or hold_samples(lr, hr, scale)
    scaled = find_scaled(lr, hr, scale, held)
    if scaled is None:
        return lr, hr
    lost = mark_surfaces(lr, hr, held.placed, scaled, scale)
    return leave_undivided(lr, scaled), leave_bare(lr, hr, lost, scale)


def find_scaled(lr: Frame, hr: Frame, scale: int, held: HeldSamples | None = None) -> Mask | None:
    """True at LR samples whose surface has a multiple of HR's material; None where none has."""
    held = held or hold_samples(lr, hr, scale)
    picked = _pick_groups(_list_ways(held))
    # the pixels at their places tell all of most frames
    if not any(bool(way.any()) for way in picked):
        return None
    means, held = held.means, held.of_own_surface
    if is_filtered(held, means):
        held = replace(held, told=held.told & ~find_mixed(hr, scale, FACTOR))
    found = torch.zeros_like(held.told)
    factors = torch.ones_like(held.told, dtype=held.placed.dtype)
    for way in picked:
        where = (way & held.told)[0, 0].nonzero()
        for some in torch.split(where, AT_ONCE):
            rho, sure = _fit(held, means, some)
            rows, columns = some[sure].T
            found[0, 0, rows, columns] = True
            factors[0, 0, rows, columns] = rho[sure]
    found &= count_around(found, REACH) >= LEAST
    if int(found.sum()) < LEAST_OF_HEIGHT * found.shape[-2]:
        return None
    return _follow(held, found, factors)


def _list_ways(held: HeldSamples) -> list[Mask]:
    """Samples that have more than HR, and those that have less, by `FACTOR` at least."""
    one, other = (image.sum(1, keepdim=True) for image in (held.material, held.placed))
    return [held.told & (one > FACTOR * other), held.told & (other > FACTOR * one)]


def _pick_groups(ways: list[Mask]) -> list[Mask]:
    """Those of each way in groups, among which they are most."""
    counts = [count_around(way, REACH) for way in ways]
    return [
        way & (count >= LEAST) & (count > other)
        for way, count, other in zip(ways, counts, reversed(counts), strict=True)
    ]


def _fit(held: HeldSamples, means: Color, picked: Tensor) -> tuple[Tensor, Tensor]:
    """Factor of each picked sample's surface, and whether it is one for sure."""
    own, placed, mean = (
        gather_around(image, picked, REACH, 1) for image in (held.material, held.placed, means)
    )
    surface = gather_around(held.told, picked, REACH, 1) > 0.5
    if held.guides is not None:
        around = gather_around(held.guides, picked, REACH, 1)
        middle = around.shape[2] // 2
        surface &= is_alike(around, around[:, :, middle : middle + 1], APART)
    weight = surface.to(own)

    def add_up(values: Tensor) -> Tensor:
        return (weight * values).sum((1, 2))

    squares = add_up(placed * placed)
    rho = add_up(own * placed) / squares
    left = add_up((own - rho.view(-1, 1, 1) * placed) ** 2)
    least = torch.minimum(add_up((own - placed) ** 2), add_up((own - mean) ** 2))
    count = surface.sum((1, 2))
    # sums tell what is so of all of them, not of the brightest
    bias = add_up(own) / add_up(placed)
    far = (torch.minimum(rho, bias) > FACTOR) | (torch.maximum(rho, bias) * FACTOR < 1.0)
    return rho, far & (count >= LEAST) & (count * (least - left) > SURE * left)


def _follow(held: HeldSamples, found: Mask, factors: Plane) -> Mask:
    """Add samples beside, which the factor there explains better than none: an edge."""
    count = count_around(found, REACH)
    rho = count_around(factors * found, REACH) / count.clamp(min=1)
    own, placed = held.material, held.placed
    better = ((own - rho * placed) ** 2).sum(1, keepdim=True) < ((own - placed) ** 2).sum(
        1, keepdim=True
    )
    return found | (held.told & better & (count > 0))
