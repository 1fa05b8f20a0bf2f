"""What the paper and its code surround NSRD's layers with, for the preset `paper`.

Raw lighting, depth as stored; vectors of two steps are added pixel by pixel; the LSTM's state stays
where it is; radiance is replaced by emission where there is any. The warps shift what does not
move: positions are divided by W and H instead of W - 1 and H - 1, so that a vector of zero fetches
up to one pixel to the left or above; motion of the HR output is in LR pixels [NSRD, code].
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import DualMotion
from rtsr_cli.core.imaging.warping import own_index
from rtsr_cli.core.lighting.lighting import keep_lighting, stored_depth
from rtsr_cli.core.lighting.radiance import add_radiance
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.nsrd.config import Mark, NSRDLossWeights, NSRDSurroundings

EMISSIVE = 1e-4
"""Emission from which, in any channel, it is shown instead of the prediction [NSRD, code]."""


def make_published_grid(motion_px: MotionPx) -> Tensor:
    """2 (x + mv) / W - 1 and the same of y, for `grid_sample` with corners aligned."""
    axes = [
        2.0 * (motion_px[:, axis] + own_index(motion_px, axis)) / motion_px.shape[3 - axis] - 1.0
        for axis in (0, 1)
    ]
    return torch.stack(axes, dim=-1)


def _sample_grid(image: Image, grid: Tensor) -> Image:
    return F.grid_sample(image, grid, mode="bilinear", padding_mode="border", align_corners=True)


def warp_frame(frame: Image, motion_px: MotionPx, current: Image) -> Image:
    """A past LR frame where each pixel was; the current one where that is outside."""
    grid = make_published_grid(motion_px)
    outside = (grid.abs() > 1.0).any(dim=-1).unsqueeze(1)
    return torch.where(outside, current, _sample_grid(frame, grid))


def warp_output(output: Color, motion_px: MotionPx) -> Color:
    """The last HR output where each pixel was, borders clamped."""
    return _sample_grid(output, make_published_grid(motion_px))


def show_lighting(frame: Frame, now: Frame) -> Color:
    """LR lighting of a frame as it is."""
    del now
    return frame.gbuffer[Buffer.LIGHTING]


def add_motion(newer: DualMotion, older: DualMotion, mark: Mark) -> tuple[MotionPx, Mask]:
    """Vectors of both steps, added pixel by pixel, and what is marked of the sums."""
    motion, dual = newer.motion_px + older.motion_px, newer.dual_px + older.dual_px
    return motion, mark(DualMotion(motion, dual, newer.known * older.known))


def enlarge_motion(window: FrameWindow, fields: Image) -> tuple[MotionPx, Image, int]:
    """Corners aligned; vectors stay in LR pixels."""
    size = [side * window.scale for side in fields.shape[-2:]]
    large = F.interpolate(fields, size=size, mode="bilinear", align_corners=True)
    return large[:, :2], large, 1


def fetch_output(lighting: Color, inputs: Tensors) -> Color:
    """The last output's lighting where each pixel was."""
    return warp_output(lighting, inputs["motion_hr"])


def show_output(previous: Color, inputs: Tensors) -> Color:
    """It as it is."""
    del inputs
    return previous


def show_emission(window: FrameWindow, image: Color) -> Color:
    """Emission instead of the prediction where there is any; sky enlarged on its own."""
    emission = window.require_hr().gbuffer.buffers.get(Buffer.EMISSION)
    if emission is not None:
        shines = (emission.abs() >= EMISSIVE).any(dim=1, keepdim=True)
        image = torch.where(shines, emission, image)
    return add_radiance(window, image)


def raw_goal(reference: Frame, scale: Tensor) -> dict[str, Tensor]:
    """`lighting`: the capture's, as it is."""
    del scale
    return {"lighting": reference.gbuffer[Buffer.LIGHTING]}


PUBLISHED = NSRDSurroundings(
    show_lighting=show_lighting,
    show_depth=stored_depth,
    decode=keep_lighting,
    corrects_base=False,
    finish=show_emission,
    goal=raw_goal,
    compared="lighting",
    loss=NSRDLossWeights(
        log=0.0, tonemapped=0.0, tonemapped_squared=0.0, smooth=1.0, structure=1.0, temporal=1.0
    ),
    chain_motion=add_motion,
    move_frame=warp_frame,
    enlarge_motion=enlarge_motion,
    fetch_output=fetch_output,
    show_output=show_output,
    moves_state=False,
)
