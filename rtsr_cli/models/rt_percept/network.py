"""The visual-error network, layer by layer [rt-percept, code], and in another order for inference.

For inference the same function is computed otherwise. A layer is

    n = max over the pool of (a r + b), r = relu(w x + c),   a and b of its batch norm

    a >= 0:  n = a relu(max(w x + c)) + b
    a <  0:  n = a relu(min(w x + c)) + b,   min(y) = -max(-y)

so that all but the convolution works on pooled values. Where nothing is pooled, |a| goes into the
layer's own convolution, and sign(a) and b into the next one. That pads with zeros, which b is not:
at the borders, what b gave beyond them is taken off again.
"""

from __future__ import annotations

import copy
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.shapes import Image, TileMap
from rtsr_cli.core.system import State, Tensors
from rtsr_cli.core.vrs.tile_pooling import pad_to_tiles
from rtsr_cli.models.rt_percept.config import WIDTH, RtPerceptConfig
from rtsr_cli.models.rt_percept.inputs import SETS

LAYERS = 5


def pool_sizes(tile: int) -> tuple[int, ...]:
    """Lambda: what each layer's maximum is taken over; together one output a tile.

    Layer 1 never pools. The others halve as long as more than a factor of 2 is left, and the last
    one takes the rest: 2, 2, 2, 2 for 16; 2, 2, 2, 8 for 64.
    """
    left, sizes = tile, [1]
    for _ in range(LAYERS - 2):
        size = 2 if left >= 2 else 1
        sizes.append(size)
        left //= size
    return (*sizes, left)


class ErrorLayer(nn.Module):
    """c3, ReLU, batch norm, maximum: the normalisation comes after the rectification."""

    def __init__(self, channels_in: int, channels_out: int, *, groups: int, pool: int) -> None:
        """Grouped convolution with bias."""
        super().__init__()
        self.conv = nn.Conv2d(channels_in, channels_out, 3, padding=1, groups=groups)
        self.norm = nn.BatchNorm2d(channels_out)
        self.pool = nn.MaxPool2d(pool) if pool > 1 else nn.Identity()

    def forward(self, features: Image) -> Image:
        """Return the pooled features."""
        pooled: Image = self.pool(self.norm(torch.relu_(self.conv(features))))
        return pooled


def fold_affine(norm: nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """(a, b): y = a x + b of a batch norm that keeps its statistics."""
    assert norm.running_mean is not None
    assert norm.running_var is not None
    a = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
    return a, norm.bias - a * norm.running_mean


def side_sums(weight: Tensor, shift: Tensor, groups: int) -> Tensor:
    """What a constant input gives through each tap: output channels 3 3."""
    outputs, inputs = weight.shape[:2]
    split = weight.view(groups, outputs // groups, inputs, 3, 3)
    return (split * shift.view(groups, 1, inputs, 1, 1)).sum(2).view(outputs, 3, 3)


class FrozenLayer(nn.Module):
    """One layer; `carried` are sign and shift that the layer before leaves to it."""

    taps: Tensor | None
    sign: Tensor
    a: Tensor
    b: Tensor

    def __init__(
        self,
        convolution: nn.Conv2d,
        norm: nn.BatchNorm2d,
        pool: int,
        carried: tuple[Tensor, Tensor] | None,
        *,
        last: bool,
    ) -> None:
        """Fold what can be folded."""
        super().__init__()
        assert convolution.bias is not None
        weight, bias = convolution.weight.detach(), convolution.bias.detach()
        groups = convolution.groups
        a, b = (part.detach() for part in fold_affine(norm))
        taps = None
        if carried is not None:
            sign, shift = carried
            taps = side_sums(weight, shift, groups)
            bias = bias + taps.sum((1, 2))
            each = sign.view(groups, 1, -1, 1, 1)
            weight = (weight.view(groups, -1, *weight.shape[1:]) * each).view_as(weight)
        sign = torch.where(a < 0, -1.0, 1.0)
        self.pool = pool
        self.leaves: tuple[Tensor, Tensor] | None = None
        if pool == 1 and not last:
            factor = a.abs()
            self.leaves = (sign, b)
        else:
            factor = sign
        outer = factor.view(-1, 1, 1, 1)
        self.convolution = nn.Conv2d(
            convolution.in_channels, convolution.out_channels, 3, padding=1, groups=groups
        )
        self.convolution.weight = nn.Parameter(weight * outer, requires_grad=False)
        self.convolution.bias = nn.Parameter(bias * factor, requires_grad=False)
        for name, tensor in (
            ("taps", None if taps is None else taps * factor.view(-1, 1, 1)),
            ("sign", sign.view(-1, 1, 1)),
            ("a", a.view(-1, 1, 1)),
            ("b", b.view(-1, 1, 1)),
        ):
            self.register_buffer(name, tensor)

    def forward(self, features: Image) -> Image:
        """Convolve, pool, rectify, normalise."""
        features_out: Image = self.convolution(features)
        if self.taps is not None:
            self._mend_borders(features_out, self.taps.to(features_out.dtype))
        if self.leaves is not None:
            return features_out.relu_()
        if self.pool > 1:
            features_out = F.max_pool2d(features_out, self.pool)
        return torch.relu(features_out * self.sign) * self.a + self.b

    def _mend_borders(self, features_out: Image, taps: Tensor) -> None:
        """Take off what the shift gave beyond the frame."""
        for row, tap in ((0, 0), (-1, 2)):
            features_out[..., row, :] -= taps[:, tap].sum(1).view(-1, 1)
            for column, beside in ((0, 0), (-1, 2)):
                features_out[..., row, column] += taps[:, tap, beside]
        for column, tap in ((0, 0), (-1, 2)):
            features_out[..., column] -= taps[:, :, tap].sum(1).view(-1, 1)


class RtPerceptNetwork(nn.Module):
    """Buffers -> transformed error of each rate, or of reuse, one value a tile; and mu."""

    mean: Tensor

    def __init__(self, config: RtPerceptConfig, scale: int) -> None:
        """Build for a config; `scale` is 1, for nothing is enlarged."""
        super().__init__()
        del scale
        self.config = config
        widths = (SETS[config.inputs][0], *(WIDTH,) * (LAYERS - 1), len(config.channels))
        # mu: a statistic like a batch norm's, no parameter
        self.register_buffer("mean", torch.full((1, 1, 1, 1), config.mean))
        self.layers = nn.Sequential(
            *(
                ErrorLayer(a, b, groups=groups, pool=pool)
                for (a, b), groups, pool in zip(
                    pairwise(widths),
                    config.groups.numbers,
                    pool_sizes(config.error.tile),
                    strict=True,
                )
            )
        )

    def for_inference(self) -> RtPerceptNetwork:
        """The same function; after the convolutions, all work is on pooled values."""
        frozen = copy.deepcopy(self).eval()
        layers: list[FrozenLayer] = []
        built = list(self.layers)
        sizes = pool_sizes(self.config.error.tile)
        for number, (layer, pool) in enumerate(zip(built, sizes, strict=True)):
            assert isinstance(layer, ErrorLayer)
            carried = layers[-1].leaves if layers else None
            last = number == len(built) - 1
            layers.append(FrozenLayer(layer.conv, layer.norm, pool, carried, last=last))
        frozen.layers = nn.Sequential(*layers)
        return frozen

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        """Pad to whole tiles, predict."""
        padded = {"seen": pad_to_tiles(inputs["seen"], self.config.error.tile)}
        return {"predicted": self.estimate(padded)["predicted"], "mean": self.mean}, state

    def estimate(self, tensors: Tensors) -> Tensors:
        """`seen`, whole tiles -> `predicted`, a value a tile: a graph."""
        predicted: TileMap = torch.sigmoid(self.layers(tensors["seen"]))
        return {"predicted": predicted}
