"""What the samples around a pixel say of its colour: mean and deviation, and history held to them.

Variance clipping [Salvi 2016, An Excursion in Temporal Supersampling] in YCoCg, whose axes follow
what varies in pictures. Colours are tone-mapped, c / (1 + c).
"""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.resampling import BILINEAR, mean_3x3, upsample
from rtsr_cli.core.shapes import Color, Image, Plane


def to_ycocg(color: Color) -> Image:
    """Y = (R + 2G + B) / 4, Co = (R - B) / 2, Cg = (2G - R - B) / 4 [Malvar and Sullivan 2003]."""
    r, g, b = color.split_with_sizes([1, 1, 1], dim=1)
    return torch.cat([(r + 2.0 * g + b) / 4.0, (r - b) / 2.0, (2.0 * g - r - b) / 4.0], dim=1)


def from_ycocg(image: Image) -> Color:
    """R = Y + Co - Cg, G = Y + Cg, B = Y - Co - Cg."""
    y, co, cg = image.split_with_sizes([1, 1, 1], dim=1)
    return torch.cat([y + co - cg, y + cg, y - co - cg], dim=1)


def measure_neighbourhood(samples: Image, scale: int, jitter_px: Jitter) -> Image:
    """Mean of the 3x3 samples around each output pixel, then their standard deviation.

    Args:
        samples: YCoCg, n 3 h w.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.

    Returns:
        n 6 H W; between the samples, linearly interpolated.
    """
    mean = mean_3x3(samples)
    deviation = (mean_3x3(samples.square()) - mean.square()).clamp(min=0.0).sqrt()
    return upsample(torch.cat([mean, deviation], dim=1), scale, jitter_px, kernel=BILINEAR)


def clip_to_neighbourhood(history: Image, neighbourhood: Image, deviations: Plane | float) -> Image:
    """Hold history within so many standard deviations of the samples' mean [Salvi 2016].

    Args:
        history: YCoCg, n 3 H W.
        neighbourhood: `measure_neighbourhood`.
        deviations: half width of the box.
    """
    mean, deviation = neighbourhood.split_with_sizes([3, 3], dim=1)
    reach = deviation * deviations
    return torch.minimum(torch.maximum(history, mean - reach), mean + reach)
