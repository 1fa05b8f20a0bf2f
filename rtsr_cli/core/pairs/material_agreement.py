"""Whether the material that LR radiance was divided by is the one that lighting is multiplied by.

    sample q strays  <=>  m_lr(q) <= T min m_hr in every channel, and < min m_hr / T in one
                          or m_lr(q) >= max m_hr / T in every channel, and > T max m_hr in one

over HR surfaces around q: the pixel whose centre it is, or the 3 x 3 around its place, or the 3 x 3
blocks around, within which a right sample is wherever in its pixel it lies, and whatever mean of
surfaces. The narrowest counts that holds the frame's samples nearly everywhere else: how exactly
the places of two renders are known differs. Off pixel centres samples stray by themselves, on what
is finer than pixels, bricks and their joints in whole bands; there it takes several to contradict,
beside one that strays from its blocks. Where one size's material is the
darker one in the mean, no places explain that, and the pixel at the place counts.

A base colour that was rendered at one size only contradicts: the quotient would be many times too
bright, or the product too dark. Such samples are left undivided, and HR pixels around them have no
material either, so that radiance is enlarged there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import reduce
from typing import NamedTuple

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.imaging.alignment import block_shift, shift_image, shift_jitter
from rtsr_cli.core.imaging.guided_kernel import REACH as KERNEL_REACH
from rtsr_cli.core.imaging.resampling import sample_jitter, upsample_nearest
from rtsr_cli.core.shapes import Color, Mask, Plane

TOLERANCE = 1.1
"""T: what 8 bits, coarser textures and normals of half leave of material that is right."""

MOST_STRAYS = 0.05
"""Share of the samples between several materials that may stray from the pixels that count: of
samples that lie half an LR pixel elsewhere than is known, 0.08 and more do from the 3 x 3."""

APART = 2
"""LR pixels from a sample that strays from its blocks to those that tell how samples lie."""

REACH, LEAST_STRAYS = 2, 0.2
"""Off pixel centres a share of the 5 x 5 samples around that contradicts: one row."""

MOST_BIAS = 1.25
"""Ratio of the mean materials of LR samples and of the pixels at their places, of right renders."""

LOST_REACH = 2 * KERNEL_REACH
"""LR pixels to each side of a sample that contradicts in which HR pixels have no material."""

CENTRED_PX = 1e-3
"""Largest distance from a sample to the pixel centre that it is, in LR pixels."""


class Range(NamedTuple):
    """Least and largest material around samples, channel by channel.

    The least is 0 where a pixel is no surface, as a filter's mean may be there; the largest is
    -inf where none is.
    """

    least: Color
    largest: Color

    def excludes(self, material: Color) -> Mask:
        """True where there is some, and the material is darker, or brighter."""
        low, high = self.least, self.largest
        darker = (material * TOLERANCE < low).any(1) & (material <= low * TOLERANCE).all(1)
        brighter = (material > high * TOLERANCE).any(1) & (material * TOLERANCE >= high).all(1)
        return (darker | brighter).unsqueeze(1) & (high > 0.0).all(1, keepdim=True)

    def is_wide(self) -> Mask:
        """True where several materials are around."""
        return (self.largest > self.least * TOLERANCE**2).any(1, keepdim=True)


def leave_contradicting(lr: Frame, hr: Frame, scale: int) -> tuple[Frame, Frame]:
    """Take material out of both frames where LR samples contradict HR's, and lighting with it.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided.
        hr: with sky and material.
        scale: S.

    Returns:
        The frames: LR's material is 0 and its lighting undivided at those samples, HR's material
        is 0 around them.
    """
    contradicts = find_contradicting(lr, hr, scale)
    if contradicts is None:
        return lr, hr
    around = upsample_nearest(_share_around(contradicts, LOST_REACH) > 0, scale)
    bare = hr.gbuffer[Buffer.MATERIAL].masked_fill(around, 0.0)
    hr = replace(hr, gbuffer=hr.gbuffer.with_buffers({Buffer.MATERIAL: bare}))
    return leave_undivided(lr, contradicts), hr


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


def find_contradicting(lr: Frame, hr: Frame, scale: int) -> Mask | None:
    """True at LR samples whose material is none of the HR surfaces around; None where all agree."""
    material, divided = lr.gbuffer[Buffer.MATERIAL], lr.gbuffer[Buffer.SKY] < 0.5
    divided &= (material > MATERIAL_EPSILON).all(1, keepdim=True)
    seen = hr.gbuffer[Buffer.MATERIAL]
    usable = (hr.gbuffer[Buffer.SKY] < 0.5) & (seen > MATERIAL_EPSILON).all(1, keepdim=True)
    shift = block_shift(lr.camera.jitter_px, scale)
    moved, moved_usable = shift_image(seen, shift), shift_image(usable, shift)

    def find_strays(around: Range) -> Mask:
        return divided & around.excludes(material)

    placed = _range_near(moved, moved_usable, scale, reach=0)
    strays = find_strays(placed)
    # the pixels at their places tell all of most frames
    if not bool(strays.any()):
        return None
    blocks = _range_of_blocks(seen, usable, scale)
    widest = find_strays(blocks)
    telling = divided & blocks.is_wide() & (_share_around(widest, APART) == 0)
    if _lies_on_centres(lr, scale) and _are_few(strays, telling):
        return strays
    if not _is_biased(material, placed.largest, telling & (placed.largest > 0.0)):
        near = find_strays(_range_near(moved, moved_usable, scale, reach=1))
        beside = _share_around(widest, LOST_REACH) > 0
        strays = near & beside if _are_few(near, telling) else widest
    contradicts = strays & (_share_around(strays, REACH) > LEAST_STRAYS - 1e-6)
    return contradicts if bool(contradicts.any()) else None


def _lies_on_centres(lr: Frame, scale: int) -> bool:
    """Tell whether every sample is the centre of an HR pixel."""
    centre = sample_jitter(scale // 2, scale)
    return all(abs(j - centre) < CENTRED_PX for j in shift_jitter(lr.camera.jitter_px, scale))


def _are_few(strays: Mask, telling: Mask) -> bool:
    return int((strays & telling).sum()) <= MOST_STRAYS * int(telling.sum())


def _is_biased(material: Color, placed: Color, where: Mask) -> bool:
    """Tell whether one material is the darker one in the mean over pixels."""
    one, other = (float(image[where].double().sum()) for image in (material, placed))
    return max(one, other) > MOST_BIAS * min(one, other)


def _share_around(mask: Mask, reach: int) -> Plane:
    """Share of the pixels in the square around, as far as it is in the picture, that are marked."""
    side = 2 * reach + 1
    return F.avg_pool2d(mask.float(), side, 1, reach, count_include_pad=False)


def _range_near(image: Color, usable: Mask, scale: int, *, reach: int) -> Range:
    """Of the pixels up to `reach` from pixel (S//2, S//2) of each block."""
    rows, columns = (side - scale + 1 for side in image.shape[-2:])
    first = range(scale // 2, scale // 2 + 2 * reach + 1)

    def gather(end: float) -> list[Color]:
        padded = F.pad(image.masked_fill(~usable, end), (reach,) * 4, value=end)
        return [
            padded[..., y : y + rows : scale, x : x + columns : scale] for y in first for x in first
        ]

    return Range(reduce(torch.minimum, gather(0.0)), reduce(torch.maximum, gather(-math.inf)))


def _range_of_blocks(image: Color, usable: Mask, scale: int) -> Range:
    """Of the 3 x 3 blocks of S x S pixels around each block."""

    def find_largest(values: Color) -> Color:
        return F.max_pool2d(F.max_pool2d(values, scale), 3, stride=1, padding=1)

    return Range(
        -find_largest(image.masked_fill(~usable, 0.0).neg()),
        find_largest(image.masked_fill(~usable, -math.inf)),
    )
