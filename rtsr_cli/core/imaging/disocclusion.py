"""Telling where the previous frame shows another surface, so that history must not be trusted.

Conventions: those of `warping`. 1 = disoccluded: the pixel has no valid history.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from rtsr_cli.core.imaging.warping import (
    backward_warp,
    bilinear_taps,
    fetch_nearest,
    inside_frame,
    require_same_size,
)
from rtsr_cli.core.shapes import IdMap, Mask, MotionPx, Plane, Vector3

SKY_DEPTH_M = 65504.0
"""Depth from which a pixel is sky: the largest half-precision number."""


@dataclass(frozen=True, kw_only=True)
class SurfaceBuffers:
    """What is known of the surfaces seen in one frame; any buffer may be absent.

    `depth_m`: planar view depth, sky 65504 or more. `normal`: world, unit, 0 on sky. `position_m`:
    world. `n_dot_v`: cosine between normal and view direction, 0 to 1. `object_id`: compared, never
    filtered.
    """

    depth_m: Plane | None = None
    normal: Vector3 | None = None
    position_m: Vector3 | None = None
    n_dot_v: Plane | None = None
    object_id: IdMap | None = None


@dataclass(frozen=True, kw_only=True)
class DisocclusionThresholds:
    """Tolerances of `disocclusion_mask`.

    `depth_relative`: share of the expected depth. `depth_slope_px`: how many pixels of the
    surface's own depth slope are allowed on top (a nearest fetch is off by up to half a pixel on
    each axis), which widens the test at grazing angles; both paper silent. `normal_cosine`:
    ExtraNet's code. `position_facing_m`, `position_grazing_m`, `position_per_depth`: ExtraNet's T_d
    = 0.075 |NoV| + 0.45 (1 - |NoV|) + 0.005 z. `position_slope_px`: as `depth_slope_px`, for a tap
    lies up to a pixel away, which far off at a grazing angle is more than T_d; ExtraNet's code has
    0. `id_taps`: history is valid if the nearest tap, or
    any bilinear tap, has the pixel's object id.
    """

    depth_relative: float = 0.05
    depth_slope_px: float = 1.0
    normal_cosine: float = 0.98
    position_facing_m: float = 0.075
    position_grazing_m: float = 0.45
    position_per_depth: float = 0.005
    position_slope_px: float = 0.0
    id_taps: Literal["nearest", "any"] = "nearest"


_DEFAULT_THRESHOLDS = DisocclusionThresholds()


def _minmod(before: Tensor, after: Tensor) -> Tensor:
    """The smaller step where both go the same way, else 0: a slope that an edge cannot feign."""
    return torch.where(before * after > 0, torch.minimum(before.abs(), after.abs()), 0)


def _find_slope(image: Tensor) -> Iterator[Tensor]:
    """Minmod of the steps along x and along y, of each channel; 0 at one-pixel edges, borders."""
    for dim in (3, 2):
        step = image.diff(dim=dim)
        end = torch.zeros_like(image.narrow(dim, 0, 1))
        yield _minmod(torch.cat((end, step), dim), torch.cat((step, end), dim))


def depth_slope(depth_m: Plane) -> Plane:
    """Metres of depth a pixel, |minmod| along x plus along y; 0 at one-pixel edges and borders."""
    across, down = _find_slope(depth_m)
    return across + down


def position_slope(position_m: Vector3) -> Plane:
    """Metres from a pixel to the next on its own surface, along x plus along y, as the above."""
    across, down = _find_slope(position_m)
    return _length(across) + _length(down)


def bound_depth(depth_m: Tensor) -> Tensor:
    """Every kind of sky (65504, 1e10, infinity, NaN) at one depth."""
    return depth_m.nan_to_num(nan=SKY_DEPTH_M).clamp(max=SKY_DEPTH_M)


def _depth_differs(
    motion_px: Tensor, depth_prev: Tensor, expected: Tensor, limits: DisocclusionThresholds
) -> Tensor:
    """|d_prev(x + mv) - d_expected(x)| > relative * d_expected + slope."""
    target = bound_depth(expected)
    allowed = limits.depth_relative * target + limits.depth_slope_px * depth_slope(target)
    return (fetch_nearest(bound_depth(depth_prev), motion_px) - target).abs() > allowed


def _length(vectors: Tensor) -> Tensor:
    """Euclidean length over channels; `Tensor.norm` is a hundred times slower along them."""
    return vectors.square().sum(dim=1, keepdim=True).sqrt()


def _normal_differs(
    motion_px: Tensor, normal_prev: Tensor, normal: Tensor, limits: DisocclusionThresholds
) -> Tensor:
    """cos(n, n_warped) < threshold; two skies agree, a sky and a surface do not."""
    warped, _ = backward_warp(normal_prev, motion_px)
    lengths = _length(warped) * _length(normal)
    dot = (warped * normal).sum(dim=1, keepdim=True)
    both_sky = (_length(warped) == 0) & (_length(normal) == 0)
    agrees: Tensor = (dot >= limits.normal_cosine * lengths) & (lengths > 0)
    return ~(agrees | both_sky)


def position_tolerance_m(
    n_dot_v: Plane, depth_m: Plane, limits: DisocclusionThresholds = _DEFAULT_THRESHOLDS
) -> Plane:
    """T_d = 0.075 |NoV| + 0.45 (1 - |NoV|) + 0.005 z, metres.   [ExtraNet, code, in metres]."""
    facing = n_dot_v.abs()
    at_angle = limits.position_facing_m * facing + limits.position_grazing_m * (1 - facing)
    return at_angle + limits.position_per_depth * depth_m


def _position_differs(
    motion_px: Tensor, position_prev: Tensor, position: Tensor, tolerance: Tensor
) -> Tensor:
    """The farthest of the tap positions that count (weight > 0) lies beyond the tolerance."""
    differs = torch.zeros_like(tolerance, dtype=torch.bool)
    for tap, weight in bilinear_taps(position_prev, motion_px):
        distance = _length(tap - position)
        differs = differs | (~(distance <= tolerance) & (weight > 0))
    return differs


def _id_differs(
    motion_px: Tensor, id_prev: Tensor, object_id: Tensor, limits: DisocclusionThresholds
) -> Tensor:
    if limits.id_taps == "nearest":
        return fetch_nearest(id_prev, motion_px) != object_id
    agrees = torch.zeros_like(object_id, dtype=torch.bool)
    for tap, weight in bilinear_taps(id_prev, motion_px):
        agrees = agrees | ((tap == object_id) & (weight > 0))
    return ~agrees


def _require_matching_sizes(
    motion_px: Tensor, current: SurfaceBuffers, previous: SurfaceBuffers
) -> None:
    named = {"motion_px": motion_px}
    for frame_name, buffers in (("current", current), ("previous", previous)):
        for buffer_name, buffer in vars(buffers).items():
            if buffer is not None:
                named[f"{frame_name} {buffer_name}"] = buffer
    require_same_size(**named)


@dataclass(frozen=True, kw_only=True)
class SurfaceDifferences:
    """Where two frames show other surfaces, test by test, n 1 h w booleans; None = not tested.

    What lies outside of the frame before is compared with that frame's border.

    Attributes:
        outside: the position lies outside of the frame before, or motion is not a number.
        depth, normal, position, object_id: the buffers tell them apart.
    """

    outside: Tensor
    depth: Tensor | None = None
    normal: Tensor | None = None
    position: Tensor | None = None
    object_id: Tensor | None = None


def compare_surfaces(
    motion_px: MotionPx,
    *,
    current: SurfaceBuffers,
    previous: SurfaceBuffers,
    expected_depth_prev_m: Plane | None = None,
    thresholds: DisocclusionThresholds = _DEFAULT_THRESHOLDS,
) -> SurfaceDifferences:
    """Run every test whose buffer both frames hold, on every pixel.

    Depth and ids are fetched nearest, normals bilinear and renormalised, positions at all bilinear
    taps. Arguments and errors as `disocclusion_mask`.
    """
    _require_matching_sizes(motion_px, current, previous)
    expected = current.depth_m if expected_depth_prev_m is None else expected_depth_prev_m
    depth = normal = position = object_id = None
    if expected is not None and previous.depth_m is not None:
        depth = _depth_differs(motion_px, previous.depth_m, expected, thresholds)
    if current.normal is not None and previous.normal is not None:
        normal = _normal_differs(motion_px, previous.normal, current.normal, thresholds)
    if current.position_m is not None and previous.position_m is not None:
        tolerance = _find_position_tolerance(current, thresholds, like=motion_px)
        if thresholds.position_slope_px:
            slope = position_slope(current.position_m)
            tolerance = tolerance + thresholds.position_slope_px * slope
        position = _position_differs(motion_px, previous.position_m, current.position_m, tolerance)
    if current.object_id is not None and previous.object_id is not None:
        object_id = _id_differs(motion_px, previous.object_id, current.object_id, thresholds)
    return SurfaceDifferences(
        outside=inside_frame(motion_px) == 0,
        depth=depth,
        normal=normal,
        position=position,
        object_id=object_id,
    )


def disocclusion_mask(
    motion_px: MotionPx,
    *,
    current: SurfaceBuffers,
    previous: SurfaceBuffers,
    expected_depth_prev_m: Plane | None = None,
    dynamic_mask: Mask | None = None,
    thresholds: DisocclusionThresholds = _DEFAULT_THRESHOLDS,
) -> Mask:
    """Mark the pixels whose surface the previous frame does not show.

    The union of every test of `compare_surfaces`; outside the frame is always marked.

    Args:
        motion_px: of the current frame.
        current, previous: buffers of the two frames at the motion's resolution. The position test
            takes `n_dot_v` and `depth_m` of the current frame; without them it assumes grazing (0)
            and depth 0.
        expected_depth_prev_m: depth of the current surface as the *previous* camera would see it;
            without it, the current depth.
        dynamic_mask: 1 on moving objects. When given, normals are tested there only and positions
            elsewhere only, as ExtraNet's code does.
        thresholds: tolerances.

    Returns:
        1 where there is no valid history.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    differ = compare_surfaces(
        motion_px,
        current=current,
        previous=previous,
        expected_depth_prev_m=expected_depth_prev_m,
        thresholds=thresholds,
    )
    normal, position = differ.normal, differ.position
    if dynamic_mask is not None:
        dynamic = dynamic_mask > 0
        normal = None if normal is None else normal & dynamic
        position = None if position is None else position & ~dynamic
    marked = differ.outside
    for test in (differ.depth, normal, position, differ.object_id):
        marked = marked if test is None else marked | test
    return marked.to(motion_px.dtype)


def _find_position_tolerance(
    current: SurfaceBuffers, thresholds: DisocclusionThresholds, *, like: Tensor
) -> Plane:
    """Tolerance of the position test; without a view cosine or a depth, as if it were 0."""
    zero = torch.zeros_like(like[:, :1])
    cosine = zero if current.n_dot_v is None else current.n_dot_v
    depth = zero if current.depth_m is None else current.depth_m
    return position_tolerance_m(cosine, depth, thresholds)
