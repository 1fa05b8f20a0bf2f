"""Luminance and transfer functions, forward and inverse side by side, constants cited."""

from __future__ import annotations

import torch

from rtsr_cli.core.shapes import Color, Image, Plane

LUMA_REC709 = (0.2126, 0.7152, 0.0722)
"""Luminance weights of linear Rec.709 primaries [ITU-R BT.709]."""

SRGB_LINEAR_END = 0.0031308
"""End of the linear segment of the sRGB curve, linear side [IEC 61966-2-1]."""

SRGB_ENCODED_END = 0.04045
"""The same point, encoded side [IEC 61966-2-1]."""

ACES_FIT = (2.51, 0.03, 2.43, 0.59, 0.14)
"""a, b, c, d, e of the curve fitted to the ACES output [Narkowicz 2016]."""

PQ_PEAK_NITS = 10000.0
"""Luminance of code value 1 [SMPTE ST 2084]."""

PQ_EXPONENTS = (1305.0 / 8192.0, 2523.0 / 32.0)
"""m1, m2 [SMPTE ST 2084]."""

PQ_FACTORS = (107.0 / 128.0, 2413.0 / 128.0, 2392.0 / 128.0)
"""c1, c2, c3; c1 = c3 - c2 + 1 [SMPTE ST 2084]."""

PU21_BANDING_GLARE = (
    0.353487901,
    0.3734658629,
    8.277049286e-05,
    0.9062562627,
    0.09150303166,
    0.9099517204,
    596.3148142,
)
"""p1 ... p7 of the variant for banding with glare [Mantiuk and Azimi 2021]."""

PU21_RANGE_NITS = (0.005, 10000.0)
"""Luminance that the fit is for [Mantiuk and Azimi 2021]."""

MAX_HALF = 65504.0
"""The largest finite half: no radiance in a half file is above it."""


def luminance(color: Color) -> Plane:
    """Y of linear Rec.709."""
    weights = torch.tensor(LUMA_REC709, dtype=color.dtype, device=color.device)
    return (color * weights.view(1, 3, 1, 1)).sum(1, keepdim=True)


def encode_reinhard(color: Image) -> Image:
    """Compress c to c / (1 + c) [Reinhard et al. 2002, Eq. 3]; negative radiance counts as 0."""
    positive = color.clamp(min=0.0)
    return positive / (1.0 + positive)


def decode_reinhard(tonemapped: Image) -> Image:
    """Expand y to y / (1 - y); y is held below the curve's value at the largest half."""
    bounded = tonemapped.clamp(0.0, MAX_HALF / (1.0 + MAX_HALF))
    return bounded / (1.0 - bounded)


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


def encode_pq(nits: Image) -> Image:
    """Perceptual quantiser of absolute luminance, 0 to 10,000 cd/m^2, to 0..1.

    y = ((c1 + c2 x^m1) / (1 + c3 x^m1))^m2,   x = nits / 10000                [SMPTE ST 2084]
    """
    (m1, m2), (c1, c2, c3) = PQ_EXPONENTS, PQ_FACTORS
    power = (nits / PQ_PEAK_NITS).clamp(0.0, 1.0) ** m1
    return ((c1 + c2 * power) / (1.0 + c3 * power)) ** m2


def decode_pq(encoded: Image) -> Image:
    """Inverse of `encode_pq` on 0..1, in cd/m^2."""
    (m1, m2), (c1, c2, c3) = PQ_EXPONENTS, PQ_FACTORS
    power = encoded.clamp(0.0, 1.0) ** (1.0 / m2)
    ratio = (power - c1).clamp(min=0.0) / (c2 - c3 * power)
    return PQ_PEAK_NITS * ratio ** (1.0 / m1)


def encode_pu21(nits: Image) -> Image:
    """Perceptually uniform values, 0..595.4, of absolute luminance in cd/m^2 (100 gives 256).

    y = p7 (((p1 + p2 x^p4) / (1 + p3 x^p4))^p5 - p6), at least 0   [Mantiuk and Azimi 2021, Eq. 4]
    """
    p1, p2, p3, p4, p5, p6, p7 = PU21_BANDING_GLARE
    power = nits.clamp(*PU21_RANGE_NITS) ** p4
    return (p7 * (((p1 + p2 * power) / (1.0 + p3 * power)) ** p5 - p6)).clamp(min=0.0)
