"""Shadows of convex solids in closed form.

The shadow volume of a convex polyhedron is convex: it is bounded by the planes through the light
and the silhouette edges, and by the faces that the light sees. A point lies in it if it is on the
inner side of all of them, so that no ray is traced. The signed distance from the silhouette planes,
against the width that a light of some size blurs the edge to, gives the penumbra.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.synth.placement import PlacedPart
from rtsr_cli.core.synth.scene import Shape
from rtsr_cli.core.synth.vector_math import Vector, dot

Array = NDArray[np.float64]

CYLINDER_SIDES = 12
"""Sides of the prism that stands for a cylinder when it casts a shadow."""

THIN_RADIUS_M = 0.05
THIN_SIDES = 6
"""Cylinders below that radius make do with fewer."""

ON_FACE_M = 1e-3
"""Points less than half of that below the plane of a face which the light sees are not in its
shadow: they lie on the face, or on another one in the same plane. Below all of it, they are."""

MIN_BLUR_M = 0.002
"""Half width of the sharpest shadow edge."""


@dataclass(frozen=True)
class Solid:
    """A convex polyhedron: corners, outward planes (n, c) with n . p + c = 0, and edges.

    `edges` are (corner, corner, face, face).
    """

    corners: Array
    planes: Array
    edges: NDArray[np.intp]


@functools.cache
def _prism(sides: int) -> tuple[Array, NDArray[np.intp], tuple[tuple[int, ...], ...]]:
    """Corners, edges and three corners a face of an upright prism around a unit cylinder.

    With four sides it is the cube of half extent 1.
    """
    angles = (np.arange(sides) + 0.5) * (2.0 * math.pi / sides)
    reach = 1.0 / math.cos(math.pi / sides)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) * reach
    low = np.concatenate([ring, np.full((sides, 1), -1.0)], axis=1)
    high = np.concatenate([ring, np.full((sides, 1), 1.0)], axis=1)
    edges = []
    for i in range(sides):
        after = (i + 1) % sides
        edges += [
            (i, after, i, sides),
            (sides + i, sides + after, i, sides + 1),
            (after, sides + after, i, after),
        ]
    faces = (
        *((i, (i + 1) % sides, sides + i) for i in range(sides)),
        (1, 0, 2),
        (sides, sides + 1, sides + 2),
    )
    return np.concatenate([low, high]), np.array(edges), faces


def polyhedron(solid: PlacedPart) -> Solid:
    """A box or a cylinder in world space."""
    half = np.array(solid.part.half_m)
    sides = 4
    if solid.part.shape is Shape.CYLINDER:
        sides = THIN_SIDES if half[0] < THIN_RADIUS_M else CYLINDER_SIDES
    unit_corners, edges, faces = _prism(sides)
    corners = unit_corners * half @ solid.axes + solid.centre
    planes = np.empty((len(faces), 4))
    for row, face in enumerate(faces):
        a, b, c = corners[list(face)]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        offset = -normal @ a
        sign = -1.0 if normal @ solid.centre + offset > 0 else 1.0
        planes[row] = (*(sign * normal), sign * offset)
    return Solid(corners, planes, edges)


@dataclass(frozen=True)
class Hull:
    """Shadow volume of one solid under one light, as planes (n, c).

    Attributes:
        number: index of the solid.
        silhouette: inner side negative; the signed distance is metric.
        facing: faces that the light sees, inner side negative.
        averted: faces that it does not see; positive beyond them.
        spread: blur per metre beyond the solid.
        reach_m: distance beyond the solid up to which blur grows.
        sphere: centre and radius of a sphere, None for a polyhedron; its planes only enclose it.
    """

    number: int
    silhouette: Array
    facing: Array
    averted: Array
    spread: float
    reach_m: float
    sphere: tuple[Array, float] | None = None


@dataclass(frozen=True)
class Hulls:
    """Shadow volumes under one light, with all their planes together for quick rejection.

    Attributes:
        hulls: one by one.
        planes: (hulls, planes, 4), those of a hull repeated up to the largest number.
        limits: (hulls, planes): points wholly beyond a plane by more are out of reach.
    """

    hulls: tuple[Hull, ...]
    planes: Tensor
    limits: Tensor

    def find_touched(self, lower: Tensor, upper: Tensor) -> Tensor:
        """Which shadow (rows) may reach which box, by lower and upper corners (3, boxes).

        The least value of n . p + c over a box is that of its centre less |n| . half extent.
        """
        centre, half = (upper + lower) / 2, (upper - lower) / 2
        flat = self.planes.flatten(0, 1)
        normals = flat[:, :3]
        least = torch.addmm(flat[:, 3:], normals, centre) - normals.abs() @ half
        beyond = least.view(*self.limits.shape, -1) - self.limits[..., None]
        return beyond.amax(1) <= 0


def join_hulls(hulls: Iterable[Hull]) -> Hulls:
    """Collect shadow volumes."""
    kept = tuple(hulls)
    most = max((len(h.silhouette) + len(h.facing) for h in kept), default=1)
    planes, limits = np.zeros((len(kept), most, 4)), np.zeros((len(kept), most))
    for row, hull in enumerate(kept):
        rim, rest = len(hull.silhouette), most - len(hull.silhouette)
        planes[row, :rim] = hull.silhouette
        limits[row, :rim] = hull.spread * hull.reach_m + MIN_BLUR_M
        planes[row, rim:] = np.resize(hull.facing, (rest, 4))
        limits[row, rim:] = -0.5 * ON_FACE_M
    return Hulls(kept, torch.from_numpy(planes).float(), torch.from_numpy(limits).float())


def make_shadow_hull(
    number: int, solid: PlacedPart, light: Array, *, softness: float, reach_m: float
) -> Hull | None:
    """Shadow volume of a solid, None where the light is inside it.

    Args:
        number: index of the solid.
        solid: what casts the shadow.
        light: homogeneous position, (direction, 0) for a sun.
        softness: radius of the light, m; of a sun the tangent of its angular radius.
        reach_m: distance beyond the solid up to which blur grows.
    """
    spread = softness
    if light[3]:
        spread = softness / max(0.1, float(np.linalg.norm(solid.centre - light[:3])))
    if solid.part.shape is Shape.SPHERE:
        return _sphere_hull(number, solid, light, spread=spread, reach_m=reach_m)
    shape = polyhedron(solid)
    seen = shape.planes @ light > 0
    if not seen.any():
        return None
    a, b, face, other = shape.edges.T
    rim = seen[face] != seen[other]
    start, end = shape.corners[a[rim]], shape.corners[b[rim]]
    normals = np.cross(end - start, light[:3] - light[3] * start)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = -(normals * start).sum(1)
    signs = np.where(normals @ solid.centre + offsets > 0, -1.0, 1.0)
    return Hull(
        number=number,
        silhouette=np.column_stack([normals, offsets]) * signs[:, None],
        facing=shape.planes[seen],
        averted=shape.planes[~seen],
        spread=spread,
        reach_m=reach_m,
    )


def _sphere_hull(
    number: int, solid: PlacedPart, light: Array, *, spread: float, reach_m: float
) -> Hull | None:
    """Shadow volume of a sphere; the planes touch it and enclose the shadow.

    Four planes go through the light, tilted from its axis by asin(radius / distance).
    """
    radius = solid.part.half_m[0]
    towards = light[:3] - light[3] * solid.centre
    distance = float(np.linalg.norm(towards))
    if light[3] and distance <= radius:
        return None
    towards = towards / distance
    side = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    side /= np.linalg.norm(side)
    across = np.cross(towards, side)
    sine = radius / distance if light[3] else 0.0
    around = np.stack([side, -side, across, -across])
    normals = np.concatenate([math.sqrt(1.0 - sine * sine) * around + sine * towards, [towards]])
    planes = np.column_stack([normals, -(normals @ solid.centre) - radius])
    return Hull(
        number=number,
        silhouette=planes[:4],
        facing=planes[4:],
        averted=np.empty((0, 4)),
        spread=spread,
        reach_m=reach_m,
        sphere=(solid.centre, radius),
    )


def _largest(planes: Array, point: Tensor) -> Tensor:
    """Largest signed distance of points (4, n), homogeneous, from planes."""
    return (torch.from_numpy(planes).float() @ point).amax(0)


def _smooth(signed: Tensor, blur: Tensor) -> Tensor:
    """0 inside, 1 outside, a smooth step over -blur..blur."""
    share = (signed / blur).mul_(0.5).add_(0.5).clamp_(0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _lit_by_sphere(hull: Hull, light: Array, point: Vector) -> Tensor:
    """Share of the light that passes a sphere, by the distance of its centre from the ray.

    The distance, taken where the ray passes the sphere, is projected from a near light to the
    point, as the distance from a silhouette plane is.
    """
    assert hull.sphere is not None
    centre, radius = hull.sphere
    cx, cy, cz = (c - p for c, p in zip(centre.tolist(), point, strict=True))
    if light[3]:
        lx, ly, lz = (float(v) - p for v, p in zip(light[:3], point, strict=True))
        length = dot((lx, ly, lz), (lx, ly, lz)).sqrt_().clamp_(min=1e-3)
        inverse = length.reciprocal()
        lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
    else:
        lx, ly, lz = (torch.full_like(cx, float(v)) for v in light[:3])
        length = torch.full_like(cx, torch.inf)
    ahead = dot((cx, cy, cz), (lx, ly, lz))
    mx, my, mz = cx - lx * ahead, cy - ly * ahead, cz - lz * ahead
    signed = dot((mx, my, mz), (mx, my, mz)).sqrt_() - radius
    if light[3]:
        signed *= length / (length - ahead).clamp_(min=1e-3)
    lit = _smooth(signed, ahead.clamp(0.0, hull.reach_m).mul_(hull.spread).add_(MIN_BLUR_M))
    return torch.where((ahead > 0) & (ahead < length), lit, torch.ones_like(lit))


def lit_share(hull: Hull, light: Array, point: Tensor) -> Tensor:
    """Share of the light that reaches points (4, n), homogeneous, past one solid; 0..1."""
    if hull.sphere is not None:
        return _lit_by_sphere(hull, light, (point[0], point[1], point[2]))
    beyond = _largest(hull.averted, point).clamp_(0.0, hull.reach_m)
    lit = _smooth(_largest(hull.silhouette, point), beyond.mul_(hull.spread).add_(MIN_BLUR_M))
    before = _largest(hull.facing, point).add_(ON_FACE_M).mul_(2.0 / ON_FACE_M).clamp_(0.0, 1.0)
    return torch.maximum(lit, before)
