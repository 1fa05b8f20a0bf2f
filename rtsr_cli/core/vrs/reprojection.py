"""The frame before as a monitor showed it, brought to this frame's pixels."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.imaging.disocclusion import (
    DisocclusionThresholds,
    SurfaceBuffers,
    disocclusion_mask,
)
from rtsr_cli.core.imaging.frame_motion import exposure_ratio, sample_motion
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.shapes import Color, Mask
from rtsr_cli.core.system import FrameWindow

SAME_SURFACE = DisocclusionThresholds(depth_relative=0.1, normal_cosine=0.5)
"""Wider than what is blended with the present may be: a normal map's detail, half a pixel off, is
no other surface, and what would be left out is just what is hard to shade."""


def encode_display(color: Color) -> Color:
    """What a monitor shows of radiance: c / (1 + c), then sRGB, 0..1."""
    return encode_srgb(encode_reinhard(color))


@dataclass(frozen=True, kw_only=True)
class Reprojection:
    """The frame before where each pixel of this one was, at this frame's exposure.

    Attributes:
        moved: the frame before as displayed, whatever it shows there. Whole pixels are fetched: a
            blend of neighbours would take off the contrast that errors are made of. What lies
            outside is the nearest pixel inside; without a frame before, black.
        seen: 1 where it shows the same surface; 0 outside of it, by depth, normals and, where
            there are any, object ids, and everywhere without a frame before.
    """

    moved: Color
    seen: Mask

    @property
    def picture(self) -> Color:
        """What it shows of this frame's surfaces, elsewhere black."""
        return self.moved * self.seen


def reproject(window: FrameWindow) -> Reprojection:
    """Bring the frame before to this one's pixels, once a window."""
    return window.compute_once(_reproject)


def _reproject(window: FrameWindow) -> Reprojection:
    now = window.current
    if len(window.lr) == 1:
        nothing = torch.zeros_like(now.gbuffer[Buffer.NORMAL])
        return Reprojection(moved=nothing, seen=nothing[:, :1])
    before = window.lr[1]
    motion = sample_motion(now, before)
    hidden = disocclusion_mask(
        motion,
        current=_read_surfaces(now),
        previous=_read_surfaces(before),
        thresholds=SAME_SURFACE,
    )
    color = before.gbuffer[Buffer.COLOR] * exposure_ratio(now, before)
    moved, _ = backward_warp(encode_display(color), motion, mode="nearest")
    return Reprojection(moved=moved, seen=1.0 - hidden)


def _read_surfaces(frame: Frame) -> SurfaceBuffers:
    gbuffer = frame.gbuffer
    return SurfaceBuffers(
        depth_m=gbuffer[Buffer.DEPTH],
        normal=gbuffer[Buffer.NORMAL],
        object_id=gbuffer.buffers.get(Buffer.OBJECT_ID),
    )
