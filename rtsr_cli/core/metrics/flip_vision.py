"""What FLIP compares of a strip: colours as seen from a distance, edges and points.

Filters, constants and formulas are those of [Andersson et al. 2020], "FLIP: A Difference Evaluator
for Alternating Images". Strips are linear RGB 0..1 with their surroundings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, reduce

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.metrics.filters import (
    band_matrix,
    column_windows,
    filter_along_columns,
    filter_along_rows,
    gaussian_taps,
)

RGB_TO_XYZ = (
    (10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794),
    (2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897),
    (1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382),
)
"""Linear Rec.709 to CIE XYZ [IEC 61966-2-1], as exact fractions; white is the sum of a row."""

SRGB_END = 0.04045
"""End of the linear segment of the sRGB curve, encoded side [IEC 61966-2-1]."""

LAB_END = (6.0 / 29.0) ** 3
"""End of the linear segment of CIELAB's cube root [CIE 15]."""

SENSITIVITY = (
    ((1.0, 0.0047),),
    ((1.0, 0.0053),),
    ((34.1, 0.04), (13.5, 0.025)),
)
"""(a, b) of the Gaussians of achromatic, red-green and blue-yellow contrast sensitivity: their
sum over a sqrt(pi / b) exp(-pi^2 x^2 / b), x in degrees [Andersson et al. 2020]."""

FEATURE_WIDTH_DEG = 0.082
"""Width of the edge and point detectors, twice their sigma [Andersson et al. 2020]."""

REACH_SIGMAS = 3.0
"""Where filters end, in standard deviations of the widest [Andersson et al. 2020]."""

Q_C, P_C, P_T, Q_F = 0.7, 0.4, 0.95, 0.5
"""Exponent of colour differences; the share of the largest that is mapped to P_T; exponent of
feature differences [Andersson et al. 2020]."""

TINY_DIFFERENCE = 1e-15
"""Colour differences up to here are none: keeps powers below 1 off their infinite slope."""

TINY_FEATURE = 1e-10
"""The same for edge and point magnitudes."""

RGB_CHANNELS = 3


@dataclass(frozen=True)
class Bands:
    """The filters of one viewing condition, ready for products.

    Attributes:
        reach: pixels to each side.
        sensitivity: for each opponent channel pairs (along rows, along columns) to sum over.
        smooth: Gaussian of the feature detectors.
        slope: its first derivative.
        bend: its second derivative.
    """

    reach: int
    sensitivity: tuple[tuple[tuple[Tensor, Tensor], ...], ...]
    smooth: Tensor
    slope: Tensor
    bend: Tensor


def _sensitivity_taps(
    gaussians: Sequence[tuple[float, float]], ppd: float, reach: int
) -> list[tuple[Tensor, Tensor]]:
    """Taps along rows and along columns of each Gaussian; all weights together sum to 1.

    In two dimensions a Gaussian's sum is a sqrt(pi / b) (sum of its taps)^2.
    """
    x = torch.arange(-reach, reach + 1, dtype=torch.float64) / ppd
    taps = [torch.exp(-(math.pi**2) * x * x / b) for _, b in gaussians]
    sums = [a * math.sqrt(math.pi / b) for a, b in gaussians]
    total = sum(s * float(t.sum()) ** 2 for s, t in zip(sums, taps, strict=True))
    return [(t, t * (s / total)) for s, t in zip(sums, taps, strict=True)]


def _balance_taps(taps: Tensor) -> Tensor:
    """Scale positive taps to sum 1 and negative ones to -1 [Andersson et al. 2020]."""
    positive, negative = taps.clamp(min=0.0), taps.clamp(max=0.0)
    return positive / positive.sum() - negative / negative.sum()


def build_bands(ppd: float, like: Tensor) -> Bands:
    """Build the filters of `ppd` pixels a degree, in the type and on the device of `like`."""
    widest = max(b for gaussians in SENSITIVITY for _, b in gaussians)
    color_reach = math.ceil(REACH_SIGMAS * math.sqrt(widest / (2.0 * math.pi**2)) * ppd)
    sigma_px = 0.5 * FEATURE_WIDTH_DEG * ppd
    feature_reach = math.ceil(REACH_SIGMAS * sigma_px)
    reach = max(color_reach, feature_reach)

    def band(taps: Tensor) -> Tensor:
        spare = reach - len(taps) // 2
        return band_matrix(F.pad(taps, (spare, spare)), like)

    x = torch.arange(-feature_reach, feature_reach + 1, dtype=torch.float64) / sigma_px
    smooth = gaussian_taps(sigma_px, feature_reach)
    return Bands(
        reach,
        tuple(
            tuple((band(h), band(v)) for h, v in _sensitivity_taps(pairs, ppd, color_reach))
            for pairs in SENSITIVITY
        ),
        band(smooth),
        band(_balance_taps(-x * smooth)),
        band(_balance_taps((x * x - 1.0) * smooth)),
    )


@cache
@torch.inference_mode(mode=False)
def _color_matrices() -> tuple[Tensor, Tensor, Tensor]:
    """Linear RGB to XYZ over white, to opponent axes, and back, in double precision.

    Axes Y, X - Y, Y - Z (over white) are YCxCz without its factors and offset, which a filter of
    sum 1 leaves alone [Andersson et al. 2020].
    """
    to_xyz = torch.tensor(RGB_TO_XYZ, dtype=torch.float64)
    to_xyz = to_xyz / to_xyz.sum(1, keepdim=True)
    axes = torch.tensor([[0.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]).double()
    to_opponent = axes @ to_xyz
    return to_xyz, to_opponent, torch.linalg.inv(to_opponent)


def _mix_channels(image: Tensor, matrix: Tensor) -> Tensor:
    """Multiply every pixel's channels with a 3 x 3 matrix."""
    batch = matrix.to(image).expand(len(image), -1, -1)
    return torch.bmm(batch, image.flatten(2)).view_as(image)


def _power(values: Tensor, exponent: float) -> Tensor:
    """values^exponent of positive values; several times faster than the power function."""
    powers: Tensor = torch.log(values).mul_(exponent).exp_()
    return powers


def decode_extended_srgb(encoded: Tensor) -> Tensor:
    """Linear light; the straight segment goes on from the curve's end (within 1e-8)."""
    curved = encoded.clamp(min=SRGB_END)
    light = _power((curved + 0.055).mul_(1.0 / 1.055), 2.4)
    return torch.add(light, encoded - curved, alpha=1.0 / 12.92)


def _lab_curve(ratio: Tensor) -> Tensor:
    """CIELAB's cube root, and the tangent below its end [CIE 15]."""
    curved = ratio.clamp(min=LAB_END)
    root = _power(curved, 1.0 / 3.0)
    return torch.add(root, ratio - curved, alpha=1.0 / (3.0 * LAB_END ** (2.0 / 3.0)))


def _perceive_color(linear: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """L*, a*, b* with chroma scaled by lightness (Hunt effect) [Andersson et al. 2020].

    L = 116 f(Y) - 16,  a = 500 (f(X) - f(Y)) L / 100,  b = 200 (f(Y) - f(Z)) L / 100
    """
    x, y, z = _lab_curve(_mix_channels(linear, _color_matrices()[0])).unbind(1)
    lightness = 116.0 * y - 16.0
    return lightness, (x - y) * lightness * 5.0, (y - z) * lightness * 2.0


def _hyab(test: tuple[Tensor, Tensor, Tensor], ref: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    """|L1 - L2| + |(a, b)1 - (a, b)2| [Andersson et al. 2020]."""
    lightness, a, b = (t - r for t, r in zip(test, ref, strict=True))
    return lightness.abs() + (a * a + b * b).clamp(min=TINY_DIFFERENCE**2).sqrt()


@cache
def _largest_difference() -> float:
    """HyAB distance of the farthest colours of the gamut, green and blue, to the power Q_C."""
    green, blue = torch.eye(RGB_CHANNELS, dtype=torch.float64)[1:].view(2, 1, RGB_CHANNELS, 1, 1)
    farthest = float(_hyab(_perceive_color(green), _perceive_color(blue)))
    return math.pow(farthest, Q_C)


def _color_difference(hyab: Tensor) -> Tensor:
    """Map 0 .. P_C of the largest difference to 0 .. P_T, the rest to P_T .. 1.

    [Andersson et al. 2020]
    """
    largest = _largest_difference()
    difference = _power(hyab, Q_C)
    lower = difference.clamp(max=P_C * largest)
    upper_slope = (1.0 - P_T) / ((1.0 - P_C) * largest)
    return lower * (P_T / (P_C * largest)) + (difference - lower) * upper_slope


def _magnitude(x: Tensor, y: Tensor) -> Tensor:
    return (x * x + y * y).clamp(min=TINY_FEATURE**2).sqrt()


@dataclass(frozen=True)
class _SeenStrip:
    """What is compared of one strip: its colours, edges and points."""

    color: tuple[Tensor, Tensor, Tensor]
    edges: Tensor
    points: Tensor


def _filter_strip(linear: Tensor, bands: Bands) -> _SeenStrip:
    """Filter a strip of linear RGB with `bands.reach` pixels around it."""
    opponent = _mix_channels(linear, _color_matrices()[1])
    windows = column_windows(opponent, bands.reach)
    filtered = [
        reduce(
            torch.add,
            (filter_along_columns(filter_along_rows(plane, h), v) for h, v in pairs),
        )
        for plane, pairs in zip(windows.unbind(1), bands.sensitivity, strict=True)
    ]
    color = _mix_channels(torch.stack(filtered, 1), _color_matrices()[2]).clamp(0.0, 1.0)
    smooth, slope, bend = (
        filter_along_rows(windows[:, 0], band) for band in (bands.smooth, bands.slope, bands.bend)
    )
    edges = _magnitude(
        filter_along_columns(slope, bands.smooth), filter_along_columns(smooth, bands.slope)
    )
    points = _magnitude(
        filter_along_columns(bend, bands.smooth), filter_along_columns(smooth, bands.bend)
    )
    return _SeenStrip(_perceive_color(color), edges, points)


def compare_strips(test: Tensor, ref: Tensor, bands: Bands) -> Tensor:
    """FLIP of a strip of linear RGB 0..1 with its surroundings, (N, rows, columns).

        FLIP = C^(1 - F),   F = (max(|edges|, |points|) / sqrt(2))^Q_F   [Andersson et al. 2020]

    with C the colour difference and the differences of edge and point magnitudes.
    """
    seen, expected = _filter_strip(test, bands), _filter_strip(ref, bands)
    hyab = _hyab(seen.color, expected.color)
    feature = torch.maximum(
        (seen.edges - expected.edges).abs(), (seen.points - expected.points).abs()
    )
    feature = _power(feature.clamp(min=TINY_FEATURE).mul_(1.0 / math.sqrt(2.0)), Q_F)
    error = torch.exp(torch.log(_color_difference(hyab)) * (1.0 - feature))
    return torch.where(hyab > 2.0 * TINY_DIFFERENCE, error, 0.0)
