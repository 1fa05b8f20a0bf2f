"""What a hit shows: normals, texture coordinates and material, in compact vectors of pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.synth.placement import PlacedPart
from rtsr_cli.core.synth.rays import Hits, LocalRays, Rays, local_rays
from rtsr_cli.core.synth.scene import Material, Part, Shape
from rtsr_cli.core.synth.textures import TEXELS, bake_texture, look_up
from rtsr_cli.core.synth.vector_math import Vector, dot, unit_vector

TEXTURE_WIDTH = 2048
"""Image width at whose pixels textures are matched, whatever the size of the frame: a level that
followed the frame's own pixels would make its samples differ from those of another resolution."""

MIN_COSINE = 0.04
"""Normal maps turn a normal no further away from the camera than this cosine."""

NORMAL, GEONORMAL, ALBEDO, EMISSION = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
ROUGHNESS, METALLIC, OBJECT_ID = 12, 13, 14
CHANNELS = 15
"""Rows of what `shade_surfaces` returns."""


@dataclass(frozen=True)
class SurfaceChart:
    """Local frame of a surface at some points: unit normal and tangents, texture coordinates (m).

    `periods` are the periods of the pattern around a round solid, None where u is a length.
    """

    normal: Vector
    along_u: Vector
    along_v: Vector
    u: Tensor
    v: Tensor
    around_m: float | None = None


def _plane_chart(point: Vector) -> SurfaceChart:
    one, zero = torch.ones_like(point[0]), torch.zeros_like(point[0])
    return SurfaceChart((zero, zero, one), (one, zero, zero), (zero, one, zero), point[0], point[1])


def _box_chart(point: Vector, half: tuple[float, float, float]) -> SurfaceChart:
    """The face is the one whose plane is nearest."""
    x, y, z = point
    over_x, over_y, over_z = (p.abs() - h for p, h in zip(point, half, strict=True))
    on_x = (over_x >= over_y) & (over_x >= over_z)
    on_y = ~on_x & (over_y >= over_z)
    fx, fy = on_x.float(), on_y.float()
    fz = 1.0 - fx - fy
    zero, side = torch.zeros_like(x), (fx * x.sign()).sub_(fy * y.sign()).add_(fz)
    # on the sides u runs to the right for who looks at them, so that writing can be read
    return SurfaceChart(
        (fx * x.sign(), fy * y.sign(), fz * z.sign()),
        (side * (1.0 - fx), side * fx, zero),
        (zero, fz, 1.0 - fz),
        torch.where(on_x, y, x) * side,
        y * fz + z * (1.0 - fz),
    )


def _sphere_chart(point: Vector, radius: float) -> SurfaceChart:
    """u around the equator, v along the meridian."""
    x, y, z = point
    ring = torch.hypot(x, y).clamp_(min=1e-6)
    length = torch.hypot(ring, z)
    normal = (x / length, y / length, z / length)
    east = (-y / ring, x / ring, torch.zeros_like(x))
    north = (-normal[2] * x / ring, -normal[2] * y / ring, ring / length)
    longitude, latitude = torch.atan2(y, x), torch.asin(normal[2].clamp(-1.0, 1.0))
    around = 2.0 * math.pi * radius
    return SurfaceChart(normal, east, north, longitude * radius, latitude * radius, around)


def _cylinder_chart(point: Vector, radius: float, half_length: float) -> SurfaceChart:
    x, y, z = point
    ring = torch.hypot(x, y).clamp_(min=1e-6)
    cap = (z.abs() - half_length >= ring - radius).float()
    side = 1.0 - cap
    normal = (side * x / ring, side * y / ring, cap * z.sign())
    east = (cap - side * y / ring, side * x / ring, torch.zeros_like(x))
    up = (torch.zeros_like(x), cap, side)
    longitude = torch.atan2(y, x)
    return SurfaceChart(
        normal,
        east,
        up,
        cap * x + side * longitude * radius,
        cap * y + side * z,
        2.0 * math.pi * radius,
    )


def chart_surface(point: Vector, part: Part) -> SurfaceChart:
    """Normal, tangents and texture coordinates of local points on a solid's surface."""
    if part.shape is Shape.BOX:
        return _box_chart(point, part.half_m)
    if part.shape is Shape.SPHERE:
        return _sphere_chart(point, part.half_m[0])
    if part.shape is Shape.CYLINDER:
        return _cylinder_chart(point, part.half_m[0], part.half_m[2])
    return _plane_chart(point)


def _turn_to_camera(normal: Vector, to_eye: Vector) -> Vector:
    """Turn normals towards the camera until their cosine is `MIN_COSINE`."""
    missing = (MIN_COSINE - dot(normal, to_eye)).clamp_(min=0.0)
    x, y, z = (torch.addcmul(n, missing, e) for n, e in zip(normal, to_eye, strict=True))
    return unit_vector((x, y, z))


def _sample_textures(surface: SurfaceChart, material: Material, pixel_m: Tensor) -> Tensor:
    """Texture values (points, 4) at charted points; `pixel_m` is the width of a pixel there."""
    period_u = period_v = material.size_m
    if surface.around_m is not None:
        # a whole number of periods around, so that the pattern has no seam
        period_u = surface.around_m / max(1, round(surface.around_m / material.size_m))
    level = (pixel_m * (TEXELS / material.size_m)).log2_()
    u = surface.u * (1.0 / period_u) + material.shift[0]
    v = surface.v * (1.0 / period_v) + material.shift[1]
    return look_up(bake_texture(material.pattern), u, v, level)


def _apply_material(out: Tensor, material: Material, mask: Tensor, tone: Tensor) -> None:
    """Write what a material makes of mask and tone into the rows of `out`."""
    brightness = torch.exp2(tone * material.tone)
    for row, (a, b) in enumerate(zip(*material.colors, strict=True)):
        out[ALBEDO][row] = ((mask * (b - a)).add_(a) * brightness).clamp_(0.0, 0.95)
    low, high = material.roughness
    wear = (tone * (0.3 * material.tone)).add_(1.0)
    out[ROUGHNESS] = ((mask * (high - low)).add_(low) * wear).clamp_(0.08, 1.0)
    low, high = material.metallic
    out[METALLIC] = (mask * (high - low)).add_(low).clamp_(0.0, 1.0)
    for row, glow in enumerate(material.glow):
        out[EMISSION][row] = mask * glow


def _shade_solid(rays: LocalRays, depth: Tensor, solid: PlacedPart, pixel: float) -> Tensor:
    """Rows of `shade_surfaces` for the pixels that see one solid."""
    part, material = solid.part, solid.part.material
    x, y, z = (
        torch.addcmul(torch.full_like(depth, o), d, depth)
        for o, d in zip(rays.origin, rays.direction, strict=True)
    )
    surface = chart_surface((x, y, z), part)
    dx, dy, dz = rays.direction
    to_eye = unit_vector((-dx, -dy, -dz))
    cosine = dot(surface.normal, to_eye).clamp_(min=0.02)
    mask, tone, slope_u, slope_v = _sample_textures(
        surface, material, depth * pixel * cosine.rsqrt()
    ).unbind(1)
    bumped = tuple(
        n - (slope_u * a + slope_v * b) * material.bump
        for n, a, b in zip(surface.normal, surface.along_u, surface.along_v, strict=True)
    )
    normal = _turn_to_camera(unit_vector((bumped[0], bumped[1], bumped[2])), to_eye)
    out = torch.empty(CHANNELS, len(depth))
    axes = torch.from_numpy(solid.axes).float()
    out[NORMAL] = torch.einsum("ij,in->jn", axes, torch.stack(normal))
    out[GEONORMAL] = torch.einsum("ij,in->jn", axes, torch.stack(surface.normal))
    _apply_material(out, material, mask, tone)
    out[OBJECT_ID] = float(solid.body.object_id)
    return out


def shade_surfaces(rays: Rays, hits: Hits, solids: tuple[PlacedPart, ...], pixel: float) -> Tensor:
    """Material and normals of every pixel, (`CHANNELS`, tiles, pixels of a tile); 0 on sky.

    Args:
        rays, hits: of the strip.
        solids: what the hits' indices refer to.
        pixel: width of a texture-matched pixel at a depth of 1 m.
    """
    out = torch.zeros(CHANNELS, rays.x.numel())
    flat_x, flat_y, flat_depth = rays.x.view(-1), rays.y.view(-1), hits.depth_m.view(-1)
    side = rays.x.shape[1]
    for number, (solid, tiles) in enumerate(zip(solids, hits.tiles, strict=True)):
        if not len(tiles):
            continue
        tile, within = (hits.index.index_select(0, tiles) == number).nonzero(as_tuple=True)
        if not len(tile):
            continue
        pixels = tiles.index_select(0, tile) * side + within
        local = local_rays(
            rays, flat_x.index_select(0, pixels), flat_y.index_select(0, pixels), solid
        )
        depth = flat_depth.index_select(0, pixels)
        out.index_copy_(1, pixels, _shade_solid(local, depth, solid, pixel))
    return out.view(CHANNELS, *rays.x.shape)
