"""Weighted means of samples or pixels, by kernels that the network finds for every pixel.

    c(p) = sum_q a_q c_q,   a = softmax_q(l_q - |p - q|^2 / (2 sigma^2))

l is what the network tells, 0 before it has learnt anything. Of a frame's samples, q are the 3 x 3
around the LR pixel that p lies in: what stands where history is of no use; samples where they lie,
which history sharpens, leave a grid there. Of a picture, q are the 3 x 3 pixels around p: what is
accumulated is noisy, and is shown smoother, or sharper, than it goes on.

Conventions: LR tensors; channels of taps by rows, of each the S x S output pixels by rows.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.shapes import Color, Image

TAPS = 9
"""Samples of a kernel, 3 x 3."""

KERNEL_SIGMA_PX = 0.7
"""Spread of the untrained kernel, in output pixels."""

PICTURE_SIGMA_PX = 0.7
"""The same of the kernel between a picture's pixels."""

FILTERED_WORTH = 0.5
"""Samples that a filtered pixel is worth, wherever samples lie: so no grid of them is left."""


def measure_reach(scale: int, jitter_px: Jitter, like: Tensor) -> Tensor:
    """-|p - q|^2 / (2 sigma^2) of every tap and output pixel of an LR pixel, n taps*S*S 1 1.

    Args:
        scale: S.
        jitter_px: of the samples, LR pixels.
        like: whose kind of numbers it takes.
    """
    place = (torch.arange(scale, dtype=torch.float64) + 0.5) / scale - 0.5
    taps = torch.arange(-1.0, 2.0, dtype=torch.float64)
    across, down = (
        ((place[None, :] - taps[:, None] - jitter) * scale).square() for jitter in jitter_px
    )
    # tap row, tap column, pixel row, pixel column
    squares = down[:, None, :, None] + across[None, :, None, :]
    reach = -0.5 * squares / KERNEL_SIGMA_PX**2
    return reach.reshape(1, -1, 1, 1).to(like.device, torch.float32)


def measure_pixel_reach(like: Tensor) -> Tensor:
    """-|p - q|^2 / (2 sigma^2) of the 3 x 3 pixels around any, n taps 1 1."""
    steps = torch.arange(-1.0, 2.0, dtype=torch.float64)
    squares = steps.square()[:, None] + steps.square()[None]
    reach = -0.5 * squares / PICTURE_SIGMA_PX**2
    return reach.reshape(1, TAPS, 1, 1).to(like.device, torch.float32)


def continue_image(image: Image) -> Image:
    """Repeat what lies at the borders, for the kernels below."""
    return F.pad(image, (1, 1, 1, 1), mode="replicate")


def filter_samples(samples: Image, logits: Image, scale: int) -> Color:
    """The sum above.

    Args:
        samples: n 3 h+2 w+2, `continue_image`.
        logits: of the kernels, n taps*S*S h w.
        scale: S.

    Returns:
        n 3 S*h S*w.
    """
    return F.pixel_shuffle(_weigh_taps(samples, logits, scale * scale).flatten(1, 2), scale)


def filter_pixels(image: Color, logits: Image, scale: int) -> Color:
    """The same of a picture's pixels.

    Args:
        image: n 3 S*h+2 S*w+2, `continue_image`.
        logits: of the kernels, n taps*S*S h w; `measure_pixel_reach` is added.
        scale: S.

    Returns:
        n 3 S*h S*w.
    """
    large = F.pixel_shuffle(logits, scale) + measure_pixel_reach(logits)
    return _weigh_taps(image, large, 1)[:, :, 0]


def _weigh_taps(image: Image, logits: Image, kernels: int) -> Tensor:
    """Means of the 3 x 3 around each pixel by so many kernels of it, n 3 kernels h w.

    Args:
        image: n 3 h+2 w+2.
        logits: n taps*kernels h w.
        kernels: of a pixel.
    """
    n, _, height, width = logits.shape
    shares = logits.to(image.dtype).view(n, TAPS, kernels, height, width).softmax(1)
    total = image.new_zeros(())
    for tap in range(TAPS):
        row, column = divmod(tap, 3)
        shifted = image[:, :, None, row : row + height, column : column + width]
        total = total + shares[:, None, tap] * shifted
    return total
