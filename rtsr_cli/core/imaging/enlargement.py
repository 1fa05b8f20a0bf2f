"""Cubic enlargement of what a renderer gives: radiance, log lighting with holes, and the sky.

Conventions: LR samples lie at `jitter_px` from their pixel's centre; borders are replicated.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.color import decode_reinhard, encode_reinhard
from rtsr_cli.core.imaging.resampling import (
    BICUBIC_SUPPORT_PX,
    grow_valid,
    upsample_bicubic,
    upsample_masked_bicubic,
    upsample_nearest,
)
from rtsr_cli.core.shapes import Color, Image, Mask

HIGHLIGHT = 0.5
"""Tone-mapped value (radiance 1) from which overshoot is bounded."""

AVERAGE_LOG_LIGHTING = math.log(2.0)
"""log(1 + lighting / k) of lighting that is k, the frame's mean."""


def enlarge_radiance(color: Color, scale: int, jitter_px: Jitter) -> Color:
    """Enlarge c / (1 + c) and expand."""
    encoded = encode_reinhard(color)
    enlarged = upsample_bicubic(encoded, scale, jitter_px)
    return decode_reinhard(bound_highlights(enlarged, encoded, scale))


def bound_highlights(enlarged: Color, encoded: Color, scale: int) -> Color:
    """Hold overshoot beside highlights at the brightest of the 5x5 samples around.

    In c / (1 + c) an overshoot of a hundredth above 0.99 is radiance without bound; below
    `HIGHLIGHT` the kernel's overshoot is the sharpening that it is meant to be.
    """
    reach = 2 * BICUBIC_SUPPORT_PX + 1
    brightest = F.max_pool2d(encoded, reach, stride=1, padding=BICUBIC_SUPPORT_PX)
    bound = upsample_nearest(brightest.clamp(min=HIGHLIGHT), scale)
    return torch.minimum(enlarged, bound)


def enlarge_log_lighting(
    encoded: Image, mask: Mask, scale: int, jitter_px: Jitter, *, grow_px: int = 1
) -> Image:
    """Enlarge log lighting over divided pixels; beyond their reach, the nearest valid lighting.

    Where nothing valid is near, it is the frame's average.

    Args:
        encoded: log(1 + lighting / k).
        mask: 1 = divided.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.
        grow_px: 3x3 steps by which valid lighting is spread.
    """
    smooth, supported = upsample_masked_bicubic(encoded, mask, scale, jitter_px)
    if bool(supported.all()):
        return smooth
    grown, reached = grow_valid(encoded, mask, grow_px)
    average = torch.full_like(encoded, AVERAGE_LOG_LIGHTING)
    nearest = upsample_nearest(torch.where(reached > 0, grown, average), scale)
    return torch.where(supported > 0, smooth, nearest)


def enlarge_masked_radiance(color: Color, mask: Mask, scale: int, jitter_px: Jitter) -> Color:
    """Enlarge the radiance of some pixels only; where none is near, plain bicubic."""
    encoded = encode_reinhard(color)
    own, supported = upsample_masked_bicubic(encoded, mask, scale, jitter_px)
    if not bool(supported.all()):
        own = torch.where(supported > 0, own, upsample_bicubic(encoded, scale, jitter_px))
    return decode_reinhard(bound_highlights(own, encoded, scale))
