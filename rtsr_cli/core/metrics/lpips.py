"""LPIPS: distance of AlexNet features, weighted by what people judged [Zhang et al. 2018], v0.1.

d(x) = sum over layers l of  sum over channels c of  w_lc (f_lc(x) / |f_l(x)| - g_lc / |g_l|)^2
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.metrics.filtering import check_pair
from rtsr_cli.core.metrics.lpips_weights import LAYERS, Weights, find_weights, read_weights
from rtsr_cli.core.shapes import Color, Image, PixelMap, Scores

SHIFT, SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
"""Mean and spread that the network was trained with, of values -1..1 [lpips 0.1]."""

STRIDES, PADDINGS = (4, 1, 1, 1, 1), (2, 2, 1, 1, 1)
POOLED_BEFORE = frozenset({1, 2})
"""AlexNet [Krizhevsky 2014]: convolutions, and those that follow a 3 x 3 maximum of stride 2."""

LEAST_SIDE = 31
"""Below, the last layers have no pixel."""

LEAST_NORM = 1e-10


class Lpips:
    """The network; any number of threads may use one."""

    def __init__(self, weights: Weights, device: torch.device | str = "cpu") -> None:
        """Take the tensors of `lpips_weights`."""
        self._weights = {
            name: w.to(device, memory_format=torch.channels_last) if w.dim() == 4 else w.to(device)
            for name, w in weights.items()
        }

    @classmethod
    def load(cls, path: Path | None = None, device: torch.device | str = "cpu") -> Lpips:
        """Load a file of weights, or those that are installed.

        Raises:
            MetricUnavailableError: there are none; names the command that helps.
            ConfigError: the file is not the published one.
        """
        return cls(read_weights(find_weights(path)), device)

    @torch.no_grad()
    def map(self, test: Color, ref: Color) -> PixelMap:
        """Distance of every pixel: the layers' maps, brought to full size, added.

        Args:
            test: display-encoded, 0..1.
            ref: the same.

        Raises:
            ShapeMismatchError: the sizes differ, or are below 31 pixels.
        """
        size = (test.shape[-2], test.shape[-1])
        total = test.new_zeros(test.shape[0], *size)
        for layer in self._distances(test, ref):
            total += F.interpolate(layer, size, mode="bilinear", align_corners=False)[:, 0]
        return total

    @torch.no_grad()
    def score(self, test: Color, ref: Color) -> Scores:
        """Distance of each pair: the means of the layers' maps, added; the published figure."""
        layers = [layer.mean((1, 2, 3)) for layer in self._distances(test, ref)]
        return torch.stack(layers).sum(0)

    def _distances(self, test: Color, ref: Color) -> Iterator[Image]:
        check_pair(test, ref)
        if min(test.shape[-2:]) < LEAST_SIDE:
            raise ShapeMismatchError(
                f"LPIPS needs {LEAST_SIDE} pixels a side, the pictures are "
                f"{test.shape[-1]} x {test.shape[-2]}"
            )
        pairs = zip(self._features(test), self._features(ref), strict=True)
        for i, (one, other) in enumerate(pairs):
            squared = (_unit(one) - _unit(other)).square_()
            yield F.conv2d(squared, self._weights[f"heads.{i}"].view(1, -1, 1, 1))

    def _features(self, image: Color) -> Iterator[Image]:
        shift, scale = (image.new_tensor(v).view(1, 3, 1, 1) for v in (SHIFT, SCALE))
        x = ((image * 2.0 - 1.0) - shift) / scale
        x = x.contiguous(memory_format=torch.channels_last)
        for i in range(LAYERS):
            x = F.max_pool2d(x, 3, stride=2) if i in POOLED_BEFORE else x
            weight, bias = (self._weights[f"features.{i}.{part}"] for part in ("weight", "bias"))
            x = F.relu_(F.conv2d(x, weight, bias, stride=STRIDES[i], padding=PADDINGS[i]))
            yield x


def _unit(features: Tensor) -> Tensor:
    """Divide by the length over the channels."""
    length = features.square().sum(1, keepdim=True).sqrt_()
    return features / length.add_(LEAST_NORM)
