from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from rtsr_cli.core.errors import RtsrError, ShapeMismatchError
from rtsr_cli.core.metrics.flip import (
    DEFAULT_PPD,
    exposure_range,
    hdr_flip,
    ldr_flip,
    pixels_per_degree,
)
from rtsr_cli.core.metrics.flip_vision import _color_matrices
from rtsr_cli.core.metrics.tonemapping import ToneMapper

MEAN_TOLERANCE, PIXEL_TOLERANCE = 1e-5, 2e-4
OFFICIAL_PIXEL_TOLERANCE = 1e-4
EXPOSURE_TOLERANCE = 1e-4
PERCENTILES = (25, 50, 75, 95, 99)

HDR_CASES = [
    "hdr_auto_aces",
    "hdr_auto_hable",
    "hdr_auto_reinhard",
    "hdr_start-2_stop2_num5_aces",
    "hdr_start-4_stop4_auto_num_aces",
]

Pair = tuple[Tensor, Tensor]
Oracle = Callable[[str], dict[str, Any]]


def plain(value: float, device: torch.device, size: int = 64) -> Tensor:
    return torch.full((1, 3, size, size), value, device=device)


def as_picture(image: Tensor) -> np.ndarray:
    return image[0].permute(1, 2, 0).contiguous().cpu().numpy()


def agrees(error: Tensor, case: dict[str, Any]) -> None:
    """Hold one map against every figure of its oracle."""
    found = error[0].double().cpu()
    assert found.mean().item() == pytest.approx(case["mean"], abs=MEAN_TOLERANCE)
    assert found.min().item() == pytest.approx(case["min"], abs=PIXEL_TOLERANCE)
    assert found.max().item() == pytest.approx(case["max"], abs=PIXEL_TOLERANCE)
    for row, column, value in case["pixels"]:
        assert found[row, column].item() == pytest.approx(value, abs=PIXEL_TOLERANCE)
    percentiles = np.percentile(found.numpy(), PERCENTILES)
    expected = [case["percentiles"][str(p)] for p in PERCENTILES]
    np.testing.assert_allclose(percentiles, expected, atol=PIXEL_TOLERANCE, rtol=0.0)
    tiles = found.unflatten(0, (-1, 16)).unflatten(2, (-1, 16))
    for name, values in (("mean", tiles.mean((1, 3))), ("max", tiles.amax((1, 3)))):
        if f"tile16_{name}" in case:
            expected_tiles = torch.tensor(case[f"tile16_{name}"]).double()
            torch.testing.assert_close(values, expected_tiles, atol=PIXEL_TOLERANCE, rtol=0.0)


def hdr_settings(parameters: dict[str, Any]) -> dict[str, Any]:
    ours = {"startExposure": "start", "stopExposure": "stop", "numExposures": "count"}
    settings = {ours[key]: value for key, value in parameters.items() if key in ours}
    return settings | {"tone_mapper": ToneMapper(parameters["tonemapper"])}


@pytest.mark.parametrize(("name", "ppd"), [("ldr_default", DEFAULT_PPD), ("ldr_ppd30", 30.0)])
def test_ldr_flip_of_the_oracles(ldr_pair: Pair, oracle: Oracle, name: str, ppd: float) -> None:
    agrees(ldr_flip(*ldr_pair, ppd), oracle("flip")["cases"][name])


def test_ldr_flip_of_equal_images_is_zero(ldr_pair: Pair, oracle: Oracle) -> None:
    error = ldr_flip(ldr_pair[1], ldr_pair[1])
    assert error.count_nonzero() == 0
    agrees(error, oracle("flip")["cases"]["ldr_identical"])


def test_ldr_flip_of_black_against_white(device: torch.device, oracle: Oracle) -> None:
    error = ldr_flip(plain(1.0, device), plain(0.0, device))
    agrees(error, oracle("flip")["cases"]["ldr_black_vs_white_64x64"])


def test_ldr_flip_of_one_white_pixel(device: torch.device, oracle: Oracle) -> None:
    ref = plain(128.0 / 255.0, device)
    test = ref.clone()
    test[..., 32, 32] = 1.0
    agrees(ldr_flip(test, ref), oracle("flip")["cases"]["ldr_one_white_pixel_on_128_grey_64x64"])


@pytest.mark.parametrize("name", HDR_CASES)
def test_hdr_flip_of_the_oracles(hdr_pair: Pair, oracle: Oracle, name: str) -> None:
    case = oracle("flip")["cases"][name]
    result = hdr_flip(*hdr_pair, **hdr_settings(case["parameters"]))
    agrees(result.error, case)
    (used,) = result.exposures
    assert used.count == case["used"]["numExposures"]
    assert used.start == pytest.approx(case["used"]["startExposure"], abs=EXPOSURE_TOLERANCE)
    assert used.stop == pytest.approx(case["used"]["stopExposure"], abs=EXPOSURE_TOLERANCE)


def test_the_default_viewing_condition_is_the_published_one(oracle: Oracle) -> None:
    assert pixels_per_degree(0.7, 3840, 0.7) == DEFAULT_PPD
    assert pytest.approx(oracle("flip")["published"]["ppd"], abs=1e-4) == DEFAULT_PPD


@pytest.mark.parametrize("size", [(33, 47), (150, 200)])
def test_every_pixel_agrees_with_the_reference_program(
    device: torch.device, size: tuple[int, int]
) -> None:
    official = pytest.importorskip("flip_evaluator")
    generator = torch.Generator().manual_seed(3)
    ref = torch.rand(1, 3, *size, generator=generator)
    test = (ref + 0.4 * (torch.rand(1, 3, *size, generator=generator) - 0.5)).clamp(0.0, 1.0)
    test[..., : size[1] // 2] = ref[..., : size[1] // 2]
    expected, _, _ = official.evaluate(
        as_picture(ref), as_picture(test), "LDR", True, False, True, {}
    )
    difference = ldr_flip(test.to(device), ref.to(device))[0].cpu().numpy() - expected[..., 0]
    assert np.abs(difference).max() < OFFICIAL_PIXEL_TOLERANCE


@pytest.mark.parametrize("tone_mapper", list(ToneMapper))
def test_every_hdr_pixel_agrees_with_the_reference_program(
    device: torch.device, tone_mapper: ToneMapper
) -> None:
    official = pytest.importorskip("flip_evaluator")
    generator = torch.Generator().manual_seed(4)
    ref = torch.exp2(8.0 * torch.rand(1, 3, 70, 90, generator=generator) - 4.0)
    test = ref * (0.7 + 0.6 * torch.rand(1, 3, 70, 90, generator=generator))
    expected, _, used = official.evaluate(
        as_picture(ref), as_picture(test), "HDR", False, False, True, {"tonemapper": tone_mapper}
    )
    result = hdr_flip(test.to(device), ref.to(device), tone_mapper=tone_mapper)
    difference = result.error[0].cpu().numpy() - expected[..., 0]
    assert np.abs(difference).max() < OFFICIAL_PIXEL_TOLERANCE
    assert result.exposures[0].stop == pytest.approx(used["stopExposure"], abs=EXPOSURE_TOLERANCE)


def test_the_result_does_not_depend_on_where_strips_end(
    ldr_pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = ldr_flip(*ldr_pair)
    monkeypatch.setattr("rtsr_cli.core.metrics.filters.BAND_OUTPUTS", 64)
    monkeypatch.setattr("rtsr_cli.core.metrics.filters.STRIP_PIXELS", {"cpu": 1, "cuda": 1})
    torch.testing.assert_close(ldr_flip(*ldr_pair), whole, atol=2e-5, rtol=0.0)


def test_images_of_a_batch_do_not_mix(ldr_pair: Pair, hdr_pair: Pair) -> None:
    test, ref = (torch.cat([image, image.flip(-1) * 0.5]) for image in ldr_pair)
    torch.testing.assert_close(
        ldr_flip(test, ref)[1:], ldr_flip(test[1:], ref[1:]), atol=2e-5, rtol=0.0
    )
    test, ref = (torch.cat([image, image * 2.0]) for image in hdr_pair)
    dim, bright = hdr_flip(test, ref).exposures
    assert bright.start == pytest.approx(dim.start - 1.0, abs=1e-5)
    assert bright.stop == pytest.approx(dim.stop - 1.0, abs=1e-5)


def test_the_gradient_agrees_with_differences() -> None:
    generator = torch.Generator().manual_seed(5)
    test, ref = (
        0.2 + 0.6 * torch.rand(1, 3, 6, 7, generator=generator, dtype=torch.float64)
        for _ in range(2)
    )
    assert torch.autograd.gradcheck(lambda image: ldr_flip(image, ref), test.requires_grad_())


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_gradients_of_equal_images_are_finite(device: torch.device, value: float) -> None:
    ref = plain(value, device, size=24)
    ref[..., 5:9, 5:9] = 0.3
    test = ref.clone().requires_grad_()
    (ldr_flip(test, ref).mean() + hdr_flip(test, ref).error.mean()).backward()
    assert test.grad is not None
    assert test.grad.isfinite().all()


def test_a_step_down_the_gradient_lowers_the_error(ldr_pair: Pair) -> None:
    test, ref = ldr_pair[0].clone().requires_grad_(), ldr_pair[1]
    before = ldr_flip(test, ref).mean()
    before.backward()
    assert test.grad is not None
    assert test.grad.isfinite().all()
    step = 1e-3 * test.grad / test.grad.abs().max()
    assert ldr_flip(test.detach() - step, ref).mean() < before.detach()


def test_exposures_follow_the_brightest_and_the_median_pixel() -> None:
    ref = torch.full((1, 3, 4, 4), 2.0)
    ref[..., 0, 0] = 16.0
    used = exposure_range(ref, ToneMapper.REINHARD)
    # Reinhard shows x / (1 + x) = 0.85 at x = 17/3
    assert used.start == pytest.approx(np.log2(17.0 / 3.0 / 16.0), abs=1e-5)
    assert used.stop == pytest.approx(np.log2(17.0 / 3.0 / 2.0), abs=1e-5)
    assert used.count == 3


def test_a_mostly_black_reference_takes_the_median_of_its_lit_pixels() -> None:
    ref = torch.zeros(1, 3, 4, 4)
    ref[..., 0, :3] = 2.0
    used = exposure_range(ref, ToneMapper.REINHARD)
    assert used.stop == used.start == pytest.approx(np.log2(17.0 / 3.0 / 2.0), abs=1e-5)
    assert hdr_flip(torch.zeros_like(ref), torch.zeros_like(ref)).error.count_nonzero() == 0


def test_what_cannot_be_compared_is_refused(device: torch.device) -> None:
    good, bad = plain(0.5, device), plain(0.5, device)
    bad[0, 1, 3, 4] = torch.nan
    with pytest.raises(RtsrError, match="the test image has NaN"):
        ldr_flip(bad, good)
    bad[0, 1, 3, 4] = torch.inf
    with pytest.raises(RtsrError, match="the reference image has NaN or infinite"):
        hdr_flip(good, bad)
    with pytest.raises(ShapeMismatchError, match=r"not 1 channel\(s\)"):
        ldr_flip(good[:, :1], good[:, :1])
    with pytest.raises(RtsrError, match="start not above the stop"):
        hdr_flip(good, good, start=2.0, stop=1.0)
    with pytest.raises(RtsrError, match="at least 2 exposures"):
        hdr_flip(good, good, start=1.0, stop=2.0, count=1)


def test_a_run_in_inference_mode_does_not_spoil_later_gradients() -> None:
    _color_matrices.cache_clear()
    ref = torch.rand(1, 3, 8, 8, dtype=torch.float64)
    with torch.inference_mode():
        ldr_flip(ref, ref)
    test = (0.9 * ref).requires_grad_()
    ldr_flip(test, ref).mean().backward()
    assert test.grad is not None


def test_one_reference_may_stand_against_many(ldr_pair: Pair) -> None:
    test, ref = ldr_pair
    many = torch.cat([test, ref, test.flip(-1)])
    each = torch.cat([ldr_flip(image, ref) for image in many.split(1)])
    assert torch.allclose(ldr_flip(many, ref), each, atol=1e-6)
    with pytest.raises(ShapeMismatchError):
        ldr_flip(many, many[:2])
