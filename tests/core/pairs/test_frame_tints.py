"""Colours of whole frames that are a few per cent apart between the sizes."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.frame_tints import measure_tint

SCALE, SIZE = 4, (192, 256)
TINTS = [(1.05, 1.05, 1.05), (0.95, 1.0, 1.04), (1.0, 1.15, 1.0)]


def paint(flat: bool) -> Tensor:
    """Squares of many colours; or noise as fine as pixels."""
    torch.manual_seed(2)
    side = 16 if flat else 1
    colours = 0.1 + 0.8 * torch.rand(1, 3, SIZE[0] // side, SIZE[1] // side)
    return colours.repeat_interleave(side, 2).repeat_interleave(side, 3)


def everywhere() -> Tensor:
    return torch.ones(1, 1, SIZE[0] // SCALE, SIZE[1] // SCALE, dtype=torch.bool)


def tinted(image: Tensor, factors: tuple[float, ...]) -> Tensor:
    return image * torch.tensor(factors).view(1, 3, 1, 1)


@pytest.mark.parametrize("tint", TINTS)
def test_a_few_per_cent_are_found_where_colours_are_flat(tint: tuple[float, ...]) -> None:
    image = paint(flat=True)
    small = decimate(image, SCALE, (2, 2))
    found = measure_tint(small, tinted(image, tint), everywhere(), SCALE)
    assert found == pytest.approx(tint, rel=1e-3)
    assert measure_tint(small, image, everywhere(), SCALE) is None


def test_fine_textures_tell_more_than_a_few_per_cent() -> None:
    image = 0.4 + 0.1 * paint(flat=False)
    small = decimate(image, SCALE, (1, 3))
    assert measure_tint(small, image, everywhere(), SCALE) is None
    found = measure_tint(small, 1.1 * image, everywhere(), SCALE)
    assert found == pytest.approx((1.1,) * 3, rel=0.02)


def test_thin_dark_joints_between_bricks_are_no_tint_and_hide_none() -> None:
    """Most samples lie on bricks, and every block has joints: its mean is darker than they are."""
    torch.manual_seed(5)
    rows, columns = (torch.arange(side) for side in SIZE)
    joint = (rows[:, None] % 5 == 4) | (columns % 7 == 6)
    bricks = (0.5 + 0.1 * torch.rand(1, 3, 39, 37)).repeat_interleave(5, 2).repeat_interleave(7, 3)
    image = torch.where(joint, 0.1, bricks[..., : SIZE[0], : SIZE[1]])
    small = decimate(image, SCALE, (1, 2))
    assert measure_tint(small, image, everywhere(), SCALE) is None
    assert measure_tint(small, 0.85 * image, everywhere(), SCALE) is not None


def test_another_colour_of_one_object_is_no_tint_of_the_frame() -> None:
    image = paint(flat=True)
    changed = image.clone()
    changed[..., :128, :] *= 1.3
    assert measure_tint(decimate(image, SCALE, (2, 2)), changed, everywhere(), SCALE) is None


def test_what_8_bits_leave_is_no_tint() -> None:
    image = torch.full((1, 3, *SIZE), 0.0492)
    small = (decimate(image, SCALE, (2, 2)) * 255.0).round() / 255.0
    assert measure_tint(small, image, everywhere(), SCALE) is None
