"""Network modules that systems are built from."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import nn

from rtsr_cli.core.shapes import Image


def make_conv3(channels_in: int, channels_out: int) -> nn.Conv2d:
    """3x3 convolution, stride 1, zero padding 1, with bias."""
    return nn.Conv2d(channels_in, channels_out, 3, padding=1)


def pixel_unshuffle(image: Image, scale: int, *, like: Image) -> Image:
    """n c S*h S*w -> n c*S*S h w, in the number and memory format of `like`.

    torch's own, and what follows it, take twice as long where `like` has its channels last.
    """
    if not like.is_contiguous(memory_format=torch.channels_last):
        return F.pixel_unshuffle(image.to(like.dtype), scale)
    n, c, height, width = image.shape
    h, w = height // scale, width // scale
    blocks = image.view(n, c, h, scale, w, scale).permute(0, 2, 4, 1, 3, 5)
    pixels = torch.empty(blocks.shape, dtype=like.dtype, device=image.device).copy_(blocks)
    return pixels.view(n, h, w, -1).permute(0, 3, 1, 2)


def continue_borders(image: Image, multiple: int) -> Image:
    """Repeat the last row and column until both sides are multiples."""
    height, width = image.shape[2:]
    below, beside = -height % multiple, -width % multiple
    return F.pad(image, (0, beside, 0, below), mode="replicate") if below or beside else image


class ResidualBlock(nn.Module):
    """c3-ReLU-c3 plus identity, no activation after [FuseSR, code]."""

    def __init__(self, channels: int) -> None:
        """Keep the width."""
        super().__init__()
        self.layers = nn.Sequential(
            make_conv3(channels, channels), nn.ReLU(inplace=True), make_conv3(channels, channels)
        )

    def forward(self, features: Image) -> Image:
        """Add what the layers give."""
        corrected: Image = self.layers(features)
        return corrected.add_(features)


def make_normalised_conv3(channels_in: int, channels_out: int) -> nn.Sequential:
    """c3, batch norm, ReLU."""
    return nn.Sequential(
        make_conv3(channels_in, channels_out), nn.BatchNorm2d(channels_out), nn.ReLU(inplace=True)
    )


def make_separable_conv(channels_in: int, channels_out: int) -> nn.Sequential:
    """Depthwise 3x3 and pointwise 1x1, both with bias, batch norm, ReLU [FuseSR, code, fast]."""
    return nn.Sequential(
        nn.Conv2d(channels_in, channels_in, 3, padding=1, groups=channels_in),
        nn.Conv2d(channels_in, channels_out, 1),
        nn.BatchNorm2d(channels_out),
        nn.ReLU(inplace=True),
    )


class InvertedResidual(nn.Module):
    """Depthwise 3x3, batch norm, ReLU6, pointwise 1x1, batch norm, plus identity, no biases.

    The expansion is 1, so that there is no widening layer [FuseSR, code, fast].
    """

    def __init__(self, channels: int) -> None:
        """Keep the width."""
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1, groups=channels, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU6(inplace=True),
            nn.Conv2d(channels, channels, 1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, features: Image) -> Image:
        """Add what the layers give."""
        corrected: Image = self.layers(features)
        return corrected.add_(features)
