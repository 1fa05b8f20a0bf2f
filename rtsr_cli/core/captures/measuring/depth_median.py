"""The depth that half of the surfaces lie below, as it is stored."""

from __future__ import annotations

import torch
from torch import Tensor

LARGEST_HALF = 65504.0
"""What Unreal writes for the sky into half files."""


def find_median_depth(stored: Tensor) -> float | None:
    """Median of stored depth where it is that of a surface; None where there is none."""
    values = stored.flatten()
    surface = torch.isfinite(values) & (values > 0.0) & (values < LARGEST_HALF)
    return float(values[surface].median()) if bool(surface.any()) else None
