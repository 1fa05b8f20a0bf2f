"""Coverage: radiance that is multiplied by alpha (premultiplied), taken apart and put back.

A file holds C = alpha c. Enlarging C through a tone curve and alpha without one gives edges that
are neither: over a background of its own colour a layer would darken or glow. So C is taken apart,

    C = w c,   c the colour where something is, w how much of the pixel it covers

c alone is enlarged, its holes filled from around them, and multiplied by the enlarged w. The weight
is alpha, but where alpha does not explain the light: light that is added without covering anything
(alpha 0, C above 0) is a colour of full weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.resampling import (
    BICUBIC_SUPPORT_PX,
    grow_valid,
    upsample_bicubic,
    upsample_nearest,
)
from rtsr_cli.core.shapes import Color, Image, Mask, Plane

LEAST_COVERAGE = 1.0 / 256.0
"""Alpha below which a quotient is rounding: there the colour is that of the pixels around."""

UNEXPLAINED = 2.0
"""Light of so many times what faint coverage explains is added light; halves that are nearly 0 err
by less."""

EDGE_STEP = 1.0 / 64.0
"""Difference of weights among neighbours from which they are an edge of what is covered."""

REACH_PX = 16
"""Pixels that colour is filled into around what is covered: kernels see 3, networks more."""


@dataclass(frozen=True, kw_only=True)
class CoveredColor:
    """Radiance taken apart: `color` times `weight` is what the file holds.

    Attributes:
        color: of what covers a pixel.
        weight: how much of the pixel that is, 0..1.
        stored: what the file holds, to the bit.
    """

    color: Color
    weight: Plane
    stored: Color

    def to(self, device: torch.device | str) -> CoveredColor:
        """Return the same on another device."""
        color, weight, stored = (i.to(device) for i in (self.color, self.weight, self.stored))
        return CoveredColor(color=color, weight=weight, stored=stored)


def divide_coverage(color: Color, alpha: Plane) -> CoveredColor | None:
    """Take premultiplied radiance apart; None where every pixel has full weight as it is.

    Args:
        color: premultiplied, finite.
        alpha: coverage, finite; below 0 it counts as 0, above 1 as 1.
    """
    coverage = alpha.clamp(0.0, 1.0)
    if bool((coverage == 1.0).all()):
        return None
    covered = coverage >= LEAST_COVERAGE
    quotient = color / coverage.clamp(min=LEAST_COVERAGE)
    around = fill_around(quotient, covered)
    explained = (color <= UNEXPLAINED * coverage * around.clamp(min=0.0)).all(1, keepdim=True)
    added = ~covered & ~explained
    if bool((added | (coverage == 1.0)).all()):
        return None
    straight = torch.where(covered, quotient, torch.where(added, color, around))
    if bool(added.any()):
        # what is added spreads into the empty pixels beside it, too
        straight = fill_around(straight, covered | added)
    weight = torch.where(added, torch.ones_like(coverage), coverage)
    return CoveredColor(color=straight, weight=weight, stored=color)


def fill_around(image: Image, mask: Mask) -> Image:
    """Fill pixels outside of a mask from its rim, `REACH_PX` deep, then with 0."""
    if bool(mask.all()):
        return image
    return grow_valid(image, mask.to(image.dtype), REACH_PX)[0]


def multiply_coverage(enlarged: Color, small: CoveredColor, scale: int, jitter_px: Jitter) -> Color:
    """Premultiply an enlarged colour by the enlarged weight.

    Where coverage ends, colour is held within that of the samples around: a network sees a surface
    end there, and what it makes of that is no part of the layer.

    Args:
        enlarged: the colour at the target size.
        small: what it was made from.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.
    """
    weight = upsample_bicubic(small.weight, scale, jitter_px).clamp(0.0, 1.0)
    darkest, brightest = (
        upsample_nearest(b, scale) for b in _find_bounds(small.color.clamp(min=0.0))
    )
    least, most = _find_bounds(small.weight)
    ends = upsample_nearest(most - least > EDGE_STEP, scale)
    bounded = torch.minimum(torch.maximum(enlarged, darkest), brightest)
    return torch.where(ends, bounded, enlarged) * weight


def _find_bounds(image: Image) -> tuple[Image, Image]:
    """Least and largest of the samples that a cubic kernel sees."""
    reach = BICUBIC_SUPPORT_PX
    lowest, highest = (
        F.max_pool2d(sign * image, 2 * reach + 1, stride=1, padding=reach) for sign in (-1, 1)
    )
    return -lowest, highest
