"""Separable filters over strips of rows, as products with banded matrices.

A strip and all that is computed from it stay in the processor's cache, so that neither time nor
memory grows with full-frame intermediates. Each pass of a filter is one matrix product: a band of
Toeplitz rows times a block of the strip, which was several times faster than a convolution and
than a sum of shifted slices, and runs alike on a GPU.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.shapes import Image

Border = Literal["replicate", "reflect", "constant"]
"""What lies outside of the frame: the edge pixel, the mirrored frame, zeros."""

COLUMN_BLOCK = 64
"""Output columns of one product along the rows; the at most `BAND_OUTPUTS`."""

STRIP_PIXELS = {"cpu": 1 << 16, "cuda": 1 << 22}
"""Pixels of one strip, all images of a batch together: what fits a core's cache, fills a GPU."""

BAND_OUTPUTS = 128
"""Outputs of a band: more of them, and most of its products are with zeros."""

MIN_STRIP_ROWS = 16
"""Fewer, and most rows of a strip are its surroundings."""

FRAME_DIMENSIONS = 4
"""N, C, H, W."""


def check_pair(test: Image, ref: Image) -> None:
    """Raise ShapeMismatchError unless both are NCHW of one size, TypeError for integers."""
    if test.shape != ref.shape or test.dim() != FRAME_DIMENSIONS:
        raise ShapeMismatchError(
            f"a metric compares images of one size, not {tuple(test.shape)} (test) with "
            f"{tuple(ref.shape)} (reference): N, channels, height, width have to agree"
        )
    if not (test.is_floating_point() and test.dtype == ref.dtype):
        raise TypeError(f"images of one floating-point type, not {test.dtype} with {ref.dtype}")


def gaussian_taps(sigma_px: float, reach: int) -> Tensor:
    """exp(-x^2 / (2 sigma^2)) for x = -reach .. reach, of sum 1, in double precision."""
    x = torch.arange(-reach, reach + 1, dtype=torch.float64)
    taps = torch.exp(-0.5 * (x / sigma_px) ** 2)
    return taps / taps.sum()


def band_matrix(taps: Tensor, like: Tensor) -> Tensor:
    """Matrix (n, n + taps - 1) whose row i holds the taps from column i on, n = `BAND_OUTPUTS`.

    Its upper left corner is the matrix of fewer outputs.
    """
    index = torch.arange(BAND_OUTPUTS)[:, None] + torch.arange(len(taps))
    band = torch.zeros(BAND_OUTPUTS, BAND_OUTPUTS + len(taps) - 1, dtype=taps.dtype)
    return band.scatter_(1, index, taps.expand(BAND_OUTPUTS, -1)).to(like)


def row_strips(image: Image, margin: int = 0) -> Iterator[tuple[int, int]]:
    """First and end row of each strip of a frame, without `margin` rows at top and bottom."""
    batch, _, height, width = image.shape
    budget = STRIP_PIXELS.get(image.device.type, STRIP_PIXELS["cuda"])
    rows = min(max(budget // (batch * width), MIN_STRIP_ROWS), BAND_OUTPUTS)
    for first in range(margin, height - margin, rows):
        yield first, min(first + rows, height - margin)


def cut_strip(image: Image, rows: tuple[int, int], reach: int, border: Border) -> Image:
    """Rows of a frame with `reach` pixels around them, as wide as whole column blocks.

    The columns that fill up the last block are zeros; nothing inside the frame depends on them.
    """
    first, end = rows
    height, width = image.shape[-2:]
    top, bottom = max(first - reach, 0), min(end + reach, height)
    ends = (reach, reach, top - (first - reach), end + reach - bottom)
    strip = F.pad(image[:, :, top:bottom], ends, mode=border)
    spare = -width % COLUMN_BLOCK
    return F.pad(strip, (0, spare)) if spare else strip


def column_windows(strip: Tensor, reach: int) -> Tensor:
    """Overlapping blocks of a strip's rows (..., rows, blocks, block + 2 reach), copied once."""
    return strip.unfold(-1, COLUMN_BLOCK + 2 * reach, COLUMN_BLOCK).contiguous()


def filter_along_rows(windows: Tensor, band: Tensor) -> Tensor:
    """Filter blocks of rows: (..., rows, blocks, block + 2 reach) to (..., rows, columns)."""
    corner = band[:COLUMN_BLOCK, : windows.shape[-1]]
    columns = torch.mm(windows.flatten(0, -2), corner.t())
    return columns.reshape(*windows.shape[:-2], -1)


def filter_along_columns(planes: Tensor, band: Tensor) -> Tensor:
    """Filter columns: (..., rows + 2 reach, columns) to (..., rows, columns)."""
    stack = planes.flatten(0, -3)
    rows = stack.shape[-2] - (band.shape[1] - band.shape[0])
    corner = band[:rows, : stack.shape[-2]].expand(len(stack), -1, -1)
    return torch.bmm(corner, stack).reshape(*planes.shape[:-2], rows, -1)
