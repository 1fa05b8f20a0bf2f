"""Vectors as three tensors: a component is contiguous, and no operation walks across channels."""

from __future__ import annotations

import torch
from torch import Tensor

Vector = tuple[Tensor, Tensor, Tensor]
"""x, y, z."""


def dot(a: Vector, b: Vector) -> Tensor:
    """Scalar product, component by component."""
    return torch.addcmul(torch.addcmul(a[0] * b[0], a[1], b[1]), a[2], b[2])


def scale_vector(a: Vector, factor: Tensor) -> Vector:
    """Product of a vector and a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def unit_vector(a: Vector) -> Vector:
    """Vector of length 1 in the same direction."""
    return scale_vector(a, dot(a, a).clamp_(min=1e-12).rsqrt_())
