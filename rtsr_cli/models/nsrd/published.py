"""The warps of the published code, for the preset `paper`; both shift what does not move.

Positions are divided by W and H instead of W - 1 and H - 1, so that a vector of zero fetches up to
one pixel to the left or above; motion of the HR output is in LR pixels [NSRD, code].
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.imaging.warping import own_index
from rtsr_cli.core.shapes import Color, Image, MotionPx


def published_grid(motion_px: MotionPx) -> Tensor:
    """2 (x + mv) / W - 1 and the same of y, for `grid_sample` with corners aligned."""
    axes = [
        2.0 * (motion_px[:, axis] + own_index(motion_px, axis)) / motion_px.shape[3 - axis] - 1.0
        for axis in (0, 1)
    ]
    return torch.stack(axes, dim=-1)


def _sampled(image: Image, grid: Tensor) -> Image:
    return F.grid_sample(image, grid, mode="bilinear", padding_mode="border", align_corners=True)


def warp_frame(frame: Image, motion_px: MotionPx, current: Image) -> Image:
    """A past LR frame where each pixel was; the current one where that is outside."""
    grid = published_grid(motion_px)
    outside = (grid.abs() > 1.0).any(dim=-1).unsqueeze(1)
    return torch.where(outside, current, _sampled(frame, grid))


def warp_output(output: Color, motion_px: MotionPx) -> Color:
    """The last HR output where each pixel was, borders clamped."""
    return _sampled(output, published_grid(motion_px))
