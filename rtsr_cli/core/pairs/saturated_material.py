"""Surfaces of a saturated colour: channels without material in which there is no radiance, either.

    channel c of sample q is dark  <=>  m_c(q) <= epsilon
    q is saturated  <=>  dark in a channel, bright in another, and in all dark ones
                         r_c(q) <= COLOURED epsilon max(l(q), k)

with the material m, the reflected radiance r, the lighting l = max r_d / m_d of the bright channels
d, and the middle k of the frame's lighting: no material above a few epsilon would leave so little.
Nothing is lost there: what is divided is the other channels. In dark ones lighting cannot be told;
it is that of the others, so that surfaces beside, which are none of that colour, are lit by it.
HR pixels that are dark in a channel go with such samples where those are most of the dark ones
around. Material of dark channels becomes the least that is divided by.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.demodulation import lighting_scale
from rtsr_cli.core.imaging.guided_kernel import REACH
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.shapes import Color, Mask

COLOURED = 2.0
"""How many times more light of one colour than of another falls on surfaces."""

LEAST_DIVISOR = 1.01 * MATERIAL_EPSILON
"""Material of dark channels."""


def divide_saturated(
    lr: Frame, hr: Frame, find_material: Callable[[], Color], scale: int
) -> tuple[Frame, Frame]:
    """Divide samples of saturated surfaces by the material of their bright channels.

    Args:
        lr: with sky, lighting and its mask, and material.
        hr: with sky and material.
        find_material: makes LR's material, also of what was not divided.
        scale: S.

    Returns:
        The frames; the very ones where there are no such surfaces.
    """
    undivided = (lr.gbuffer[Buffer.LIGHTING_MASK] < 0.5) & (lr.gbuffer[Buffer.SKY] < 0.5)
    if not bool(undivided.any()):
        return lr, hr
    material = find_material()
    dark, mixed = _find_dark(material)
    mixed &= undivided
    if not bool(mixed.any()):
        return lr, hr
    reflected = lr.gbuffer[Buffer.LIGHTING]
    quotient = torch.where(dark, 0.0, reflected / material.clamp(min=MATERIAL_EPSILON))
    own = quotient.amax(1, keepdim=True)
    most = COLOURED * MATERIAL_EPSILON * own.clamp(min=lr.lighting_scale)
    saturated = mixed & ((reflected <= most) | ~dark).all(1, keepdim=True)
    if not bool(saturated.any()):
        return lr, hr
    lr = _divide(lr, saturated, torch.where(dark, own, quotient), material)
    dark, pixels = _find_dark(hr.gbuffer[Buffer.MATERIAL])
    more = _count(saturated) > _count(mixed & ~saturated)
    pixels &= upsample_nearest(more, scale) & (hr.gbuffer[Buffer.SKY] < 0.5)
    if not bool(pixels.any()):
        return lr, hr
    lifted = hr.gbuffer[Buffer.MATERIAL].masked_fill(dark & pixels, LEAST_DIVISOR)
    return lr, replace(hr, gbuffer=hr.gbuffer.with_buffers({Buffer.MATERIAL: lifted}))


def _find_dark(material: Color) -> tuple[Mask, Mask]:
    """Channels without material, and where some are, but not all."""
    dark = material <= MATERIAL_EPSILON
    mixed = dark.any(1, keepdim=True) & (material > MATERIAL_EPSILON).any(1, keepdim=True)
    return dark, mixed


def _divide(lr: Frame, where: Mask, quotient: Color, material: Color) -> Frame:
    gbuffer = lr.gbuffer
    lighting = torch.where(where, quotient, gbuffer[Buffer.LIGHTING])
    mask = torch.where(where, 1.0, gbuffer[Buffer.LIGHTING_MASK])
    changed = {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: mask}
    if Buffer.MATERIAL in gbuffer:
        divisor = material.clamp(min=LEAST_DIVISOR)
        changed[Buffer.MATERIAL] = torch.where(where, divisor, gbuffer[Buffer.MATERIAL])
    scale = lighting_scale(lighting, mask)
    return replace(lr, gbuffer=gbuffer.with_buffers(changed), lighting_scale=scale)


def _count(mask: Mask) -> torch.Tensor:
    """How many samples of the kernel's reach are marked."""
    return F.avg_pool2d(mask.float(), 2 * REACH + 1, 1, REACH, divisor_override=1)
