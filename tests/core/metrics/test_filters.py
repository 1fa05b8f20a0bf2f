from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F

from rtsr_cli.core.metrics.filters import (
    Border,
    band_matrix,
    column_windows,
    cut_strip,
    filter_along_columns,
    filter_along_rows,
    gaussian_taps,
    row_strips,
)


@pytest.mark.parametrize("border", ["replicate", "reflect", "constant"])
@pytest.mark.parametrize("size", [(7, 9), (300, 70), (40, 128)])
def test_strips_together_are_the_filtered_frame(
    device: torch.device, border: Border, size: tuple[int, int]
) -> None:
    generator = torch.Generator().manual_seed(2)
    frame = torch.rand(2, 3, *size, generator=generator, dtype=torch.float64).to(device)
    taps = gaussian_taps(1.5, 5) + torch.arange(11).double()
    band = band_matrix(taps, frame)
    strips = [
        filter_along_columns(
            filter_along_rows(column_windows(cut_strip(frame, rows, 5, border), 5), band), band
        )
        for rows in row_strips(frame)
    ]
    kernel = torch.outer(taps, taps).to(device).expand(3, 1, 11, 11)
    expected = F.conv2d(F.pad(frame, (5, 5, 5, 5), mode=border), kernel, groups=3)
    torch.testing.assert_close(torch.cat(strips, dim=-2)[..., : size[1]], expected)


def test_strips_cover_the_rows_inside_a_margin_once() -> None:
    rows = [row for ends in row_strips(torch.zeros(1, 3, 500, 900), 5) for row in range(*ends)]
    assert rows == list(range(5, 495))
