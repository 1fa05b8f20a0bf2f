"""What tells a pixel's history from its present: depth, motion, colour range, counter.

The auxiliary buffers of classifier guided temporal supersampling [Guo et al. 2022, supplement,
section 3], all at the output's size. D is reversed depth, 1 / z, sky 0. What is carried from frame
to frame is fetched at x + V(x); colours and ranges are tone-mapped, c / (1 + c).

Where the text is silent: the range of a frame of one sample a pixel is that of 3 x 3 output pixels,
and what it was before fades by `RANGE_RATE` a frame.
"""

from __future__ import annotations

import math

import torch
from torch.nn import functional

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.resampling import repeat_samples
from rtsr_cli.core.imaging.sample_ranges import reverse_depth
from rtsr_cli.core.imaging.warping import dilate_motion
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx, Plane

RANGE_RATE = 1.0 / 8.0
"""Share of a frame's own range in the one that is carried on."""

FRONT_REACH_PX = 0.75
"""LR pixels, along an axis, within which samples count for the motion of an output pixel.

A square, not a circle: along an upright silhouette rows do not differ.
"""


def enlarge_depth(depth_m: Plane, scale: int, jitter_px: Jitter) -> Plane:
    """D of the nearest sample of every output pixel, 1/m."""
    return repeat_samples(reverse_depth(depth_m), scale, jitter_px)


def enlarge_motion(motion_px: MotionPx, depth_m: Plane, scale: int, jitter_px: Jitter) -> MotionPx:
    """Motion of the nearest sample of every output pixel, silhouettes widened by one LR pixel.

    Args:
        motion_px: in LR pixels.
        depth_m: view depth of the same samples.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.

    Returns:
        Motion in output pixels.
    """
    return repeat_samples(dilate_motion(motion_px, depth_m), scale, jitter_px) * scale


def enlarge_front_motion(
    motion_px: MotionPx, depth_m: Plane, scale: int, jitter_px: Jitter
) -> MotionPx:
    """Motion of the nearest surface among the samples around each output pixel.

        argmin_q z(q),   |u - q| < 3/4 along both axes,   u = (X + 0.5) / S - 0.5 - jitter

    One to four samples count, of two as near the closer one. Silhouettes are widened to where they
    may lie between samples, and no farther: `enlarge_motion` gives a foreground's motion to two
    output pixels more beside it, at S = 2.

    Args:
        motion_px: in LR pixels.
        depth_m: view depth of the same samples.
        scale: output pixels per LR pixel.
        jitter_px: of the samples.

    Returns:
        Motion in output pixels.
    """
    height, width = depth_m.shape[2:]
    motion, depth = (
        functional.pad(t, (2, 2, 2, 2), mode="replicate") for t in (motion_px, depth_m)
    )
    enlarged = motion_px.new_empty((motion_px.shape[0], 2, height * scale, width * scale))
    across, down = ([(p + 0.5) / scale - 0.5 - j for p in range(scale)] for j in jitter_px)
    for row, v in enumerate(down):
        for column, u in enumerate(across):
            chosen: tuple[MotionPx, Plane] | None = None
            for y, x in _list_around(u, v):
                top, left = y + 2, x + 2
                there = (..., slice(top, top + height), slice(left, left + width))
                if chosen is None:
                    chosen = motion[there], depth[there]
                else:
                    nearer = depth[there] < chosen[1]
                    chosen = (
                        torch.where(nearer, motion[there], chosen[0]),
                        torch.where(nearer, depth[there], chosen[1]),
                    )
            assert chosen is not None
            enlarged[..., row::scale, column::scale] = chosen[0]
    return enlarged * scale


def _list_around(u: float, v: float) -> list[tuple[int, int]]:
    """Rows and columns of the samples that count at (u, v), the nearest first."""
    found = []
    for y in (math.floor(v), math.floor(v) + 1):
        for x in (math.floor(u), math.floor(u) + 1):
            if max(abs(y - v), abs(x - u)) < FRONT_REACH_PX:
                found.append(((y - v) ** 2 + (x - u) ** 2, y, x))
    return [(y, x) for _, y, x in sorted(found)]


def measure_depth_difference(nearness: Plane, before: Plane, inside: Mask) -> Plane:
    """How much nearer than the surface what history shows is; above 0, it was hidden.

        (D_rp - D) / max(D_rp, D)   [Guo et al. 2022, supplement, Eq. 10]

    Sky against sky is 0; where there is no history, 1.

    Args:
        nearness: D.
        before: D_rp, D of the frame before at x + V(x).
        inside: 1 where that lies in the frame.
    """
    nearest = torch.maximum(nearness, before)
    difference = (before - nearness) / nearest.masked_fill(nearest == 0, 1.0)
    return torch.where(inside > 0, difference, 1.0)


def span_colors(color: Color) -> Image:
    """Smallest of 3 x 3 pixels, a channel, then largest; n 6 h w."""
    low = high = functional.pad(color, (1, 1, 1, 1), mode="replicate")
    for dim in (2, 3):
        length = low.shape[dim] - 2
        low, high = (
            pick(pick(p.narrow(dim, 0, length), p.narrow(dim, 1, length)), p.narrow(dim, 2, length))
            for pick, p in ((torch.minimum, low), (torch.maximum, high))
        )
    return torch.cat([low, high], dim=1)


def merge_range(own: Image, carried: Image, useless: Mask) -> Image:
    """Range of colours to carry on, n 6 h w: the smallest of each channel, then the largest.

        low = min(c, c' + (c - c') / 8),   high = max(C, C' + (C - C') / 8)

    of the frame's own range c .. C and the carried one c' .. C'; the frame's own alone where
    history is of no use.

    Args:
        own: `span_colors` of the frame.
        carried: range of the frame before at x + V(x).
        useless: 1 where it shows another surface, or nothing.
    """
    faded = torch.lerp(carried, own, RANGE_RATE)
    low = torch.minimum(own[:, :3], faded[:, :3])
    high = torch.maximum(own[:, 3:], faded[:, 3:])
    return torch.where(useless > 0, own, torch.cat([low, high], dim=1))


def count_frames(carried: Plane, useless: Mask) -> Plane:
    """Frames that history holds: one more each frame, 0 where it is of no use."""
    return torch.where(useless > 0, 0.0, carried + 1.0)
