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

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.resampling import grow_valid, upsample_bicubic
from rtsr_cli.core.shapes import Color, Image, Mask, Plane

LEAST_COVERAGE = 1.0 / 256.0
"""Alpha below which a quotient is rounding: there the colour is that of the pixels around."""

UNEXPLAINED = 2.0
"""Light of so many times what faint coverage explains is added light; halves that are nearly 0 err
by less."""

REACH_PX = 16
"""Pixels that colour is filled into around what is covered: kernels see 3, networks more."""


@dataclass(frozen=True, kw_only=True)
class CoveredColor:
    """Radiance taken apart: `color` times `weight` is what the file holds."""

    color: Color
    weight: Plane


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
    return CoveredColor(color=straight, weight=weight)


def fill_around(image: Image, mask: Mask) -> Image:
    """Fill pixels outside of a mask from its rim, `REACH_PX` deep, then with 0."""
    if bool(mask.all()):
        return image
    return grow_valid(image, mask.to(image.dtype), REACH_PX)[0]


def multiply_coverage(color: Color, weight: Plane, scale: int, jitter_px: Jitter) -> Color:
    """Premultiply an enlarged colour by the enlarged weight.

    Args:
        color: at the target size.
        weight: of `CoveredColor`, at the rendered size.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.
    """
    return color * upsample_bicubic(weight, scale, jitter_px).clamp(0.0, 1.0)
