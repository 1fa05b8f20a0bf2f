"""NSRD's network, layer by layer [NSRD, code]; parameter names are those of the weights."""

from __future__ import annotations

from typing import NamedTuple, cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.network.blocks import make_conv3, pixel_unshuffle
from rtsr_cli.core.shapes import Color, Image
from rtsr_cli.core.system import State, Tensors
from rtsr_cli.models.nsrd.config import HISTORY_FRAMES, LR_CHANNELS, NSRDConfig
from rtsr_cli.models.nsrd.inputs import surroundings_of

PAST = tuple(f"past_{age}" for age in range(1, HISTORY_FRAMES + 1))
"""Past frames, newest first."""

WIDTH = 32
"""Channels of each of the four parts that the LSTM sees."""

UNET_WIDTH = 64

SQUEEZED_WIDTH = 4
"""Channels inside channel attention."""

LEAK = 0.2
"""Slope of the gated convolution's leaky ReLU below 0."""


class NSRDState(NamedTuple):
    """What one frame leaves to the next.

    Attributes:
        lighting: prediction on the aligned grid, linear, so that the next frame can express it
            with its own k; as predicted in `paper`.
        hidden, cell: of the LSTM.
        linked: frames that gradients reach back through.
    """

    lighting: Color
    hidden: Image
    cell: Image
    linked: int


class GatedConvolution(nn.Module):
    """Warped frame and mask -> features: BN(LeakyReLU(c3 x) * sigmoid(c3 x))."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        """Weights start Kaiming-normal."""
        super().__init__()
        self.feature = make_conv3(channels_in, channels_out)
        self.gate = make_conv3(channels_in, channels_out)
        self.norm = nn.BatchNorm2d(channels_out)
        for layer in (self.feature, self.gate):
            nn.init.kaiming_normal_(layer.weight)

    def forward(self, frame: Image) -> Image:
        """Gate and normalise."""
        features = F.leaky_relu(self.feature(frame), LEAK)
        gated: Image = self.norm(features * torch.sigmoid(self.gate(frame)))
        return gated


class ConvLSTM(nn.Module):
    """LSTM cell whose gates are one 3x3 convolution of input and hidden state.

    c' = f c + i g,   h' = o tanh(c'),   (i, f, o, g) = (s, s, s, tanh)(c3 [x, h])
    """

    def __init__(self, channels_in: int, channels: int) -> None:
        """Keep the width."""
        super().__init__()
        self.channels = channels
        self.gates = make_conv3(channels_in + channels, 4 * channels)

    def forward(self, seen: Image, hidden: Image, cell: Image) -> tuple[Image, Image]:
        """Return the new hidden state and cell; what adds up over frames is of single precision."""
        gates = self.gates(torch.cat([seen, hidden.to(seen.dtype)], dim=1))
        enter, forget, leave, candidate = gates.chunk(4, dim=1)
        entering = torch.sigmoid(enter) * torch.tanh(candidate)
        cell = torch.addcmul(entering.float(), torch.sigmoid(forget).float(), cell)
        return torch.sigmoid(leave) * torch.tanh(cell).to(leave.dtype), cell


class ChannelAttentionBlock(nn.Module):
    """RCAB: c3-ReLU-c3, each channel times what its mean over the image decides, plus identity."""

    def __init__(self, channels: int) -> None:
        """Keep the width."""
        super().__init__()
        self.layers = nn.Sequential(
            make_conv3(channels, channels), nn.ReLU(inplace=True), make_conv3(channels, channels)
        )
        self.attention = nn.Sequential(
            nn.Conv2d(channels, SQUEEZED_WIDTH, 1),
            nn.ReLU(inplace=True),
            nn.Conv2d(SQUEEZED_WIDTH, channels, 1),
            nn.Sigmoid(),
        )

    def forward(self, features: Image) -> Image:
        """Add what the layers give."""
        corrected = self.layers(features)
        # half holds no sum over an image
        mean = corrected.mean((2, 3), keepdim=True, dtype=torch.float32)
        weights = self.attention(mean.to(corrected.dtype))
        return torch.addcmul(features, corrected, weights)


def make_attention_blocks(count: int) -> nn.Sequential:
    """Blocks one after the other."""
    return nn.Sequential(*(ChannelAttentionBlock(UNET_WIDTH) for _ in range(count)))


def halve_size(features: Image) -> Image:
    """2x2 maximum; a side of one pixel stays."""
    height, width = features.shape[-2:]
    return F.max_pool2d(features, (min(2, height), min(2, width)))


def double_size(features: Image, like: Image) -> Image:
    """Twice the size, bilinear from corner to corner, zeros around up to the size of `like`.

    Of what is missing, floor(half) goes above and to the left [NSRD, code].
    """
    height, width = like.shape[-2:]
    h, w = (min(2 * a, b) for a, b in zip(features.shape[-2:], (height, width), strict=True))
    enlarged = F.interpolate(features, size=(h, w), mode="bilinear", align_corners=True)
    down, right = height - h, width - w
    if not (down or right):
        return enlarged
    return F.pad(enlarged, (right // 2, right - right // 2, down // 2, down - down // 2))


class LevelJoin(nn.Module):
    """Coarse features, doubled, beside those of the finer level -> the finer level."""

    def __init__(self, blocks: int) -> None:
        """Keep the number of blocks."""
        super().__init__()
        self.join = make_conv3(2 * UNET_WIDTH, UNET_WIDTH)
        self.blocks = make_attention_blocks(blocks)

    def forward(self, coarse: Image, fine: Image) -> Image:
        """Double, join, refine."""
        joined: Image = self.blocks(self.join(torch.cat([double_size(coarse, fine), fine], dim=1)))
        return joined


class MultiscaleReconstruction(nn.Module):
    """Hidden state -> features, over three levels of resolution."""

    def __init__(self) -> None:
        """Build the published numbers of blocks."""
        super().__init__()
        self.encoder_1 = make_attention_blocks(3)
        self.encoder_2 = make_attention_blocks(2)
        self.centre = make_attention_blocks(3)
        self.decoder_2 = LevelJoin(2)
        self.decoder_1 = LevelJoin(3)
        self.narrow = make_conv3(UNET_WIDTH, WIDTH)

    def forward(self, hidden: Image) -> Image:
        """Down and up again."""
        fine = self.encoder_1(hidden)
        middle = self.encoder_2(halve_size(fine))
        coarse = self.centre(halve_size(middle))
        features: Image = self.narrow(self.decoder_1(self.decoder_2(coarse, middle), fine))
        return features


class NSRDNetwork(nn.Module):
    """The whole network; its state is an `NSRDState`."""

    def __init__(self, config: NSRDConfig, scale: int) -> None:
        """Build for a config and a scale; starts as the identity on `base` where there is one."""
        super().__init__()
        self.config = config
        self.surroundings = surroundings_of(config)
        self.scale = scale
        self.current = make_conv3(LR_CHANNELS, WIDTH)
        self.reliable = GatedConvolution(LR_CHANNELS + 1, WIDTH)
        self.last = make_conv3(3 * scale**2, WIDTH)
        self.memory = ConvLSTM((2 + HISTORY_FRAMES) * WIDTH, UNET_WIDTH)
        self.reconstruction = MultiscaleReconstruction()
        self.output = make_conv3(WIDTH, 3 * scale**2)
        if self.surroundings.corrects_base:
            nn.init.zeros_(self.output.weight)
            nn.init.zeros_(cast(Tensor, self.output.bias))

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        """Encode current and past frames and the last output, remember, reconstruct."""
        before = cast(NSRDState | None, state)
        previous = None
        if before is not None:
            previous = self.surroundings.fetch_output(before.lighting, inputs)
        hidden, cell = self._recall_state(inputs, before)
        tensors = {name: inputs[name] for name in ("frame_0", *PAST, "base") if name in inputs}
        tensors |= {"last": self._show_last(inputs, previous), "hidden": hidden, "cell": cell}
        made = self.reconstruct(tensors)
        outputs = {"predicted": made["predicted"]}
        if previous is not None:
            outputs["previous"] = previous
        return outputs, self._make_state(inputs, made, before)

    def reconstruct(self, tensors: Tensors) -> Tensors:
        """Frames, last output, state -> `predicted`, `hidden_next`, `cell_next`: a graph."""
        current = self.current(tensors["frame_0"])
        past = [self.reliable(tensors[name]) for name in PAST]
        last = self.last(pixel_unshuffle(tensors["last"], self.scale, like=current))
        seen = torch.cat([current, *past, last], dim=1)
        hidden, cell = self.memory(seen, tensors["hidden"], tensors["cell"])
        features = self.reconstruction(hidden)
        predicted = F.pixel_shuffle(self.output(features), self.scale).float()
        if "base" in tensors:
            predicted = predicted + tensors["base"]
        return {"predicted": predicted, "hidden_next": hidden, "cell_next": cell}

    def _show_last(self, inputs: Tensors, previous: Color | None) -> Color:
        """What the network sees of the last output: zeros where there is none."""
        if previous is None or not self.config.feedback:
            return torch.zeros_like(inputs["material"])
        return self.surroundings.show_output(previous, inputs)

    def _recall_state(self, inputs: Tensors, before: NSRDState | None) -> tuple[Image, Image]:
        """Hidden state and cell of the frame before, zeros where there is none."""
        if before is None or not self.config.lstm:
            frame = inputs["frame_0"]
            nothing = frame.new_zeros(frame.shape[0], UNET_WIDTH, *frame.shape[2:])
            return nothing, nothing
        if not (self.config.warp_state and self.surroundings.moves_state):
            return before.hidden, before.cell
        hidden, cell = (
            backward_warp(image, inputs["motion_1"], mode="nearest", border="zero")[0]
            for image in (before.hidden, before.cell)
        )
        return hidden, cell

    def _make_state(
        self,
        inputs: Tensors,
        made: Tensors,
        before: NSRDState | None,
    ) -> NSRDState:
        """Make the state; gradients are cut where the config says so."""
        hidden, cell = made["hidden_next"], made["cell_next"]
        lighting = self.surroundings.decode(made["predicted"], inputs["lighting_scale"])
        linked = 1 if before is None else before.linked + 1
        if linked < self.config.gradient_frames:
            return NSRDState(lighting, hidden, cell, linked)
        return NSRDState(lighting.detach(), hidden.detach(), cell.detach(), 0)
