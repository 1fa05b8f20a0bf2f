from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.metrics.fidelity import masked_mean, psnr, squared_error_map

TOLERANCE_DB = 1e-4
Oracle = Callable[[str], dict[str, Any]]


def test_psnr_of_the_oracles(
    ldr_pair: tuple[Tensor, Tensor], ldr_crop: tuple[Tensor, Tensor], oracle: Oracle
) -> None:
    cases = oracle("psnr_ssim")["cases"]
    for pair, name in (
        (ldr_pair, "ldr_reference_vs_test"),
        (ldr_crop, "crop_64x64_at_row_64_col_96"),
    ):
        assert psnr(*pair).item() == pytest.approx(cases[name]["psnr_db"], abs=TOLERANCE_DB)


def test_tiles_of_the_error_map_have_the_psnr_of_the_oracle(
    ldr_pair: tuple[Tensor, Tensor], oracle: Oracle
) -> None:
    tiles = squared_error_map(*ldr_pair)[0].unflatten(0, (12, 16)).unflatten(2, (16, 16))
    expected = torch.tensor(oracle("psnr_ssim")["tile16_psnr_db"])
    torch.testing.assert_close(
        -10.0 * tiles.mean((1, 3)).log10().cpu(), expected, atol=TOLERANCE_DB, rtol=0.0
    )


def test_equal_images_have_infinite_psnr_each_image_its_own(device: torch.device) -> None:
    ref = torch.rand(2, 3, 20, 30, device=device)
    test = ref.clone()
    test[1] += 0.1
    assert psnr(test, ref).tolist() == [float("inf"), pytest.approx(20.0, abs=1e-4)]


def test_a_mask_leaves_out_what_it_covers(device: torch.device) -> None:
    ref = torch.full((1, 3, 8, 8), 0.5, device=device)
    test = ref + 0.01
    test[..., 4:] = torch.nan
    mask = torch.ones(1, 1, 8, 8, device=device)
    mask[..., 4:] = 0.0
    assert psnr(test, ref, mask).item() == pytest.approx(40.0, abs=1e-4)


def test_an_empty_mask_gives_nan() -> None:
    assert masked_mean(torch.ones(1, 4, 4), torch.zeros(1, 1, 4, 4)).isnan().all()


def test_the_error_map_agrees_with_the_definition_where_strips_end(device: torch.device) -> None:
    generator = torch.Generator().manual_seed(1)
    test, ref = (torch.rand(2, 3, 301, 70, generator=generator).to(device) for _ in range(2))
    torch.testing.assert_close(squared_error_map(test, ref), (test - ref).square().mean(1))


def test_images_of_different_sizes_are_refused() -> None:
    with pytest.raises(ShapeMismatchError, match="of one size"):
        psnr(torch.zeros(1, 3, 4, 4), torch.zeros(1, 3, 4, 5))


def test_integers_and_masks_of_another_size_are_refused() -> None:
    byte = torch.zeros(1, 3, 4, 4, dtype=torch.uint8)
    with pytest.raises(TypeError, match="floating-point"):
        psnr(byte, byte)
    with pytest.raises(ShapeMismatchError, match="does not fit"):
        masked_mean(torch.ones(1, 4, 4), torch.ones(1, 1, 4, 5))
