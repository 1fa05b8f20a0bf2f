"""Whether the material that LR radiance was divided by is the one that lighting is multiplied by.

    sample q contradicts  <=>  some channel of m_lr(q) is outside of [min m_hr / T, max m_hr * T]

over the HR surfaces of the 3 x 3 blocks around q: wherever in its pixel the sample lies, and
whatever mean of surfaces it is, a right one is within. A base colour that was rendered at one size
only is not: the quotient would be many times too bright, or the product too dark. Such samples are
left undivided, so that radiance is enlarged there, as around samples that have no material at all.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.imaging.alignment import block_shift, shift_image
from rtsr_cli.core.shapes import Color, Mask

TOLERANCE = 1.1
"""T: what 8 bits, coarser textures and normals of half leave of material that is right."""


def leave_contradicting(lr: Frame, hr: Frame, scale: int) -> Frame:
    """Return the LR frame, its material 0 and its lighting undivided at samples that contradict.

    Args:
        lr: with sky and material, and lighting with its mask where it was divided.
        hr: with sky and material.
        scale: S.
    """
    contradicts = find_contradicting(lr, hr, scale)
    if contradicts is None:
        return lr
    material = lr.gbuffer[Buffer.MATERIAL]
    changed = {Buffer.MATERIAL: material.masked_fill(contradicts, 0.0)}
    if Buffer.LIGHTING not in lr.gbuffer:
        return replace(lr, gbuffer=lr.gbuffer.with_buffers(changed))
    lighting, mask = lr.gbuffer[Buffer.LIGHTING], lr.gbuffer[Buffer.LIGHTING_MASK]
    lighting = torch.where(contradicts, dm.remodulate(lighting, material), lighting)
    mask = mask.masked_fill(contradicts, 0.0)
    changed |= {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: mask}
    gbuffer = lr.gbuffer.with_buffers(changed)
    return replace(lr, gbuffer=gbuffer, lighting_scale=dm.lighting_scale(lighting, mask))


def find_contradicting(lr: Frame, hr: Frame, scale: int) -> Mask | None:
    """True at LR samples whose material is none of the HR surfaces around; None where all agree."""
    material, divided = lr.gbuffer[Buffer.MATERIAL], lr.gbuffer[Buffer.SKY] < 0.5
    divided &= (material > MATERIAL_EPSILON).all(1, keepdim=True)
    seen = hr.gbuffer[Buffer.MATERIAL]
    middle = scale // 2
    at_samples = shift_image(seen, block_shift(lr.camera.jitter_px, scale))
    at_samples = at_samples[..., middle::scale, middle::scale]
    # the pixel that a sample lies in tells all of most frames
    if not bool((divided & _is_outside(material, at_samples, at_samples)).any()):
        return None
    usable = (hr.gbuffer[Buffer.SKY] < 0.5) & (seen > MATERIAL_EPSILON).all(1, keepdim=True)
    lowest = -_largest_around(seen.masked_fill(~usable, math.inf).neg(), scale)
    highest = _largest_around(seen.masked_fill(~usable, -math.inf), scale)
    known = torch.isfinite(lowest) & torch.isfinite(highest)
    outside = divided & _is_outside(material, lowest, highest, known)
    return outside if bool(outside.any()) else None


def _is_outside(
    material: Color, lowest: Color, highest: Color, known: Mask | None = None
) -> Mask:
    outside = (material * TOLERANCE < lowest) | (material > highest * TOLERANCE)
    return (outside if known is None else outside & known).any(1, keepdim=True)


def _largest_around(image: Color, scale: int) -> Color:
    """Largest value of the 3 x 3 blocks of S x S pixels around each block."""
    return F.max_pool2d(F.max_pool2d(image, scale), 3, stride=1, padding=1)
