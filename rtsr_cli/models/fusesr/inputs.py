"""What FuseSR's networks see: LR frames, HR buffers and motion; and what surrounds their layers.

Conventions: LR features are those of the samples as rendered; HR buffers are moved by whole pixels
so that the sample is always pixel (S//2, S//2) of its block. Motion t -> t-1 is in LR pixels
between samples, jitter included. History that is missing is the current frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import torch
from torch import Tensor

from rtsr_cli.core.choices import DemodulationMode, Preset
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.imaging.frame_motion import sample_motion
from rtsr_cli.core.imaging.warping import compose_motion
from rtsr_cli.core.lighting.lighting import (
    MAX_LIGHTING,
    align_image,
    build_lighting_inputs,
    encode_lighting,
    lighting_scale_of,
    network_normal,
)
from rtsr_cli.core.shapes import Color, Image
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.fusesr.config import (
    HISTORY_FRAMES,
    FuseSRConfig,
    FuseSRSurroundings,
)
from rtsr_cli.models.fusesr.published import MAX_RADIANCE, PUBLISHED


def log_lighting(frame: Frame) -> Color:
    """Log lighting of an LR frame with its own k, bounded; 0 where nothing was divided."""
    bounded = frame.gbuffer[Buffer.LIGHTING].clamp(max=MAX_LIGHTING)
    return encode_lighting(bounded, lighting_scale_of(frame)) * frame.gbuffer[Buffer.LIGHTING_MASK]


SURROUNDINGS: Mapping[Preset, FuseSRSurroundings] = {
    Preset.RTSR: FuseSRSurroundings(
        show_lighting=log_lighting,
        max_radiance=MAX_RADIANCE,
        loss=None,
        brdf=DemodulationMode.BRDF,
        warps_depth=True,
    ),
    Preset.PAPER: PUBLISHED,
}
"""What surrounds the layers, by preset."""


def surroundings_of(config: FuseSRConfig) -> FuseSRSurroundings:
    """What surrounds the layers of a config."""
    return SURROUNDINGS[config.preset]


@cache
def derivation(config: FuseSRConfig) -> DerivationConfig:
    """What divides the radiance of a config."""
    mode = config.demodulation
    if mode is DemodulationMode.BRDF:
        mode = surroundings_of(config).brdf
    return DerivationConfig(mode=mode, lut=config.lut)


def frame_features(frame: Frame, surroundings: FuseSRSurroundings) -> Image:
    """Lighting, depth, normal of an LR frame."""
    lighting = surroundings.show_lighting(frame)
    depth = surroundings.show_depth(frame.gbuffer[Buffer.DEPTH])
    return torch.cat([lighting, depth, network_normal(frame)], dim=1)


def hr_features(window: FrameWindow, config: FuseSRConfig) -> Image:
    """HR buffers that the network sees, aligned; depth as networks take it."""
    gbuffer, show_depth = window.require_hr().gbuffer, surroundings_of(config).show_depth
    parts = [
        show_depth(gbuffer[buffer]) if buffer is Buffer.DEPTH else gbuffer[buffer]
        for buffer in config.hr_parts
    ]
    height, width = gbuffer.size
    empty = torch.zeros(1, 0, height, width, device=gbuffer.device)
    return align_image(window, torch.cat([empty, *parts], dim=1))


def history_inputs(window: FrameWindow, surroundings: FuseSRSurroundings) -> dict[str, Tensor]:
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
        inputs[f"frame_{age}"] = frame_features(past, surroundings)
        inputs[f"motion_{age}"] = motion
        inputs[f"motion_ndc_{age}"] = motion * screen
    return inputs


def prepare(config: FuseSRConfig, window: FrameWindow) -> Tensors:
    """Inputs of either network."""
    surroundings = surroundings_of(config)
    apart = derivation(config).has_emission
    inputs = build_lighting_inputs(window, surroundings, config.base, emission_apart=apart)
    inputs["frame_0"] = frame_features(window.current, surroundings)
    inputs["hr"] = hr_features(window, config)
    if config.history:
        inputs |= history_inputs(window, surroundings)
    return inputs
