"""Things too thin for groups of samples, whose base colour is lost or another at one size.

Few samples lie on antennas, ropes, leaves and pebbles, and most of them in HR pixels of what is
behind. So each is held against all HR pixels at its depth in the 3 x 3 blocks around it,

    q contradicts  <=>  there are such pixels P, and for all p of P, in a channel,
                        c(q) > FAR c(p)  or  c(p) > FAR c(q)

with base colours c, held to be `LEVEL` at least. Where both sizes have hardly a colour, what tells
is light: q outshines where it has more than OUTSHINES times the middle of the frame's.

Whether a pixel p has lost its colour is decided by vote of the samples at its depth around it:

    lost    q contradicts, and its P have the colour of p; or both are faint, and q outshines
    right   q does neither, and has the colour of p

and a faint sample's by the same vote. Samples further away are asked about faint pixels, and those
of a colour that is contradicted; where nobody knows a faint one it is lost, unless its surface has
a colour beside it: joints of bricks are thin, too. Lost pixels have no material, so that radiance
is enlarged there, and samples that contradict are not divided.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.demodulation import LIGHTING_FLOOR, lighting_scale
from rtsr_cli.core.imaging.mask_groups import spread_mask
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.pairs.colourless_material import keep_whole_surfaces
from rtsr_cli.core.pairs.dark_material import TOO_BRIGHT
from rtsr_cli.core.pairs.held_samples import (
    LIKE,
    MOST_DIELECTRIC,
    HeldSamples,
    gather_around,
    is_filtered,
    is_near,
)
from rtsr_cli.core.pairs.material_causes import DARKER_AT_HR, DARKER_AT_LR, DIFFERS, MISSING, UNSAID
from rtsr_cli.core.pairs.surface_reach import LOST_REACH
from rtsr_cli.core.shapes import Color, Mask, Plane

FAR = 4.0
"""Ratio of base colours in a channel from which they contradict: textures, of which samples fall
between pixels, have less between neighbours."""

FAINT = 0.03
"""Base colour up to here is hardly one: coal has more."""

LEVEL = 0.01
"""Base colours below it are held to be it: 8 bits tell no ratios of them."""

OUTSHINES = 8.0
"""Lighting of so many times the middle of the frame's is none that falls on all surfaces."""

AROUND = 5.0
"""The same times the middle of the samples around: in the sun black things have as much as any."""

THIN = 0.6
"""Share of faint samples in the 5 x 5 around up to which a thing is thin: others mirror lamps."""

TEXTURE = 0.6
"""Share of HR pixels at a faint sample's depth around that have a colour: more are of a texture."""

SAME = 1.25
"""Ratio of base colours, in every channel, up to which a sample bears a pixel out: stones have
nearly the colour of the ground."""

APART = 0.02
"""Difference of depth within a thing, as a share of it."""

MOST = 0.05
"""Share of a frame's samples that may contradict: more is no fault of thin things."""

LEAST = 3
"""Samples of one colour that contradict pixels of one: single ones are of what no pixel shows."""

MANY = 16
"""Samples that outshine from which it is said."""

FURTHER, FURTHER_APART = 16, 0.1
"""LR pixels to each side, and difference of depth, in which samples know of pixels that have none
of their own around."""

MAJORITY = 2
"""How many of those must be for it, for one that is against it."""

AT_ONCE = 1 << 12
"""Samples whose blocks are held in memory."""


class LostThings(NamedTuple):
    """What is lost of thin things.

    Attributes:
        samples: why LR samples are not to be divided -> which.
        pixels: HR, True at pixels whose colour is lost.
        sure: whether that is said: of right frames, too, some dark samples shine.
    """

    samples: dict[str, Mask]
    pixels: Mask
    sure: bool


class Voters(NamedTuple):
    """LR samples that tell of pixels at their depth.

    Attributes:
        depth: theirs.
        colour: theirs.
        there: that of the HR pixels which those that contradict are held against.
        contradicts, outshines, agrees: what they are, one of them at most.
    """

    depth: Plane
    colour: Color
    there: Color
    contradicts: Mask
    outshines: Mask
    agrees: Mask


def find_lost_things(held: HeldSamples) -> LostThings | None:
    """Find what is lost of thin things; None where nothing is, or nothing can be told.

    Args:
        held: samples of LR frames whose radiance was divided, before any was taken out; base
            colours and depths are needed at both sizes.
    """
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    needed = {Buffer.ALBEDO, Buffer.DEPTH}
    if needed - lr.keys() or needed - hr.keys() or Buffer.LIGHTING not in lr:
        return None
    own, pixels = (_find_base_colours(gbuffer) for gbuffer in (lr, hr))
    surface = lr[Buffer.SKY] < 0.5
    contradicts, there = _find_contradicting(held, own, pixels)
    faint = surface & _is_faint(own)
    outshines = _find_bright(held.lr, faint) & ~contradicts
    outshines &= ~_is_of_texture(held, pixels, outshines)
    agrees = surface & ~contradicts & ~outshines
    certain = _keep_frequent(contradicts, own, there, agrees)
    contradicted = bool((certain | contradicts & (faint | _is_faint(there))).any())
    if not contradicted and int(outshines.sum()) < LEAST:
        return None
    surface_hr = hr[Buffer.SKY] < 0.5
    faint_hr = surface_hr & _is_faint(pixels)
    voters = Voters(lr[Buffer.DEPTH], own, there, certain, outshines, agrees)
    asked = _pick_pixels(held, voters, faint_hr)
    depth = hr[Buffer.DEPTH]
    lost, unknown = _vote(depth, pixels, asked, voters)
    near = upsample_nearest(spread_mask(certain | outshines, FURTHER), held.scale)
    suspect = faint_hr | (surface_hr & near & _is_of_some(pixels, there, certain))
    gone, _ = _ask_further(depth, pixels, suspect & ~lost & (near | unknown), voters)
    lost |= gone
    alone = keep_whole_surfaces(hr, faint_hr, unknown & faint_hr & ~lost)
    lost |= _ask_further(depth, pixels, alone, voters)[1]
    asked = faint & spread_mask(outshines, FURTHER) & ~contradicts
    gone, _ = _ask_further(lr[Buffer.DEPTH], own, asked, voters)
    outshines = _vote(lr[Buffer.DEPTH], own, outshines, voters)[0] | gone
    if not any(bool(mask.any()) for mask in (certain, outshines, lost)):
        return None
    sure = contradicted or int(outshines.sum()) >= MANY
    samples = _name_samples(certain, own, there) | {TOO_BRIGHT if sure else UNSAID: outshines}
    return LostThings(samples, lost, sure)


def _keep_frequent(contradicts: Mask, own: Color, there: Color, agrees: Mask) -> Mask:
    """Keep those that have `LEAST` of their colours, their own and that of the pixels."""
    rows, columns = contradicts[0, 0].nonzero().T
    both = torch.cat([own, there], 1)[0][:, rows, columns].log().T
    counts = [
        ((part[:, None] - both[None]).abs().amax(2) <= math.log(LIKE)).sum(1)
        for part in torch.split(both, AT_ONCE // 8)
    ]
    kept = torch.zeros_like(contradicts)
    if not len(rows):
        return kept
    # of a texture that both sizes have most samples of either colour are as HR is
    colours = own[0][:, agrees[0, 0]].log().T
    step = max(1, len(colours) // AT_ONCE)
    shared = [
        step * (part[:, None] - colours[None, ::step]).abs().amax(2).le(math.log(LIKE)).sum(1)
        for half in (both[:, :3], both[:, 3:])
        for part in torch.split(half, AT_ONCE // 8)
    ]
    least = torch.cat(shared).view(2, -1).amin(0).clamp(min=LEAST)
    kept[0, 0, rows, columns] = torch.cat(counts) >= least
    return kept


def _name_samples(contradicts: Mask, own: Color, there: Color) -> dict[str, Mask]:
    """Say which size's base colour is missing where samples contradict; that it differs else."""
    at_lr, at_hr = (colour.sum(1, keepdim=True) for colour in (own, there))
    darker_lr, darker_hr = at_lr <= MISSING * at_hr, at_hr <= MISSING * at_lr
    differs = contradicts & ~darker_lr & ~darker_hr
    return {
        DARKER_AT_LR: contradicts & darker_lr,
        DARKER_AT_HR: contradicts & darker_hr,
        DIFFERS: differs,
    }


def _find_base_colours(gbuffer: GBuffer) -> Color:
    """Base colours; metals' are their F0 where a diffuse colour is stored, which is 0 of them."""
    albedo = gbuffer[Buffer.ALBEDO]
    if Buffer.SPECULAR in gbuffer:
        specular = gbuffer[Buffer.SPECULAR]
        metal = specular.amax(1, keepdim=True) > MOST_DIELECTRIC
        albedo = torch.where(metal, torch.maximum(albedo, specular), albedo)
    return albedo.clamp(min=LEVEL)


def _is_faint(colour: Color) -> Mask:
    """True where a base colour is hardly one."""
    return colour.amax(1, keepdim=True) <= FAINT


def _find_contradicting(held: HeldSamples, own: Color, pixels: Color) -> tuple[Mask, Color]:
    """Samples that no HR pixel at their depth around is like, and the mean colour of those."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    surface = lr[Buffer.SKY] < 0.5
    depth, deep = lr[Buffer.DEPTH], hr[Buffer.DEPTH]
    as_placed = is_near(own, held.place(pixels), LIKE) & _is_as_deep(depth, held.place(deep))
    contradicts, there = torch.zeros_like(surface), torch.zeros_like(own)
    where = (surface & ~as_placed)[0, 0].nonzero()
    deep = deep.masked_fill(hr[Buffer.SKY] > 0.5, 0.0)
    for some in torch.split(where, AT_ONCE):
        rows, columns = some.T
        seen, seen_depth = (gather_around(image, some, 1, held.scale) for image in (pixels, deep))
        colour = own[0][:, rows, columns].T.unsqueeze(2)
        same = _is_as_deep(depth[0][:, rows, columns].T.unsqueeze(2), seen_depth)
        like = same & is_near(colour, seen, FAR)
        count = same.sum(2)
        contradicts[0, 0, rows, columns] = ((count > 0) & ~like.any(2))[:, 0]
        there[0, :, rows, columns] = ((seen * same).sum(2) / count.clamp(min=1)).T
    if not bool(contradicts.any()):
        return contradicts, there
    others = replace(held, told=held.told & ~contradicts)
    if int(contradicts.sum()) > MOST * int(surface.sum()) or is_filtered(others, held.means):
        contradicts = torch.zeros_like(contradicts)
    return contradicts, there


def _find_bright(lr: Frame, faint: Mask) -> Mask:
    """Faint samples of thin things that have far more light than surfaces that are not faint, in
    the middle and around: the sun falls on some parts of a room."""
    lighting, mask = lr.gbuffer[Buffer.LIGHTING], lr.gbuffer[Buffer.LIGHTING_MASK]
    beside = mask.masked_fill(faint, 0.0)
    middle = lighting_scale(lighting, beside) if bool(beside.any()) else lr.lighting_scale
    # lighting of what was not divided is its radiance
    light = torch.where(mask > 0.5, lighting, lighting / MATERIAL_EPSILON)
    most = light.amax(1, keepdim=True)
    bright = faint & (most > OUTSHINES * middle)
    if not bool(bright.any()):
        return bright
    side = 2 * LOST_REACH + 1
    logs = lighting.clamp(min=LIGHTING_FLOOR).log().mean(1, keepdim=True)
    count, total = (F.avg_pool2d(t, side, 1, LOST_REACH) for t in (beside, logs * beside))
    around = (total / count.clamp(min=1.0 / side**2)).exp().masked_fill(count == 0.0, 0.0)
    thin = F.avg_pool2d(faint.float(), 5, 1, 2) <= THIN
    return bright & thin & (most > AROUND * around)


def _is_of_texture(held: HeldSamples, pixels: Color, where: Mask) -> Mask:
    """True at samples at whose depth HR pixels around have a base colour."""
    depth, deep = held.lr.gbuffer[Buffer.DEPTH], held.hr.gbuffer[Buffer.DEPTH]
    deep = deep.masked_fill(held.hr.gbuffer[Buffer.SKY] > 0.5, 0.0)
    found = torch.zeros_like(where)
    for some in torch.split(where[0, 0].nonzero(), AT_ONCE):
        rows, columns = some.T
        seen, seen_depth = (gather_around(image, some, 1, held.scale) for image in (pixels, deep))
        same = _is_as_deep(depth[0][:, rows, columns].T.unsqueeze(2), seen_depth)
        coloured = same & ~_is_faint(seen)
        found[0, 0, rows, columns] = (coloured.sum(2) > TEXTURE * same.sum(2))[:, 0]
    return found


def _is_of_some(image: Color, known: Color, where: Mask) -> Mask:
    """True where a colour is near one of those that some samples have."""
    step = math.log(LIKE)
    values = known[0][:, where[0, 0]].log().div(step).round().T
    near = torch.zeros_like(image[:, :1], dtype=torch.bool)
    for value in np.unique(values.numpy(), axis=0):
        colour = torch.from_numpy(value * step).exp().view(1, 3, 1, 1)
        near |= is_near(image, colour, LIKE**1.5)
    return near


def _pick_pixels(held: HeldSamples, voters: Voters, faint: Mask) -> Mask:
    """HR pixels near samples that tell against them, and faint ones that no sample bears out."""
    accuses = upsample_nearest(spread_mask(voters.contradicts, LOST_REACH), held.scale)
    borne_out = upsample_nearest(
        spread_mask(voters.agrees & _is_faint(voters.colour), 1), held.scale
    )
    surface = held.hr.gbuffer[Buffer.SKY] < 0.5
    outshone = upsample_nearest(spread_mask(voters.outshines, LOST_REACH), held.scale)
    return (accuses & surface) | (faint & (outshone | ~borne_out))


def _vote(depth: Plane, colour: Color, where: Mask, voters: Voters) -> tuple[Mask, Mask]:
    """Ask the samples around about pixels: which are lost, and which nobody knows.

    Args:
        depth, colour: of pixels, at LR's size or a multiple.
        where: those that are asked about.
        voters: LR samples.
    """
    rows, columns = where[0, 0].nonzero().T
    height, width = voters.depth.shape[-2:]
    scale = where.shape[-1] // width
    own, z = colour[0][:, rows, columns][None], depth[0][:, rows, columns][None]
    faint = _is_faint(own)
    votes, voices = (torch.zeros(len(rows), dtype=torch.int32) for _ in range(2))
    for down, across in product(range(-LOST_REACH, LOST_REACH + 1), repeat=2):
        y, x = rows // scale + down, columns // scale + across
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        at = (0, slice(None), y.clamp(0, height - 1), x.clamp(0, width - 1))
        near = inside & _is_as_deep(z, voters.depth[at][None])
        accused = voters.contradicts[at] & is_near(own, voters.there[at][None], LIKE)
        accused |= voters.outshines[at] & faint
        borne = voters.agrees[at] & _is_alike(own, voters.colour[at][None], faint)
        votes += (near & accused)[0, 0].int() - (near & borne)[0, 0].int()
        voices += (near & (accused | borne))[0, 0].int()
    lost, unknown = torch.zeros_like(where), torch.zeros_like(where)
    lost[0, 0, rows, columns] = votes > 0
    unknown[0, 0, rows, columns] = voices == 0
    return lost, unknown


def _ask_further(depth: Plane, colour: Color, where: Mask, voters: Voters) -> tuple[Mask, Mask]:
    """Ask samples further away, and less strictly at their depth, about pixels: which are
    lost by most of them, and which nobody knows.

    Args:
        depth, colour: of pixels, at LR's size or a multiple.
        where: those that are asked about.
        voters: LR samples.
    """
    scale = where.shape[-1] // voters.depth.shape[-1]
    borne = _is_faint(voters.colour) | _is_of_some(voters.colour, voters.there, voters.contradicts)
    knows = voters.contradicts | voters.outshines | (voters.agrees & borne)
    y, x = knows[0, 0].nonzero().T
    accuses = (voters.contradicts | voters.outshines)[0, 0, y, x]
    seen = torch.where(voters.contradicts, voters.there, voters.colour)[0][:, y, x].log()
    ratio = torch.where(accuses, LIKE, SAME).log()
    far = voters.depth[0, 0, y, x]
    lost, unknown = torch.zeros_like(where), torch.zeros_like(where)
    for some, top, left in _list_tiles(where, scale):
        beside = (y >= top - FURTHER) & (y < top + 2 * FURTHER)
        beside &= (x >= left - FURTHER) & (x < left + 2 * FURTHER)
        down, across, deep, accusing, colours = (
            part[..., beside] for part in (y, x, far, accuses, seen)
        )
        rows, columns = some.T[:, :, None]
        near = (rows // scale - down).abs().maximum((columns // scale - across).abs()) <= FURTHER
        z = depth[0, 0][rows, columns]
        near &= (deep - z).abs() <= FURTHER_APART * torch.minimum(deep, z)
        own = colour[0][:, rows, columns].log()
        near &= (own - colours[:, None]).abs().amax(0) <= ratio[beside]
        accused, borne = (near & accusing).sum(1), (near & ~accusing).sum(1)
        lost[0, 0, some[:, 0], some[:, 1]] = accused > MAJORITY * borne
        unknown[0, 0, some[:, 0], some[:, 1]] = ~near.any(1)
    return lost, unknown


def _list_tiles(where: Mask, scale: int) -> Iterator[tuple[Tensor, int, int]]:
    """Rows and columns of marked pixels, some at a time, all of them in one tile of `FURTHER` LR
    pixels a side, and the tile's first LR row and column."""
    picked = where[0, 0].nonzero()
    own = (picked // (scale * FURTHER)).numpy()
    tiles, numbers = np.unique(own, axis=0, return_inverse=True)
    of_tile = torch.from_numpy(numbers.reshape(-1))
    for number, (top, left) in enumerate((tiles * FURTHER).tolist()):
        for some in torch.split(picked[of_tile == number], AT_ONCE // 8):
            yield some, top, left


def _is_alike(one: Tensor, other: Tensor, faint: Mask) -> Mask:
    return is_near(one, other, SAME) | (faint & _is_faint(other))


def _is_as_deep(one: Tensor, other: Tensor) -> Mask:
    return (one - other).abs() <= APART * torch.minimum(one, other)
