"""Enlarging radiance, log lighting with holes, and the sky."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.enlargement import (
    AVERAGE_LOG_LIGHTING,
    bound_highlights,
    enlarge_log_lighting,
    enlarge_masked_radiance,
    enlarge_radiance,
)
from rtsr_cli.core.imaging.resampling import upsample_bicubic

MIDDLE = (0.125, 0.125)
"""Jitter of sample 2 of a block of 4."""


@pytest.mark.parametrize("value", [0.0, 0.3, 1.0, 40.0])
@pytest.mark.parametrize("jitter_px", [(0.0, 0.0), (0.375, -0.125)])
def test_constant_radiance_stays_constant(value: float, jitter_px: tuple[float, float]) -> None:
    large = enlarge_radiance(torch.full((1, 3, 5, 6), value), 4, jitter_px)
    assert large.shape == (1, 3, 20, 24)
    assert torch.allclose(large, torch.tensor(value), rtol=1e-4, atol=1e-6)


def test_radiance_passes_through_its_samples() -> None:
    color = torch.rand(1, 3, 6, 7) * 3.0
    large = enlarge_radiance(color, 4, MIDDLE)
    assert torch.allclose(large[..., 2::4, 2::4], color, rtol=1e-4)


def test_no_pixel_beside_a_highlight_is_brighter_than_it() -> None:
    color = torch.full((1, 3, 9, 9), 0.2)
    color[..., 4:] = 60.0
    large = enlarge_radiance(color, 4, (0.0, 0.0))
    assert float(large.max()) <= 60.0 * (1 + 1e-4)
    # without the bound, an overshoot in c / (1 + c)
    assert float(upsample_bicubic(encode_reinhard(color), 4).max()) > 1.0


def test_overshoot_of_what_is_dark_is_left() -> None:
    encoded = torch.full((1, 1, 5, 5), 0.2)
    sharpened = torch.full((1, 1, 10, 10), 0.3)
    assert torch.equal(bound_highlights(sharpened, encoded, 2), sharpened)
    assert float(bound_highlights(3.0 * sharpened, encoded, 2).max()) == 0.5


def holed() -> tuple[Tensor, Tensor]:
    """Return a constant with values that mean nothing in a hole of 7 x 7."""
    encoded, mask = torch.full((1, 3, 12, 12), 0.7), torch.ones(1, 1, 12, 12)
    mask[..., 2:9, 2:9] = 0.0
    return torch.where(mask > 0, encoded, torch.full_like(encoded, 99.0)), mask


def test_values_in_a_hole_never_reach_beyond_it() -> None:
    encoded, mask = holed()
    large = enlarge_log_lighting(encoded, mask, 4, MIDDLE)
    valid = mask.repeat_interleave(4, 2).repeat_interleave(4, 3).expand_as(large) > 0
    assert torch.allclose(large[valid], torch.tensor(0.7), atol=1e-5)
    assert float(large.max()) < 1.0


def test_lighting_is_the_average_where_nothing_valid_is_near() -> None:
    encoded, mask = holed()
    large = enlarge_log_lighting(encoded, mask, 4, MIDDLE)
    assert math.isclose(AVERAGE_LOG_LIGHTING, math.log(2.0))
    assert torch.allclose(large[..., 20:24, 20:24], torch.tensor(math.log(2.0)))
    # lighting that grows three pixels into the hole from each side leaves none
    grown = enlarge_log_lighting(encoded, mask, 4, MIDDLE, grow_px=4)
    assert torch.allclose(grown, torch.tensor(0.7), atol=1e-5)


def test_full_lighting_is_plain_bicubic() -> None:
    encoded = torch.rand(1, 3, 6, 6)
    large = enlarge_log_lighting(encoded, torch.ones(1, 1, 6, 6), 2, (0.25, 0.25))
    assert torch.allclose(large, upsample_bicubic(encoded, 2, (0.25, 0.25)), atol=1e-6)


def test_the_sky_is_enlarged_from_sky_alone() -> None:
    color, sky = torch.full((1, 3, 8, 8), 50.0), torch.zeros(1, 1, 8, 8)
    color[..., :4, :], sky[..., :4, :] = 0.8, 1.0
    large = enlarge_masked_radiance(color, sky, 4, MIDDLE)
    assert torch.allclose(large[..., :16, :], torch.tensor(0.8), atol=1e-4)


def test_sky_behind_a_lamp_is_the_nearest_sky() -> None:
    color, sky = torch.full((1, 3, 12, 12), 0.3), torch.ones(1, 1, 12, 12)
    color[..., 4:8, 4:8], sky[..., 4:8, 4:8] = 6.0, 0.0
    large = enlarge_masked_radiance(color, sky, 4, MIDDLE)
    # no pixel of the picture takes the lamp's light, whatever a guide at the target size asks for
    assert torch.allclose(large, torch.tensor(0.3), atol=1e-4)


def test_where_no_sky_is_near_the_plain_enlargement_stands_in() -> None:
    color = 0.1 + torch.rand(1, 3, 8, 8)
    large = enlarge_masked_radiance(color, torch.zeros(1, 1, 8, 8), 2, (0.0, 0.0))
    assert torch.allclose(large, enlarge_radiance(color, 2, (0.0, 0.0)), rtol=1e-5)


@pytest.mark.parametrize("value", [7e4, 2e5, 1e12, 3e38])
def test_radiance_that_half_cannot_hold_stays_constant(value: float) -> None:
    color = torch.full((1, 3, 5, 6), value)
    large = enlarge_radiance(color, 4, MIDDLE)
    assert large.dtype == torch.float32
    torch.testing.assert_close(large, torch.full_like(large, value), rtol=1e-5, atol=0.0)
    sky = enlarge_masked_radiance(color, torch.ones(1, 1, 5, 6), 4, MIDDLE)
    torch.testing.assert_close(sky, torch.full_like(sky, value), rtol=1e-5, atol=0.0)


def test_one_bright_pixel_leaves_the_others_as_they_are() -> None:
    color = torch.rand(1, 3, 12, 12) * 3.0
    plain = enlarge_radiance(color, 4, MIDDLE)
    color[..., 10, 10] = 1e6
    large = enlarge_radiance(color, 4, MIDDLE)
    torch.testing.assert_close(large[..., :24, :24], plain[..., :24, :24], rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(large[..., 42, 42], color[..., 10, 10], rtol=1e-5, atol=0.0)


def test_the_largest_half_is_not_exceeded() -> None:
    large = enlarge_radiance(torch.full((1, 3, 5, 6), 65504.0), 4, MIDDLE)
    assert float(large.max()) <= 65504.0
