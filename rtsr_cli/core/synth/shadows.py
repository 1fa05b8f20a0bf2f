"""Shadows of convex solids in closed form.

The shadow volume of a convex polyhedron is convex: it is bounded by the planes through the light
and the silhouette edges, and by the faces that the light sees. A point lies in it if it is on the
inner side of all of them, so that no ray is traced. The signed distance from the silhouette planes,
against the width that a light of some size blurs the edge to, gives the penumbra.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.synth.placing import Placed
from rtsr_cli.core.synth.rays import Vector
from rtsr_cli.core.synth.scene import Shape

Array = NDArray[np.float64]

CYLINDER_SIDES = 12
"""Sides of the prism that stands for a cylinder when it casts a shadow."""

THIN_RADIUS_M = 0.05
THIN_SIDES = 6
"""Cylinders below that radius make do with fewer."""

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


def polyhedron(solid: Placed) -> Solid:
    """The solid in world space; spheres by their bounding box."""
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
        sphere: centre and radius of a sphere, None for a polyhedron.
    """

    number: int
    silhouette: Array
    facing: Array
    averted: Array
    spread: float
    reach_m: float
    sphere: tuple[Array, float] | None = None

    def touched(self, lower: Array, upper: Array) -> NDArray[np.intp]:
        """Boxes, by their lower and upper corners (boxes, 3), that the shadow may reach."""
        margin = self.spread * self.reach_m + MIN_BLUR_M
        planes = np.concatenate([self.silhouette, self.facing])
        limits = np.concatenate([np.full(len(self.silhouette), margin), np.zeros(len(self.facing))])
        normal = planes[:, None, :3]
        least = np.minimum(normal * lower, normal * upper).sum(2) + planes[:, 3:]
        return np.flatnonzero((least <= limits[:, None]).all(0))


def shadow_hull(
    number: int, solid: Placed, light: Array, *, softness: float, reach_m: float
) -> Hull | None:
    """Shadow volume of a solid, None where the light is inside it.

    Args:
        number: index of the solid.
        solid: what casts the shadow.
        light: homogeneous position, (direction, 0) for a sun.
        softness: radius of the light, m; of a sun the tangent of its angular radius.
        reach_m: distance beyond the solid up to which blur grows.
    """
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
    spread = softness
    if light[3]:
        spread = softness / max(0.1, float(np.linalg.norm(solid.centre - light[:3])))
    is_sphere = solid.part.shape is Shape.SPHERE
    return Hull(
        number=number,
        silhouette=np.column_stack([normals, offsets]) * signs[:, None],
        facing=shape.planes[seen],
        averted=shape.planes[~seen],
        spread=spread,
        reach_m=reach_m,
        sphere=(solid.centre, solid.part.half_m[0]) if is_sphere else None,
    )


def _largest(planes: Array, point: Vector) -> Tensor:
    """Largest signed distance of points from planes."""
    result: Tensor | None = None
    for x, y, z, offset in planes.tolist():
        value = (point[0] * x).add_(point[1], alpha=y).add_(point[2], alpha=z).add_(offset)
        result = value if result is None else torch.maximum(result, value, out=result)
    assert result is not None
    return result


def _smooth(signed: Tensor, blur: Tensor) -> Tensor:
    """0 inside, 1 outside, a smooth step over -blur..blur."""
    share = (signed / blur).mul_(0.5).add_(0.5).clamp_(0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _lit_by_sphere(hull: Hull, light: Array, point: Vector) -> Tensor:
    """Share of the light that passes a sphere: distance of its centre from the ray, by blur."""
    assert hull.sphere is not None
    centre, radius = hull.sphere
    from_point = [c - p for c, p in zip(centre.tolist(), point, strict=True)]
    if light[3]:
        ray = [p - float(origin) for p, origin in zip(point, light, strict=False)]
        length = (ray[0].square() + ray[1].square() + ray[2].square()).sqrt_().clamp_(min=1e-3)
        towards = [-r / length for r in ray]
    else:
        length = torch.full_like(point[0], torch.inf)
        towards = [torch.full_like(point[0], float(v)) for v in light[:3]]
    ahead = sum((f * t for f, t in zip(from_point, towards, strict=True)), torch.zeros(()))
    missed = sum(
        ((f - t * ahead).square() for f, t in zip(from_point, towards, strict=True)),
        torch.zeros(()),
    ).sqrt()
    blur = ahead.clamp(0.0, hull.reach_m) * hull.spread + MIN_BLUR_M
    lit = _smooth(missed - radius, blur)
    return torch.where((ahead > 0) & (ahead < length), lit, torch.ones_like(lit))


def lit_share(hull: Hull, light: Array, point: Vector) -> Tensor:
    """Share of the light that reaches points past one solid, 0..1."""
    if hull.sphere is not None:
        return _lit_by_sphere(hull, light, point)
    beyond = _largest(hull.averted, point).clamp_(0.0, hull.reach_m)
    lit = _smooth(_largest(hull.silhouette, point), beyond.mul_(hull.spread).add_(MIN_BLUR_M))
    return torch.maximum(lit, _largest(hull.facing, point).mul_(500.0).clamp_(0.0, 1.0))
