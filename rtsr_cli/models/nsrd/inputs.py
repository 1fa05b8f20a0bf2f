"""What NSRD's network sees, and what surrounds its layers.

It sees the current frame, two past ones moved to it, and where to look back.

Conventions: motion is in LR pixels between samples, jitter included; that of the last output is in
HR pixels between the grids that `alignment` moved. A mask of 1 is unreliable.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from rtsr_cli.core.choices import Preset
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.alignment import block_shift, shift_jitter
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.imaging.frame_motion import DualMotion, exposure_ratio, find_dual_motion
from rtsr_cli.core.imaging.splatting import UNRELIABLE_PX, unreliable_mask
from rtsr_cli.core.imaging.warping import (
    backward_warp,
    compose_motion,
    inside_frame,
    upsample_motion,
)
from rtsr_cli.core.lighting.lighting import (
    MAX_LIGHTING,
    build_lighting_inputs,
    encode_lighting,
    lighting_scale_of,
    network_normal,
)
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.nsrd.config import HISTORY_FRAMES, Mark, NSRDConfig, NSRDSurroundings
from rtsr_cli.models.nsrd.published import PUBLISHED

ALL_KNOWN = 0.999
"""Share of a bilinear fetch's weight from which every vector that takes part counts as known."""

MAX_RADIANCE = 10.0
"""Bound of the capture's radiance in the loss' term of that name [FuseSR, code]."""


def derivation(config: NSRDConfig) -> DerivationConfig:
    """What divides the radiance of a config."""
    return config.derivation


def show_lighting(frame: Frame, now: Frame) -> Color:
    """Log lighting of an LR frame, at the current one's exposure and with its k, bounded."""
    exposed = frame.gbuffer[Buffer.LIGHTING] * exposure_ratio(now, frame)
    encoded = encode_lighting(exposed.clamp(max=MAX_LIGHTING), lighting_scale_of(now))
    return encoded * frame.gbuffer[Buffer.LIGHTING_MASK]


def outside_mask(motion_px: MotionPx) -> Mask:
    """1 where a position lies outside of the frame."""
    return 1.0 - inside_frame(motion_px)


def choose_mark(config: NSRDConfig) -> Mark:
    """What tells where the frame before must not be trusted: dual vectors, or what was outside."""
    if config.dual_vectors:
        return lambda dual: dual.unreliable
    return lambda dual: outside_mask(dual.motion_px)


def chain_motion(newer: DualMotion, older: DualMotion, mark: Mark) -> tuple[MotionPx, Mask]:
    """Motion over two frames and its mask: a surface that either step loses is lost."""
    motion, _ = compose_motion(newer.motion_px, older.motion_px, mode="nearest")
    lost, _ = backward_warp(mark(older), newer.motion_px, mode="nearest")
    lost = torch.maximum(lost, mark(newer))
    return motion, torch.maximum(lost, outside_mask(motion))


def move_frame(frame: Image, motion_px: MotionPx, current: Image) -> Image:
    """A past frame's features where each pixel was; the current ones where that is outside."""
    moved, inside = backward_warp(frame, motion_px)
    return torch.where(inside > 0, moved, current)


def enlarge_motion(window: FrameWindow, fields: Image) -> tuple[MotionPx, Image, int]:
    """mv_HR = S up(mv) + shift(now) - shift(before), of the grids that `alignment` moved."""
    now, before = window.lr[:2]
    scale = window.scale
    jitter = shift_jitter(now.camera.jitter_px, scale)
    large = upsample_motion(fields, scale, jitter_px=jitter)
    shifts = [block_shift(f.camera.jitter_px, scale) for f in (now, before)]
    shift = [a - b for a, b in zip(*shifts, strict=True)]
    return large[:, :2] + large.new_tensor(shift).view(1, 2, 1, 1), large, scale


def fetch_output(lighting: Color, inputs: Tensors) -> Color:
    """The last output where each pixel was, as this frame expresses lighting."""
    moved, _ = backward_warp(lighting, inputs["motion_hr"])
    exposed = (moved * inputs["brightening"]).clamp(max=MAX_LIGHTING)
    return encode_lighting(exposed, inputs["lighting_scale"])


def show_output(previous: Color, inputs: Tensors) -> Color:
    """Its difference from `base`, where it is reliable."""
    return (previous - inputs["base"]) * (1.0 - inputs["unreliable_hr"])


SURROUNDINGS: Mapping[Preset, NSRDSurroundings] = {
    Preset.RTSR: NSRDSurroundings(
        show_lighting=show_lighting,
        max_radiance=MAX_RADIANCE,
        compared="encoded",
        loss=None,
        chain_motion=chain_motion,
        move_frame=move_frame,
        enlarge_motion=enlarge_motion,
        fetch_output=fetch_output,
        show_output=show_output,
        moves_state=True,
    ),
    Preset.PAPER: PUBLISHED,
}
"""What surrounds the layers, by preset."""


def surroundings_of(config: NSRDConfig) -> NSRDSurroundings:
    """What surrounds the layers of a config."""
    return SURROUNDINGS[config.preset]


def frame_features(frame: Frame, now: Frame, surroundings: NSRDSurroundings) -> Image:
    """Lighting, normal, depth of an LR frame."""
    lighting = surroundings.show_lighting(frame, now)
    depth = surroundings.show_depth(frame.gbuffer[Buffer.DEPTH])
    return torch.cat([lighting, network_normal(frame), depth], dim=1)


def output_motion(
    config: NSRDConfig, window: FrameWindow, dual: DualMotion
) -> tuple[MotionPx, Mask]:
    """Motion of the last HR output's pixels, and where it is unreliable.

    1 where |S up(DMV) - S up(TMV)| >= 0.1 S; in `paper` vectors and threshold are in LR pixels.
    """
    motion = window.current.gbuffer[Buffer.MOTION]
    fields = torch.cat([motion, dual.dual_px - dual.motion_px, dual.known], 1)
    motion, large, unit = surroundings_of(config).enlarge_motion(window, fields)
    unreliable = outside_mask(motion)
    if config.dual_vectors:
        known = (large[:, 4:] > ALL_KNOWN * unit).to(large.dtype)
        none = torch.zeros_like(motion)
        differs = unreliable_mask(none, large[:, 2:4], known, threshold_px=UNRELIABLE_PX * unit)
        unreliable = torch.maximum(unreliable, differs)
    return motion, unreliable


def history_inputs(config: NSRDConfig, window: FrameWindow, current: Image) -> dict[str, Tensor]:
    """Past frames with their masks, newest first; motion and trust of the last output.

    What is missing at the start is the current frame with a mask of 1.
    """
    frames, now, scale = window.lr, window.current, window.scale
    surroundings, mark = surroundings_of(config), choose_mark(config)
    nothing = torch.zeros_like(now.gbuffer[Buffer.MOTION])
    untrusted = torch.ones_like(nothing[:, :1])
    inputs = {f"past_{age}": torch.cat([current, untrusted], 1) for age in (1, HISTORY_FRAMES)}
    inputs["motion_1"] = nothing
    inputs["brightening"] = nothing.new_ones(1, 1, 1, 1)
    large = nothing.repeat_interleave(scale, 2).repeat_interleave(scale, 3)
    inputs["motion_hr"], inputs["unreliable_hr"] = large, torch.ones_like(large[:, :1])
    if len(frames) == 1:
        return inputs
    newer = find_dual_motion(now, frames[1])
    steps = [(newer.motion_px, mark(newer))]
    if len(frames) > HISTORY_FRAMES:
        older = find_dual_motion(frames[1], frames[2])
        steps.append(surroundings.chain_motion(newer, older, mark))
    for age, (motion, unreliable) in enumerate(steps, start=1):
        past = frame_features(frames[age], now, surroundings)
        moved = surroundings.move_frame(past, motion, current)
        inputs[f"past_{age}"] = torch.cat([moved, unreliable], dim=1)
    inputs["motion_1"] = newer.motion_px
    inputs["brightening"] = inputs["brightening"] * exposure_ratio(now, frames[1])
    inputs["motion_hr"], inputs["unreliable_hr"] = output_motion(config, window, newer)
    return inputs


def prepare(config: NSRDConfig, window: FrameWindow) -> Tensors:
    """Inputs of the network."""
    surroundings, now = surroundings_of(config), window.current
    current = frame_features(now, now, surroundings)
    apart = config.derivation.has_emission
    inputs = build_lighting_inputs(window, surroundings, config.base, emission_apart=apart)
    return inputs | {"frame_0": current} | history_inputs(config, window, current)
