"""Tone mapping of HDR-FLIP, and the range of exposures that shows a picture.

y = (k0 x^2 + k1 x) / (k3 x^2 + k4 x + k5),   x = radiance 2^exposure, clipped to 0..1
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from torch import Tensor

from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.shapes import Color


class ToneMapper(StrEnum):
    """Curve that turns exposed radiance into display light."""

    ACES = "aces"
    HABLE = "hable"
    REINHARD = "reinhard"


@dataclass(frozen=True)
class RationalCurve:
    """Coefficients of the rational curve; names as in the formula above."""

    k0: float
    k1: float
    k3: float
    k4: float
    k5: float

    def inverse(self, level: float) -> float:
        """Give the x that maps to `level`: the root of (k0-t k3) x^2 + (k1-t k4) x - t k5."""
        a, b, c = self.k0 - level * self.k3, self.k1 - level * self.k4, -level * self.k5
        if a == 0.0:
            return -c / b
        root = math.sqrt(b * b - 4.0 * a * c)
        return max((-b + root) / (2.0 * a), (-b - root) / (2.0 * a))


def _aces_curve() -> RationalCurve:
    """Fit of the ACES output [Narkowicz 2016] with its exposure of 0.6 left in."""
    e = 0.6
    return RationalCurve(e * e * 2.51, e * 0.03, e * e * 2.43, e * 0.59, 0.14)


def _hable_curve() -> RationalCurve:
    """Filmic curve with exposure bias 2 and white point 11.2 [Hable 2010]."""
    a, b, c, d, e, f = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
    white, bias = 11.2, 2.0
    k0, k1, k3, k4, k5 = a * f - a * e, c * b * f - b * e, a * f, b * f, d * f * f
    scale = (k3 * white**2 + k4 * white + k5) / (k0 * white**2 + k1 * white)
    return RationalCurve(bias**2 * k0 * scale, bias * k1 * scale, bias**2 * k3, bias * k4, k5)


CURVES = {
    ToneMapper.ACES: _aces_curve(),
    ToneMapper.HABLE: _hable_curve(),
    ToneMapper.REINHARD: RationalCurve(0.0, 1.0, 0.0, 1.0, 1.0),
}
"""The curve of each; Reinhard's is taken of the luminance [Reinhard et al. 2002, Eq. 3]."""

SHOWN_LEVEL = 0.85
"""Display light that the brightest and the median pixel are brought to
[Andersson et al. 2021]."""

MIN_EXPOSURES = 2
"""The darkest and the brightest."""


@dataclass(frozen=True, kw_only=True)
class ExposureRange:
    """Exposures of HDR-FLIP in stops (log2), evenly spaced.

    Attributes:
        start: the darkest picture.
        stop: the brightest picture.
        count: pictures, both ends included.
    """

    start: float
    stop: float
    count: int

    def __post_init__(self) -> None:
        """Raise RtsrError for a range that shows nothing."""
        if not (math.isfinite(self.start) and math.isfinite(self.stop)):
            raise RtsrError(f"HDR-FLIP: exposures {self.start} to {self.stop} are not finite")
        if self.start > self.stop or self.count < MIN_EXPOSURES:
            raise RtsrError(
                f"HDR-FLIP: {self.count} exposures from {self.start} to {self.stop} stops: give a "
                f"start not above the stop and at least {MIN_EXPOSURES} exposures"
            )

    @property
    def stops(self) -> list[float]:
        """Each exposure, darkest first."""
        step = (self.stop - self.start) / (self.count - 1)
        return [self.start + i * step for i in range(self.count)]


def exposure_count(start: float, stop: float) -> int:
    """One exposure a stop, rounded up, at least two."""
    return max(MIN_EXPOSURES, math.ceil(stop - start))


def _median(values: Tensor) -> float:
    """Upper middle value of even counts, as FLIP's reference program has it (torch's is lower)."""
    return -float((-values).median())


def exposure_ends(luminance: Tensor, tone_mapper: ToneMapper) -> tuple[float, float]:
    """Exposures at which the brightest and the median pixel reach `SHOWN_LEVEL`.

        start = log2(x / max Y),  stop = log2(x / median Y),  curve(x) = 0.85
                                                      [Andersson et al. 2021]

    Departs from the paper: where the median is black, the median of the lit pixels counts, and
    a black picture has the range 0 to 0 (paper silent).
    """
    values = luminance.detach().flatten()
    median = _median(values)
    if median <= 0.0:
        values = values[values > 0.0]
        if not values.numel():
            return 0.0, 0.0
        median = _median(values)
    level = CURVES[tone_mapper].inverse(SHOWN_LEVEL)
    return math.log2(level / float(values.max())), math.log2(level / median)


def expose(color: Color, luminance: Tensor, exposure: float, tone_mapper: ToneMapper) -> Color:
    """Display light 0..1, linear, of radiance at an exposure in stops.

    Args:
        color: linear radiance, not negative.
        luminance: of `color`, broadcast over the channels.
        exposure: log2 of the factor.
        tone_mapper: the curve; Reinhard divides a colour by 1 + its luminance.
    """
    scale = math.exp2(exposure)
    curve = CURVES[tone_mapper]
    if tone_mapper is ToneMapper.REINHARD:
        return (color * scale / (luminance * scale + 1.0)).clamp(0.0, 1.0)
    top = (color * (curve.k0 * scale * scale) + curve.k1 * scale) * color
    bottom = (color * (curve.k3 * scale * scale) + curve.k4 * scale) * color + curve.k5
    return (top / bottom).clamp(0.0, 1.0)
