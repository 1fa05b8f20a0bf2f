"""Camera rays in tiles of pixels, and what they hit first.

Rays are (x, y, -1) in camera space, so that the parameter of a hit is its planar depth. Pixels of a
strip are kept tile by tile, (tiles, pixels of a tile): a solid is intersected only with the tiles
that its projection touches.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.synth.placement import PlacedPart
from rtsr_cli.core.synth.scene import NEAR_M, Shape
from rtsr_cli.core.synth.vector_math import Vector

TILE_PX = 16
"""Side of a tile."""

SLOPE_STEPS = 2.0**40
"""Slopes are multiples of one over this, coarser than double and finer than single precision."""

FAR_M = 4000.0
"""Hits beyond are sky: the ground ends there, well below the depth that stands for sky."""

NOTHING = -1
"""Index of a pixel that sees the sky."""

_EDGES = [(a, b) for a, b in itertools.combinations(range(8), 2) if (a ^ b).bit_count() == 1]
"""Pairs of corners (numbered by their bits) that an edge of a box joins."""


@dataclass(frozen=True, kw_only=True)
class Rays:
    """Rays of a strip of pixels.

    Attributes:
        x, y: slopes, (tiles, pixels of a tile).
        grid: tiles down and across.
        size: (height, width) of the pixels asked for; tiles may reach beyond.
        to_camera: world to camera, 4 x 4.
    """

    x: Tensor
    y: Tensor
    grid: tuple[int, int]
    size: Size
    to_camera: NDArray[np.float64]

    @property
    def highest(self) -> float:
        """Largest slope y."""
        return float(self.y[0, 0])

    @property
    def lowest(self) -> float:
        """Smallest slope y."""
        return float(self.y[-1, -1])

    @property
    def eye(self) -> NDArray[np.float64]:
        """Position of the camera."""
        eye: NDArray[np.float64] = -self.to_camera[3, :3] @ self.to_camera[:3, :3].T
        return eye

    @property
    def basis(self) -> NDArray[np.float64]:
        """World directions of slope x, slope y and the view axis, one a row."""
        right, up, back = self.to_camera[:3, :3].T
        return np.stack([right, up, -back])

    def image(self, values: Tensor) -> Tensor:
        """Rearrange (..., tiles, pixels of a tile) to (..., height, width)."""
        down, across = self.grid
        lead = values.shape[:-2]
        tiled = values.reshape(*lead, down, across, TILE_PX, TILE_PX).transpose(-3, -2)
        whole = tiled.reshape(*lead, down * TILE_PX, across * TILE_PX)
        return whole[..., : self.size[0], : self.size[1]]

    def world(self, depth_m: Tensor) -> Vector:
        """World positions of points on the rays."""
        x, y, z = (
            (self.x * r + self.y * u + f).mul_(depth_m).add_(e)
            for r, u, f, e in zip(*self.basis.tolist(), self.eye.tolist(), strict=True)
        )
        return x, y, z


def _slopes(exact: Tensor) -> Tensor:
    """Round to float; the same sample of two resolutions, equal but for rounding, becomes equal."""
    return ((exact * SLOPE_STEPS).round_() / SLOPE_STEPS).float()


def strip_rays(camera: CameraMetadata, display: Size, rows: range) -> Rays:
    """Rays through the samples (pixel centre + jitter) of some rows of an image.

    Args:
        camera: matrices and jitter.
        display: (height, width) of the whole image.
        rows: those of the strip.
    """
    assert camera.world_to_camera is not None
    projection = camera.projection
    assert projection is not None
    height, width = display
    down, across = -(-len(rows) // TILE_PX), -(-width // TILE_PX)
    columns = torch.arange(across * TILE_PX, dtype=torch.float64) + (0.5 + camera.jitter_px[0])
    lines = torch.arange(down * TILE_PX, dtype=torch.float64) + (
        rows.start + 0.5 + camera.jitter_px[1]
    )
    x = _slopes((2.0 * columns / width - 1.0) / projection[0, 0])
    y = _slopes((1.0 - 2.0 * lines / height) / projection[1, 1])
    shape = (down, across, TILE_PX, TILE_PX)
    return Rays(
        x=x.view(1, across, 1, TILE_PX).expand(shape).reshape(down * across, -1),
        y=y.view(down, 1, TILE_PX, 1).expand(shape).reshape(down * across, -1),
        grid=(down, across),
        size=(len(rows), width),
        to_camera=camera.world_to_camera.numpy(),
    )


Bounds = tuple[float, float, float, float]
"""Smallest and largest slope of what a solid covers: x0, x1, y0, y1."""

NOWHERE: Bounds = (math.inf, -math.inf, math.inf, -math.inf)
EVERYWHERE: Bounds = (-math.inf, math.inf, -math.inf, math.inf)


def project_bounds(solid: PlacedPart, to_camera: NDArray[np.float64]) -> Bounds:
    """Bounds of a solid's bounding box.

    What reaches behind the near plane is cut off there first.
    """
    if not solid.bounded:
        return EVERYWHERE
    points = solid.corners() @ to_camera[:3, :3] + to_camera[3, :3]
    ahead = -points[:, 2] > NEAR_M
    kept = [points[ahead]]
    for a, b in _EDGES:
        if ahead[a] != ahead[b]:
            share = (-NEAR_M - points[a, 2]) / (points[b, 2] - points[a, 2])
            kept.append((points[a] + share * (points[b] - points[a]))[None])
    visible = np.concatenate(kept)
    if not len(visible):
        return NOWHERE
    slopes = visible[:, :2] / -visible[:, 2:]
    (x0, y0), (x1, y1) = slopes.min(0), slopes.max(0)
    return float(x0), float(x1), float(y0), float(y1)


def find_touched_tiles(rays: Rays, bounds: Bounds) -> Tensor:
    """Numbers of the tiles whose rays may hit what lies within bounds."""
    x0, x1, y0, y1 = bounds
    if y0 > rays.highest or y1 < rays.lowest:
        return torch.empty(0, dtype=torch.int64)
    # the first pixel of a tile has the smallest x and the largest y
    inside = (rays.x[:, -1] >= x0) & (rays.x[:, 0] <= x1)
    inside &= (rays.y[:, 0] >= y0) & (rays.y[:, -1] <= y1)
    return inside.nonzero()[:, 0]


@dataclass(frozen=True)
class LocalRays:
    """Rays in the local frame of a solid: one origin, a direction a ray."""

    origin: tuple[float, float, float]
    direction: Vector


def local_rays(rays: Rays, x: Tensor, y: Tensor, solid: PlacedPart) -> LocalRays:
    """Rays of slopes x and y in the local frame of a solid."""
    ox, oy, oz = (solid.axes @ (rays.eye - solid.centre)).tolist()
    dx, dy, dz = (
        (x * r).add_(y, alpha=u).add_(f) for r, u, f in (solid.axes @ rays.basis.T).tolist()
    )
    return LocalRays((ox, oy, oz), (dx, dy, dz))


def _slab(origin: float, direction: Tensor, half: float) -> Vector:
    """Where a ray enters and leaves |p| <= half, and the reciprocal direction."""
    inverse = direction.reciprocal()
    a, b = inverse * (-origin - half), inverse * (-origin + half)
    return torch.minimum(a, b), torch.maximum(a, b), inverse


def _hit_interval(enter: Tensor, leave: Tensor) -> Tensor:
    """Depth of entry, infinite for an empty interval."""
    return enter.masked_fill_(enter > leave, torch.inf)


def _hit_box(rays: LocalRays, half: tuple[float, float, float]) -> Tensor:
    enter, leave, _ = _slab(rays.origin[0], rays.direction[0], half[0])
    for axis in (1, 2):
        a, b, _ = _slab(rays.origin[axis], rays.direction[axis], half[axis])
        enter, leave = torch.maximum(enter, a), torch.minimum(leave, b)
    return _hit_interval(enter, leave)


def _hit_round(rays: LocalRays, axes: tuple[int, ...], radius: float) -> tuple[Tensor, Tensor]:
    """Enter and leave a sphere (three axes) or an endless cylinder (two).

        t = -(o.d) / (d.d) -+ sqrt((r^2 - |o + t_mid d|^2) / (d.d))

    The nearest point of the line is formed first: o.o - r^2 would cancel. NaN where missed.
    """
    squared = sum((rays.direction[i].square() for i in axes[1:]), rays.direction[axes[0]].square())
    along = sum(
        (rays.direction[i] * rays.origin[i] for i in axes[1:]),
        rays.direction[axes[0]] * rays.origin[axes[0]],
    )
    middle = -along / squared
    rest = torch.full_like(middle, radius * radius)
    for i in axes:
        rest -= (middle * rays.direction[i]).add_(rays.origin[i]).square_()
    reach = (rest / squared).sqrt_()
    return middle - reach, middle + reach


def _hit_cylinder(rays: LocalRays, half: tuple[float, float, float]) -> Tensor:
    enter, leave = _hit_round(rays, (0, 1), half[0])
    a, b, _ = _slab(rays.origin[2], rays.direction[2], half[2])
    # a NaN of the round part survives both, and compares as no hit
    return _hit_interval(torch.maximum(enter, a), torch.minimum(leave, b))


def intersect(rays: LocalRays, shape: Shape, half: tuple[float, float, float]) -> Tensor:
    """Depth at which rays enter a solid; infinite or NaN where they miss, may be negative."""
    if shape is Shape.BOX:
        return _hit_box(rays, half)
    if shape is Shape.SPHERE:
        return _hit_round(rays, (0, 1, 2), half[0])[0]
    if shape is Shape.CYLINDER:
        return _hit_cylinder(rays, half)
    return -rays.origin[2] / rays.direction[2]


@dataclass(frozen=True)
class Hits:
    """First hits of a strip: depth (infinite on sky), index of the solid, and each one's tiles."""

    depth_m: Tensor
    index: Tensor
    tiles: tuple[Tensor, ...]


def trace(rays: Rays, solids: tuple[PlacedPart, ...], bounds: tuple[Bounds, ...]) -> Hits:
    """Find the first hit of every ray.

    Args:
        rays: of the strip.
        solids: what they may hit.
        bounds: of each solid, by `project_bounds`.
    """
    depth = torch.full_like(rays.x, torch.inf)
    index = torch.full(rays.x.shape, NOTHING, dtype=torch.int32)
    touched = tuple(find_touched_tiles(rays, part) for part in bounds)
    for number, (solid, tiles) in enumerate(zip(solids, touched, strict=True)):
        if not len(tiles):
            continue
        x, y = rays.x.index_select(0, tiles), rays.y.index_select(0, tiles)
        depths = intersect(local_rays(rays, x, y, solid), solid.part.shape, solid.part.half_m)
        before = depth.index_select(0, tiles)
        closer = (depths > NEAR_M) & (depths < before) & (depths < FAR_M)
        depth.index_copy_(0, tiles, torch.where(closer, depths, before))
        index.index_copy_(0, tiles, index.index_select(0, tiles).masked_fill_(closer, number))
    return Hits(depth, index, touched)
