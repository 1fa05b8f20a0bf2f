"""Transfer functions against the oracle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from rtsr_cli.core.imaging.color import (
    encode_aces,
    encode_srgb,
)

Oracle = Callable[[str], dict[str, Any]]


def grey(*values: float, device: torch.device | None = None) -> torch.Tensor:
    """One row of pixels, each value in all three channels."""
    return torch.tensor(values, device=device).view(1, 1, 1, -1).expand(1, 3, 1, -1)


@pytest.mark.parametrize(
    ("encode", "case", "given", "peak"),
    [
        (encode_srgb, "srgb_encode", "linear", 1.0),
        (encode_aces, "aces_narkowicz", "linear", 1.0),
    ],
)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 5e-8), (torch.float32, 1e-5)])
def test_transfer_functions_agree_with_the_oracle(
    oracle: Oracle,
    device: torch.device,
    encode: Any,
    case: str,
    given: str,
    peak: float,
    dtype: torch.dtype,
    tolerance: float,
) -> None:
    figures = oracle("transfer")[case]
    encoded = encode(grey(*figures[given], device=device).to(dtype))
    for channel in encoded[0].flatten(1).cpu():
        assert channel.tolist() == pytest.approx(figures["encoded"], abs=tolerance * peak)


def test_the_aces_curve_keeps_within_its_range() -> None:
    assert encode_aces(grey(-1.0, 65504.0))[0, 0, 0].tolist() == [0.0, 1.0]
