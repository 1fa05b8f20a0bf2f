"""What is made of a frame alone: its colour, depth and motion at the output's size.

color     3   c / (1 + c), un-jittered
worth     1   samples that a pixel of it is worth
depth     1   D = 1 / z of the nearest sample, sky 0
motion    2   of the nearest sample, widened, output pixels
reactive  1   1 where history is not to be trusted; 0 where no such buffer is there
exposure  1   pre-exposure, n 1 1 1
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from rtsr_cli.core.choices import Preset
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.auxiliary_buffers import enlarge_depth, enlarge_motion
from rtsr_cli.core.imaging.resampling import repeat_samples
from rtsr_cli.core.imaging.sample_splats import (
    encode_samples,
    find_brightest,
    interpolate_samples,
    splat_samples,
)
from rtsr_cli.core.shapes import Color, Image, MotionPx, Plane
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.cgts.config import CgtsConfig, CgtsSurroundings
from rtsr_cli.models.cgts.published import PUBLISHED

SAMPLE_SIGMA_PX = 0.4
"""Spread of a sample, in output pixels."""

INTERPOLATION_A = -0.3
"""Slope of the cubic kernel between samples: softer than Keys', as history sharpens it."""

INTERPOLATED_WORTH = 0.1
"""Samples that what was interpolated is worth."""

LEAST_HISTORY = 0.05
"""Samples that history is worth at least, so that a weight has a logit."""

FASTEST_PX = 8.0
"""Motion beyond which nothing more is told of it."""

SIGNALS = 5
"""Channels of `see_signals`."""


def enlarge_samples(frame: Frame, scale: int) -> tuple[Color, Plane]:
    """Samples where they lie, interpolated between: (sum w c + p c') / (sum w + p)."""
    color, jitter_px = encode_samples(frame), frame.camera.jitter_px
    between = interpolate_samples(
        color, jitter_px, scale, a=INTERPOLATION_A, brightest=find_brightest(color)
    )
    summed, weight = splat_samples(color, jitter_px, scale, sigma_px=SAMPLE_SIGMA_PX)
    worth = weight + INTERPOLATED_WORTH
    return (summed + INTERPOLATED_WORTH * between) / worth, worth


def see_signals(known: Tensors) -> Image:
    """Worth of the frame and of history, history beyond the frame's range, speed, blur.

    Blur is that of fetching between pixels: fx (1 - fx) + fy (1 - fy), f the motion's fraction.
    """
    history, span = known["history"], known["span"]
    low, high = span[:, :3], span[:, 3:]
    beyond = torch.maximum(history - high, low - history).clamp(min=0.0)
    motion = known["motion"]
    speed = motion.abs().amax(1, keepdim=True).clamp(max=FASTEST_PX) / FASTEST_PX
    fraction = motion - motion.floor()
    blur = (fraction * (1.0 - fraction)).sum(1, keepdim=True)
    worth = torch.log1p(known["history_worth"]) / 4.0
    return torch.cat(
        [known["worth"], worth, beyond.amax(1, keepdim=True), speed, 2.0 * blur], dim=1
    )


def start_from_worth(worth: Plane, history_worth: Plane) -> Plane:
    """Logit of worth / (worth + history's): the weight of a running mean of samples."""
    return worth.log() - history_worth.clamp(min=LEAST_HISTORY).log()


SURROUNDINGS: Mapping[Preset, CgtsSurroundings] = {
    Preset.RTSR: CgtsSurroundings(
        enlarge=enlarge_samples, signals=SIGNALS, see=see_signals, start=start_from_worth
    ),
    Preset.PAPER: PUBLISHED,
}
"""What surrounds the layers, by preset."""


def find_motion(window: FrameWindow) -> MotionPx:
    """Motion of the window's frame, output pixels."""
    frame = window.current
    buffers = frame.gbuffer
    jitter_px = frame.camera.jitter_px
    return enlarge_motion(buffers[Buffer.MOTION], buffers[Buffer.DEPTH], window.scale, jitter_px)


def prepare(config: CgtsConfig, window: FrameWindow) -> Tensors:
    """The buffers named above."""
    frame, scale = window.current, window.scale
    buffers, jitter_px = frame.gbuffer, frame.camera.jitter_px
    color, worth = SURROUNDINGS[config.preset].enlarge(frame, scale)
    return {
        "color": color,
        "worth": worth.float(),
        "depth": enlarge_depth(buffers[Buffer.DEPTH], scale, jitter_px),
        "motion": find_motion(window),
        "reactive": _enlarge_reactive(frame, scale, like=worth),
        "exposure": worth.new_full((1, 1, 1, 1), frame.camera.pre_exposure),
    }


def _enlarge_reactive(frame: Frame, scale: int, *, like: Plane) -> Tensor:
    reactive = frame.gbuffer.buffers.get(Buffer.REACTIVE)
    if reactive is None:
        return torch.zeros_like(like)
    return repeat_samples(reactive.clamp(0.0, 1.0), scale, frame.camera.jitter_px)
