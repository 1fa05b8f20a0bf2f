from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity
from torch import Tensor

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.metrics.ssim import cut_margin, margin_px, ms_ssim, ssim, ssim_map

TOLERANCE = 1e-5
ORACLE_KEYS = {
    SsimConvention.WANG: "ssim_gauss11_sigma1.5_valid_rgb_mean",
    SsimConvention.SKIMAGE7: "ssim_uniform7",
    SsimConvention.SKIMAGE11: "ssim_uniform11",
    SsimConvention.ZERO_PAD: "ssim_gauss11_zero_padded",
    SsimConvention.TORCHMETRICS: "ssim_torchmetrics_1.9",
}
SKIMAGE_SETTINGS: dict[SsimConvention, dict[str, Any]] = {
    SsimConvention.WANG: {
        "gaussian_weights": True,
        "sigma": 1.5,
        "use_sample_covariance": False,
    },
    SsimConvention.SKIMAGE7: {"win_size": 7},
    SsimConvention.SKIMAGE11: {"win_size": 11},
}

Pair = tuple[Tensor, Tensor]
Oracle = Callable[[str], dict[str, Any]]


def random_pair(height: int, width: int, batch: int = 1) -> Pair:
    generator = torch.Generator().manual_seed(height + width)
    ref = torch.rand(batch, 3, height, width, generator=generator)
    noise = torch.rand(batch, 3, height, width, generator=generator) - 0.5
    return (ref + 0.2 * noise).clamp(0.0, 1.0), ref


def as_picture(image: Tensor) -> np.ndarray:
    return image[0].permute(1, 2, 0).double().cpu().numpy()


@pytest.mark.parametrize("convention", list(SsimConvention))
def test_ssim_of_the_oracles(
    ldr_pair: Pair, ldr_crop: Pair, oracle: Oracle, convention: SsimConvention
) -> None:
    cases = oracle("psnr_ssim")["cases"]
    for pair, name in (
        (ldr_pair, "ldr_reference_vs_test"),
        (ldr_crop, "crop_64x64_at_row_64_col_96"),
    ):
        key = next(k for k in cases[name] if k.startswith(ORACLE_KEYS[convention]))
        assert ssim(*pair, convention).item() == pytest.approx(cases[name][key], abs=TOLERANCE)


def test_ms_ssim_of_the_oracles(ldr_pair: Pair, oracle: Oracle) -> None:
    case = oracle("psnr_ssim")["cases"]["ldr_reference_vs_test"]
    ours = ms_ssim(*ldr_pair).item()
    assert ours == pytest.approx(case["ms_ssim_piq"], abs=TOLERANCE)
    assert ours == pytest.approx(case["ms_ssim_torchmetrics"], abs=TOLERANCE)


@pytest.mark.parametrize("convention", list(SKIMAGE_SETTINGS))
@pytest.mark.parametrize("size", [(31, 45), (140, 130)])
def test_every_pixel_agrees_with_scikit_image(
    device: torch.device, convention: SsimConvention, size: tuple[int, int]
) -> None:
    test, ref = random_pair(*size)
    _, expected = structural_similarity(
        as_picture(ref),
        as_picture(test),
        channel_axis=-1,
        data_range=1.0,
        full=True,
        **SKIMAGE_SETTINGS[convention],
    )
    ours = ssim_map(test.to(device), ref.to(device), convention)
    inside = cut_margin(torch.from_numpy(expected.mean(-1))[None], margin_px(convention))
    torch.testing.assert_close(ours.cpu().double(), inside, atol=TOLERANCE, rtol=0.0)


@pytest.mark.parametrize(
    ("convention", "margin"),
    [("wang", 5), ("skimage7", 3), ("skimage11", 5), ("zero-pad", 0), ("torchmetrics", 0)],
)
def test_the_map_lies_a_margin_inside_the_frame(convention: str, margin: int) -> None:
    named = SsimConvention(convention)
    assert margin_px(named) == margin
    shape = ssim_map(*random_pair(150, 90, batch=2), named).shape
    assert shape == (2, 150 - 2 * margin, 90 - 2 * margin)


@pytest.mark.parametrize("convention", list(SsimConvention))
def test_equal_images_score_one(device: torch.device, convention: SsimConvention) -> None:
    ref = random_pair(40, 50)[1].to(device)
    assert ssim(ref, ref, convention).item() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("convention", list(SsimConvention))
def test_a_mask_of_the_frame_is_cut_to_the_map(convention: SsimConvention) -> None:
    test, ref = random_pair(40, 60)
    mask = torch.zeros(1, 1, 40, 60)
    mask[..., 12:20, 30:41] = 1.0
    margin = margin_px(convention)
    rows, columns = slice(12 - margin, 20 - margin), slice(30 - margin, 41 - margin)
    expected = ssim_map(test, ref, convention)[0, rows, columns].mean().item()
    assert ssim(test, ref, convention, mask=mask).item() == pytest.approx(expected, abs=1e-6)


def test_a_bright_flat_picture_keeps_its_precision() -> None:
    ref = torch.full((1, 3, 40, 40), 0.98)
    ref[..., ::2, ::3] += 0.002
    test = ref.flip(-1)
    exact = ssim_map(test.double(), ref.double())
    torch.testing.assert_close(ssim_map(test, ref).double(), exact, atol=2e-4, rtol=0.0)


def test_images_of_a_batch_do_not_mix() -> None:
    test, ref = random_pair(170, 180, batch=2)
    torch.testing.assert_close(ssim(test, ref)[1:], ssim(test[1:], ref[1:]))
    torch.testing.assert_close(ms_ssim(test, ref)[1:], ms_ssim(test[1:], ref[1:]))


def test_the_gradient_is_finite_for_equal_images(device: torch.device) -> None:
    ref = random_pair(30, 30)[1].to(device)
    test = ref.clone().requires_grad_()
    ssim(test, ref).mean().backward()
    assert test.grad is not None
    assert test.grad.isfinite().all()


@pytest.mark.parametrize("convention", list(SsimConvention))
def test_the_gradient_agrees_with_differences(convention: SsimConvention) -> None:
    test, ref = (image.double() for image in random_pair(12, 13))
    assert torch.autograd.gradcheck(
        lambda image: ssim(image, ref, convention), test.requires_grad_(), fast_mode=True
    )


def test_frames_smaller_than_a_window_are_refused() -> None:
    with pytest.raises(ShapeMismatchError, match=r"SSIM \(wang\) needs at least 11 pixels"):
        ssim(*random_pair(10, 40))
    with pytest.raises(ShapeMismatchError, match="MS-SSIM needs at least 161 pixels"):
        ms_ssim(*random_pair(160, 400))
    assert ms_ssim(*random_pair(161, 170)).isfinite().all()
