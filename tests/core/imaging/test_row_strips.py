from __future__ import annotations

from collections.abc import Mapping

import pytest
import torch
from torch import Tensor, nn

from rtsr_cli.core.imaging.resampling import mean_3x3, upsample_nearest
from rtsr_cli.core.imaging.row_strips import (
    cut_pixels,
    cut_rows,
    fill_in_strips,
    run_in_strips,
)

LAYERS = nn.Sequential(*(nn.Conv2d(2, 2, 3, padding=1) for _ in range(3))).double().eval()


def enlarged(images: Mapping[str, Tensor]) -> Tensor:
    """Three 3x3 layers at LR, then to HR, where one more image is added."""
    wide = LAYERS(images["lr"]).repeat_interleave(2, 2).repeat_interleave(2, 3)
    return wide + images["hr"]


@pytest.fixture
def images() -> dict[str, Tensor]:
    torch.manual_seed(3)
    lr = torch.rand(1, 2, 23, 9, dtype=torch.float64)
    return {"lr": lr, "hr": torch.rand(1, 2, 46, 18, dtype=torch.float64)}


@pytest.mark.parametrize("rows", [1, 4, 7, 22, 23, 100])
def test_strips_give_what_the_whole_gives(images: dict[str, Tensor], rows: int) -> None:
    with torch.no_grad():
        whole, strips = enlarged(images), run_in_strips(enlarged, images, rows=rows, halo=3)
    assert strips.shape == whole.shape
    assert torch.allclose(strips, whole, atol=1e-12)


def test_a_halo_that_is_too_small_shows(images: dict[str, Tensor]) -> None:
    with torch.no_grad():
        whole, strips = enlarged(images), run_in_strips(enlarged, images, rows=4, halo=2)
    assert (strips - whole).abs().max() > 1e-6


def test_no_strip_is_larger_than_its_rows_and_halo(images: dict[str, Tensor]) -> None:
    heights = []

    def seen(strip: Mapping[str, Tensor]) -> Tensor:
        heights.append(strip["lr"].shape[2])
        return strip["hr"]

    assert torch.equal(run_in_strips(seen, images, rows=8, halo=3), images["hr"])
    assert heights == [11, 14, 10]


def test_strips_cover_every_row_once_and_in_order() -> None:
    assert cut_rows(7, 3) == [range(3), range(3, 6), range(6, 7)]
    assert cut_rows(2, 3) == [range(2)]


def test_strips_hold_at_most_so_many_pixels_but_at_least_the_fewest_rows() -> None:
    assert cut_pixels((5, 10), 29) == [range(2), range(2, 4), range(4, 5)]
    assert cut_pixels((2, 10), 9) == [range(1), range(1, 2)]
    assert cut_pixels((7, 10), 59, multiple=2) == [range(4), range(4, 7)]
    assert cut_pixels((4, 10), 9, multiple=2) == [range(2), range(2, 4)]


@pytest.mark.parametrize("threads", [1, 3])
def test_strips_fill_what_is_there(threads: int) -> None:
    images = {"lr": torch.rand(1, 2, 11, 7), "hr": torch.rand(1, 2, 22, 14)}

    def blurred(strips: Mapping[str, Tensor], rows: slice = slice(None)) -> Tensor:
        return mean_3x3(strips["hr"])[:, :, rows] + upsample_nearest(strips["lr"], 2)

    out = torch.full((1, 2, 22, 14), torch.nan)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        fill_in_strips(blurred, images, out, rows=4, halo=1)
    finally:
        torch.set_num_threads(before)
    assert torch.equal(out, blurred(images))
