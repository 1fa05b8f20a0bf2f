"""The oracles of the metrics, the images they were measured on, and the devices to run on."""

from __future__ import annotations

import json
import runpy
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

HERE = Path(__file__).parent
CROP = (slice(64, 128), slice(96, 160))
"""Rows and columns of the crop that psnr_ssim.json names."""

Pair = tuple[Tensor, Tensor]


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> torch.device:
    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    return torch.device(request.param)


@pytest.fixture(scope="session")
def recipe() -> SimpleNamespace:
    """The functions of recipe.py."""
    return SimpleNamespace(**runpy.run_path(str(HERE / "recipe.py")))


@pytest.fixture(scope="session")
def oracle() -> Callable[[str], dict[str, Any]]:
    """A JSON file beside this one, by name."""

    def read(name: str) -> dict[str, Any]:
        return json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))

    return read


def as_tensor(picture: NDArray[np.generic], device: torch.device) -> Tensor:
    return torch.from_numpy(picture.copy()).permute(2, 0, 1)[None].float().to(device)


@pytest.fixture
def ldr_pair(recipe: SimpleNamespace, device: torch.device) -> Pair:
    """Test and reference, display-encoded, 0..1."""
    ref = recipe.ldr_reference()
    return tuple(as_tensor(p, device) / 255.0 for p in (recipe.ldr_test(ref), ref))


@pytest.fixture
def ldr_crop(ldr_pair: Pair) -> Pair:
    """The crop of `ldr_pair` that psnr_ssim.json has figures of."""
    return tuple(image[:, :, CROP[0], CROP[1]] for image in ldr_pair)


@pytest.fixture
def hdr_pair(recipe: SimpleNamespace, device: torch.device) -> Pair:
    """Test and reference, linear."""
    ref = recipe.hdr_reference()
    return tuple(as_tensor(p, device) for p in (recipe.hdr_test(ref), ref))
