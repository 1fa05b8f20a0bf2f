"""Material taken out of frames: what has none is enlarged as radiance."""

from __future__ import annotations

from dataclasses import replace

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.imaging.alignment import block_shift, shift_image
from rtsr_cli.core.shapes import Mask


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


def find_taken(before: Frame, after: Frame) -> Mask:
    """True at samples whose material was taken out."""
    one, other = (frame.gbuffer[Buffer.MATERIAL] for frame in (before, after))
    return (one != other).any(1, keepdim=True)
