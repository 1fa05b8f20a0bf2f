"""How far stored numbers are from what was meant: what halves and coarse steps leave."""

from __future__ import annotations

import torch
from torch import Tensor

HALF_ROUNDING, SINGLE_ROUNDING = 2.0**-11, 2.0**-24
"""Shares of a number that halves and singles of 11 and 24 digits are off by at most."""

SMALLEST_HALF = 2.0**-25
"""What small halves, of fewer digits, are off by."""

COARSEST, FINEST = 0, -20
"""Powers of two that steps are looked for in."""

LEAST_STEPS = 8
"""Fewer distinct numbers may be multiples of a step by chance: walls that move alike."""


def measure_rounding(stored: Tensor) -> Tensor:
    """Largest distance of each number from what was meant, in its unit; 0 where it is not finite.

        r = max(s, |x| 2^-11 of halves or |x| 2^-24 of singles)

    s is the largest power of two of which all are multiples, as halves around 0.5 are from which a
    constant was taken: there the step of the smaller ones is half that of the larger ones.

    Args:
        stored: as in the files, or computed from that.
    """
    finite = torch.isfinite(stored)
    known = stored[finite]
    halves = bool((known.half().to(known) == known).all())
    step = max(find_step(known), SMALLEST_HALF if halves else 0.0)
    off = (stored.abs() * (HALF_ROUNDING if halves else SINGLE_ROUNDING)).clamp(min=step)
    return torch.where(finite, off, torch.zeros_like(off))


def find_step(known: Tensor) -> float:
    """The largest power of two of which all numbers are multiples; 0 where there is none.

    Args:
        known: finite numbers.
    """
    if torch.unique(known).numel() < LEAST_STEPS:
        return 0.0
    for power in range(COARSEST, FINEST - 1, -1):
        counted = known.double() * 2.0**-power
        if bool((counted == counted.round()).all()):
            return 2.0**power
    return 0.0
