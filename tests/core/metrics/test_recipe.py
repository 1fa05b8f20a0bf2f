from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest


@pytest.mark.parametrize("name", ["flip", "psnr_ssim"])
def test_the_images_are_those_the_oracles_were_measured_on(
    recipe: SimpleNamespace, oracle: Callable[[str], dict[str, Any]], name: str
) -> None:
    ldr, hdr = recipe.ldr_reference(), recipe.hdr_reference()
    images = {
        "ldr_reference": ldr,
        "ldr_test": recipe.ldr_test(ldr),
        "hdr_reference": hdr,
        "hdr_test": recipe.hdr_test(hdr),
    }
    assert {key: recipe.sha256(image) for key, image in images.items()} == oracle(name)["images"]
