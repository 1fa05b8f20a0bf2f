"""Where surfaces without material lie, in words."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.upscale.lost_material import describe_place


@pytest.mark.parametrize(
    ("rows", "columns", "words"),
    [
        (slice(0, 3), slice(0, 4), "upper left, x 0-3, y 0-2"),
        (slice(6, 9), slice(8, 12), "lower right, x 8-11, y 6-8"),
        (slice(0, 9), slice(0, 12), "middle centre, x 0-11, y 0-8"),
    ],
)
def test_the_part_of_the_picture_and_the_box_are_named(
    rows: slice, columns: slice, words: str
) -> None:
    mask = torch.zeros(1, 1, 9, 12, dtype=torch.bool)
    mask[..., rows, columns] = True
    assert describe_place(mask) == f"{words} of LR's 12 x 9"
