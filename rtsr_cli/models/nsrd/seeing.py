"""What NSRD's network sees: the current frame, two past ones moved to it, and where to look back.

Conventions: motion is in LR pixels between samples, jitter included; that of the last output is in
HR pixels between the grids that `alignment` moved. A mask of 1 is unreliable.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.history import DualMotion, brightening, dual_motion_between
from rtsr_cli.core.imaging.alignment import block_shift, shifted_jitter
from rtsr_cli.core.imaging.splatting import UNRELIABLE_PX, unreliable_mask
from rtsr_cli.core.imaging.warping import (
    backward_warp,
    compose_motion,
    inside_frame,
    upsample_motion,
)
from rtsr_cli.core.lighting import (
    MAX_LIGHTING,
    Preset,
    encode_lighting,
    lighting_inputs,
    network_depth,
    network_normal,
    scale_of,
)
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx
from rtsr_cli.core.system import Tensors, Window
from rtsr_cli.models.nsrd.config import HISTORY_FRAMES, NSRDConfig
from rtsr_cli.models.nsrd.published import warp_frame

ALL_KNOWN = 0.999
"""Share of a bilinear fetch's weight from which every vector that takes part counts as known."""


def seen_lighting(frame: Frame, now: Frame, preset: Preset) -> Color:
    """LR lighting of a frame, brought to the current one's exposure and expressed with its k."""
    lighting = frame.gbuffer[Buffer.LIGHTING]
    if preset is Preset.PAPER:
        return lighting
    exposed = (lighting * brightening(now, frame)).clamp(max=MAX_LIGHTING)
    return encode_lighting(exposed, scale_of(now)) * frame.gbuffer[Buffer.LIGHTING_MASK]


def frame_features(frame: Frame, now: Frame, preset: Preset) -> Image:
    """Lighting, normal, depth of an LR frame."""
    lighting = seen_lighting(frame, now, preset)
    depth = network_depth(frame.gbuffer[Buffer.DEPTH], preset)
    return torch.cat([lighting, network_normal(frame), depth], dim=1)


def outside_mask(motion_px: MotionPx) -> Mask:
    """1 where a position lies outside of the frame."""
    return 1.0 - inside_frame(motion_px)


def unreliable_frame(dual: DualMotion, config: NSRDConfig) -> Mask:
    """Where the frame before must not be trusted; without dual vectors, what was outside of it."""
    return dual.unreliable if config.dual_vectors else outside_mask(dual.motion_px)


def chained(config: NSRDConfig, newer: DualMotion, older: DualMotion) -> tuple[MotionPx, Mask]:
    """Motion over two frames and its mask: a surface that either step loses is lost.

    `paper` adds the vectors of both steps pixel by pixel [NSRD, code].
    """
    if config.preset is Preset.PAPER:
        motion, dual = newer.motion_px + older.motion_px, newer.dual_px + older.dual_px
        known = newer.known * older.known
        return motion, unreliable_frame(DualMotion(motion, dual, known), config)
    motion, _ = compose_motion(newer.motion_px, older.motion_px, mode="nearest")
    lost, _ = backward_warp(unreliable_frame(older, config), newer.motion_px, mode="nearest")
    lost = torch.maximum(lost, unreliable_frame(newer, config))
    return motion, torch.maximum(lost, outside_mask(motion))


def moved_frame(config: NSRDConfig, frame: Image, motion_px: MotionPx, current: Image) -> Image:
    """A past frame's features where each pixel was; the current ones where that is outside."""
    if config.preset is Preset.PAPER:
        return warp_frame(frame, motion_px, current)
    moved, inside = backward_warp(frame, motion_px)
    return torch.where(inside > 0, moved, current)


def output_motion(config: NSRDConfig, window: Window, dual: DualMotion) -> tuple[MotionPx, Mask]:
    """Motion of the last HR output's pixels, and where it is unreliable.

    mv_HR = S up(mv) + shift(now) - shift(before);  1 where |S up(DMV) - S up(TMV)| >= 0.1 S

    In `paper` up() aligns corners, and vectors and threshold stay in LR pixels [NSRD, code].
    """
    now, before = window.lr[:2]
    scale = window.scale
    fields = torch.cat([now.gbuffer[Buffer.MOTION], dual.dual_px - dual.motion_px, dual.known], 1)
    if config.preset is Preset.PAPER:
        size = [side * scale for side in fields.shape[-2:]]
        large = F.interpolate(fields, size=size, mode="bilinear", align_corners=True)
        motion, limit = large[:, :2], 1
    else:
        jitter = shifted_jitter(now.camera.jitter_px, scale)
        large = upsample_motion(fields, scale, jitter_px=jitter)
        shifts = [block_shift(f.camera.jitter_px, scale) for f in (now, before)]
        shift = [a - b for a, b in zip(*shifts, strict=True)]
        motion, limit = large[:, :2] + large.new_tensor(shift).view(1, 2, 1, 1), scale
    unreliable = outside_mask(motion)
    if config.dual_vectors:
        known = (large[:, 4:] > ALL_KNOWN * limit).to(large.dtype)
        none = torch.zeros_like(motion)
        differs = unreliable_mask(none, large[:, 2:4], known, threshold_px=UNRELIABLE_PX * limit)
        unreliable = torch.maximum(unreliable, differs)
    return motion, unreliable


def history_inputs(config: NSRDConfig, window: Window, current: Image) -> dict[str, Tensor]:
    """Past frames with their masks, newest first; motion and trust of the last output.

    What is missing at the start is the current frame with a mask of 1.
    """
    frames, now, scale = window.lr, window.current, window.scale
    nothing = torch.zeros_like(now.gbuffer[Buffer.MOTION])
    untrusted = torch.ones_like(nothing[:, :1])
    inputs = {f"past_{age}": torch.cat([current, untrusted], 1) for age in (1, HISTORY_FRAMES)}
    inputs["motion_1"] = nothing
    inputs["brightening"] = nothing.new_ones(1, 1, 1, 1)
    large = nothing.repeat_interleave(scale, 2).repeat_interleave(scale, 3)
    inputs["motion_hr"], inputs["unreliable_hr"] = large, torch.ones_like(large[:, :1])
    if len(frames) == 1:
        return inputs
    newer = dual_motion_between(now, frames[1])
    steps = [(newer.motion_px, unreliable_frame(newer, config))]
    if len(frames) > HISTORY_FRAMES:
        older = dual_motion_between(frames[1], frames[2])
        steps.append(chained(config, newer, older))
    for age, (motion, unreliable) in enumerate(steps, start=1):
        past = frame_features(frames[age], now, config.preset)
        moved = moved_frame(config, past, motion, current)
        inputs[f"past_{age}"] = torch.cat([moved, unreliable], dim=1)
    inputs["motion_1"] = newer.motion_px
    inputs["brightening"] = inputs["brightening"] * brightening(now, frames[1])
    inputs["motion_hr"], inputs["unreliable_hr"] = output_motion(config, window, newer)
    return inputs


def prepare(config: NSRDConfig, window: Window) -> Tensors:
    """Inputs of the network."""
    now = window.current
    current = frame_features(now, now, config.preset)
    apart = config.derivation.has_emission
    inputs = lighting_inputs(window, config.preset, config.base, emission_apart=apart)
    return inputs | {"frame_0": current} | history_inputs(config, window, current)
