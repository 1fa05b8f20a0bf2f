"""Whether the material that LR radiance was divided by is the one that lighting is multiplied by.

    sample q strays  <=>  m_lr(q) > FAR m_hr(q) in a channel, and not below it in any; or reverse

with m_hr(q) of the HR pixel in which q lies, where that is of q's surface (normals and depths, as
far as both sizes have them). A base colour that was rendered at one size only makes samples stray
in groups: the quotient would be many times too bright, or the product too dark. Right samples stray
singly, or in lines, on what is finer than pixels, joints of bricks and edges. So a sample begins a
group only if, of the samples of its surface in the 5 x 5 around it,

    LEAST and a SHARE stray with it, and the sums of their materials are BIAS apart     (`STRONG`),

if it is one of 2 x 2 that all stray, and if no HR pixel of its surface in the 3 x 3 blocks around
is like it, nor around most of the group. Where the darker material is what a base colour of 0
leaves, and the other one is not, less will do (`WEAK`). Once there is a group, what strays beside
pixels as dark as its own goes with it. Things as thin as samples lie apart hold no 2 x 2: lines of
samples that are alone at their depth will do where base colours are known (`THIN`). Where samples
are centres of HR pixels two that stray together suffice, unless most do.

Such samples are left undivided, and HR pixels of their surface have no material either, so that
radiance is enlarged there (`surface_reach`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import product
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.imaging.alignment import block_shift, shift_image, shift_jitter
from rtsr_cli.core.imaging.mask_groups import keep_groups
from rtsr_cli.core.imaging.resampling import sample_jitter, upsample_nearest
from rtsr_cli.core.pairs.surface_reach import LOST_REACH, mark_surfaces
from rtsr_cli.core.shapes import Color, Image, Mask, Plane

DARKER_AT_HR, DARKER_AT_LR = (
    f"material is darker at {one} than at {other} (base colour missing at {one}?)"
    for one, other in (("HR", "LR"), ("LR", "HR"))
)
"""What is said of samples that contradict."""

DIFFERS = (
    "an object's material differs between LR and HR (its detail comes back if both sizes are "
    "rendered with one material)"
)
"""The same where neither size lacks it."""

UNSAID = ""
"""Cause of which nothing is said: nothing is wrong there."""

GUIDES = (Buffer.ALBEDO, Buffer.NORMAL, Buffer.DEPTH)
"""Buffers that tell more, where they are there."""

TOLERANCE = 1.1
"""What 8 bits, coarser textures and normals of half leave of material that is right."""

FAR = 1.6
"""The same where a sample lies elsewhere in the pixel than its centre."""

BLACK = 1e-3
"""Base colour up to here is none: the third level above 0 of 8 bits in sRGB."""

MOST_DIELECTRIC = 0.17
"""F0 of dielectrics is up to that of diamond."""

CHANCE, LEAST_INSIDE = 1e-6, 4
"""Least probability of what may be chance, and the samples in bare pixels that it takes."""

BESIDE_PX = (1, 2, 3)
"""HR pixels to each side in which other parts of a surface are looked for."""

MOST_STRAYS = 0.05
"""Share of the samples that may stray in the middle one of all tiles: of samples that lie elsewhere
than is known more do."""

TILE, LEAST_TELLING = 8, 6
"""Samples to each side of a tile, and how many of it must tell."""

REACH, LEAST_BIASED = 2, 0.2
"""Samples to each side that are held together, and the share that strays where most tiles do."""

FACING, APARTS, APART_THERE = 0.7, (0.02, 0.1), 0.02
"""Least cosine between normals of one surface, and differences of depth, as a share of it: between
samples (a flat one, or one that is seen at a slant), and of a sample from its pixel."""

MISSING = 0.2
"""What is left of a material without its base colour, as a share of it at most, on the whole."""

LIKE = 1.5
"""Ratio of materials, in every channel, up to which a pixel is like a sample."""

MOST = 0.95
"""Share of a group's samples whose material is at most, or at least, that of single ones beside."""

MOST_ALIKE = 0.9
"""Share of a group's pixels that are as dark as those which go with it at most."""

AT_ONCE = 1 << 12
"""Samples whose blocks are held in memory."""

CENTRED_PX = 1e-3
"""Largest distance from a sample to the pixel centre that it is, in LR pixels."""


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


@dataclass(frozen=True, kw_only=True)
class HeldSamples:
    """LR samples held against the HR pixels in which they lie.

    Attributes:
        lr, hr: the frames.
        scale: S.
        placed: HR material at the samples.
        told: True where both are surfaces with material; of one surface, where that is known.
        guides: normal and depth of the samples; None where a size lacks them.
    """

    lr: Frame
    hr: Frame
    scale: int
    placed: Color
    told: Mask
    guides: Image | None

    @property
    def material(self) -> Color:
        """The samples'."""
        return self.lr.gbuffer[Buffer.MATERIAL]

    @cached_property
    def means(self) -> Color:
        """Of HR material over the samples' blocks."""
        return average_blocks(self.hr, self.scale)

    @cached_property
    def of_own_surface(self) -> HeldSamples:
        """The same, less what `keep_own_surface` leaves out."""
        return keep_own_surface(self)

    @cached_property
    def bare(self) -> tuple[Mask, Mask]:
        """Where LR's and HR's surfaces have no base colour."""
        lr, hr = (is_colourless(frame.gbuffer) for frame in (self.lr, self.hr))
        return lr, hr

    def place(self, image: Image) -> Image:
        """Pixels of an HR image in which the samples lie."""
        return place_pixels(image, self.lr, self.scale)


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
    colour, placed = _find_colours(held)
    least, most = _find_range(placed, contradicts & held.told)
    if bool((most > least * LIKE).any()):
        return torch.zeros_like(hr[Buffer.SKY], dtype=torch.bool)
    agrees = held.told & is_near(colour, placed, LIKE) & ~contradicts
    agrees &= _is_between(colour, least, most)
    same = _is_between(hr[_name_colour(held)], least, most) & (hr[Buffer.SKY] < 0.5)
    return same & ~upsample_nearest(_spread(agrees, LOST_REACH), held.scale)


def _name_colour(held: HeldSamples) -> Buffer:
    known = all(Buffer.ALBEDO in frame.gbuffer for frame in (held.lr, held.hr))
    return Buffer.ALBEDO if known else Buffer.MATERIAL


def _find_colours(held: HeldSamples) -> tuple[Color, Color]:
    """Base colours of samples and of the pixels in which they lie; else their materials."""
    name = _name_colour(held)
    return held.lr.gbuffer[name], held.place(held.hr.gbuffer[name])


def leave_bare(lr: Frame, hr: Frame, where: Mask, scale: int) -> Frame:
    """Take material out of HR pixels, and out of those at the border that are made of them.

    Lighting is multiplied where images are shifted (`alignment`), and shifted back.
    """
    across, down = block_shift(lr.camera.jitter_px, scale)
    where = where | shift_image(shift_image(where, (across, down)), (-across, -down))
    bare = hr.gbuffer[Buffer.MATERIAL].masked_fill(where, 0.0)
    return replace(hr, gbuffer=hr.gbuffer.with_buffers({Buffer.MATERIAL: bare}))


def leave_undivided(lr: Frame, where: Mask) -> Frame:
    """Take material and lighting out of LR samples.

    Args:
        lr: with material, and lighting with its mask where it was divided.
        where: True at samples that are to be undivided.

    Returns:
        The frame, with the lighting scale of what is left.
    """
    material = lr.gbuffer[Buffer.MATERIAL]
    changed = {Buffer.MATERIAL: material.masked_fill(where, 0.0)}
    if Buffer.LIGHTING not in lr.gbuffer:
        return replace(lr, gbuffer=lr.gbuffer.with_buffers(changed))
    lighting, mask = lr.gbuffer[Buffer.LIGHTING], lr.gbuffer[Buffer.LIGHTING_MASK]
    lighting = torch.where(where, dm.remodulate(lighting, material), lighting)
    mask = mask.masked_fill(where, 0.0)
    changed |= {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: mask}
    gbuffer = lr.gbuffer.with_buffers(changed)
    return replace(lr, gbuffer=gbuffer, lighting_scale=dm.lighting_scale(lighting, mask))


def is_colourless(gbuffer: GBuffer) -> Mask:
    """True where the base colour is stored, and is none: what is left is a specular term.

    A diffuse colour of 0 beside an F0 above dielectrics' is that of metal.
    """
    if Buffer.ALBEDO not in gbuffer:
        return torch.zeros_like(gbuffer[Buffer.SKY], dtype=torch.bool)
    albedo = gbuffer[Buffer.ALBEDO]
    # one fast pass tells frames in which nothing is black
    if float(albedo.amin()) > BLACK:
        return torch.zeros_like(gbuffer[Buffer.SKY], dtype=torch.bool)
    bare = albedo.amax(1, keepdim=True) <= BLACK
    if Buffer.SPECULAR not in gbuffer:
        return bare
    return bare & (gbuffer[Buffer.SPECULAR].amax(1, keepdim=True) <= MOST_DIELECTRIC)


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
    alone = bare_lr & ~_spread(in_block, 1)
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
    unseen = bare_hr & ~upsample_nearest(_spread(bare_lr, REACH), scale)
    whole = F.max_pool2d(-F.pad(bare_hr.float(), (1,) * 4), 3, 1) < -0.5
    sure = held.place(whole) & coloured & keep_own_surface(replace(held, told=inside)).told
    if _is_by_chance(float(bare_hr.sum()) / scale**2, int(bare_lr.sum()), int(inside.sum())):
        unseen &= upsample_nearest(_spread(sure, LOST_REACH), scale)
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
    return _mark(picked[~coloured], hidden)


def find_taken(before: Frame, after: Frame) -> Mask:
    """True at samples whose material was taken out."""
    one, other = (frame.gbuffer[Buffer.MATERIAL] for frame in (before, after))
    return (one != other).any(1, keepdim=True)


def name_darker(lr: Frame, hr: Frame, scale: int, contradicts: Mask) -> str:
    """Say which size's material is missing where samples contradict; that it differs if none is."""
    held = hold_samples(lr, hr, scale)
    where = held.told & contradicts
    at_lr, at_hr = (float((image * where).sum()) for image in (held.material, held.placed))
    if min(at_lr, at_hr) > MISSING * max(at_lr, at_hr):
        return DIFFERS
    return DARKER_AT_LR if at_lr < at_hr else DARKER_AT_HR


def describe_difference(held: HeldSamples, where: Mask) -> str:
    """Say what colours samples have at both sizes, in the middle."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    pairs = {"material": (held.material, held.placed)}
    if Buffer.ALBEDO in lr and Buffer.ALBEDO in hr:
        pairs = {"base colour": (lr[Buffer.ALBEDO], held.place(hr[Buffer.ALBEDO])), **pairs}
    said = ""
    for name, images in pairs.items():
        own, there = (image[0][:, where[0, 0]].median(1).values for image in images)
        at_lr, at_hr = (", ".join(f"{value:.2g}" for value in values) for values in (own, there))
        said = f"{name} about {at_lr} at LR where HR has {at_hr}"
        # of one base colour metallic or roughness differs
        if not bool(is_near(own.view(1, 3, 1, 1), there.view(1, 3, 1, 1), TOLERANCE)):
            break
    return said


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
        found = _find_groups(held.of_own_surface, held.bare, brighter, darker)
        found |= _find_thin(held, brighter, darker)
    return found if bool(found.any()) else None


def hold_samples(lr: Frame, hr: Frame, scale: int) -> HeldSamples:
    """Find the pixels in which samples lie."""
    material, divided = lr.gbuffer[Buffer.MATERIAL], lr.gbuffer[Buffer.SKY] < 0.5
    divided &= (material > MATERIAL_EPSILON).all(1, keepdim=True)
    if Buffer.LIGHTING_MASK in lr.gbuffer:
        # the material of what is not divided is 1
        divided &= lr.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    placed, sky = (place_pixels(hr.gbuffer[b], lr, scale) for b in (Buffer.MATERIAL, Buffer.SKY))
    told = divided & (sky < 0.5) & (placed > MATERIAL_EPSILON).all(1, keepdim=True)
    return HeldSamples(lr=lr, hr=hr, scale=scale, placed=placed, told=told, guides=None)


def average_blocks(hr: Frame, scale: int) -> Color:
    """What a filter of a pixel's width leaves of HR material: sky has none."""
    material, surface = hr.gbuffer[Buffer.MATERIAL], hr.gbuffer[Buffer.SKY] < 0.5
    rows = (~surface.flatten(0, 2).all(1)).nonzero()[:, 0] // scale
    if not len(rows):
        return F.avg_pool2d(material, scale)
    first, last = int(rows[0]) * scale, (int(rows[-1]) + 1) * scale
    parts = [material[:, :, :first], material[:, :, first:last], material[:, :, last:]]
    parts[1] = parts[1] * surface[:, :, first:last]
    return torch.cat([F.avg_pool2d(part, scale) for part in parts if part.shape[2]], 2)


def find_mixed(hr: Frame, scale: int, tolerance: float) -> Mask:
    """True at blocks whose HR materials are further apart than a ratio; sky has none."""
    material = hr.gbuffer[Buffer.MATERIAL] * (hr.gbuffer[Buffer.SKY] < 0.5)
    most, least = (sign * F.max_pool2d(sign * material, scale) for sign in (1.0, -1.0))
    return (most > least * tolerance).any(1, keepdim=True)


def is_filtered(held: HeldSamples, means: Color) -> bool:
    """Tell whether most LR samples in mixed blocks are like the mean, and not like the pixel."""
    mixed = held.told & ~is_near(held.placed, means, TOLERANCE)
    to_pixel, to_mean = (
        (held.material - image).abs().sum(1, keepdim=True)[mixed] for image in (held.placed, means)
    )
    return 2 * int((to_mean < to_pixel).sum()) > len(to_mean)


def is_near(one: Tensor, other: Tensor, tolerance: float | Tensor) -> Tensor:
    """Whether materials are within a ratio in all channels."""
    return ((one <= other * tolerance) & (other <= one * tolerance)).all(1, keepdim=True)


def place_pixels(image: Image, lr: Frame, scale: int) -> Image:
    """Pixels of an HR image in which LR samples lie."""
    shift = block_shift(lr.camera.jitter_px, scale)
    columns, rows = (
        (torch.arange(scale // 2, side, scale) + by).clamp_(0, side - 1)
        for by, side in zip(shift, image.shape[:-3:-1], strict=True)
    )
    return image[..., rows[:, None], columns]


def keep_own_surface(held: HeldSamples) -> HeldSamples:
    """Leave out samples whose pixel is of another surface, as far as that can be told."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    parts = (Buffer.NORMAL, Buffer.DEPTH)
    if not all(part in gbuffer for gbuffer in (lr, hr) for part in parts):
        return held
    own = torch.cat([lr[part] for part in parts], 1)
    there = torch.cat([held.place(hr[part]) for part in parts], 1)
    return replace(held, told=held.told & is_alike(own, there, APART_THERE), guides=own)


def _exceeds(one: Color, other: Color, tolerance: float) -> Mask:
    more = (one > other * tolerance).any(1, keepdim=True)
    return more & (one * TOLERANCE >= other).all(1, keepdim=True)


def is_alike(one: Tensor, other: Tensor, apart: float) -> Mask:
    """Of one surface, by normal and depth; a normal of 0 tells nothing."""
    (normal, z), (other_normal, other_z) = (
        image.split_with_sizes([3, 1], dim=1) for image in (one, other)
    )
    facing = (normal * other_normal).sum(1, keepdim=True)
    unfaced = (normal == 0).all(1, keepdim=True) | (other_normal == 0).all(1, keepdim=True)
    near = (z - other_z).abs() <= apart * torch.minimum(z, other_z)
    return ((facing > FACING) | unfaced) & near


def _find_groups(held: HeldSamples, bare: tuple[Mask, Mask], brighter: Mask, darker: Mask) -> Mask:
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


def _find_thin(held: HeldSamples, brighter: Mask, darker: Mask) -> Mask:
    """True at samples on things that are as thin as they lie apart: wires, leaves.

    Their normals turn from pixel to pixel: what is of them is found by depth alone. All samples at
    that depth stray, and no HR pixel at that depth around is like them. Reflectance turns with the
    normals, too, so that base colours must be known, and differ.
    """
    found = torch.zeros_like(brighter)
    needed = {Buffer.ALBEDO, Buffer.DEPTH}
    if any(needed - frame.gbuffer.keys() for frame in (held.lr, held.hr)):
        return found
    colour, there = (image.sum(1, keepdim=True) for image in _find_colours(held))
    sides = (
        (held.material, held.placed, brighter, colour > THIN.bias * there),
        (held.placed, held.material, darker, there > THIN.bias * colour),
    )
    held = _hold_at_depths(held)
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
    found = _mark(where, strays)
    alike = reduce(torch.logical_and, (_is_within(m, found) for m in materials))
    found |= strays & alike & _spread(found, LOST_REACH)
    # at edges samples lie in pixels of what is behind
    colour, placed = _find_colours(held)
    like = _is_within(colour, found) & (held.lr.gbuffer[Buffer.SKY] < 0.5)
    agrees = like & is_near(colour, placed, LIKE)
    return found | (like & ~_spread(agrees, LOST_REACH))


def _hold_at_depths(held: HeldSamples) -> HeldSamples:
    """Tell surfaces apart by depth alone."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    own, there = lr[Buffer.DEPTH], held.place(hr[Buffer.DEPTH])
    near = (own - there).abs() <= APART_THERE * torch.minimum(own, there)
    unfaced = torch.zeros_like(own).expand(-1, 3, -1, -1)
    return replace(held, told=held.told & near, guides=torch.cat([unfaced, own], 1))


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
    groups = strays & _spread(_mark(picked[begins], strays), REACH)
    dark = dim[groups.expand_as(dim)].view(3, -1).sort(1).values
    darkest = dark[:, int(MOST_ALIKE * dark.shape[1])].view(1, 3, 1, 1)
    alike = strays & (dim <= darkest * TOLERANCE).all(1, keepdim=True)
    groups |= alike & _spread(_mark(picked[passes(WEAK)], strays) & alike, REACH)
    # and single ones beside: what is seen of the surface between other things
    like = strays & _is_within(bright, groups) & _is_within(dim, groups)
    groups |= like & _spread(groups, LOST_REACH)
    # of a texture that both sizes have most samples are like pixels around, though few are not;
    # where one size has no base colour it is no texture
    where = groups[0, 0].nonzero()
    alone = ~has_like(held, where, LIKE) | bare[0, 0][where[:, 0], where[:, 1]]
    return groups if 2 * int(alone.sum()) > len(alone) else torch.zeros_like(groups)


def _is_within(material: Color, groups: Mask) -> Mask:
    """True where a material is within what most of the groups' are."""
    return _is_between(material, *_find_range(material, groups))


def _find_range(material: Color, groups: Mask) -> tuple[Tensor, Tensor]:
    """Least and largest material of most of the groups, 1 3 1 1."""
    values = material[groups.expand_as(material)].view(3, -1).sort(1).values
    last = values.shape[1] - 1
    least, most = (values[:, int(part * last)].view(1, 3, 1, 1) for part in (1 - MOST, MOST))
    return least, most


def _is_between(material: Color, least: Tensor, most: Tensor) -> Mask:
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


def has_like(held: HeldSamples, picked: Tensor, ratio: float | Tensor) -> Tensor:
    """Whether HR pixels of a sample's surface in the 3 x 3 blocks around are of its material.

    Args:
        held: the samples.
        picked: rows and columns of some, k 2.
        ratio: of materials, in every channel, up to which they are one; of all, or k 1 1.
    """
    ratios = torch.as_tensor(ratio, dtype=held.material.dtype).expand(len(picked), 1, 1)
    chunks = zip(torch.split(picked, AT_ONCE), torch.split(ratios, AT_ONCE), strict=True)
    return torch.cat([_has_like_of(held, some, ratio) for some, ratio in chunks])


def _has_like_of(held: HeldSamples, picked: Tensor, ratio: Tensor) -> Tensor:
    seen = gather_around(held.hr.gbuffer[Buffer.MATERIAL], picked, 1, held.scale)
    own = held.material[0][:, picked[:, 0], picked[:, 1]].t().unsqueeze(2)
    like = is_near(own, seen, ratio)
    if held.guides is not None:
        depth = gather_around(held.hr.gbuffer[Buffer.DEPTH], picked, 1, held.scale)
        normal = torch.zeros_like(depth).expand(-1, 3, -1)
        if Buffer.NORMAL in held.hr.gbuffer:
            normal = gather_around(held.hr.gbuffer[Buffer.NORMAL], picked, 1, held.scale)
        pixels = torch.cat([normal, depth], 1)
        surface = held.guides[0][:, picked[:, 0], picked[:, 1]].t().unsqueeze(2)
        like &= is_alike(pixels, surface, APARTS[-1])
    return like.any(2)[:, 0]


def gather_around(image: Image, picked: Tensor, reach: int, scale: int) -> Tensor:
    """The blocks up to `reach` from those of the picked samples, k c n; 0 beyond the borders."""
    steps = torch.arange(-reach * scale, (reach + 1) * scale)
    (rows, row_there), (columns, column_there) = (
        (at.clamp(0, size - 1), (at >= 0) & (at < size))
        for at, size in zip((picked * scale).T[:, :, None] + steps, image.shape[-2:], strict=True)
    )
    values: Tensor = image[0].float()[:, rows[:, :, None], columns[:, None]]
    values = values * (row_there[:, :, None] & column_there[:, None])
    return values.flatten(2).movedim(0, 1)


def _mark(picked: Tensor, like: Mask) -> Mask:
    marked = torch.zeros_like(like)
    marked[0, 0][picked[:, 0], picked[:, 1]] = True
    return marked


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


def count_around(mask: Mask, reach: int) -> Plane:
    """How many pixels of the square around are marked."""
    side = 2 * reach + 1
    rows = F.avg_pool2d(mask.float(), (side, 1), 1, (reach, 0), divisor_override=1)
    return F.avg_pool2d(rows, (1, side), 1, (0, reach), divisor_override=1)


def _spread(mask: Mask, reach: int) -> Mask:
    return F.max_pool2d(mask.float(), 2 * reach + 1, 1, reach) > 0.5
