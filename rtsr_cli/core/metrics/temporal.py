"""Errors along motion: what flickers, and what only moves.

All maps are (N, H, W), averaged over the channels. The frame before is fetched along this frame's
backward motion, bilinearly (exactly where motion is whole pixels); the caller masks what the
frame before does not show.
"""

from __future__ import annotations

import torch

from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.shapes import Image, MotionPx, PixelMap


def warped_error_map(image: Image, before: Image, motion_px: MotionPx) -> PixelMap:
    """|I_t(x) - I_{t-1}(x + mv)|: changes of shading count, motion does not.

    Args:
        image: this frame, in the space to compare in.
        before: the frame before.
        motion_px: previous minus current, pixels.
    """
    fetched, _ = backward_warp(before, motion_px)
    return (image - fetched).abs_().mean(1)


def temporal_change_map(
    test: Image, ref: Image, test_before: Image, ref_before: Image, motion_px: MotionPx
) -> PixelMap:
    """|(T_t - R_t)(x) - (T_{t-1} - R_{t-1})(x + mv)|: how the error itself changes along motion.

    0 for a perfect result, and for an error that sticks to its surface: such blur is seen, but it
    does not flicker.
    """
    return warped_error_map(test - ref, test_before - ref_before, motion_px)


def stack_rows(rows: list[Image]) -> Image:
    """Stack one row of every frame, time downwards: 1 x c x t x w of 1 x c x 1 x w each.

    Steady edges draw smooth lines, flicker and jitter draw combs [Bolles et al. 1987].
    """
    return torch.cat(rows, dim=2)
