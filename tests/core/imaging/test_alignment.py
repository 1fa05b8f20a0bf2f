"""Moving the HR grid so that LR samples are one pixel of their block."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.imaging.alignment import block_shift, shift_image, shift_jitter
from rtsr_cli.core.imaging.resampling import sample_jitter

SCALES = (2, 3, 4, 6, 8)


@pytest.mark.parametrize("scale", SCALES)
def test_the_shift_is_the_distance_to_the_middle_sample(scale: int) -> None:
    for x in range(scale):
        for y in range(scale):
            jitter_px = (sample_jitter(x, scale), sample_jitter(y, scale))
            assert block_shift(jitter_px, scale) == (x - scale // 2, y - scale // 2)


@pytest.mark.parametrize("scale", SCALES)
def test_after_the_shift_every_phase_has_the_jitter_of_the_middle_sample(scale: int) -> None:
    middle = sample_jitter(scale // 2, scale)
    for x in range(scale):
        moved = shift_jitter((sample_jitter(x, scale), middle), scale)
        assert moved == pytest.approx((middle, middle))


def test_a_jitter_between_pixels_takes_the_nearest_half_up() -> None:
    # 4x: samples at 4 (0.5 + j) HR pixels from the block's edge; pixel 2 holds 2.0 to 3.0
    assert block_shift((0.1, 0.0), 4) == (0, 0)
    assert block_shift((0.25, -0.01), 4) == (1, -1)
    assert block_shift((0.49, -0.5), 4) == (1, -2)


def test_an_image_is_read_at_the_shifted_place_borders_replicated() -> None:
    image = torch.arange(12.0).view(1, 1, 3, 4)
    # one to the right, one up
    expected = torch.tensor([[1.0, 2, 3, 3], [1, 2, 3, 3], [5, 6, 7, 7]])
    assert torch.equal(shift_image(image, (1, -1))[0, 0], expected)


@pytest.mark.parametrize("shift", [(0, 0), (1, 0), (-2, 3), (3, -1)])
def test_shifting_there_and_back_is_the_identity_inside(shift: tuple[int, int]) -> None:
    image = torch.rand(2, 3, 12, 14)
    back = shift_image(shift_image(image, shift), (-shift[0], -shift[1]))
    assert torch.equal(back[..., 3:-3, 3:-3], image[..., 3:-3, 3:-3])


def test_a_constant_stays_one() -> None:
    image = torch.full((1, 3, 5, 6), 0.3)
    assert torch.equal(shift_image(image, (2, -1)), image)
