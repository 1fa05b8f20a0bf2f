"""The kernel that `cgts` filters a frame's samples by."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.imaging.predicted_kernel import (
    KERNEL_SIGMA_PX,
    PICTURE_SIGMA_PX,
    TAPS,
    continue_image,
    filter_pixels,
    filter_samples,
    measure_reach,
)
from rtsr_cli.core.imaging.resampling import repeat_samples

JITTERS = [(0.0, 0.0), (0.375, -0.125), (-0.375, 0.125)]


def filtered(samples: torch.Tensor, logits: torch.Tensor) -> torch.Tensor:
    return filter_samples(continue_image(samples), logits, 2)


@pytest.mark.parametrize("jitter", JITTERS)
def test_untrained_it_is_a_gaussian_around_each_pixel(jitter: tuple[float, float]) -> None:
    torch.manual_seed(2)
    samples = torch.rand(1, 3, 5, 7)
    reach = measure_reach(2, jitter, samples)
    made = filtered(samples, reach.expand(1, -1, 5, 7))
    y, x = 2, 3
    for below in (0, 1):
        for beside in (0, 1):
            total, weights = torch.zeros(3), 0.0
            for v in (y - 1, y, y + 1):
                for u in (x - 1, x, x + 1):
                    down = 2 * (v + 0.5 + jitter[1]) - (2 * y + below + 0.5)
                    across = 2 * (u + 0.5 + jitter[0]) - (2 * x + beside + 0.5)
                    w = torch.exp(torch.tensor(-(down**2 + across**2) / (2 * KERNEL_SIGMA_PX**2)))
                    total, weights = total + w * samples[0, :, v, u], weights + float(w)
            found = made[0, :, 2 * y + below, 2 * x + beside]
            torch.testing.assert_close(found, total / weights, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("jitter", JITTERS)
def test_a_narrow_kernel_repeats_the_nearest_sample(jitter: tuple[float, float]) -> None:
    samples = torch.rand(2, 3, 4, 6)
    reach = 1e4 * measure_reach(2, jitter, samples)
    made = filtered(samples, reach.expand(2, -1, 4, 6))
    torch.testing.assert_close(made, repeat_samples(samples, 2, jitter))


def test_what_the_network_tells_moves_a_kernel() -> None:
    samples = torch.rand(1, 3, 4, 6)
    logits = torch.zeros(1, TAPS * 4, 4, 6)
    # the sample above, of every second pixel of the lower row
    logits[:, 1 * 4 + 2] = 1e4
    made = filtered(samples, logits)
    torch.testing.assert_close(made[..., 3::2, 0::2], samples[:, :, :-1])


def test_bright_samples_stay_in_double_precision() -> None:
    samples = torch.full((1, 3, 2, 2), 1.0 - 1e-9, dtype=torch.float64)
    made = filtered(samples, torch.zeros(1, TAPS * 4, 2, 2))
    assert made.dtype == torch.float64
    torch.testing.assert_close(made, torch.full_like(made, 1.0 - 1e-9), rtol=0, atol=1e-12)


def test_untrained_a_picture_s_kernel_is_a_gaussian() -> None:
    picture = torch.rand(1, 3, 6, 8)
    made = filter_pixels(continue_image(picture), torch.zeros(1, TAPS * 4, 3, 4), 2)
    side = torch.exp(torch.tensor(-0.5 / PICTURE_SIGMA_PX**2))
    row = torch.stack([side, torch.tensor(1.0), side]) / (1 + 2 * side)
    expected = torch.einsum("nchw,h,w->nc", picture[:, :, 1:4, 3:6], row, row)
    torch.testing.assert_close(made[:, :, 2, 4], expected, rtol=1e-4, atol=1e-6)


def test_every_pixel_of_a_picture_has_its_own_kernel() -> None:
    picture = torch.rand(1, 3, 6, 8)
    logits = torch.zeros(1, TAPS * 4, 3, 4)
    # the right neighbour, of every second pixel of the upper row
    logits[:, 5 * 4 + 0] = 1e4
    made = filter_pixels(continue_image(picture), logits, 2)
    torch.testing.assert_close(made[..., 0::2, 0::2], picture[..., 0::2, 1::2])
