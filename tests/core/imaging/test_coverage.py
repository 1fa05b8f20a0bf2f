"""Coverage: what is taken apart and put together again."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from rtsr_cli.core.imaging.coverage import divide_coverage, multiply_coverage
from rtsr_cli.core.imaging.enlargement import enlarge_radiance
from rtsr_cli.core.imaging.resampling import upsample_bicubic

SIZE = (12, 16)
STILL = (0.0, 0.0)


def plane(value: float) -> Tensor:
    return torch.full((1, 1, *SIZE), value)


def color(value: float) -> Tensor:
    return torch.full((1, 3, *SIZE), value)


def soft_disc() -> Tensor:
    y, x = torch.meshgrid(torch.arange(12.0), torch.arange(16.0), indexing="ij")
    distance = ((x - 7.3) ** 2 + (y - 5.6) ** 2).sqrt()
    return (4.0 - distance).clamp(0.0, 1.0)[None, None]


def enlarge(radiance: Tensor, alpha: Tensor, scale: int = 4) -> Tensor:
    """Premultiplied radiance as `bicubic` enlarges it."""
    covered = divide_coverage(radiance, alpha)
    if covered is None:
        return enlarge_radiance(radiance, scale, STILL)
    return multiply_coverage(enlarge_radiance(covered.color, scale, STILL), covered, scale, STILL)


@pytest.mark.parametrize("value", [1.0, 1.25])
def test_what_covers_every_pixel_is_not_touched(value: float) -> None:
    assert divide_coverage(torch.rand(1, 3, *SIZE), plane(value)) is None


@pytest.mark.parametrize("alpha", [0.0, -0.5])
def test_light_without_any_coverage_is_not_touched(alpha: float) -> None:
    """Alpha may be no coverage at all: engines leave it 0."""
    assert divide_coverage(torch.rand(1, 3, *SIZE) + 0.1, plane(alpha)) is None


def test_nothing_where_nothing_is() -> None:
    covered = divide_coverage(color(0.0), plane(0.0))
    assert covered is not None
    assert not covered.color.any()
    assert not covered.weight.any()


def test_colour_times_weight_is_what_the_file_holds() -> None:
    random = torch.Generator().manual_seed(3)
    alpha = 0.01 + 0.99 * torch.rand(1, 1, *SIZE, generator=random)
    radiance = alpha * (0.1 + torch.rand(1, 3, *SIZE, generator=random))
    covered = divide_coverage(radiance, alpha)
    assert covered is not None
    torch.testing.assert_close(covered.color * covered.weight, radiance)


@pytest.mark.parametrize("value", [0.01, 0.8, 8.0, 300.0, 3e4, 2e5])
@pytest.mark.parametrize("half", [False, True])
def test_a_layer_over_its_own_colour_stays_that_colour(value: float, half: bool) -> None:
    alpha = soft_disc()
    radiance = (alpha * value).expand(-1, 3, -1, -1)
    if half and value < 65504:
        alpha, radiance = alpha.half().float(), radiance.half().float()
    enlarged_alpha = upsample_bicubic(alpha, 4).clamp(0.0, 1.0)
    over = enlarge(radiance, alpha) + (1.0 - enlarged_alpha) * value
    torch.testing.assert_close(over, torch.full_like(over, value), rtol=5e-3, atol=0.0)


@given(st.floats(1e-7, 1.0), st.floats(0.01, 1e4))
def test_faint_coverage_has_the_colour_around_it(faint: float, value: float) -> None:
    """Pixel filters leave tails whose quotient in half is anything."""
    alpha = plane(1.0)
    alpha[..., 8] = faint
    alpha[..., 9:] = 0.0
    radiance = (alpha * value).half().float().expand(-1, 3, -1, -1)
    enlarged_alpha = upsample_bicubic(alpha.half().float(), 4).clamp(0.0, 1.0)
    over = enlarge(radiance, alpha.half().float()) + (1.0 - enlarged_alpha) * value
    torch.testing.assert_close(over, torch.full_like(over, value), rtol=0.02, atol=0.0)


@pytest.mark.parametrize("alpha", [0.0, 1e-6, 1e-3])
def test_light_that_is_added_survives(alpha: float) -> None:
    radiance, coverage = color(0.0), plane(0.0)
    radiance[..., 3:8, 4:9], coverage[..., 3:8, 4:9] = 5.0, alpha
    enlarged = enlarge(radiance, coverage)
    middle = enlarged[..., 20:24, 24:28]
    torch.testing.assert_close(middle, torch.full_like(middle, 5.0), rtol=1e-3, atol=0.0)
    assert not enlarged[..., -8:, -8:].any()


def test_light_beside_a_layer_leaves_the_layer_alone() -> None:
    alpha, radiance = plane(1.0), color(0.8)
    alpha[..., 8:], radiance[..., 8:] = 0.0, 0.3
    assert divide_coverage(radiance, alpha) is None


def test_negative_radiance_comes_through() -> None:
    alpha = soft_disc()
    covered = divide_coverage(-alpha.expand(-1, 3, -1, -1), alpha)
    assert covered is not None
    assert torch.isfinite(covered.color).all()
    assert float(covered.color.amin()) == pytest.approx(-1.0)


def test_what_a_system_invents_where_coverage_ends_is_held_within_the_samples() -> None:
    alpha = soft_disc()
    covered = divide_coverage((alpha * 2.0).expand(-1, 3, -1, -1), alpha)
    assert covered is not None
    odd = torch.full((1, 3, 48, 64), 9.0)
    enlarged = multiply_coverage(odd, covered, 4, STILL)
    weight = upsample_bicubic(alpha, 4).clamp(0.0, 1.0)
    ends = (weight > 0.0) & (weight < 1.0)
    assert float((enlarged - 2.0 * weight)[ends.expand(-1, 3, -1, -1)].abs().max()) < 1e-4
