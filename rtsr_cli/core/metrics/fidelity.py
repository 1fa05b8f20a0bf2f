"""Squared error and PSNR, and the mean of an error map over a mask."""

from __future__ import annotations

import torch

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.metrics.filters import check_pair, row_strips
from rtsr_cli.core.shapes import Image, Mask, PixelMap, Scores

DECIBELS = 10.0
"""Per factor of ten in power."""


def masked_mean(values: PixelMap, mask: Mask | None = None) -> Scores:
    """Mean of each image's map over the pixels that count.

        sum(values * mask) / sum(mask)

    Args:
        values: one value a pixel.
        mask: 1 = counts, of the map's size; None = every pixel.

    Returns:
        One mean an image; NaN where the mask is empty.

    Raises:
        ShapeMismatchError: the mask is of another size.
    """
    if mask is None:
        return values.mean((-2, -1))
    if mask.shape != (len(values), 1, *values.shape[1:]):
        raise ShapeMismatchError(
            f"a mask of {tuple(mask.shape)} does not fit a map of {tuple(values.shape)}"
        )
    weights = mask[:, 0]
    total = torch.where(weights > 0, values * weights, 0.0).sum((-2, -1))
    return total / weights.sum((-2, -1))


def squared_error_map(test: Image, ref: Image) -> PixelMap:
    """(test - ref)^2, averaged over the channels.

    Raises:
        ShapeMismatchError: the sizes differ.
    """
    check_pair(test, ref)
    strips = [
        (test[:, :, first:end] - ref[:, :, first:end]).square_().mean(1)
        for first, end in row_strips(test)
    ]
    return torch.cat(strips, dim=-2)


def psnr(test: Image, ref: Image, mask: Mask | None = None) -> Scores:
    """Peak signal-to-noise ratio of images with data range 1, in dB.

        PSNR = -10 log10(mean squared error)

    Args:
        test: values in the space to compare in, peak 1.
        ref: the same.
        mask: 1 = counts; None = every pixel.

    Returns:
        One figure an image; inf where the images are equal, NaN where the mask is empty.

    Raises:
        ShapeMismatchError: the sizes differ.
    """
    return -DECIBELS * torch.log10(masked_mean(squared_error_map(test, ref), mask))
