"""`fusesr`, `fusesr-fast`, `fusesr-direct`: super-resolution by an H-shaped network.

Zhong et al., "FuseSR: Super Resolution for Real-time Rendering through Efficient Multi-resolution
Fusion", SIGGRAPH Asia 2023. HR material buffers are pixel-unshuffled to LR, where they meet the
features of LR lighting; the result is shuffled back and multiplied by the HR material. The fast
network leaves history out; the direct one predicts radiance without demodulation.

Conventions: LR features are those of the samples as rendered; HR buffers are moved by whole pixels
so that the sample is always pixel (S//2, S//2) of its block. Motion t -> t-1 is in LR pixels
between samples, jitter included. History that is missing is the current frame.

Departs from the publication in the preset `rtsr`: the network sees and predicts log(1 + L/k), k of
the whole frame; depth is 1 / (1 + metres); its output is added to an enlargement of the lighting
along HR surfaces before the last layer; warps are pixel-centred, motion to t-2 is chained in order,
history depth is warped; emission is added and sky enlarged on its own. `paper` keeps the published
choices around the same layers: raw lighting over softplus(F), depth as stored, no such sum.
"""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.choices import DemodulationMode
from rtsr_cli.core.derive import DerivationConfig
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.history import sample_motion
from rtsr_cli.core.imaging.warping import compose_motion
from rtsr_cli.core.lighting import (
    GUIDES,
    HR_BUFFERS,
    HR_OPTIONAL,
    LR_BUFFERS,
    REFERENCE_BUFFERS,
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
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import (
    Learning,
    Prediction,
    System,
    Tensors,
    Window,
    neural_predict,
)
from rtsr_cli.models.fusesr.config import (
    HISTORY_FRAMES,
    FuseSRConfig,
    FuseSRDirectConfig,
    FuseSRFastConfig,
)
from rtsr_cli.models.fusesr.network import FuseSRFastNetwork, FuseSRNetwork

FAST_HALO_PX = 17
"""LR pixels that an output of the fast network reaches to: 14 layers at LR, one HR, and `base`."""


def derivation(config: FuseSRConfig) -> DerivationConfig:
    """What divides the radiance of a config."""
    softened = config.preset is Preset.PAPER and config.demodulation is DemodulationMode.BRDF
    mode = DemodulationMode.SOFTPLUS if softened else config.demodulation
    return DerivationConfig(mode=mode, lut=config.lut)


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
    apart = derivation(config).has_emission
    inputs = lighting_inputs(window, config.preset, config.base, emission_apart=apart)
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
    variants={v.value: FuseSRConfig(variant=v) for v in FuseSRConfig.variants},
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
    hr_optional=(*HR_OPTIONAL, *GUIDES),
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
