"""Luminance and transfer functions, forward and inverse side by side, constants cited."""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.shapes import Color, Image, Plane

LUMA_REC709 = (0.2126, 0.7152, 0.0722)
"""Luminance weights of linear Rec.709 primaries [ITU-R BT.709]."""

SRGB_LINEAR_END = 0.0031308
"""End of the linear segment of the sRGB curve, linear side [IEC 61966-2-1]."""

SRGB_ENCODED_END = 0.04045
"""The same point, encoded side [IEC 61966-2-1]."""

ACES_FIT = (2.51, 0.03, 2.43, 0.59, 0.14)
"""a, b, c, d, e of the curve fitted to the ACES output [Narkowicz 2016]."""


def luminance(color: Color) -> Plane:
    """Y of linear Rec.709."""
    weights = torch.tensor(LUMA_REC709, dtype=color.dtype, device=color.device)
    return (color * weights.view(1, 3, 1, 1)).sum(1, keepdim=True)


def encode_reinhard(color: Image) -> Image:
    """Compress c to c / (1 + c) [Reinhard et al. 2002, Eq. 3]; negative radiance counts as 0."""
    positive = color.clamp(min=0.0)
    return positive / (1.0 + positive)


def decode_reinhard(tonemapped: Image, most: float = MAX_HALF) -> Image:
    """Expand y to y / (1 - y), at most the largest half, or `most`."""
    bounded = tonemapped.clamp(0.0, most / (1.0 + most))
    # float32 has few steps left so near 1, and rounds past it
    return (bounded / (1.0 - bounded)).clamp(max=most)


def relight_reinhard(tonemapped: Image, gain: Tensor) -> Image:
    """What c / (1 + c) becomes when c is multiplied by a gain, without expanding it.

    y' = g y / (1 + (g - 1) y)
    """
    return gain * tonemapped / (1.0 + (gain - 1.0) * tonemapped)


def encode_reinhard_wide(color: Image) -> Image:
    """Compress c to c / (1 + c) - 1 = -1 / (1 + c), in float64; negative radiance counts as 0.

    The curve of `encode_reinhard`, which has no steps left where c is above the largest half.
    """
    return -1.0 / (1.0 + color.double().clamp(min=0.0))


def decode_reinhard_wide(tonemapped: Image) -> Image:
    """Inverse of `encode_reinhard_wide`, up to the largest float."""
    rest = (-tonemapped).clamp(1.0 / torch.finfo(torch.float32).max, 1.0)
    return ((1.0 - rest) / rest).float()


def encode_log(lighting: Image, scale: float) -> Image:
    """Compress to log(1 + lighting / k), k = `scale` of the whole frame."""
    return torch.log1p(lighting.clamp(min=0.0) / scale)


def decode_log(encoded: Image, scale: float) -> Image:
    """Expand to k (exp(y) - 1), never negative."""
    return torch.expm1(encoded.clamp(min=0.0)) * scale


def encode_srgb(linear: Image) -> Image:
    """sRGB transfer function of linear values, clipped to 0..1 [IEC 61966-2-1]."""
    x = linear.clamp(0.0, 1.0)
    # 1.055 x^(1/2.4) - 0.055, so written that white is exactly 1 and stays 255 when truncated
    curve = 1.0 + 1.055 * (x.clamp(min=SRGB_LINEAR_END) ** (1.0 / 2.4) - 1.0)
    return torch.where(x <= SRGB_LINEAR_END, 12.92 * x, curve)


def decode_srgb(encoded: Image) -> Image:
    """Inverse of `encode_srgb` on 0..1."""
    y = encoded.clamp(0.0, 1.0)
    curve = ((y.clamp(min=SRGB_ENCODED_END) + 0.055) / 1.055) ** 2.4
    return torch.where(y <= SRGB_ENCODED_END, y / 12.92, curve)


def encode_aces(linear: Image) -> Image:
    """Filmic curve to linear display values, clipped to 0..1; negative radiance counts as 0.

    y = x (a x + b) / (x (c x + d) + e)                                        [Narkowicz 2016]
    """
    a, b, c, d, e = ACES_FIT
    x = linear.clamp(min=0.0)
    return (x * (a * x + b) / (x * (c * x + d) + e)).clamp(0.0, 1.0)
