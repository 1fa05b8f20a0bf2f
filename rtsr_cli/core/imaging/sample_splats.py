"""A frame's samples at a larger size: spread over the pixels around them, or interpolated.

What temporal accumulation adds to its history. Samples lie at `jitter_px` from their LR pixel's
centre; colours are tone-mapped, c / (1 + c).
"""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.resampling import Kernel, cubic_kernel, upsample
from rtsr_cli.core.shapes import Color, Plane

MAX_ENCODED = 0.9999
"""Largest tone-mapped value that interpolation may reach: radiance of 10^4."""


def encode_samples(frame: Frame) -> Color:
    """c / (1 + c) of a frame's radiance; in float64 where half does not hold it.

    In float32 there are too few steps left so near 1.
    """
    color = frame.gbuffer[Buffer.COLOR]
    return encode_reinhard(color.double() if float(color.amax()) > MAX_HALF else color)


def find_brightest(color_tonemapped: Color) -> float:
    """Tone-mapped value that interpolation may reach; samples in float64 are brighter."""
    wide = color_tonemapped.dtype == torch.float64
    return float(color_tonemapped.amax()) if wide else MAX_ENCODED


def splat_samples(
    color_tonemapped: Color, jitter_px: Jitter, scale: int, *, sigma_px: float
) -> tuple[Color, Plane]:
    """Sum of the samples around each output pixel, and the sum of their weights.

    w = exp(-d^2 / (2 sigma^2)),   d in output pixels, 3x3 samples
    """
    kernel = Kernel(
        weight=lambda distance: torch.exp(-0.5 * (distance * scale / sigma_px) ** 2),
        support_px=1.5,
        normalised=False,
    )
    stacked = torch.cat([color_tonemapped, torch.ones_like(color_tonemapped[:, :1])], dim=1)
    summed = upsample(stacked, scale, jitter_px, kernel=kernel)
    return summed[:, :3], summed[:, 3:]


def interpolate_samples(
    color_tonemapped: Color,
    jitter_px: Jitter,
    scale: int,
    *,
    a: float,
    brightest: float = MAX_ENCODED,
) -> Color:
    """Cubic enlargement of the frame alone; `a` is the kernel's slope, `brightest` its bound."""
    kernel = Kernel(weight=lambda distance: cubic_kernel(distance, a), support_px=2.0)
    enlarged = upsample(color_tonemapped, scale, jitter_px, kernel=kernel)
    return enlarged.clamp_(0.0, brightest)
