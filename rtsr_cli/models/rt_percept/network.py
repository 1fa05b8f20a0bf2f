"""The visual-error network, layer by layer [rt-percept, code]."""

from __future__ import annotations

import copy
from itertools import pairwise

import torch
from torch import Tensor, nn

from rtsr_cli.core.shapes import Image, TileMap
from rtsr_cli.core.system import State, Tensors
from rtsr_cli.core.vrs.tiles import padded
from rtsr_cli.models.rt_percept.config import WIDTH, RtPerceptConfig
from rtsr_cli.models.rt_percept.frozen import FrozenLayer
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
        seen = padded(inputs["seen"], self.config.error.tile)
        predicted: TileMap = torch.sigmoid(self.layers(seen))
        return {"predicted": predicted, "mean": self.mean}, state
