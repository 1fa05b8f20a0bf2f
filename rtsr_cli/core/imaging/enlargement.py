"""Cubic enlargement of what a renderer gives: radiance, log lighting with holes, and the sky.

Conventions: LR samples lie at `jitter_px` from their pixel's centre; borders are replicated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.imaging.color import (
    decode_reinhard,
    decode_reinhard_wide,
    encode_reinhard,
    encode_reinhard_wide,
)
from rtsr_cli.core.imaging.resampling import (
    find_largest_around,
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

SKY_REACH_PX = 4
"""Small pixels that radiance of a mask is carried to where the cubic kernel finds none of it."""


@dataclass(frozen=True, kw_only=True)
class ToneCurve:
    """c / (1 + c), less a constant: what is interpolated in place of radiance.

    Attributes:
        encode, decode: radiance to it, and back.
        highlight: its value from which overshoot is bounded.
    """

    encode: Callable[[Color], Color]
    decode: Callable[[Color], Color]
    highlight: float


CURVE = ToneCurve(encode=encode_reinhard, decode=decode_reinhard, highlight=HIGHLIGHT)
WIDE_CURVE = ToneCurve(
    encode=encode_reinhard_wide, decode=decode_reinhard_wide, highlight=HIGHLIGHT - 1.0
)
"""For radiance that half cannot hold: the same curve, slower, of more digits."""


def choose_curve(color: Color) -> ToneCurve:
    """Return the curve that keeps the brightest pixel."""
    return WIDE_CURVE if float(color.amax()) > MAX_HALF else CURVE


def enlarge_radiance(color: Color, scale: int, jitter_px: Jitter) -> Color:
    """Enlarge c / (1 + c) and expand."""
    curve = choose_curve(color)
    encoded = curve.encode(color)
    enlarged = upsample_bicubic(encoded, scale, jitter_px)
    return curve.decode(bound_highlights(enlarged, encoded, scale, curve.highlight))


def bound_highlights(
    enlarged: Color, encoded: Color, scale: int, highlight: float = HIGHLIGHT
) -> Color:
    """Hold overshoot beside highlights at the brightest of the 5x5 samples around.

    In c / (1 + c) an overshoot of a hundredth above 0.99 is radiance without bound; below
    `highlight` the kernel's overshoot is the sharpening that it is meant to be.
    """
    bound = upsample_nearest(find_largest_around(encoded).clamp(min=highlight), scale)
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
    nearest = torch.where(reached > 0, grown, average).repeat_interleave(scale, dim=-1)
    count, channels, height, width = nearest.shape
    blocks = smooth.view(count, channels, height, scale, width)
    there = supported.view(count, 1, height, scale, width) > 0
    return torch.where(there, blocks, nearest.unsqueeze(3), out=blocks).flatten(2, 3)


def enlarge_masked_radiance(
    color: Color, mask: Mask, scale: int, jitter_px: Jitter, *, wanted: Mask | None = None
) -> Color:
    """Enlarge the radiance of some pixels only; beyond the kernel, the nearest of them.

    Where none is near, plain bicubic.

    Args:
        color: linear radiance.
        mask: 1 = counts.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.
        wanted: output pixels that are looked at, 1 = wanted; others may hold anything. None = all.
    """
    curve = choose_curve(color)
    encoded = curve.encode(color)
    own, supported = upsample_masked_bicubic(encoded, mask.to(encoded), scale, jitter_px)
    missing = supported <= 0
    if bool((missing if wanted is None else missing & (wanted > 0)).any()):
        grown, reached = grow_valid(encoded, mask.to(encoded), SKY_REACH_PX)
        nearest, near = (upsample_nearest(image, scale) for image in (grown, reached))
        other = torch.where(near > 0, nearest, upsample_bicubic(encoded, scale, jitter_px))
        own = torch.where(missing, other, own)
    return curve.decode(bound_highlights(own, encoded, scale, curve.highlight))
