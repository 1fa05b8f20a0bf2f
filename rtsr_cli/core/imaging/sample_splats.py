"""A frame's samples at a larger size: spread over the pixels around them, or interpolated.

What temporal accumulation adds to its history. Samples lie at `jitter_px` from their LR pixel's
centre; colours are tone-mapped, c / (1 + c).
"""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.resampling import Kernel, cubic_kernel, upsample
from rtsr_cli.core.shapes import Color, Plane

MAX_ENCODED = 0.9999
"""Largest tone-mapped value that interpolation may reach: radiance of 10^4."""


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
