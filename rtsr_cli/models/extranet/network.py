"""ExtraNet's layers: light gated convolutions, a history encoder with shared weights, a U-shape.

Guo et al., "ExtraNet: Real-time Extrapolated Rendering for Low-latency Temporal Supersampling",
SIGGRAPH Asia 2021. A light gated convolution, LGC, is

    out = conv(x) * sigmoid(gate(x)),   gate of one channel

Conventions: `current` holds two pictures of log lighting, the same two masked, and the target's
geometry; `history` three moved frames, oldest first, each of log lighting and a mask of its holes.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.network.blocks import continue_borders, make_normalised_conv3
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import Tensors

if TYPE_CHECKING:
    from rtsr_cli.models.extranet.config import ExtraNetConfig

CURRENT_CHANNELS = 18
HISTORY_FRAMES, HISTORY_CHANNELS = 3, 4
PICTURE = slice(0, 3)
"""Channels of `current` that the output is added to."""

DIVISOR = 8
"""Sizes that the layers take are multiples of it: three halvings."""

_HISTORY_WIDTHS = ((24, 24, 24), (32, 32, 32), (32, 32, 32))


class LightGatedConv(nn.Module):
    """3x3 convolution times the sigmoid of a one-channel 3x3 convolution, both with bias."""

    def __init__(self, channels_in: int, channels_out: int, *, stride: int = 1) -> None:
        """Keep the widths; `stride` 2 halves the size."""
        super().__init__()
        self.features = nn.Conv2d(channels_in, channels_out, 3, stride=stride, padding=1)
        self.gate = nn.Conv2d(channels_in, 1, 3, stride=stride, padding=1)

    def forward(self, image: Image) -> Image:
        """Convolve, and let the gate through."""
        gate: Tensor = torch.sigmoid(self.gate(image))
        features: Tensor = self.features(image)
        return features.mul(gate)


class MergedGatedConv(nn.Module):
    """The same as one convolution, the norm behind it folded in; for inference.

    The gate is its last channel. A norm's scale is one of the features; its shift is not, as it
    comes behind the gate: scale f gate + shift.
    """

    shift: Tensor | None

    def __init__(self, layer: LightGatedConv, norm: nn.BatchNorm2d | None = None) -> None:
        """Take over a layer and the norm behind it, ReLU included; without a norm, neither."""
        super().__init__()
        features, gate = layer.features, layer.gate
        scale, shift = torch.ones(features.out_channels), None
        if norm is not None:
            mean, variance = cast(Tensor, norm.running_mean), cast(Tensor, norm.running_var)
            scale = norm.weight * torch.rsqrt(variance + norm.eps)
            shift = (norm.bias - mean * scale).detach().view(1, -1, 1, 1)
        self.register_buffer("shift", shift)
        self.convolution = nn.Conv2d(
            features.in_channels,
            features.out_channels + 1,
            3,
            stride=(features.stride[0], features.stride[1]),
            padding=1,
        )
        weight, bias = features.weight * scale.view(-1, 1, 1, 1), cast(Tensor, features.bias)
        self.convolution.weight = nn.Parameter(torch.cat([weight, gate.weight]))
        self.convolution.bias = nn.Parameter(torch.cat([bias * scale, cast(Tensor, gate.bias)]))

    def forward(self, image: Image) -> Image:
        """Convolve, let the gate through, and where there was a norm: shift, ReLU."""
        both: Tensor = self.convolution(image)
        features, gate = both[:, :-1], both[:, -1:].sigmoid()
        if self.shift is None:
            passed: Tensor = features * gate
            return passed
        return torch.addcmul(self.shift, features, gate).relu_()


def _make_gated_block(channels_in: int, channels_out: int) -> nn.Sequential:
    """LGC, batch norm, ReLU."""
    return nn.Sequential(
        LightGatedConv(channels_in, channels_out),
        nn.BatchNorm2d(channels_out),
        nn.ReLU(inplace=True),
    )


def is_gated_block(module: nn.Module) -> bool:
    """Tell whether a module is an LGC, batch norm, ReLU."""
    kinds = [LightGatedConv, nn.BatchNorm2d, nn.ReLU]
    return isinstance(module, nn.Sequential) and [type(layer) for layer in module] == kinds


def _make_down(channels_in: int, channels_out: int) -> nn.Sequential:
    """LGC of stride 2 without norm or activation, then two gated blocks."""
    return nn.Sequential(
        LightGatedConv(channels_in, channels_in, stride=2),
        _make_gated_block(channels_in, channels_out),
        _make_gated_block(channels_out, channels_out),
    )


def _make_up(channels_in: int, channels_between: int, channels_out: int) -> nn.Sequential:
    return nn.Sequential(
        make_normalised_conv3(channels_in, channels_between),
        make_normalised_conv3(channels_between, channels_out),
    )


def _make_history_stage(channels_in: int, widths: tuple[int, ...]) -> nn.Sequential:
    """3x3 convolutions with batch norm and ReLU, the first of stride 2."""
    layers: list[nn.Module] = []
    for place, width in enumerate(widths):
        stride = 2 if place == 0 else 1
        layers += [
            nn.Conv2d(channels_in, width, 3, stride=stride, padding=1),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
        ]
        channels_in = width
    return nn.Sequential(*layers)


class HistoryEncoder(nn.Module):
    """Features of each moved frame at an eighth of the size, one set of weights for all."""

    def __init__(self) -> None:
        """Make nine layers, and the gated one that joins the frames."""
        super().__init__()
        before = (HISTORY_CHANNELS, *(widths[-1] for widths in _HISTORY_WIDTHS[:-1]))
        stages = zip(before, _HISTORY_WIDTHS, strict=True)
        self.frames = nn.Sequential(*(_make_history_stage(c, widths) for c, widths in stages))
        features = _HISTORY_WIDTHS[-1][-1]
        self.join = LightGatedConv(HISTORY_FRAMES * features, features)

    def forward(self, history: Image) -> Image:
        """Encode n 12 h w, frames folded into the batch; to n 32 h/8 w/8."""
        folded = torch.cat(history.chunk(HISTORY_FRAMES, dim=1))
        if history.is_contiguous(memory_format=torch.channels_last):
            folded = folded.contiguous(memory_format=torch.channels_last)
        features: Tensor = self.frames(folded)
        joined: Image = self.join(torch.cat(features.chunk(HISTORY_FRAMES), dim=1))
        return joined


class ExtraNetNetwork(nn.Module):
    """Log lighting of a frame that was never shaded, from moved ones and its geometry.

    262,141 parameters; sizes that are no multiple of 8 are padded by their borders.
    """

    def __init__(self, config: ExtraNetConfig, scale: int = 1) -> None:
        """Make the layers.

        Args:
            config: settings; `history` False leaves the encoder out of the sum (an ablation).
            scale: 1: there is nothing to enlarge.
        """
        super().__init__()
        del scale
        self.config = config
        self.history = HistoryEncoder()
        self.enter = nn.Sequential(
            _make_gated_block(CURRENT_CHANNELS, 24), _make_gated_block(24, 24)
        )
        self.down = nn.ModuleList([_make_down(24, 24), _make_down(24, 32), _make_down(32, 32)])
        self.up = nn.ModuleList([_make_up(96, 48, 32), _make_up(56, 28, 24), _make_up(48, 24, 24)])
        self.leave = nn.Conv2d(24, 3, 1)
        # nothing is corrected before anything is learnt
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(cast(Tensor, self.leave.bias))

    def for_inference(self) -> ExtraNetNetwork:
        """Return the same function with every gated convolution merged into one."""
        merged = copy.deepcopy(self)
        for module in list(merged.modules()):
            for name, layer in list(module.named_children()):
                if isinstance(layer, LightGatedConv):
                    setattr(module, name, MergedGatedConv(layer))
                elif is_gated_block(layer):
                    gated, norm, _ = cast(tuple[LightGatedConv, nn.BatchNorm2d, nn.ReLU], layer)
                    setattr(module, name, MergedGatedConv(gated, norm))
        return merged

    def forward(self, inputs: Tensors, state: object = None) -> tuple[dict[str, Tensor], None]:
        """Predict log lighting.

        Args:
            inputs: `current` n 18 h w, `history` n 12 h w.
            state: none is kept.

        Returns:
            `predicted` n 3 h w, and no state.
        """
        del state
        height, width = inputs["current"].shape[2:]
        names = ("current", "history")
        padded = {name: continue_borders(inputs[name], DIVISOR) for name in names}
        predicted = self.correct(padded)["predicted"]
        return {"predicted": predicted[:, :, :height, :width]}, None

    def correct(self, tensors: Tensors) -> Tensors:
        """`current`, `history`, sides multiples of 8 -> `predicted`: a graph."""
        current, history = tensors["current"], tensors["history"]
        return {"predicted": self._correct(current, history) + current[:, PICTURE]}

    def _correct(self, current: Image, history: Image) -> Image:
        levels = [self.enter(current)]
        for down in self.down:
            levels.append(down(levels[-1]))
        encoded = self.history(history)
        features = torch.cat([levels.pop(), encoded if self.config.history else 0.0 * encoded], 1)
        for up in self.up:
            # align_corners as the published code has it
            large = F.interpolate(features, scale_factor=2.0, mode="bilinear", align_corners=True)
            features = up(torch.cat([levels.pop(), large], dim=1))
        correction: Image = self.leave(features)
        return correction
