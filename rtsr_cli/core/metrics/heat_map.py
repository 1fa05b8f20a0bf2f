"""Pictures of error maps: black for none, through violet, red and orange to pale yellow."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from rtsr_cli.core.imaging.color import encode_srgb
from rtsr_cli.core.shapes import Color, PixelMap

OKLAB_TO_CUBE_ROOTS = (
    (1.0, 0.3963377774, 0.2158037573),
    (1.0, -0.1055613458, -0.0638541728),
    (1.0, -0.0894841775, -1.2914855480),
)
"""Oklab to the cube roots of cone responses [Ottosson 2020, "A perceptual color space"]."""

CONES_TO_RGB = (
    (4.0767416621, -3.3077115913, 0.2309699292),
    (-1.2684380046, 2.6097574011, -0.3413193965),
    (-0.0041960863, -0.7034186147, 1.7076147010),
)
"""Cone responses to linear Rec.709 [Ottosson 2020]."""

END_LIGHTNESS = 0.97
"""Oklab lightness of the greatest error; it grows in even steps from 0."""

START_HUE_DEG, END_HUE_DEG = 285.0, 465.0
"""Oklab hues of the ends: violet, and through red (390) to yellow (465 = 105)."""

MAX_CHROMA = 0.16
"""Greatest Oklab chroma of the ramp; more would leave the sRGB gamut."""

CHROMA_SPAN, CHROMA_SHAPE = 0.94, 0.75
"""Share of a half wave that chroma runs through, so that the end keeps some; its exponent."""

STEPS = 256
"""Colours of the ramp."""


def heat_ramp(steps: int = STEPS) -> Tensor:
    """Display-encoded sRGB (steps, 3) from black to pale yellow, lightness in even steps.

    L = 0.97 t,   chroma = 0.16 sin(0.94 pi t)^(3/4),   hue = 285 .. 465 degrees      (Oklab)
    """
    t = torch.linspace(0.0, 1.0, steps, dtype=torch.float64)
    hue = torch.deg2rad(START_HUE_DEG + (END_HUE_DEG - START_HUE_DEG) * t)
    chroma = MAX_CHROMA * torch.sin(math.pi * CHROMA_SPAN * t) ** CHROMA_SHAPE
    lab = torch.stack([END_LIGHTNESS * t, chroma * hue.cos(), chroma * hue.sin()], dim=1)
    cones = (lab @ lab.new_tensor(OKLAB_TO_CUBE_ROOTS).t()) ** 3
    linear = cones @ cones.new_tensor(CONES_TO_RGB).t()
    return encode_srgb(linear).float()


def heat_map(values: PixelMap, largest: float = 1.0) -> Color:
    """Colour every value by the ramp.

    Args:
        values: errors; below 0 and NaN count as 0, above `largest` as `largest`.
        largest: the value of the ramp's end, above 0.

    Returns:
        Display-encoded sRGB 0..1, (N, 3, H, W).
    """
    index = (values.nan_to_num(0.0) / largest).clamp(0.0, 1.0).mul(STEPS - 1).round().long()
    return heat_ramp().to(values.device)[index].permute(0, 3, 1, 2)
