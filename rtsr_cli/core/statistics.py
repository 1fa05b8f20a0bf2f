"""How far a mean over few frames can be trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

T_975 = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
    2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086,
    2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
)  # fmt: skip
"""97.5 % quantile of Student's t for 1 to 30 degrees of freedom [any table of it]."""

Z_975 = 1.960

MIN_VALUES = 3
"""Of fewer values an interval would say nothing."""

MAX_CORRELATION = 0.8
"""Bound of the neighbours' correlation, which a short sequence estimates poorly."""

INTERVAL_RULE = (
    "95 % intervals are Student's t over the frames, widened by the correlation of neighbouring "
    "frames as far as it shows; none below 3 frames. They tell how a method does on more frames "
    "like these, not on other scenes"
)


def quantile_975(freedom: int) -> float:
    """97.5 % quantile of t; beyond the table by its expansion z + (z^3 + z) / (4 n)."""
    if freedom <= len(T_975):
        return T_975[freedom - 1]
    return Z_975 + (Z_975**3 + Z_975) / (4.0 * freedom)


def mean_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """95 % interval of the mean of successive values, None of fewer than `MIN_VALUES`.

    m -+ t s / sqrt(n) * sqrt((1 + r) / (1 - r)),   r the correlation of neighbours, 0 to 0.8
    """
    count = len(values)
    if count < MIN_VALUES:
        return None
    mean = math.fsum(values) / count
    away = [value - mean for value in values]
    squares = math.fsum(a * a for a in away)
    if squares == 0.0:
        return mean, mean
    shared = math.fsum(a * b for a, b in pairwise(away)) / squares
    correlation = min(max(shared, 0.0), MAX_CORRELATION)
    error = math.sqrt(squares / (count - 1) / count)
    half = quantile_975(count - 1) * error
    half *= math.sqrt((1.0 + correlation) / (1.0 - correlation))
    return mean - half, mean + half
