"""Errors to 0..1, where a network can learn them evenly, and back   [rt-percept, Section 3.3].

clamped:   T = min(1, Y / (2 mu))
logistic:  T = (S(Y) - S(0)) / (S(1) - S(0)),   S(Y) = 1 / (1 + exp(-k (Y - mu))),  k = 10

mu is the mean error of the training set. The clamped one hides what lies above 2 mu; the logistic
one, whose ends are at 0 and 1, is made for errors of that range.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from rtsr_cli.models.rt_percept.config import Transform

STEEPNESS = 10.0

EDGE = 1e-4
"""What the logistic inverse keeps away from 0 and 1, where it has no value."""


def _ends(mean: float) -> tuple[float, float]:
    """S(0) and S(1)."""
    return tuple(1.0 / (1.0 + math.exp(-STEEPNESS * (y - mean))) for y in (0.0, 1.0))  # type: ignore[return-value]


def transformed(errors: Tensor, mean: float, kind: Transform) -> Tensor:
    """T(Y), 0..1."""
    if kind is Transform.CLAMPED:
        return (errors / (2.0 * mean)).clamp(0.0, 1.0)
    low, high = _ends(mean)
    curve = torch.sigmoid(STEEPNESS * (errors - mean))
    return ((curve - low) / (high - low)).clamp(0.0, 1.0)


def restored(values: Tensor, mean: float, kind: Transform) -> Tensor:
    """T^-1."""
    if kind is Transform.CLAMPED:
        return values.clamp(0.0, 1.0) * (2.0 * mean)
    low, high = _ends(mean)
    share = (values * (high - low) + low).clamp(EDGE, 1.0 - EDGE)
    return (torch.log(share / (1.0 - share)) / STEEPNESS + mean).clamp(min=0.0)
