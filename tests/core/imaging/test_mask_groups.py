"""Marked pixels that lie together."""

from __future__ import annotations

import torch

from rtsr_cli.core.imaging.mask_groups import keep_groups


def test_single_pixels_rows_and_columns_are_no_groups() -> None:
    mask = torch.zeros(1, 1, 9, 11, dtype=torch.bool)
    mask[..., 1, 1] = mask[..., 3, :] = mask[..., 5:, 9] = True
    assert not bool(keep_groups(mask).any())


def test_squares_are_kept_to_the_border_and_what_hangs_on_them_is_not() -> None:
    mask = torch.zeros(1, 1, 9, 11, dtype=torch.bool)
    mask[..., :2, :2] = mask[..., 6:, 8:] = True
    wanted = mask.clone()
    mask[..., 1, 2:6] = True
    assert torch.equal(keep_groups(mask), wanted)
    assert not bool(keep_groups(torch.ones(1, 1, 1, 5, dtype=torch.bool)).any())
