"""Lighting that is gathered at the target size, frame after frame, along surfaces.

    h(p), c(p)   lighting so far and samples that it is worth, where p's surface was
    d(p) = guided enlargement of e(q) - h(q) over the samples q whose surface was seen before
    h' = h + b d
    c' = a c / (1 + |d|^2 / s^2)
    n(p) = fit(p)^f,   how well the best sample fits p
    e'(p) = (c' h' + n g) / (c' + n),   c(p) = c' + n

g is the guided enlargement of the frame's own lighting e = log(1 + lighting / k). A pixel takes
most from the frames whose samples came nearest to it on its own surface; those of this frame tell
how light has changed since. History of another surface weighs nothing (`warp_along_surfaces`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import add_jitter_change, exposure_ratio
from rtsr_cli.core.imaging.guided_enlargement import upsample_guided_and_fit
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.imaging.surface_history import warp_along_surfaces
from rtsr_cli.core.imaging.surfaces import Surfaces, describe_surfaces, find_moving
from rtsr_cli.core.imaging.warping import upsample_motion
from rtsr_cli.core.lighting.lighting import (
    GUIDES,
    decode_lighting,
    encode_frame,
    encode_lighting,
    enlarge_cubic,
    guide_window,
    lighting_scale_of,
    pick_samples,
    unalign_image,
)
from rtsr_cli.core.lighting.past_lighting import find_divided
from rtsr_cli.core.shapes import Color, MotionPx, Plane
from rtsr_cli.core.system import FrameWindow

LR_BUFFERS = (*GUIDES, Buffer.MOTION)
HR_BUFFERS = GUIDES
LR_OPTIONAL = (Buffer.REACTIVE,)
HR_OPTIONAL = (Buffer.MOTION, Buffer.OBJECT_ID, Buffer.POSITION)
"""What this module reads beside what `lighting` reads."""

SEEN = 1e-3
"""Samples that history has to be worth to be compared with the frame's."""

LEAST_SEEN = 0.05
"""Share of samples around with a history from which a change is known."""

LEAST_WORTH = 1e-6
"""Where nothing is worth anything, the frame's own enlargement stands."""


@dataclass(frozen=True, kw_only=True)
class HistoryWeights:
    """Weights of the equations above.

    Attributes:
        age: a, what history is still worth a frame later.
        change: b, share of the change at the samples that is believed.
        change_spread: s, change of log lighting that halves what history is worth.
        fit_power: f.
    """

    age: float = 0.9
    change: float = 0.65
    change_spread: float = 0.5
    fit_power: float = 4.0


@dataclass(frozen=True, kw_only=True)
class LightingHistory:
    """What one frame leaves to the next, at the target size.

    Attributes:
        lighting: linear, as the frame was exposed.
        worth: samples that it is worth.
        surfaces: that it lies on.
        frame: whose they are; its camera and exposure, no buffers.
    """

    lighting: Color
    worth: Plane
    surfaces: Surfaces
    frame: Frame


@dataclass(frozen=True, kw_only=True)
class GatheredLighting:
    """Lighting of a frame.

    Attributes:
        encoded: e'.
        worth: c.
        history: what goes on to the next frame.
    """

    encoded: Color
    worth: Plane
    history: LightingHistory


def gather_lighting(
    window: FrameWindow, before: LightingHistory | None, weights: HistoryWeights
) -> GatheredLighting:
    """Gather a frame's samples; without history they are enlarged along surfaces.

    Args:
        window: LR and HR frame.
        before: history, None at a reset.
        weights: of the equations.
    """
    hr, scale = window.require_hr(), lighting_scale_of(window.current)
    own = describe_surfaces(hr, find_divided(hr))
    if before is None:
        carried, worth = None, torch.zeros_like(own.kind)
    else:
        carried, worth = carry_history(window, before, own)
    now, fit, change = _enlarge_frame(window, carried, worth)
    fresh = fit.pow(weights.fit_power)
    encoded = now
    if carried is not None:
        spread = change.square().mean(1, keepdim=True) / weights.change_spread**2
        worth = worth * weights.age / (1.0 + spread)
        total = (fresh + worth).clamp(min=LEAST_WORTH)
        encoded = torch.lerp(now, carried + weights.change * change, worth / total)
        encoded = encoded.clamp_(min=0.0)
    worth = worth + fresh
    history = LightingHistory(
        lighting=decode_lighting(encoded, scale),
        worth=worth,
        surfaces=own,
        frame=replace(hr, gbuffer=hr.gbuffer.only(())),
    )
    return GatheredLighting(encoded=encoded, worth=worth, history=history)


def carry_history(
    window: FrameWindow, before: LightingHistory, own: Surfaces
) -> tuple[Color, Plane]:
    """e of the lighting so far where each pixel's surface was, and samples that it is worth.

    Args:
        window: LR and HR frame.
        before: history.
        own: surfaces of the HR frame.
    """
    hr = window.require_hr()
    motion = find_motion(window, before.frame)
    gain = exposure_ratio(hr, before.frame)
    encoded = encode_lighting(before.lighting * gain, lighting_scale_of(window.current))
    carried = warp_along_surfaces(
        torch.cat([encoded, before.worth], dim=1),
        motion,
        own.widen(find_moving(own, motion, before.frame)),
        before.surfaces,
    )
    encoded, worth = carried.values.split_with_sizes([3, 1], dim=1)
    worth = worth * carried.weight
    reactive = window.current.gbuffer.buffers.get(Buffer.REACTIVE)
    if reactive is not None:
        worth = worth * (1.0 - upsample_nearest(reactive.clamp(0.0, 1.0), window.scale))
    return encoded, worth


def find_motion(window: FrameWindow, before: Frame) -> MotionPx:
    """Motion of the HR pixels to those of the HR frame before; that of the nearest LR sample
    where the HR G-buffer has none.
    """
    hr, lr = window.require_hr(), window.current
    own = hr.gbuffer.buffers.get(Buffer.MOTION)
    if own is None:
        jitter_px = lr.camera.jitter_px
        own = upsample_motion(
            lr.gbuffer[Buffer.MOTION], window.scale, mode="nearest", jitter_px=jitter_px
        )
    return add_jitter_change(own, hr, before)


def _enlarge_frame(
    window: FrameWindow, carried: Color | None, worth: Plane
) -> tuple[Color, Plane, Color]:
    """g, fit, and d, 0 where it is not known; enlarged at once, as their weights are one."""
    encoded, mask = encode_frame(window.current), window.current.gbuffer[Buffer.LIGHTING_MASK]
    values = [encoded]
    if carried is not None:
        seen = (pick_samples(window, worth) > SEEN).to(mask) * mask
        change = (encoded - pick_samples(window, carried)) * seen
        values += [change, seen]
    enlarged, fit = upsample_guided_and_fit(
        torch.cat(values, dim=1),
        mask,
        *guide_window(window),
        scale=window.scale,
        fallback=enlarge_cubic(window, encoded),
    )
    enlarged, fit = unalign_image(window, enlarged), unalign_image(window, fit)
    now, change = enlarged[:, :3], torch.zeros_like(enlarged[:, :3])
    if carried is not None:
        seen = enlarged[:, 6:]
        change = torch.where(seen > LEAST_SEEN, enlarged[:, 3:6] / seen, 0.0)
    return now, fit, change
