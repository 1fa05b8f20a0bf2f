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
from rtsr_cli.core.network.graphs import is_exporting
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

AGES = (1, 2)
"""Past frames that are fetched."""

DEPTH = slice(3, 4)
"""Channel of a frame's features."""

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
        tensors = dict(self.encode({"frame": inputs["frame_0"]}))
        main = tensors["main"]
        past: list[Image] = []
        if self.attention is not None:
            past = [self._encode_past(age, inputs, state) for age in AGES]
            for age in AGES:
                tensors |= self._fetch(age, past[age - 1], inputs)
            tensors["depth"] = inputs["frame_0"][:, DEPTH]
        tensors |= {name: inputs[name] for name in ("hr", "base") if name in inputs}
        # after a reset the current frame may have stood in for the past: it is none of the next's
        known = past[:1] if state is not None else []
        return self.fuse(tensors), (main, *known) if past else None

    def encode(self, tensors: Tensors) -> Tensors:
        """`frame` -> `shallow` 64 and `main` 32: a graph."""
        shallow, main = self.encoder(tensors["frame"])
        return {"shallow": shallow, "main": main}

    def fuse(self, tensors: Tensors) -> Tensors:
        """Features, fetched ones, HR buffers -> `predicted`: a graph."""
        parts = [self.expand(tensors["main"])]
        if self.attention is not None:
            parts += [tensors[f"past_{age}"] * self._weigh(age, tensors) for age in AGES]
        images = {"seen": torch.cat(parts, dim=1), "shallow": tensors["shallow"]}
        images |= {name: tensors[name] for name in ("hr", "base") if name in tensors}
        if is_exporting():
            return {"predicted": self._fuse(images)}
        height, width = parts[0].shape[-2:]
        rows = height if height * width <= WHOLE_PIXELS else max(1, WHOLE_PIXELS // width)
        return {"predicted": run_in_strips(self._fuse, images, rows=rows, halo=STRIP_HALO)}

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
        features: Image = self.encode({"frame": inputs[f"frame_{age}"]})["main"]
        return features

    def _fetch(self, age: int, features: Image, inputs: Tensors) -> dict[str, Tensor]:
        """Features and depth where each pixel was, and the motion to there."""
        motion_px = inputs[f"motion_{age}"]
        depth_past = inputs[f"frame_{age}"][:, DEPTH]
        if surroundings_of(self.config).warps_depth:
            depth_past, _ = backward_warp(depth_past, motion_px, mode="nearest")
        warped, _ = backward_warp(features, motion_px, mode="nearest", border="zero")
        return {
            f"past_{age}": warped,
            f"depth_{age}": depth_past,
            f"motion_ndc_{age}": inputs[f"motion_ndc_{age}"],
        }

    def _weigh(self, age: int, tensors: Tensors) -> Plane:
        """Weight of fetched features."""
        assert self.attention is not None
        weight: Plane = self.attention(
            tensors[f"motion_ndc_{age}"], tensors[f"depth_{age}"], tensors["depth"]
        )
        return weight


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
        tensors = {name: inputs[name] for name in ("frame_0", "hr", "base") if name in inputs}
        return self.correct(tensors), state

    def correct(self, tensors: Tensors) -> Tensors:
        """`frame_0`, `hr`, `base` -> `predicted`: a graph."""
        shallow = self.shallow(tensors["frame_0"])
        parts = [self.expand(self.main(shallow))]
        if self.fusion.lr_channels:
            parts.append(self.fusion.at_lr(tensors["hr"], like=shallow))
        features = self.backbone(torch.cat(parts, dim=1))
        return {"predicted": self.decoder(torch.cat([features, shallow], dim=1), tensors)}
