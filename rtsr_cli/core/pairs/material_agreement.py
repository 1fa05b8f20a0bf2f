"""Whether the material that LR radiance was divided by is the one that lighting is multiplied by.

    sample q strays  <=>  m_lr(q) > FAR m_hr(q) in a channel, and not below it in any; or reverse

with m_hr(q) of the HR pixel in which q lies, where that is of q's surface (normals and depths, as
far as both sizes have them). A base colour that was rendered at one size only makes samples stray
in groups (`straying_groups`): the quotient would be many times too bright, or the product too dark.
Where samples are centres of HR pixels two that stray together suffice, unless most do.

Such samples are left undivided, and HR pixels of their surface have no material either, so that
radiance is enlarged there (`surface_reach`).
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.alignment import shift_jitter
from rtsr_cli.core.imaging.mask_groups import count_around, spread_mask
from rtsr_cli.core.imaging.resampling import sample_jitter, upsample_nearest
from rtsr_cli.core.pairs.held_samples import (
    LIKE,
    TOLERANCE,
    HeldSamples,
    find_colours,
    hold_samples,
    is_filtered,
    is_near,
    name_colour,
)
from rtsr_cli.core.pairs.material_removal import leave_bare, leave_undivided
from rtsr_cli.core.pairs.straying_groups import (
    LEAST_TELLING,
    REACH,
    WEAK,
    find_groups,
    find_range,
    find_thin,
    is_between,
)
from rtsr_cli.core.pairs.surface_reach import LOST_REACH, mark_surfaces
from rtsr_cli.core.shapes import Color, Mask, Plane

FAR = 1.6
"""The same where a sample lies elsewhere in the pixel than its centre."""

MOST_STRAYS = 0.05
"""Share of the samples that may stray in the middle one of all tiles: of samples that lie elsewhere
than is known more do."""

TILE = 8
"""Samples to each side of a tile."""

LEAST_BIASED = 0.2
"""Share of the samples around that strays where most tiles do."""

CENTRED_PX = 1e-3
"""Largest distance from a sample to the pixel centre that it is, in LR pixels."""


def leave_contradicting(
    lr: Frame, hr: Frame, scale: int, held: HeldSamples | None = None
) -> tuple[Frame, Frame]:
    """Take material out of both frames where LR samples contradict HR's, and lighting with it.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided; `GUIDES` where
            they are there.
        hr: with sky and material; `GUIDES` where they are there.
        scale: S.
        held: what `hold_samples` finds of these frames, if that is known.

    Returns:
        The frames: LR's material is 0 and its lighting undivided at those samples, HR's material
        is 0 around them.
    """
    held = held or hold_samples(lr, hr, scale)
    contradicts = find_contradicting(lr, hr, scale, held)
    if contradicts is None:
        return lr, hr
    lost = mark_surfaces(lr, hr, held.placed, contradicts, scale)
    lost |= _find_same(held, contradicts)
    return leave_undivided(lr, contradicts), leave_bare(lr, hr, lost, scale)


def _find_same(held: HeldSamples, contradicts: Mask) -> Mask:
    """True at HR pixels of the colour that contradicting samples have at HR, if it is one.

    Parts of thin things have no sample of their own. Where samples around have it at both sizes it
    is another thing's. Base colours are compared where they are there.
    """
    hr = held.hr.gbuffer
    colour, placed = find_colours(held)
    least, most = find_range(placed, contradicts & held.told)
    if bool((most > least * LIKE).any()):
        return torch.zeros_like(hr[Buffer.SKY], dtype=torch.bool)
    agrees = held.told & is_near(colour, placed, LIKE) & ~contradicts
    agrees &= is_between(colour, least, most)
    same = is_between(hr[name_colour(held)], least, most) & (hr[Buffer.SKY] < 0.5)
    return same & ~upsample_nearest(spread_mask(agrees, LOST_REACH), held.scale)


def find_contradicting(
    lr: Frame, hr: Frame, scale: int, held: HeldSamples | None = None
) -> Mask | None:
    """True at LR samples whose material is not that of the surface at HR; None where all agree."""
    held = held or hold_samples(lr, hr, scale)
    centred = _lies_on_centres(lr, scale)
    tolerance = TOLERANCE if centred else FAR
    brighter = held.told & _exceeds(held.material, held.placed, tolerance)
    darker = held.told & _exceeds(held.placed, held.material, tolerance)
    # the pixels at their places tell all of most frames
    if not bool((brighter | darker).any()):
        return None
    if is_filtered(held, held.means):
        explained = is_near(held.material, held.means, tolerance)
        brighter, darker = brighter & ~explained, darker & ~explained
    strays = brighter | darker
    if centred and _are_few(strays, held.told):
        found = strays & (count_around(strays, 1) >= 2)
    elif _is_biased(held):
        found = strays & (_share_around(strays) > LEAST_BIASED - 1e-6)
    else:
        found = find_groups(held.of_own_surface, held.bare, brighter, darker)
        found |= find_thin(held, brighter, darker)
    return found if bool(found.any()) else None


def _exceeds(one: Color, other: Color, tolerance: float) -> Mask:
    more = (one > other * tolerance).any(1, keepdim=True)
    return more & (one * TOLERANCE >= other).all(1, keepdim=True)


def _lies_on_centres(lr: Frame, scale: int) -> bool:
    """Tell whether every sample is the centre of an HR pixel."""
    centre = sample_jitter(scale // 2, scale)
    return all(abs(j - centre) < CENTRED_PX for j in shift_jitter(lr.camera.jitter_px, scale))


def _are_few(strays: Mask, told: Mask) -> bool:
    """Tell whether in most tiles nearly all of the samples that tell agree."""
    count, part = _sum_tiles(told.float()), _sum_tiles((strays & told).float())
    tells = count >= LEAST_TELLING
    return bool(tells.any()) and float((part / count)[tells].median()) <= MOST_STRAYS


def _is_biased(held: HeldSamples) -> bool:
    """Tell whether one size's material is the darker one, by far, in nearly all tiles."""
    tells = _sum_tiles(held.told.float()) >= LEAST_TELLING
    if not bool(tells.any()):
        return False
    one, other = (
        _sum_tiles((image * held.told).sum(1, keepdim=True))[tells]
        for image in (held.material, held.placed)
    )
    ratio = (one / other).log()
    return max(float(r.quantile(0.25)) for r in (ratio, -ratio)) > math.log(WEAK.bias)


def _sum_tiles(image: Plane) -> Tensor:
    return F.avg_pool2d(image, TILE, ceil_mode=True, divisor_override=1).flatten()


def _share_around(mask: Mask) -> Plane:
    """Share of the pixels in the square around, as far as it is in the picture, that are marked."""
    return F.avg_pool2d(mask.float(), 2 * REACH + 1, 1, REACH, count_include_pad=False)
