"""Past frames as the current one sees them: motion between samples, dual motion, brightness.

A sample of frame t lies at pixel + jitter(t). Motion vectors are those of surfaces, without
jitter; between pixels of two frames, and so between their tensors, jitter joins in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.disocclusion import bound_depth
from rtsr_cli.core.imaging.splatting import (
    dual_motion,
    forward_motion_by_splat,
    unreliable_mask,
)
from rtsr_cli.core.imaging.warping import compose_motion, fetch_nearest
from rtsr_cli.core.shapes import Image, Mask, MotionPx

IN_FRONT = 0.8
"""Share of a surface's depth below which what was seen in its place lay in front of it."""


def add_jitter_change(vectors_px: Image, now: Frame, then: Frame) -> Image:
    """Vectors from surface points of `now` to those of `then` -> from sample to sample.

    v + jitter(now) - jitter(then), pixels
    """
    shift = [a - b for a, b in zip(now.camera.jitter_px, then.camera.jitter_px, strict=True)]
    return vectors_px + vectors_px.new_tensor(shift).view(1, 2, 1, 1)


def sample_motion(now: Frame, before: Frame) -> MotionPx:
    """Motion between samples: mv + jitter - jitter_prev, pixels."""
    return add_jitter_change(now.gbuffer[Buffer.MOTION], now, before)


def chain_motion(frames: Sequence[Frame]) -> MotionPx:
    """Motion between the samples of the first frame and those of the last, frame after frame.

        m(x) = m_t(x) + m_t-1(x + m_t(x)) + ...

    Args:
        frames: successive ones, newest first, two or more; all but the last hold motion.
    """
    motion = sample_motion(frames[0], frames[1])
    for now, before in pairwise(frames[1:]):
        motion, _ = compose_motion(motion, sample_motion(now, before))
    return motion


def exposure_ratio(now: Frame, before: Frame) -> float:
    """What radiance of the frame before is to be multiplied by: ratio of the pre-exposures."""
    return now.camera.pre_exposure / before.camera.pre_exposure


@dataclass(frozen=True)
class DualMotion:
    """Motion of a surface, and of what its old position showed; samples, pixels.

    Attributes:
        motion_px: TMV.
        dual_px: DMV; TMV where it is not known.
        known: 1 where it is.
    """

    motion_px: MotionPx
    dual_px: MotionPx
    known: Mask

    @property
    def unreliable(self) -> Mask:
        """1 where the frame before shows another surface, or none at all."""
        return unreliable_mask(self.motion_px, self.dual_px, self.known)


def find_dual_motion(now: Frame, before: Frame) -> DualMotion:
    """Dual motion by the forward vectors of the frame before, by a splat where it has none.

    A splat is of what this frame shows: a surface that left the frame, or is itself hidden now, has
    no vector. Where it lay in front it is told by its depth, and taken to move on as it came.
    """
    motion = sample_motion(now, before)
    if Buffer.FORWARD in before.gbuffer:
        forward = add_jitter_change(before.gbuffer[Buffer.FORWARD], before, now)
    else:
        depth = bound_depth(now.gbuffer[Buffer.DEPTH])
        forward, landed = forward_motion_by_splat(motion, depth)
        dual, known = dual_motion(motion, forward, known_prev_mask=landed)
        seen = fetch_nearest(bound_depth(before.gbuffer[Buffer.DEPTH]), motion)
        came = add_jitter_change(fetch_nearest(before.gbuffer[Buffer.MOTION], motion), now, before)
        return DualMotion(motion, torch.where(seen < IN_FRONT * depth, came, dual), known)
    return DualMotion(motion, *dual_motion(motion, forward))
