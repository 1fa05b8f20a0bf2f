"""`fusesr`, `fusesr-fast`, `fusesr-direct`: super-resolution by an H-shaped network.

Zhong et al., "FuseSR: Super Resolution for Real-time Rendering through Efficient Multi-resolution
Fusion", SIGGRAPH Asia 2023. HR material buffers are pixel-unshuffled to LR, where they meet the
features of LR lighting; the result is shuffled back and multiplied by the HR material. The fast
network leaves history out; the direct one predicts radiance without demodulation.

Conventions: LR features are those of the samples as rendered; HR buffers are moved by whole pixels
so that the sample is always pixel (S//2, S//2) of its block. Motion t -> t-1 is in LR pixels
between samples, jitter included. History that is missing is the current frame.

Departs from the publication in the preset `rtsr`: the network sees and predicts log(1 + L/k), k of
the whole frame; depth is 1 / (1 + metres); its output is added to the cubic enlargement of the
lighting before the last layer; warps are pixel-centred, motion to t-2 is chained in order, history
depth is warped; emission is added and sky enlarged on its own. `paper` keeps the published choices
around the same layers: raw lighting over softplus(F), depth as stored, no such sum.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.blocks import (
    InvertedResidual,
    ResidualBlock,
    conv3,
    normalised_conv3,
    pixel_unshuffle,
    separable,
)
from rtsr_cli.core.derive import DerivationConfig
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.brdf_lut import LutConvention
from rtsr_cli.core.imaging.demodulation import DemodulationMode
from rtsr_cli.core.imaging.warping import backward_warp, compose_motion
from rtsr_cli.core.lighting import (
    HR_BUFFERS,
    HR_OPTIONAL,
    LR_BUFFERS,
    PAPER_LOSS,
    REFERENCE_BUFFERS,
    LossWeights,
    Preset,
    aligned,
    compose_lighting,
    hr_frame,
    lighting_goal,
    lighting_inputs,
    lighting_loss,
    network_depth,
    network_lighting,
    network_normal,
)
from rtsr_cli.core.shapes import Color, Image, MotionPx, Plane
from rtsr_cli.core.system import (
    Learning,
    Prediction,
    State,
    System,
    Tensors,
    Window,
    neural_predict,
)

HISTORY_FRAMES = 2

LR_CHANNELS = 7
"""Lighting 3, depth 1, normal 3, in this order."""

HR_CHANNELS = {Buffer.MATERIAL: 3, Buffer.DEPTH: 1, Buffer.NORMAL: 3, Buffer.ALBEDO: 3}

MAIN_WIDTHS = (64, 64, 32, 24, 24, 32, 32)
"""Channels through the encoder's main path [FuseSR, code]."""

FAST_WIDTHS = (32, 16, 12, 12, 16)
"""The same of the fast network."""

BACKBONE_BLOCKS = 6

FAST_HALO_PX = 17
"""LR pixels that an output of the fast network reaches to: 14 layers at LR, one HR, and `base`."""


class Variant(StrEnum):
    """Which of the published networks."""

    HEAD = "head"
    FIRST_RELEASE = "first-release"
    DIRECT = "direct"
    FAST = "fast"


class Fusion(StrEnum):
    """How HR buffers reach LR features; all but `unshuffle` are ablations."""

    UNSHUFFLE = "unshuffle"
    POOL = "pool"
    UPSAMPLE = "upsample"
    NONE = "none"


HR_PARTS = {
    Variant.HEAD: (Buffer.MATERIAL, Buffer.DEPTH, Buffer.NORMAL, Buffer.ALBEDO),
    Variant.FIRST_RELEASE: (Buffer.MATERIAL,),
    Variant.DIRECT: (Buffer.ALBEDO, Buffer.DEPTH, Buffer.NORMAL),
    Variant.FAST: (Buffer.MATERIAL,),
}
"""HR buffers that each network sees, in the published order."""


@dataclass(frozen=True, kw_only=True)
class FuseSRConfig:
    """Settings of the full network.

    Attributes:
        variant: published network.
        preset: what surrounds its layers.
        demodulation: divisor of the radiance; `paper` takes softplus.
        lut: convention of the split-sum table.
        fusion: how HR buffers come in.
        history: whether past frames do.
        loss: weights of its terms; `paper` has its own.
    """

    variant: Variant = Variant.HEAD
    preset: Preset = Preset.RTSR
    demodulation: DemodulationMode = DemodulationMode.BRDF
    lut: LutConvention = LutConvention.KARIS
    fusion: Fusion = Fusion.UNSHUFFLE
    history: bool = True
    loss: LossWeights = field(default_factory=LossWeights)

    @property
    def hr_parts(self) -> tuple[Buffer, ...]:
        """HR buffers that the network sees."""
        return () if self.fusion is Fusion.NONE else HR_PARTS[self.variant]

    @property
    def hr_channels(self) -> int:
        """Their channels."""
        return sum(HR_CHANNELS[buffer] for buffer in self.hr_parts)

    @property
    def loss_weights(self) -> LossWeights:
        """Weights of the preset."""
        return PAPER_LOSS if self.preset is Preset.PAPER else self.loss


@dataclass(frozen=True, kw_only=True)
class FuseSRFastConfig(FuseSRConfig):
    """Settings of the fast network, which sees no history."""

    variant: Variant = Variant.FAST
    history: bool = False


@dataclass(frozen=True, kw_only=True)
class FuseSRDirectConfig(FuseSRConfig):
    """Settings of the network that predicts radiance itself."""

    variant: Variant = Variant.DIRECT
    demodulation: DemodulationMode = DemodulationMode.NONE


def derivation(config: FuseSRConfig) -> DerivationConfig:
    """What divides the radiance of a config."""
    softened = config.preset is Preset.PAPER and config.demodulation is DemodulationMode.BRDF
    mode = DemodulationMode.SOFTPLUS if softened else config.demodulation
    return DerivationConfig(mode=mode, lut=config.lut)


class Encoder(nn.Module):
    """LR frame -> shallow features (64) and main features (32); one set of weights a frame."""

    def __init__(self) -> None:
        """Build the layers of `MAIN_WIDTHS`."""
        super().__init__()
        self.shallow = nn.Sequential(conv3(LR_CHANNELS, MAIN_WIDTHS[0]), nn.ReLU(inplace=True))
        self.main = nn.Sequential(*(normalised_conv3(a, b) for a, b in pairwise(MAIN_WIDTHS)))

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
        self.first = conv3(4, 4)
        self.second = conv3(4, 4)
        self.last = conv3(1, 1)

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
        self.upsample = conv3(channels, 3 * fusion.scale**2)
        self.refine = conv3(3 + fusion.hr_channels, 3)
        if corrects:
            nn.init.zeros_(self.upsample.weight)
            nn.init.zeros_(self.refine.weight)
            nn.init.dirac_(self.refine.weight.data[:, :3])
            for layer in (self.upsample, self.refine):
                nn.init.zeros_(cast(Tensor, layer.bias))

    def forward(self, features: Image, inputs: Tensors) -> Tensors:
        """Shuffle to HR, add `base` if there is one, refine."""
        image = F.pixel_shuffle(self.upsample(features), self.fusion.scale)
        if "base" in inputs:
            image = image + inputs["base"]
        refined = self.refine(self.fusion.at_hr(image, inputs["hr"]))
        return {"predicted": refined.relu_()}


class FuseSRNetwork(nn.Module):
    """The full network; its state is the main features of past frames, newest first."""

    def __init__(self, config: FuseSRConfig, scale: int) -> None:
        """Build for a config and a scale."""
        super().__init__()
        self.config = config
        self.encoder = Encoder()
        self.expand = nn.Sequential(conv3(MAIN_WIDTHS[-1], 64), nn.ReLU(inplace=True))
        self.attention = WarpAttention() if config.history else None
        self.fusion = HrFusion(config, scale)
        # the first release concatenates the unshuffled material as it is
        compacts = self.fusion.lr_channels > 0 and config.variant is not Variant.FIRST_RELEASE
        self.compact = (
            nn.Sequential(conv3(self.fusion.lr_channels, 64), nn.ReLU(inplace=True))
            if compacts
            else nn.Identity()
        )
        past = HISTORY_FRAMES * MAIN_WIDTHS[-1] if config.history else 0
        fused = 64 if compacts else self.fusion.lr_channels
        self.backbone = nn.Sequential(
            conv3(64 + past + fused, 128),
            nn.ReLU(inplace=True),
            *(ResidualBlock(128) for _ in range(BACKBONE_BLOCKS)),
        )
        self.decoder = Decoder(
            128 + MAIN_WIDTHS[0], self.fusion, corrects=config.preset is Preset.RTSR
        )

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        """Encode, fetch history, fuse, decode."""
        shallow, main = self.encoder(inputs["frame_0"])
        parts = [self.expand(main)]
        past: list[Image] = []
        if self.attention is not None:
            past = [self._past(age, inputs, state) for age in (1, 2)]
            parts += [self._fetched(age, past[age - 1], inputs) for age in (1, 2)]
        if self.fusion.lr_channels:
            parts.append(self.compact(self.fusion.at_lr(inputs["hr"], like=main)))
        features = self.backbone(torch.cat(parts, dim=1))
        outputs = self.decoder(torch.cat([features, shallow], dim=1), inputs)
        # after a reset the current frame may have stood in for the past: it is none of the next's
        known = past[:1] if state is not None else []
        return outputs, (main, *known) if past else None

    def _past(self, age: int, inputs: Tensors, state: State) -> Image:
        """Main features of a past frame, or of what stands in: as computed then, or anew."""
        known = cast(tuple[Image, ...], state or ())
        if age <= len(known):
            return known[age - 1]
        features: Image = self.encoder(inputs[f"frame_{age}"])[1]
        return features

    def _fetched(self, age: int, features: Image, inputs: Tensors) -> Image:
        """Features where each pixel was, weighted."""
        motion_px = inputs[f"motion_{age}"]
        depth_past = inputs[f"frame_{age}"][:, 3:4]
        if self.config.preset is Preset.RTSR:
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
        self.shallow = nn.Sequential(conv3(LR_CHANNELS, width), nn.ReLU(inplace=True))
        self.main = nn.Sequential(*(separable(a, b) for a, b in pairwise(FAST_WIDTHS)))
        self.expand = nn.Sequential(conv3(FAST_WIDTHS[-1], width), nn.ReLU(inplace=True))
        self.fusion = HrFusion(config, scale)
        self.backbone = nn.Sequential(
            conv3(width + self.fusion.lr_channels, width),
            nn.ReLU(inplace=True),
            *(InvertedResidual(width) for _ in range(BACKBONE_BLOCKS)),
        )
        self.decoder = Decoder(2 * width, self.fusion, corrects=config.preset is Preset.RTSR)

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        """Encode, fuse, decode."""
        shallow = self.shallow(inputs["frame_0"])
        parts = [self.expand(self.main(shallow))]
        if self.fusion.lr_channels:
            parts.append(self.fusion.at_lr(inputs["hr"], like=shallow))
        features = self.backbone(torch.cat(parts, dim=1))
        return self.decoder(torch.cat([features, shallow], dim=1), inputs), state


def frame_features(frame: Frame, preset: Preset) -> Image:
    """Lighting, depth, normal of an LR frame."""
    lighting = network_lighting(frame, preset)
    depth = network_depth(frame.gbuffer[Buffer.DEPTH], preset)
    return torch.cat([lighting, depth, network_normal(frame)], dim=1)


def hr_features(window: Window, config: FuseSRConfig) -> Image:
    """HR buffers that the network sees, aligned; depth as networks take it."""
    gbuffer = hr_frame(window).gbuffer
    parts = [
        network_depth(gbuffer[buffer], config.preset) if buffer is Buffer.DEPTH else gbuffer[buffer]
        for buffer in config.hr_parts
    ]
    height, width = gbuffer.size
    empty = torch.zeros(1, 0, height, width, device=gbuffer.device)
    return aligned(window, torch.cat([empty, *parts], dim=1))


def sample_motion(now: Frame, before: Frame) -> MotionPx:
    """Motion between samples: mv + jitter - jitter_prev, LR pixels."""
    motion = now.gbuffer[Buffer.MOTION]
    shift = [a - b for a, b in zip(now.camera.jitter_px, before.camera.jitter_px, strict=True)]
    return motion + motion.new_tensor(shift).view(1, 2, 1, 1)


def history_inputs(window: Window, preset: Preset) -> dict[str, Tensor]:
    """Past frames, motion to them in pixels and in (-1, 1) screen units, newest first."""
    inputs: dict[str, Tensor] = {}
    frames, current = window.lr, window.current
    motion = torch.zeros_like(current.gbuffer[Buffer.MOTION])
    height, width = current.view.display
    screen = motion.new_tensor([2.0 / width, 2.0 / height]).view(1, 2, 1, 1)
    for age in range(1, HISTORY_FRAMES + 1):
        past = current
        if age < len(frames):
            past = frames[age]
            older = sample_motion(frames[age - 1], past)
            motion = older if age == 1 else compose_motion(motion, older, mode="nearest")[0]
        else:
            motion = torch.zeros_like(motion)
        inputs[f"frame_{age}"] = frame_features(past, preset)
        inputs[f"motion_{age}"] = motion
        inputs[f"motion_ndc_{age}"] = motion * screen
    return inputs


def prepare(config: FuseSRConfig, window: Window) -> Tensors:
    """Inputs of either network."""
    inputs = lighting_inputs(window, config.preset)
    inputs["frame_0"] = frame_features(window.current, config.preset)
    inputs["hr"] = hr_features(window, config)
    if config.history:
        inputs |= history_inputs(window, config.preset)
    return inputs


def compose(config: FuseSRConfig, window: Window, inputs: Tensors, outputs: Tensors) -> Prediction:
    """Radiance from predicted lighting."""
    return compose_lighting(config.preset, window, inputs, outputs["predicted"])


def goal(config: FuseSRConfig, window: Window, reference: Frame) -> Tensors:
    """What the capture's lighting is."""
    return lighting_goal(config.preset, window, reference)


def loss(config: FuseSRConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Weighted terms of `lighting_loss`."""
    return lighting_loss(
        config.loss_weights,
        outputs["predicted"],
        inputs=inputs,
        goal=target,
        preset=config.preset,
    )


LEARNING = Learning(prepare=prepare, reference=REFERENCE_BUFFERS, goal=goal, loss=loss)

CITATION = "Zhong et al., FuseSR, SIGGRAPH Asia 2023"

FUSESR = System(
    name="fusesr",
    summary="H-shaped network over lighting, HR G-buffer and two past frames",
    citation=CITATION,
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
    hr_inputs=(*HR_BUFFERS, Buffer.DEPTH, Buffer.NORMAL, Buffer.ALBEDO),
    hr_optional=HR_OPTIONAL,
    scales=(4, 8),
    history_frames=HISTORY_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=FuseSRConfig,
    variants={v.value: FuseSRConfig(variant=v) for v in (Variant.HEAD, Variant.FIRST_RELEASE)},
    build=FuseSRNetwork,
    predict=neural_predict(prepare, compose),
    learning=LEARNING,
    weights="fusesr-{scale}x.safetensors",
)

FUSESR_FAST = System(
    name="fusesr-fast",
    summary="the light H-shaped network: no history, no motion",
    citation=CITATION,
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH),
    hr_inputs=HR_BUFFERS,
    hr_optional=HR_OPTIONAL,
    scales=(2, 4, 8),
    halo_px=FAST_HALO_PX,
    derivation=derivation,
    config=FuseSRFastConfig,
    build=FuseSRFastNetwork,
    predict=neural_predict(prepare, compose),
    learning=LEARNING,
    weights="fusesr-fast-{scale}x.safetensors",
)

FUSESR_DIRECT = System(
    name="fusesr-direct",
    summary="H-shaped network that predicts radiance without demodulation",
    citation=CITATION,
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
    hr_inputs=(*HR_BUFFERS, Buffer.ALBEDO, Buffer.DEPTH, Buffer.NORMAL),
    scales=(4, 8),
    history_frames=HISTORY_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=FuseSRDirectConfig,
    build=FuseSRNetwork,
    predict=neural_predict(prepare, compose),
    learning=LEARNING,
    weights="fusesr-direct-{scale}x.safetensors",
)

SYSTEMS = (FUSESR, FUSESR_FAST, FUSESR_DIRECT)
