"""FuseSR's networks, layer by layer [FuseSR, code]; parameter names are those of the weights."""

from __future__ import annotations

from itertools import pairwise
from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.imaging.row_strips import run_in_strips
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.network.blocks import (
    InvertedResidual,
    ResidualBlock,
    make_conv3,
    make_normalised_conv3,
    make_separable_conv,
    pixel_unshuffle,
)
from rtsr_cli.core.shapes import Color, Image, Plane
from rtsr_cli.core.system import State, Tensors
from rtsr_cli.models.fusesr.config import HISTORY_FRAMES, LR_CHANNELS, FuseSRConfig, Fusion, Variant
from rtsr_cli.models.fusesr.inputs import surroundings_of

MAIN_WIDTHS = (64, 64, 32, 24, 24, 32, 32)
"""Channels through the encoder's main path [FuseSR, code]."""

FAST_WIDTHS = (32, 16, 12, 12, 16)
"""The same of the fast network."""

BACKBONE_BLOCKS = 6

WHOLE_PIXELS = 2**18
"""LR pixels up to which the full network's backbone sees a frame whole: 128 MiB a feature map."""

STRIP_HALO = 17
"""LR rows that fusion, 13 layers of backbone, upsampling and refinement reach to, and one."""


class Encoder(nn.Module):
    """LR frame -> shallow features (64) and main features (32); one set of weights a frame."""

    def __init__(self) -> None:
        """Build the layers of `MAIN_WIDTHS`."""
        super().__init__()
        self.shallow = nn.Sequential(make_conv3(LR_CHANNELS, MAIN_WIDTHS[0]), nn.ReLU(inplace=True))
        self.main = nn.Sequential(*(make_normalised_conv3(a, b) for a, b in pairwise(MAIN_WIDTHS)))

    def forward(self, frame: Image) -> tuple[Image, Image]:
        """Return both."""
        shallow = self.shallow(frame)
        return shallow, self.main(shallow)


class WarpAttention(nn.Module):
    """Weight of warped history, at least 0, from motion and the two depths.

    w = ReLU(c3(tanh(sum over channels of ReLU(c3 x) + ReLU(c3 x))))    [FuseSR, code]
    """

    def __init__(self) -> None:
        """Four channels in, one out."""
        super().__init__()
        self.first = make_conv3(4, 4)
        self.second = make_conv3(4, 4)
        self.last = make_conv3(1, 1)

    def forward(self, motion_ndc: Image, depth_past: Plane, depth: Plane) -> Plane:
        """Motion in screen widths and heights times 2."""
        seen = torch.cat([motion_ndc, depth_past, depth], dim=1)
        summed = F.relu(self.first(seen)) + F.relu(self.second(seen))
        weight: Plane = F.relu(self.last(torch.tanh(summed.sum(1, keepdim=True))))
        return weight


class HrFusion(nn.Module):
    """Where HR buffers meet LR features, and what turns features into an HR image.

    `unshuffle` brings each S x S block to LR as channels; `pool` its mean; `upsample` lets the
    last layer alone see the buffers, at HR; `none` leaves them out.
    """

    def __init__(self, config: FuseSRConfig, scale: int) -> None:
        """Keep what decides the channels."""
        super().__init__()
        self.fusion = config.fusion
        self.scale = scale
        at_lr = {Fusion.UNSHUFFLE: scale**2, Fusion.POOL: 1}
        self.lr_channels = config.hr_channels * at_lr.get(config.fusion, 0)
        self.hr_channels = config.hr_channels if config.fusion is Fusion.UPSAMPLE else 0

    def at_lr(self, hr: Image, like: Image) -> Image:
        """n c S*h S*w -> n `lr_channels` h w, in the number and memory format of `like`."""
        if self.fusion is Fusion.POOL:
            return F.avg_pool2d(hr, self.scale)
        return pixel_unshuffle(hr, self.scale, like=like)

    def at_hr(self, image: Color, hr: Image) -> Image:
        """Return what the last layer sees."""
        return torch.cat([image, hr], dim=1) if self.hr_channels else image


class Decoder(nn.Module):
    """Backbone features and shallow features -> HR prediction."""

    def __init__(self, channels: int, fusion: HrFusion, *, corrects: bool) -> None:
        """Start as the identity on `base` where the network corrects one."""
        super().__init__()
        self.fusion = fusion
        self.upsample = make_conv3(channels, 3 * fusion.scale**2)
        self.refine = make_conv3(3 + fusion.hr_channels, 3)
        if corrects:
            nn.init.zeros_(self.upsample.weight)
            nn.init.zeros_(self.refine.weight)
            nn.init.dirac_(self.refine.weight.data[:, :3])
            for layer in (self.upsample, self.refine):
                nn.init.zeros_(cast(Tensor, layer.bias))

    def forward(self, features: Image, inputs: Tensors) -> Color:
        """Shuffle to HR, add `base` if there is one, refine."""
        image = F.pixel_shuffle(self.upsample(features), self.fusion.scale)
        if "base" in inputs:
            image = image + inputs["base"]
        refined: Color = self.refine(self.fusion.at_hr(image, inputs["hr"]))
        return refined.relu_()


class FuseSRNetwork(nn.Module):
    """The full network; its state is the main features of past frames, newest first."""

    def __init__(self, config: FuseSRConfig, scale: int) -> None:
        """Build for a config and a scale."""
        super().__init__()
        self.config = config
        self.encoder = Encoder()
        self.expand = nn.Sequential(make_conv3(MAIN_WIDTHS[-1], 64), nn.ReLU(inplace=True))
        self.attention = WarpAttention() if config.history else None
        self.fusion = HrFusion(config, scale)
        # the first release concatenates the unshuffled material as it is
        compacts = self.fusion.lr_channels > 0 and config.variant is not Variant.FIRST_RELEASE
        self.compact = (
            nn.Sequential(make_conv3(self.fusion.lr_channels, 64), nn.ReLU(inplace=True))
            if compacts
            else nn.Identity()
        )
        past = HISTORY_FRAMES * MAIN_WIDTHS[-1] if config.history else 0
        fused = 64 if compacts else self.fusion.lr_channels
        self.backbone = nn.Sequential(
            make_conv3(64 + past + fused, 128),
            nn.ReLU(inplace=True),
            *(ResidualBlock(128) for _ in range(BACKBONE_BLOCKS)),
        )
        corrects = surroundings_of(config).corrects_base
        self.decoder = Decoder(128 + MAIN_WIDTHS[0], self.fusion, corrects=corrects)

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        """Encode, fetch history, fuse, decode."""
        shallow, main = self.encoder(inputs["frame_0"])
        parts = [self.expand(main)]
        past: list[Image] = []
        if self.attention is not None:
            past = [self._encode_past(age, inputs, state) for age in (1, 2)]
            parts += [self._fetch(age, past[age - 1], inputs) for age in (1, 2)]
        images = {"seen": torch.cat(parts, dim=1), "shallow": shallow}
        images |= {name: inputs[name] for name in ("hr", "base") if name in inputs}
        height, width = main.shape[-2:]
        rows = height if height * width <= WHOLE_PIXELS else max(1, WHOLE_PIXELS // width)
        predicted = run_in_strips(self._fuse, images, rows=rows, halo=STRIP_HALO)
        # after a reset the current frame may have stood in for the past: it is none of the next's
        known = past[:1] if state is not None else []
        return {"predicted": predicted}, (main, *known) if past else None

    def _fuse(self, images: Tensors) -> Color:
        """Current and past features, HR buffers -> HR prediction."""
        parts = [images["seen"]]
        if self.fusion.lr_channels:
            parts.append(self.compact(self.fusion.at_lr(images["hr"], like=parts[0])))
        features = self.backbone(torch.cat(parts, dim=1))
        predicted: Color = self.decoder(torch.cat([features, images["shallow"]], dim=1), images)
        return predicted

    def _encode_past(self, age: int, inputs: Tensors, state: State) -> Image:
        """Main features of a past frame, or of what stands in: as computed then, or anew."""
        known = cast(tuple[Image, ...], state or ())
        if age <= len(known):
            return known[age - 1]
        features: Image = self.encoder(inputs[f"frame_{age}"])[1]
        return features

    def _fetch(self, age: int, features: Image, inputs: Tensors) -> Image:
        """Features where each pixel was, weighted."""
        motion_px = inputs[f"motion_{age}"]
        depth_past = inputs[f"frame_{age}"][:, 3:4]
        if surroundings_of(self.config).warps_depth:
            depth_past, _ = backward_warp(depth_past, motion_px, mode="nearest")
        assert self.attention is not None
        depth = inputs["frame_0"][:, 3:4]
        weight: Plane = self.attention(inputs[f"motion_ndc_{age}"], depth_past, depth)
        warped, _ = backward_warp(features, motion_px, mode="nearest", border="zero")
        return warped * weight


class FuseSRFastNetwork(nn.Module):
    """The fast network: separable convolutions, no history, no compact layer."""

    def __init__(self, config: FuseSRConfig, scale: int) -> None:
        """Build for a config and a scale."""
        super().__init__()
        self.config = config
        width = FAST_WIDTHS[0]
        self.shallow = nn.Sequential(make_conv3(LR_CHANNELS, width), nn.ReLU(inplace=True))
        self.main = nn.Sequential(*(make_separable_conv(a, b) for a, b in pairwise(FAST_WIDTHS)))
        self.expand = nn.Sequential(make_conv3(FAST_WIDTHS[-1], width), nn.ReLU(inplace=True))
        self.fusion = HrFusion(config, scale)
        self.backbone = nn.Sequential(
            make_conv3(width + self.fusion.lr_channels, width),
            nn.ReLU(inplace=True),
            *(InvertedResidual(width) for _ in range(BACKBONE_BLOCKS)),
        )
        self.decoder = Decoder(
            2 * width, self.fusion, corrects=surroundings_of(config).corrects_base
        )

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        """Encode, fuse, decode."""
        shallow = self.shallow(inputs["frame_0"])
        parts = [self.expand(self.main(shallow))]
        if self.fusion.lr_channels:
            parts.append(self.fusion.at_lr(inputs["hr"], like=shallow))
        features = self.backbone(torch.cat(parts, dim=1))
        return {"predicted": self.decoder(torch.cat([features, shallow], dim=1), inputs)}, state
