"""Shading rates: names, the codes of graphics interfaces, errors of rates from those of others.

A rate of A x B shades one sample for A pixels across and B down.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

import torch

from rtsr_cli.core.shapes import TileMap

DOUBLING = 2.13
"""What an error grows by when one axis' rate is halved once more   [Yang et al. 2019]."""


class ShadingRate(Enum):
    """A shading rate: (pixels across, pixels down, code).

    The code is that of D3D12_SHADING_RATE; Vulkan's fragment-shading-rate attachment has the same.
    """

    FULL = (1, 1, 0)
    HALF_Y = (1, 2, 1)
    HALF_X = (2, 1, 4)
    HALF = (2, 2, 5)
    QUARTER_Y = (2, 4, 6)
    QUARTER_X = (4, 2, 9)
    QUARTER = (4, 4, 10)

    @property
    def across(self) -> int:
        """Pixels that share a sample, along x."""
        return self.value[0]

    @property
    def down(self) -> int:
        """The same along y."""
        return self.value[1]

    @property
    def code(self) -> int:
        """Byte of a shading-rate image."""
        return self.value[2]

    @property
    def label(self) -> str:
        """What files and users call it."""
        return f"{self.across}x{self.down}"

    @property
    def samples(self) -> float:
        """Share of the pixels that are shaded."""
        return 1.0 / (self.across * self.down)


REDUCED: tuple[ShadingRate, ...] = tuple(
    rate for rate in ShadingRate if rate is not ShadingRate.FULL
)
"""Every rate that saves anything."""

CHEAPEST_FIRST = (
    (ShadingRate.QUARTER,),
    (ShadingRate.QUARTER_X, ShadingRate.QUARTER_Y),
    (ShadingRate.HALF,),
    (ShadingRate.HALF_X, ShadingRate.HALF_Y),
)
"""Rates by cost; among those of one cost the one of the lower error is taken."""

Errors = Mapping[ShadingRate, TileMap]
"""Amplitude of the error of each rate, 0 = none, n 1 tiles-down tiles-across."""


def extrapolate_errors(errors: Errors) -> dict[ShadingRate, TileMap]:
    """Errors of the rates that were not predicted, from those that were.

        22 = max(12, 21),  24 = max(k 12, 22),  42 = max(k 21, 22),  44 = max(24, 42)   [Eq. 10]

    Args:
        errors: of 1x2 and 2x1 at least; what is given stays as it is.

    Returns:
        Errors of every reduced rate.
    """
    known = dict(errors)
    x, y = known[ShadingRate.HALF_X], known[ShadingRate.HALF_Y]
    half = known.setdefault(ShadingRate.HALF, torch.maximum(x, y))
    known.setdefault(ShadingRate.QUARTER_Y, torch.maximum(DOUBLING * y, half))
    known.setdefault(ShadingRate.QUARTER_X, torch.maximum(DOUBLING * x, half))
    quarters = torch.maximum(known[ShadingRate.QUARTER_X], known[ShadingRate.QUARTER_Y])
    known.setdefault(ShadingRate.QUARTER, quarters)
    return {rate: known[rate] for rate in REDUCED}


def choose_codes(errors: Errors, threshold: float) -> TileMap:
    """Codes of the cheapest rates whose error lies below a threshold; full rate where none does.

    Args:
        errors: of every reduced rate.
        threshold: amplitude of the error that may just not be reached.

    Returns:
        Whole numbers, of the errors' shape.
    """
    codes = torch.full_like(errors[ShadingRate.HALF], ShadingRate.FULL.code)
    for same_cost in reversed(CHEAPEST_FIRST):
        stacked = torch.stack([errors[rate] for rate in same_cost])
        lowest, index = stacked.min(dim=0)
        of_cost = codes.new_tensor([rate.code for rate in same_cost])[index]
        codes = torch.where(lowest < threshold, of_cost, codes)
    return codes


def rate_shares(codes: TileMap, pixels: TileMap) -> dict[str, float]:
    """Share of the frame's pixels at each rate.

    Args:
        codes: of the tiles' rates.
        pixels: share of the frame's pixels in each tile.
    """
    return {rate.label: float(pixels[codes == rate.code].sum()) for rate in ShadingRate}


def shaded_share(shares: Mapping[str, float]) -> float:
    """Samples that are shaded, as a share of those at full rate."""
    return sum(shares[rate.label] * rate.samples for rate in ShadingRate)
