"""What the networks see: of the frame alone, and of the history that is carried to it.

color     3   c / (1 + c), un-jittered
worth     1   samples that a pixel of it is worth
depth     1   D = 1 / z of the nearest sample, sky 0
motion    2   of the nearest surface around, output pixels
reactive  1   1 where history is not to be trusted; 0 where no such buffer is there
exposure  1   pre-exposure, n 1 1 1
around    6   mean and deviation of the samples around, YCoCg; not in the preset `paper`
samples   3   c / (1 + c), of LR's size; not in `paper`
reach    36   of the kernel around every output pixel, n 36 1 1; not in `paper`

Colours are c / (1 + c), all else is of the output's size, history moves along (x, y) + motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.choices import Preset
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.auxiliary_buffers import (
    enlarge_depth,
    enlarge_front_motion,
    measure_depth_difference,
)
from rtsr_cli.core.imaging.color import relight_reinhard
from rtsr_cli.core.imaging.color_neighbourhood import (
    clip_to_neighbourhood,
    from_ycocg,
    measure_neighbourhood,
    to_ycocg,
)
from rtsr_cli.core.imaging.predicted_kernel import measure_reach
from rtsr_cli.core.imaging.resampling import repeat_samples
from rtsr_cli.core.imaging.sample_splats import (
    encode_samples,
    find_brightest,
    interpolate_samples,
    splat_samples,
)
from rtsr_cli.core.imaging.warping import backward_warp, fetch_nearest
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx, Plane
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.cgts.config import CLASSES, CgtsConfig, CgtsSurroundings
from rtsr_cli.models.cgts.published import PUBLISHED

SAMPLE_SIGMA_PX = 0.4
"""Spread of a sample, in output pixels."""

INTERPOLATION_A = -0.3
"""Slope of the cubic kernel between samples: softer than Keys', as history sharpens it."""

INTERPOLATED_WORTH = 0.1
"""Samples that what was interpolated is worth."""

LEAST_HISTORY = 0.05
"""Samples that history is worth at least, so that a weight has a logit."""

STILL_PX = 0.25
"""Motion at which 1 - 1/e of what is to be clipped is."""

CLIPPED_DEVIATIONS = 1.0
"""Half width of the box that history is held in."""

LEAST_FILTERED = 0.5
"""m: share of the frame that is filtered at least where it moves."""

FASTEST_PX = 8.0
"""Motion beyond which nothing more is told of it."""

CERTAIN = 4.0
"""Logit of visibility ghosting where nothing is known of the frame before."""

SIGNALS = 9
"""Channels of `see_signals`."""


SHOWN = 5
"""Channels of `show_history`."""


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
    """Worth of the frame and of history, history beyond the frame's range, speed, blur, and more.

    Blur is that of fetching between pixels: fx (1 - fx) + fy (1 - fy), f the motion's fraction.
    What follows is contrast: how far clipping moves history, the deviation of the samples around,
    and how wide the ranges of colours are, the frame's and the carried one.
    """
    history, span = known["history"], known["span"]
    low, high = span[:, :3], span[:, 3:]
    beyond = torch.maximum(history - high, low - history).clamp(min=0.0)
    motion = known["motion"]
    speed = motion.abs().amax(1, keepdim=True).clamp(max=FASTEST_PX) / FASTEST_PX
    fraction = motion - motion.floor()
    blur = (fraction * (1.0 - fraction)).sum(1, keepdim=True)
    worth = torch.log1p(known["history_worth"]) / 4.0
    moved = (known["clipped"] - history).abs()
    seen = [
        known["worth"],
        worth,
        beyond.amax(1, keepdim=True),
        speed,
        2.0 * blur,
        moved.amax(1, keepdim=True),
        known["around"][:, 3:4],
        _measure_width(span),
        _measure_width(known["history_span"]),
    ]
    return torch.cat(seen, dim=1)


def show_history(known: Tensors) -> Image:
    """How far history is from the frame, a colour; worth of the frame and of history.

    What neighbours have in common of that tells a change from aliasing, whose signs differ.
    """
    worth = torch.log1p(known["history_worth"]) / 4.0
    return torch.cat([known["history"] - known["color"], known["worth"], worth], dim=1)


def _measure_width(span: Image) -> Plane:
    return (span[:, 3:] - span[:, :3]).amax(1, keepdim=True)


def start_from_worth(worth: Plane, history_worth: Plane) -> Plane:
    """Logit of worth / (worth + history's): the weight of a running mean of samples."""
    return worth.log() - history_worth.clamp(min=LEAST_HISTORY).log()


SURROUNDINGS: Mapping[Preset, CgtsSurroundings] = {
    Preset.RTSR: CgtsSurroundings(
        enlarge=enlarge_samples,
        move=enlarge_front_motion,
        signals=SIGNALS,
        see=see_signals,
        start=start_from_worth,
        shown=SHOWN,
        show=show_history,
        guides=True,
    ),
    Preset.PAPER: PUBLISHED,
}
"""What surrounds the layers, by preset."""


def find_motion(config: CgtsConfig, window: FrameWindow) -> MotionPx:
    """Motion of the window's frame, output pixels."""
    move = SURROUNDINGS[config.preset].move
    frame = window.current
    buffers = frame.gbuffer
    jitter_px = frame.camera.jitter_px
    return move(buffers[Buffer.MOTION], buffers[Buffer.DEPTH], window.scale, jitter_px)


def prepare(config: CgtsConfig, window: FrameWindow) -> Tensors:
    """The buffers named above."""
    frame, scale = window.current, window.scale
    buffers, jitter_px = frame.gbuffer, frame.camera.jitter_px
    surroundings = SURROUNDINGS[config.preset]
    color, worth = surroundings.enlarge(frame, scale)
    inputs = {
        "color": color,
        "worth": worth.float(),
        "depth": enlarge_depth(buffers[Buffer.DEPTH], scale, jitter_px),
        "motion": find_motion(config, window),
        "reactive": _enlarge_reactive(frame, scale, like=worth),
        "exposure": worth.new_full((1, 1, 1, 1), frame.camera.pre_exposure),
    }
    if surroundings.guides:
        samples = encode_samples(frame)
        inputs["around"] = measure_neighbourhood(to_ycocg(samples), scale, jitter_px)
        inputs["samples"] = samples
        inputs["reach"] = measure_reach(scale, jitter_px, samples)
    return inputs


def clip_history(history: Color, around: Image) -> Color:
    """History held within the colours around, c / (1 + c)."""
    clipped = clip_to_neighbourhood(to_ycocg(history), around, CLIPPED_DEVIATIONS)
    return from_ycocg(clipped).clamp_(0.0, 1.0)


def limit_clipping(share: Plane, motion: MotionPx) -> Plane:
    """Share of clipping where history moves: s (1 - exp(-|v| / 0.25 px)).

    A box around a few samples that alias is a poor judge of a history that stood still.
    """
    speed = motion.square().sum(1, keepdim=True).sqrt()
    return share * (1.0 - torch.exp(-speed / STILL_PX))


def filter_moving(share: Plane, motion: MotionPx) -> Plane:
    """Share of filtering, more where the surface moves: s + (1 - s) m (1 - exp(-|v| / 0.25 px)).

    Rows that hold a sample differ from those between, which shows as teeth along upright edges.
    """
    return share + (1.0 - share) * limit_clipping(torch.full_like(share, LEAST_FILTERED), motion)


def _enlarge_reactive(frame: Frame, scale: int, *, like: Plane) -> Tensor:
    reactive = frame.gbuffer.buffers.get(Buffer.REACTIVE)
    if reactive is None:
        return torch.zeros_like(like)
    return repeat_samples(reactive.clamp(0.0, 1.0), scale, frame.camera.jitter_px)


@dataclass(frozen=True, kw_only=True)
class CgtsState:
    """What one frame leaves to the next.

    Attributes:
        color: output, c / (1 + c).
        counter: frames that it holds.
        worth: samples that it is worth.
        span: range of colours, smallest then largest, n 6 h w.
        depth: D.
        logits: n 6 h w, before softmax.
        exposure: n 1 1 1.
        linked: frames that gradients reach back through.
    """

    color: Color
    counter: Plane
    worth: Plane
    span: Image
    depth: Plane
    logits: Image
    exposure: Tensor
    linked: int

    def detached(self) -> CgtsState:
        """Return the same state, where gradients end."""
        kept = {name: value.detach() for name, value in vars(self).items() if name != "linked"}
        return CgtsState(**kept, linked=0)


@dataclass(frozen=True, kw_only=True)
class CarriedHistory:
    """The state where each pixel was.

    Attributes:
        color, counter, worth, span, logits: of the state, at x + V(x).
        difference: of depth.
        inside: 1 where there is any.
    """

    color: Color
    counter: Plane
    worth: Plane
    span: Image
    logits: Image
    difference: Plane
    inside: Mask


def carry_history(before: CgtsState | None, inputs: Tensors, own: Image) -> CarriedHistory:
    """Fetch the state where each pixel was; colours by a sharp kernel, logits bilinearly.

    Counter, worth, range and depth are those of the nearest pixel. Where there is no history, the
    frame stands for it, and its logits say so.

    Args:
        before: the state; None at a reset.
        inputs: of the frame.
        own: range of its colours.
    """
    color, depth, motion = inputs["color"], inputs["depth"], inputs["motion"]
    if before is None:
        nothing = torch.zeros_like(depth)
        return CarriedHistory(
            color=color,
            counter=nothing,
            worth=nothing,
            span=own,
            logits=_doubt_history(depth),
            difference=nothing + 1.0,
            inside=nothing,
        )
    gain = inputs["exposure"] / before.exposure
    fetched, inside = backward_warp(before.color.to(color.dtype), motion, mode="sharp")
    fetched = fetched.clamp(0.0, 1.0)
    logits, _ = backward_warp(before.logits, motion)
    planes = torch.cat([before.counter, before.worth, before.depth], dim=1)
    nearest = fetch_nearest(planes, motion)
    span = fetch_nearest(before.span.to(color.dtype), motion)
    if bool((gain != 1.0).any()):
        fetched, span = relight_reinhard(fetched, gain), relight_reinhard(span, gain)
    shown = inside > 0
    return CarriedHistory(
        color=torch.where(shown, fetched, color),
        counter=nearest[:, :1] * inside,
        worth=nearest[:, 1:2] * inside,
        span=torch.where(shown, span, own),
        logits=torch.where(shown, logits, _doubt_history(depth)),
        difference=measure_depth_difference(depth, nearest[:, 2:], inside),
        inside=inside,
    )


def _doubt_history(like: Plane) -> Image:
    """Logits that say visibility ghosting, and nothing of aliasing."""
    return torch.cat(
        [
            like.new_full(like.shape, CERTAIN),
            like.new_zeros(like.shape).expand(-1, 2 * CLASSES - 1, -1, -1),
        ],
        dim=1,
    )
