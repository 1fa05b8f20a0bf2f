from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.imaging.color import (
    LUMA_REC709,
    decode_log,
    decode_reinhard,
    decode_srgb,
    encode_log,
    encode_reinhard,
    encode_srgb,
    luminance,
)
from rtsr_cli.core.imaging.primaries import import_colour


def values(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.float64).view(1, 1, 1, -1)


def test_the_weights_of_luminance_sum_to_one() -> None:
    assert sum(LUMA_REC709) == pytest.approx(1.0)


def test_luminance_is_the_weighted_sum_of_each_pixel() -> None:
    color = torch.tensor([[1.0, 2.0, 3.0], [0.0, 1.0, 0.0]]).T.reshape(1, 3, 1, 2)
    expected = [0.2126 + 2 * 0.7152 + 3 * 0.0722, 0.7152]
    assert luminance(color).flatten().tolist() == pytest.approx(expected)


def test_reinhard_halves_one_and_maps_three_to_three_quarters() -> None:
    assert encode_reinhard(values(0.0, 1.0, 3.0)).flatten().tolist() == [0.0, 0.5, 0.75]


def test_reinhard_takes_negative_radiance_for_black() -> None:
    assert float(encode_reinhard(values(-0.5))) == 0.0


def test_expanding_a_filtered_overshoot_stays_within_half_range() -> None:
    expanded = decode_reinhard(torch.tensor([1.0, 1.2, -0.3]).view(1, 1, 1, 3)).flatten()
    assert torch.isfinite(expanded).all()
    assert float(expanded[0]) == float(expanded[1])
    assert float(expanded[1]) == pytest.approx(MAX_HALF, rel=2e-3)
    assert float(expanded[2]) == 0.0


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, MAX_HALF))
def test_reinhard_comes_back(radiance: float) -> None:
    assert float(decode_reinhard(encode_reinhard(values(radiance)))) == pytest.approx(
        radiance, rel=1e-9, abs=1e-12
    )


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, MAX_HALF), st.floats(1e-3, 1e3))
def test_the_log_curve_is_log_of_one_plus_lighting_over_scale_and_comes_back(
    lighting: float, scale: float
) -> None:
    encoded = encode_log(values(lighting), scale)
    assert float(encoded) == pytest.approx(math.log(1.0 + lighting / scale), rel=1e-9, abs=1e-12)
    assert float(decode_log(encoded, scale)) == pytest.approx(lighting, rel=1e-9, abs=1e-9)


def test_expanding_a_negative_log_value_gives_black() -> None:
    assert float(decode_log(values(-0.1), 2.0)) == 0.0


def srgb(linear: float) -> float:
    """IEC 61966-2-1, one value at a time."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 1.0))
def test_the_srgb_curve_is_that_of_the_standard_and_comes_back(linear: float) -> None:
    encoded = encode_srgb(values(linear))
    assert float(encoded) == pytest.approx(srgb(linear), abs=1e-9)
    assert float(decode_srgb(encoded)) == pytest.approx(linear, abs=1e-7)


def test_the_two_parts_of_the_srgb_curve_meet() -> None:
    around = encode_srgb(values(0.0031307, 0.0031308, 0.0031309)).flatten()
    assert (around.diff().abs() < 2e-6).all()
    assert (around.diff() > 0).all()


def test_the_srgb_curve_agrees_with_colour_science() -> None:
    models = import_colour().models
    linear = torch.linspace(0, 1, 101, dtype=torch.float64)
    oracle = models.eotf_inverse_sRGB(linear.numpy())
    ours = encode_srgb(linear.view(1, 1, 1, -1)).flatten().numpy()
    assert abs(ours - oracle).max() < 1e-6


def test_srgb_clips_to_its_range_in_both_directions() -> None:
    assert encode_srgb(values(-1.0, 7.0)).flatten().tolist() == [0.0, pytest.approx(1.0)]
    assert decode_srgb(values(-1.0, 7.0)).flatten().tolist() == [0.0, pytest.approx(1.0)]


@pytest.mark.parametrize("number", [0.0, 0.001, 0.0031308, 0.2])
def test_gradients_of_the_srgb_curve_are_finite(number: float) -> None:
    linear = values(number).requires_grad_()
    encode_srgb(linear).sum().backward()
    assert linear.grad is not None
    assert torch.isfinite(linear.grad).all()
