"""Radiance of surfaces and sky.

    L = emission + sum over lights of V E (f_d + f_s) (n.l) + ambient
    f_d = (1 - metallic) albedo / pi,    f_s = D V F              [Burley 2012, Walter et al. 2007]

GGX with alpha = roughness^2, Schlick's Fresnel, Schlick-GGX visibility with k = alpha / 2. Ambient
light is the sky's, by the direction of the normal (diffuse) and of the reflected ray (specular,
with the split sum of `brdf_lut`), darkened where solids cover the zenith.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.imaging.brdf_lut import integrate_lut, sample_lut
from rtsr_cli.core.synth.scene import Light, Pattern, Sky, Vec3
from rtsr_cli.core.synth.shadows import Hulls, lit_share
from rtsr_cli.core.synth.surfaces import (
    ALBEDO,
    GEONORMAL,
    METALLIC,
    NORMAL,
    ROUGHNESS,
)
from rtsr_cli.core.synth.textures import bake_texture, look_up
from rtsr_cli.core.synth.vector_math import Vector, dot, unit_vector

DIELECTRIC_F0 = 0.04
"""Reflectance of a dielectric at normal incidence [Karis 2013]."""

LUT_SIZE, LUT_SAMPLES = 64, 64
"""A coarse split-sum table will do: it lights the scene, nothing is divided by it."""

COVERED = 0.30
"""Ambient light left where the zenith is wholly covered."""

CORNER_M = 0.5
CORNER_DARKENING = 0.35
"""Ambient light falls by that share towards the walls of a room, over that distance."""

CLOUD_LEVEL = 3.0
"""Level of the texture that clouds are taken from: they have no fine grain."""

CLOUD_HEIGHT = 0.12
"""Clouds lie on a plane seen at elevations from 0; added to the elevation's sine."""

SUN_DISC_COS = 0.99985
"""Cosine of the sun's angular radius, about 1 degree."""

SUN_DISC = 8.0
"""Radiance of the sun's disc in units of its glow."""


@dataclass(frozen=True)
class FrameLight:
    """A light at one frame.

    Attributes:
        light: what it is.
        position: homogeneous, (direction, 0) for a sun.
        hulls: what may shade it.
    """

    light: Light
    position: NDArray[np.float64]
    hulls: Hulls


@dataclass(frozen=True)
class SurfacePoints:
    """Surface points of some tiles, each value (tiles, pixels of a tile).

    Attributes:
        rows: what `shade_surfaces` returned.
        position: world space.
        to_eye: unit vectors.
        index: solid of each.
    """

    rows: Tensor
    position: Vector
    to_eye: Vector
    index: Tensor

    def vector(self, rows: slice) -> Vector:
        """Three rows as a vector."""
        x, y, z = self.rows[rows].unbind(0)
        return x, y, z

    def tiles(self, chosen: Tensor) -> SurfacePoints:
        """Return some of the tiles."""
        px, py, pz = (p.index_select(0, chosen) for p in self.position)
        ex, ey, ez = (p.index_select(0, chosen) for p in self.to_eye)
        rows, index = self.rows.index_select(1, chosen), self.index.index_select(0, chosen)
        return SurfacePoints(rows, (px, py, pz), (ex, ey, ez), index)


@functools.cache
def _split_sum() -> Tensor:
    return integrate_lut(LUT_SIZE, LUT_SAMPLES)


def blend(low: float, high: float, value: Tensor) -> Tensor:
    """Smooth step from 0 at `low` to 1 at `high`."""
    share = ((value - low) * (1.0 / (high - low))).clamp_(0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def trace_shadows(points: SurfacePoints, hulls: Hulls, light: NDArray[np.float64]) -> Tensor:
    """Share of a light that reaches each point; a convex solid does not shade itself."""
    lit = torch.ones_like(points.position[0])
    if not hulls.hulls:
        return lit
    homogeneous = torch.stack([*points.position, torch.ones_like(lit)])
    touched = hulls.find_touched(homogeneous[:3].amin(2), homogeneous[:3].amax(2))
    for number in touched.any(1).nonzero()[:, 0].tolist():
        hull, tiles = hulls.hulls[number], touched[number].nonzero()[:, 0]
        some = homogeneous.index_select(1, tiles)
        own = (points.index.index_select(0, tiles) == hull.number).float()
        share = torch.maximum(lit_share(hull, light, some.flatten(1)).view_as(own), own)
        lit.index_copy_(0, tiles, share.mul_(lit.index_select(0, tiles)))
    return lit


def _find_light(points: SurfacePoints, lighting: FrameLight) -> tuple[Vector, Tensor]:
    """Unit vector to the light, and the share of its colour that arrives unshaded."""
    light, position = lighting.light, lighting.position
    if light.distant:
        x, y, z = (
            torch.full_like(points.index, float(v), dtype=torch.float32) for v in position[:3]
        )
        return (x, y, z), torch.ones_like(x)
    x, y, z = (float(origin) - p for origin, p in zip(position[:3], points.position, strict=True))
    squared = dot((x, y, z), (x, y, z)).clamp_(min=light.softness**2 + 1e-4)
    towards = unit_vector((x, y, z))
    # inverse square, brought smoothly to zero at the light's reach
    window = (1.0 - (squared * (1.0 / light.reach_m**2)).square_()).clamp_(min=0.0).square_()
    strength = window / squared
    if light.aim_m is not None:
        axis = np.array(light.aim_m) - position[:3]
        ax, ay, az = (axis / np.linalg.norm(axis)).tolist()
        cosine = -(towards[0] * ax + towards[1] * ay + towards[2] * az)
        inner, outer = light.cone_cos
        strength = strength * blend(outer, inner, cosine)
    return towards, strength


def _reflect_light(
    points: SurfacePoints, towards: Vector, facing: Tensor, nov: Tensor, softness: float
) -> Tensor:
    """Diffuse and specular response (3, ...) times n.l, of a unit irradiance."""
    rows = points.rows
    lov = dot(towards, points.to_eye)
    half_squared = (2.0 + 2.0 * lov).clamp_(min=1e-4)
    noh = ((facing + nov).square() / half_squared).clamp_(max=1.0)
    alpha = rows[ROUGHNESS].square()
    wide = (alpha + 0.5 * softness).clamp_(max=1.0)
    squared = wide.square()
    slope = noh * (squared - 1.0) + 1.0
    distribution = squared / (slope.square() * math.pi)
    k = alpha * 0.5
    view = nov * (1.0 - k) + k
    incident = facing * (1.0 - k) + k
    lobe = distribution / (4.0 * view * incident)
    fresnel = (1.0 - (half_squared * 0.25).sqrt().clamp_(max=1.0)).pow(5)
    metallic = rows[METALLIC]
    diffuse = (1.0 - metallic) * (1.0 / math.pi)
    out = torch.empty_like(rows[ALBEDO])
    for channel, albedo in zip(out, rows[ALBEDO], strict=True):
        f0 = (albedo - DIELECTRIC_F0) * metallic + DIELECTRIC_F0
        f = (1.0 - f0) * fresnel + f0
        torch.addcmul(albedo * diffuse, f, lobe, out=channel)
        channel *= facing
    return out


def shade_direct(points: SurfacePoints, lighting: FrameLight, nov: Tensor) -> Tensor:
    """Radiance (3, ...) that one light causes."""
    towards, strength = _find_light(points, lighting)
    facing = dot(points.vector(NORMAL), towards).clamp_(0.0, 1.0)
    # a normal map must not light a face that is turned away
    above = (dot(points.vector(GEONORMAL), towards) * 12.0).clamp_(0.0, 1.0)
    strength = strength * above
    out = torch.zeros_like(points.rows[ALBEDO])
    chosen = ((strength * facing) > 0).any(1).nonzero()[:, 0]
    if not len(chosen):
        return out
    some = points.tiles(chosen)
    strength = strength.index_select(0, chosen)
    strength = strength * trace_shadows(some, lighting.hulls, lighting.position)
    tx, ty, tz = (t.index_select(0, chosen) for t in towards)
    softness = lighting.light.softness * (1.0 if lighting.light.distant else 0.25)
    response = _reflect_light(
        some, (tx, ty, tz), facing.index_select(0, chosen), nov.index_select(0, chosen), softness
    )
    for channel, lit, color in zip(out, response, lighting.light.color, strict=True):
        channel.index_copy_(0, chosen, lit.mul_(strength).mul_(color))
    return out


def _sky_gradient(sky: Sky, up: Tensor, blur: Tensor | float) -> Tensor:
    """Radiance (3, ...) by the sine of the elevation; the horizon is blurred."""
    above = (up / (0.35 + blur)).clamp(0.0, 1.0)
    below = (-up / (0.06 + blur)).clamp(0.0, 1.0)
    above = above * (2.0 - above)
    out = torch.empty(3, *up.shape)
    for channel, (zenith, horizon, ground) in zip(
        out, zip(sky.zenith, sky.horizon, sky.ground, strict=True), strict=True
    ):
        channel.copy_(horizon + above * (zenith - horizon) + below * (ground - horizon))
    return out


def shade_ambient(points: SurfacePoints, sky: Sky, nov: Tensor, open_share: Tensor) -> Tensor:
    """Radiance (3, ...) by the light of all directions.

    Args:
        points: where.
        sky: what shines.
        nov: cosine of view and normal.
        open_share: share of it that is not covered, 0..1.
    """
    rows = points.rows
    roughness, metallic = rows[ROUGHNESS], rows[METALLIC]
    normal_z = rows[NORMAL][2]
    irradiance = _sky_gradient(sky, normal_z * 0.5, 0.6)
    mirrored = 2.0 * nov * normal_z - points.to_eye[2]
    reflected = _sky_gradient(sky, mirrored, roughness * 0.8)
    terms = sample_lut(_split_sum(), nov[None, None], roughness[None, None])[0]
    out = torch.empty_like(rows[ALBEDO])
    strength = open_share * sky.ambient
    for channel, albedo, diffuse, glossy in zip(
        out, rows[ALBEDO], irradiance, reflected, strict=True
    ):
        f0 = (albedo - DIELECTRIC_F0) * metallic + DIELECTRIC_F0
        specular = (f0 * terms[0] + terms[1]) * glossy
        torch.addcmul(specular, albedo * (1.0 - metallic), diffuse, out=channel)
        channel *= strength
    return out


def corner_share(position: Vector, room: tuple[Vec3, Vec3]) -> Tensor:
    """Ambient light that is left near the walls of a room."""
    share = torch.ones_like(position[0])
    for p, low, high in zip(position, *room, strict=True):
        for distance in (p - low, high - p):
            share *= 1.0 - CORNER_DARKENING * torch.exp(distance.clamp(min=0.0) * (-1 / CORNER_M))
    return share


def sky_radiance(sky: Sky, direction: Vector, sun: Vec3 | None) -> Tensor:
    """Radiance (3, ...) of unit directions: gradient, clouds, glow and disc of the sun."""
    up = direction[2]
    out = _sky_gradient(sky, up, 0.0)
    if sky.clouds > 0:
        plane = (1.0 / (up.clamp(min=0.0) + CLOUD_HEIGHT)).mul_(0.09)
        level = torch.full_like(up, CLOUD_LEVEL)
        values = look_up(
            bake_texture(Pattern.PLASTER),
            (direction[0] * plane).flatten(),
            (direction[1] * plane).flatten(),
            level.flatten(),
        )
        cover = blend(-0.2, 1.2, values[:, 1] * 1.2 + values[:, 0]).view_as(up)
        cover *= blend(0.0, 0.15, up) * sky.clouds
        out += (1.15 * max(sky.horizon) - out) * cover
    if sun is not None:
        cosine = dot(direction, tuple(torch.full_like(up, s) for s in sun)).clamp_(0.0, 1.0)  # type: ignore[arg-type]
        glow = cosine.pow(60) * 0.3 + cosine.pow(900)
        glow += (cosine > SUN_DISC_COS).float() * SUN_DISC
        for channel, color in zip(out, sky.sun_glow, strict=True):
            channel += glow * color
    return out
