"""Forward splatting with a depth test, and the motion vectors that are built on it.

Names of the field, all in rtsr's sense (previous minus current, pixels, x right, y down):

- traditional motion vector TMV: y = x + TMV(x), the previous position of the surface point seen at
  x;
- forward motion FWD, on the previous frame's grid: next position = y + FWD(y);
- dual motion vector DMV = -FWD(y): the motion of whatever was visible at y   [Zeng et al. 2021].
"""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.warping import (
    AnyImage,
    backward_warp,
    bound_motion,
    own_index,
    require_same_size,
    whole_pixels,
)
from rtsr_cli.core.shapes import Mask, MotionPx, Plane, Size

UNRELIABLE_PX = 0.1
"""|DMV - TMV| from which history is unreliable, low-resolution pixels   [NSRD, code]."""

MARGIN = 2
"""Pixels around a target that catch what leaves it: a source lands on two a line at most."""

_INDEX_BITS = 32
_INDEX_MASK = (1 << _INDEX_BITS) - 1
_NO_SOURCE = torch.iinfo(torch.int64).max


def _packed_keys(depth_m: Tensor) -> Tensor:
    """(depth bits << 32) | source index; bits of floats >= 0 grow with the float: min = nearest."""
    num_sources = depth_m[0].numel()
    bits = depth_m.float().clamp(min=0).add(0.0).contiguous().view(torch.int32).long()
    index = torch.arange(num_sources, device=depth_m.device)
    return (bits.view(-1, num_sources) << _INDEX_BITS) | index


def _place_sources(motion_px: Tensor, usable: Tensor, size: Size, *, spread: bool) -> list[Tensor]:
    """Index of each pixel that a source lands on, of a target that is `MARGIN` larger all round.

    What leaves the target ends in the margin, and so do sources that are not usable.
    """
    width = size[1] + 2 * MARGIN
    rounding = 0.0 if spread else 0.5
    column, row = (
        (whole_pixels(motion_px[:, axis] + rounding) + own_index(motion_px, axis))
        .clamp_(-MARGIN, size[1 - axis])
        .add_(MARGIN)
        for axis in (0, 1)
    )
    first = torch.add(column, row, alpha=width) * usable
    if not spread:
        return [first]
    # on whole pixels there is nothing between
    right, down = (motion_px[:, axis].frac().ne(0).long() for axis in (0, 1))
    right = right.add_(first)
    return [first, right, torch.add(first, down, alpha=width), down.mul_(width).add_(right)]


def forward_splat(
    source_values: AnyImage,
    forward_motion_px: MotionPx,
    depth_m: Plane,
    *,
    size: Size | None = None,
    spread: bool = False,
) -> tuple[Tensor, Tensor]:
    """Move every source pixel along its forward motion; the nearest one keeps the pixel.

    One scatter-min of packed keys decides all pixels; ties go to the lower source index, so the
    result does not depend on the order of execution. Differentiable in `source_values`.

    Args:
        source_values: any type and channel count.
        forward_motion_px: target position minus own position, pixels.
        depth_m: of the sources, at the target time; sources with NaN or infinite depth or motion
            are left out.
        size: (height, width) of the target; default that of the source.
        spread: let a source land on each of the four pixels around its new position, so that
            surfaces that grow keep no cracks; else on the one that holds it.

    Returns:
        Values on the target, n c and `size` (0 where nothing lands), and a mask, 1 where something
        landed.

    Raises:
        ShapeMismatchError: sizes differ, or the source has 2^32 pixels or more.
    """
    require_same_size(
        source_values=source_values, forward_motion_px=forward_motion_px, depth_m=depth_m
    )
    n, c, source_h, source_w = source_values.shape
    h, w = size or (source_h, source_w)
    if source_h * source_w > _INDEX_MASK:
        raise ShapeMismatchError(f"{source_h} x {source_w} sources are more than a key can index")
    keys = _packed_keys(depth_m)
    usable = (depth_m + forward_motion_px.sum(dim=1, keepdim=True)).isfinite()[:, 0]
    motion = bound_motion(forward_motion_px, limit_px=h + w + source_h + source_w)
    rows, columns = h + 2 * MARGIN, w + 2 * MARGIN
    target = keys.new_full((n, rows * columns), _NO_SOURCE)
    for index in _place_sources(motion, usable, (h, w), spread=spread):
        target.scatter_reduce_(1, index.reshape(n, -1), keys, "amin")
    inner = slice(MARGIN, -MARGIN)
    winner = target.view(n, rows, columns)[:, inner, inner].reshape(n, h * w)
    hit = winner != _NO_SOURCE
    source = torch.where(hit, winner & _INDEX_MASK, 0).unsqueeze(1)
    values = source_values.reshape(n, c, -1).gather(2, source.expand(n, c, -1))
    values = values.masked_fill(~hit.unsqueeze(1), 0)
    return values.view(n, c, h, w), hit.view(n, 1, h, w).to(depth_m.dtype)


def forward_motion_by_splat(
    motion_px: MotionPx, depth_m: Plane, *, spread: bool = False
) -> tuple[MotionPx, Mask]:
    """Forward motion on the previous frame's grid, where the file has none.

        FWD(x + TMV(x)) = -TMV(x), nearest surface first

    Args:
        motion_px: traditional motion of the current frame.
        depth_m: of the current frame.
        spread: onto all four pixels around, as `forward_splat` has it.

    Returns:
        FWD and a mask, 1 where a surface of the current frame landed.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    return forward_splat(-motion_px, motion_px, depth_m, spread=spread)


def dual_motion(
    motion_px: MotionPx, forward_motion_prev_px: MotionPx, *, known_prev_mask: Mask | None = None
) -> tuple[MotionPx, Mask]:
    """Dual motion vector: the motion of the surface that was visible at x's old position.

        y = x + TMV(x),  z = y + FWD(y),  DMV = y + (x - z) - x = -FWD(y)   [Zeng et al. 2021]

    So DMV - TMV = x - z: zero where both frames show the same surface, large at disocclusions.

    Args:
        motion_px: TMV of the current frame.
        forward_motion_prev_px: FWD, rendered with the previous frame, or by
            `forward_motion_by_splat`; fetched nearest, for a mean of two surfaces' vectors belongs
            to neither.
        known_prev_mask: 1 where FWD is known; default everywhere.

    Returns:
        DMV and a mask, 1 where y lies in the frame and FWD is known there; DMV = TMV elsewhere.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    forward, known = backward_warp(forward_motion_prev_px, motion_px, mode="nearest")
    if known_prev_mask is not None:
        known = known * backward_warp(known_prev_mask, motion_px, mode="nearest")[0]
    return torch.where(known > 0, -forward, motion_px), known


def unreliable_mask(
    motion_px: MotionPx,
    dual_motion_px: MotionPx,
    known_mask: Mask | None = None,
    *,
    threshold_px: float = UNRELIABLE_PX,
) -> Mask:
    """Forward-backward consistency: where history must not be trusted.

        M(x) = 1 where |DMV - TMV| >= threshold in x or y, or DMV is unknown, else 0   [NSRD, code]

    Args:
        motion_px: TMV.
        dual_motion_px: DMV.
        known_mask: 1 where DMV is known; default everywhere.
        threshold_px: pixels of the vectors' resolution (0.1 at low resolution, 0.1 * scale at
            high).

    Returns:
        1 = unreliable.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    require_same_size(motion_px=motion_px, dual_motion_px=dual_motion_px)
    agrees = ((dual_motion_px - motion_px).abs() < threshold_px).all(dim=1, keepdim=True)
    if known_mask is not None:
        agrees = agrees & (known_mask > 0)
    return (~agrees).to(motion_px.dtype)
