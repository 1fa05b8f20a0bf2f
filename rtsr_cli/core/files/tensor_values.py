"""Numbers in files of tensors: what is read of weights is finite, or is refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor

from rtsr_cli.core.errors import CheckpointError


def check_finite(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """Refuse NaN and Inf, which would spread over every frame.

    Raises:
        CheckpointError: names the file, the first tensor that holds any, and counts the others.
    """
    # a sum is not enough: that of finite values may overflow
    bad = {
        name: count
        for name, tensor in tensors.items()
        if tensor.is_floating_point() and (count := _count_nonfinite(tensor))
    }
    if not bad:
        return
    name, count = next(iter(bad.items()))
    more = f", and {len(bad) - 1} other tensors hold some" if len(bad) > 1 else ""
    raise CheckpointError(
        f"{path}: {count} of the {tensors[name].numel()} values of tensor '{name}' are NaN or Inf"
        f"{more}; give weights of another checkpoint, or train them again"
    )


def _count_nonfinite(tensor: Tensor) -> int:
    return int((~torch.isfinite(tensor.float())).sum())
