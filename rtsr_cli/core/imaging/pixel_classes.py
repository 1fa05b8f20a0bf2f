"""Ghosting and aliasing pixels, told by all samples of a pixel.

The labels of classifier guided temporal supersampling [Guo et al. 2022, supplement, section 2],
whose equation numbers stand below. D is reversed depth (1 / z), I the box of colours, N the normals
of a pixel's samples, V its motion, W = x + V(x) where it was in the frame before; D and V are those
of the nearest sample. Frames before are fetched at the nearest pixel.

Where the print and its text differ, the text is followed: (1) compares W with the point's own depth
carried to the frame before, not with another pixel of that frame; (5) takes the absolute
difference, so that an arriving shadow is a change, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import product

import torch
from torch import Tensor
from torch.nn import functional

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.camera_motion import (
    differs_from_camera,
    find_camera_motion,
    locate_points,
)
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.frame_motion import exposure_ratio, sample_motion
from rtsr_cli.core.imaging.sample_ranges import (
    SampleRanges,
    gather_ranges,
    pick_nearest,
    reverse_depth,
)
from rtsr_cli.core.imaging.warping import fetch_nearest, inside_frame
from rtsr_cli.core.shapes import Color, Mask, Plane


class Ghosting(IntEnum):
    """Whether history is of use."""

    NONE = 0
    VISIBILITY = 1
    """It shows another surface, or nothing."""
    SHADING = 2
    """It shows the surface in another light."""


class Aliasing(IntEnum):
    """Whether one sample is enough."""

    NONE = 0
    GEOMETRY = 1
    """Several surfaces."""
    TEXTURE = 2
    """One surface whose colour or normal map changes within the pixel."""


@dataclass(frozen=True, kw_only=True)
class GhostingConfig:
    """Thresholds of ghosting.

    Attributes:
        depth: T_D, share of the nearer D.
        speed_px2: T_V, squared pixels a frame.
        color: T_I, of c / (1 + c); not in the publication.
        overlap: T_IoU, of colour boxes in c / (1 + c); not in the publication.
        box_margin: by which boxes grow to each side, so that flat ones have a volume; ours.
        openings: times that the shading label is eroded, and then dilated.
        depth_only: leave (2) and (4) out, which miss what the camera's own slow motion uncovers.
    """

    depth: float = 0.01
    speed_px2: float = 1.0
    color: float = 0.05
    overlap: float = 0.10
    box_margin: float = 0.004
    openings: int = 2
    depth_only: bool = False


@dataclass(frozen=True, kw_only=True)
class AliasingConfig:
    """Thresholds of aliasing.

    Attributes:
        depth: T_D, share of the nearest D.
        normal: T_N, sum of the absolute differences of components.
        color: T_I, share of a channel's largest radiance.
        planes: depth counts beyond what one plane spans; else (7) as printed, which marks every
            floor that is seen at a grazing angle.
    """

    depth: float = 0.01
    normal: float = 0.5
    color: float = 0.5
    planes: bool = True


@dataclass(frozen=True, kw_only=True)
class ClassConfig:
    """Thresholds of both."""

    ghosting: GhostingConfig = field(default_factory=GhostingConfig)
    aliasing: AliasingConfig = field(default_factory=AliasingConfig)


@dataclass(frozen=True, kw_only=True)
class PixelClasses:
    """Classes of a frame's pixels.

    Attributes:
        visibility, shading: 1 where ghosting is of that kind; never both.
        geometry, texture: 1 where aliasing is of that kind; never both.
        outside: 1 where a pixel was outside of the frame before; part of `visibility`.
    """

    visibility: Mask
    shading: Mask
    geometry: Mask
    texture: Mask
    outside: Mask

    @property
    def ghosting(self) -> Plane:
        """Numbers of `Ghosting`."""
        return Ghosting.VISIBILITY * self.visibility + Ghosting.SHADING * self.shading

    @property
    def aliasing(self) -> Plane:
        """Numbers of `Aliasing`."""
        return Aliasing.GEOMETRY * self.geometry + Aliasing.TEXTURE * self.texture


_DEFAULT = ClassConfig()


def classify_pixels(
    frames: Sequence[Frame], k: int, config: ClassConfig = _DEFAULT, *, on_grid: bool = True
) -> PixelClasses:
    """Tell the classes of a frame's pixels.

    Args:
        frames: captures of k x k samples a pixel, newest first: the frame and, unless it is the
            first or follows a cut, the one before; as `gather_ranges` wants them.
        k: samples along an axis; it divides both sides.
        config: thresholds.
        on_grid: as for `gather_ranges`.

    Returns:
        Classes at the pixels' resolution; without a frame before, every pixel is visibility
        ghosting, none of it outside.

    Raises:
        MissingBufferError: colour, depth or motion is not there.
        ShapeMismatchError: sizes differ.
    """
    now = gather_ranges(frames[0], k, on_grid=on_grid)
    geometry, texture = find_aliasing(now, config.aliasing)
    if len(frames) == 1:
        nothing = torch.zeros_like(geometry)
        visibility, shading, outside = nothing + 1.0, nothing, nothing
    else:
        before = gather_ranges(frames[1], k, on_grid=on_grid)
        limits, inside = config.ghosting, inside_frame(now.motion_px)
        carried = carry_depth(frames[0], frames[1], k)
        hidden = find_hidden(now, before, carried, limits)
        outside = 1.0 - inside
        visibility = torch.maximum(hidden, outside)
        ratio = exposure_ratio(frames[0], frames[1])
        changed = find_shading_change(now, before, limits, ratio=ratio)
        # corrections: motion says nothing where history is another surface, nor do aliased boxes
        shading = changed * (1.0 - visibility) * (1.0 - geometry) * (1.0 - texture)
    return PixelClasses(
        visibility=visibility,
        shading=shading,
        geometry=geometry,
        texture=texture,
        outside=outside,
    )


def carry_depth(now: Frame, before: Frame, k: int) -> Plane:
    """D of each pixel's nearest sample as the frame before would see the same point.

        D' = 1 / z_before(P) on what stands still,  D on what moves by itself

    Where no camera or position is known, D everywhere.

    Args:
        now, before: captures of k x k samples a pixel.
        k: samples along an axis.
    """
    depth = now.gbuffer[Buffer.DEPTH]
    nearness = reverse_depth(depth)
    position = locate_points(now)
    camera_px = None if position is None else find_camera_motion(position, before)
    matrix = before.camera.world_to_camera
    if position is not None and camera_px is not None and matrix is not None:
        m = matrix.to(depth)
        away = -torch.einsum("nchw,c->nhw", position, m[:3, 2]).unsqueeze(1) - m[3, 2]
        moves = differs_from_camera(sample_motion(now, before), camera_px) > 0
        own = moves | (nearness == 0) | ~(away > 0)
        nearness = torch.where(own, nearness, reverse_depth(away))
    return pick_nearest(nearness, depth, k)


def find_hidden(
    now: SampleRanges, before: SampleRanges, carried: Plane, config: GhostingConfig
) -> Mask:
    """1 where the frame before shows a nearer surface in a pixel's place.

        (Dmax(W) - D') / Dmax(W) > T_D  (1)    and    |V(x) - V(W)|^2 > T_V  (2)

    and from a marked pixel x on to a neighbour x' that lies behind it and moves otherwise:

        (Dmax(x) - Dmax(x')) / Dmax(x) > T_D  (3)    and    |V(x) - V(x')|^2 > T_V  (4)

    Args:
        now, before: ranges of the frame and the one before.
        carried: D' of `carry_depth`.
        config: thresholds.

    Returns:
        0 where W is outside, unless a neighbour marks the pixel: what is fetched there is the
        border, which hid nothing, and nothing grows from it.
    """
    nearest = fetch_nearest(before.nearest, now.motion_px)
    motion = fetch_nearest(before.motion_px, now.motion_px)
    hidden = _lies_behind(carried, nearest, config) & _moves_apart(now.motion_px, motion, config)
    hidden = hidden & (inside_frame(now.motion_px) > 0)
    own = torch.cat([hidden.to(carried), now.nearest, now.motion_px], dim=1)
    spread = hidden
    for marked in _look_around(own):
        behind = _lies_behind(now.nearest, marked[:, 1:2], config)
        apart = _moves_apart(now.motion_px, marked[:, 2:], config)
        spread = spread | ((marked[:, :1] > 0) & behind & apart)
    return spread.to(carried)


def _lies_behind(nearness: Plane, other: Plane, config: GhostingConfig) -> Tensor:
    """(other - D) / other > T_D; sky (0) hides nothing."""
    return other - nearness > config.depth * other


def _moves_apart(motion_px: Tensor, other_px: Tensor, config: GhostingConfig) -> Tensor:
    apart = (motion_px - other_px).square().sum(1, keepdim=True) > config.speed_px2
    return torch.ones_like(apart) if config.depth_only else apart


def _look_around(image: Tensor) -> Iterator[Tensor]:
    """Each of the eight neighbours of every pixel; 0 outside of the frame."""
    height, width = image.shape[2:]
    padded = functional.pad(image, (1, 1, 1, 1))
    for top, left in product(range(3), repeat=2):
        if (top, left) != (1, 1):
            yield padded[..., top : top + height, left : left + width]


def find_shading_change(
    now: SampleRanges, before: SampleRanges, config: GhostingConfig, *, ratio: float = 1.0
) -> Mask:
    """1 where a surface is lit otherwise than it was, in c / (1 + c); small regions are opened.

        max_rgb |I(x) - I(W)| > T_I  (5)    and    IoU(I(x), I(W)) < T_IoU  (6)

    Args:
        now, before: ranges of the frame and the one before.
        config: thresholds.
        ratio: what radiance of the frame before is to be multiplied by.
    """
    corners = [encode_reinhard(corner) for corner in (now.color_min, now.color_max)]
    past = [
        encode_reinhard(ratio * fetch_nearest(corner, now.motion_px))
        for corner in (before.color_min, before.color_max)
    ]
    apart = (corners[1] - past[1]).abs().amax(1, keepdim=True)
    overlap = measure_overlap(*corners, *past, margin=config.box_margin)
    changed = ((apart > config.color) & (overlap < config.overlap)).to(apart)
    return open_mask(changed, config.openings)


def measure_overlap(
    least: Color, most: Color, least_past: Color, most_past: Color, *, margin: float
) -> Plane:
    """Intersection over union of two boxes of colours, 0 to 1.

        IoU = v(A and B) / (v(A) + v(B) - v(A and B)),   v = product of the sides over r, g, b

    Args:
        least, most: corners of one.
        least_past, most_past: corners of the other.
        margin: by which both grow to each side; above 0.
    """
    shared = torch.minimum(most, most_past) - torch.maximum(least, least_past) + 2 * margin
    common = shared.clamp(min=0.0).prod(1, keepdim=True)
    first, second = (
        (high - low + 2 * margin).prod(1, keepdim=True)
        for low, high in ((least, most), (least_past, most_past))
    )
    return common / (first + second - common)


def open_mask(mask: Mask, times: int) -> Mask:
    """Erode by 3 x 3 pixels, so many times, then dilate as often; beyond borders lies nothing."""
    for sign in (-1, 1):
        for _ in range(times):
            mask = sign * functional.max_pool2d(sign * mask, 3, stride=1, padding=1)
    return mask


def find_aliasing(ranges: SampleRanges, config: AliasingConfig) -> tuple[Mask, Mask]:
    """1 where aliasing is of geometry, and 1 where it is of texture only.

        (Dmax - Dmin) / Dmax > T_D  (7)    or    max_i |N_0 - N_i|_1 > T_N  (8)
        or    max_rgb |(Imax - Imin) / Imax| > T_I  (9)

    Geometry is (7), less what one plane spans, or (8), of normals without normal map; texture is
    the rest of (8), of normals with it, or (9). Where there are no normals without normal map,
    several objects are geometry in place of (8).
    """
    span = ranges.nearest - ranges.farthest
    beyond = span - ranges.slope_range if config.planes else span
    geometry = beyond > config.depth * ranges.nearest
    if ranges.geonormals is not None:
        geometry = geometry | _bends(ranges.geonormals, config)
    elif ranges.other_ids is not None:
        geometry = geometry | (ranges.other_ids > 0)
    most, least = (color.clamp(min=0.0) for color in (ranges.color_max, ranges.color_min))
    aliased = (most - least > config.color * most).any(1, keepdim=True)
    if ranges.normals is not None:
        aliased = aliased | _bends(ranges.normals, config)
    return geometry.to(span), (aliased & ~geometry).to(span)


def _bends(normals: Tensor, config: AliasingConfig) -> Tensor:
    """max_i |N_0 - N_i|_1 > T_N; n 1 h w."""
    first = normals[:, :, :1]
    return (normals - first).abs().sum(1).amax(1, keepdim=True) > config.normal
