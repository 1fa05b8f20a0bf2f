"""Rendering a scene: strips of rows, each traced, surfaced and lit, in parallel and in any size."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import box_mean
from rtsr_cli.core.imaging.row_strips import cut_pixels
from rtsr_cli.core.shapes import Color, Size
from rtsr_cli.core.synth import surfaces
from rtsr_cli.core.synth.placement import PlacedPart, place_parts
from rtsr_cli.core.synth.point_motion import motion_px
from rtsr_cli.core.synth.rays import NOTHING, Bounds, Hits, Rays, project_bounds, strip_rays, trace
from rtsr_cli.core.synth.scene import Scene, Vec3
from rtsr_cli.core.synth.shading import (
    COVERED,
    FrameLight,
    SurfacePoints,
    corner_share,
    shade_ambient,
    shade_direct,
    sky_radiance,
    trace_shadows,
)
from rtsr_cli.core.synth.shadows import Hulls, join_hulls, make_shadow_hull
from rtsr_cli.core.synth.vector_math import Vector, dot, unit_vector
from rtsr_cli.core.threads import worker_pool

STRIP_PIXELS = 1 << 18
"""Pixels rendered at a time by one thread: some 150 values of 4 bytes each, 160 MiB."""

THREADS = 2
"""Strips rendered at a time."""

SUN_REACH_M = 30.0
LAMP_REACH_M = 5.0
"""Distances beyond a solid up to which the shadow's edge gets softer."""

ZENITH = np.array([0.10, 0.06, 0.993, 0.0])
ZENITH_SOFTNESS = 0.8
ZENITH_REACH_M = 1.5
"""The light whose shadows stand for ambient occlusion: nearly overhead, very wide."""

SURFACE_ROWS = {
    Buffer.NORMAL: surfaces.NORMAL,
    Buffer.GEONORMAL: surfaces.GEONORMAL,
    Buffer.ALBEDO: surfaces.ALBEDO,
    Buffer.EMISSION: surfaces.EMISSION,
    Buffer.ROUGHNESS: slice(surfaces.ROUGHNESS, surfaces.ROUGHNESS + 1),
    Buffer.METALLIC: slice(surfaces.METALLIC, surfaces.METALLIC + 1),
}

GEOMETRY = (
    Buffer.DEPTH,
    Buffer.POSITION,
    Buffer.OBJECT_ID,
    Buffer.MOTION,
    Buffer.FORWARD,
    *SURFACE_ROWS,
)
"""Every buffer but radiance."""

ALL_BUFFERS = (Buffer.COLOR, *GEOMETRY)


@dataclass(frozen=True, kw_only=True)
class RenderedShot:
    """A scene at one frame, ready for its strips.

    Attributes:
        scene, number: what is rendered.
        size: (height, width).
        camera, previous, following: this frame's and those beside it, without jitter but here.
        solids: placed parts.
        bounds: what each may cover of the image.
        lights: with their shadow volumes.
        cover: shadow volumes under the zenith.
    """

    scene: Scene
    number: int
    size: Size
    camera: CameraMetadata
    previous: CameraMetadata
    following: CameraMetadata
    solids: tuple[PlacedPart, ...]
    bounds: tuple[Bounds, ...]
    lights: tuple[FrameLight, ...]
    cover: Hulls

    @property
    def texture_pixel(self) -> float:
        """Width of a texture-matched pixel at a depth of 1 m."""
        half = math.tan(math.radians(self.scene.camera.fov_deg) / 2.0)
        return 2.0 * half / surfaces.TEXTURE_WIDTH

    @property
    def sun(self) -> Vec3 | None:
        """Direction towards the first sun."""
        for lighting in self.lights:
            if lighting.light.distant:
                x, y, z = lighting.position[:3].tolist()
                return x, y, z
        return None


def _make_hulls(
    solids: tuple[PlacedPart, ...],
    light: np.ndarray,
    softness: float,
    *,
    reach_m: float,
    shell: bool,
) -> Hulls:
    made = (
        make_shadow_hull(i, solid, light, softness=softness, reach_m=reach_m)
        for i, solid in enumerate(solids)
        if solid.bounded and solid.body.casts_shadow and (shell or not solid.body.shell)
    )
    return join_hulls(hull for hull in made if hull is not None)


def _light_scene(
    scene: Scene, solids: tuple[PlacedPart, ...], number: int
) -> tuple[FrameLight, ...]:
    lights = []
    for light in scene.lights:
        place_now = light.motion.position(number)
        if light.distant:
            place_now = place_now / np.linalg.norm(place_now)
        position = np.append(place_now, 0.0 if light.distant else 1.0)
        reach = SUN_REACH_M if light.distant else LAMP_REACH_M
        hulls = _make_hulls(solids, position, light.softness, reach_m=reach, shell=True)
        lights.append(FrameLight(light, position, hulls))
    return tuple(lights)


def prepare_shot(
    scene: Scene, number: int, size: Size, jitter_px: Jitter = (0.0, 0.0)
) -> RenderedShot:
    """Place everything of a frame."""
    solids = place_parts(scene, number)
    camera = scene.camera.metadata(number, size, jitter_px)
    assert camera.world_to_camera is not None
    to_camera = camera.world_to_camera.numpy()
    return RenderedShot(
        scene=scene,
        number=number,
        size=size,
        camera=camera,
        previous=scene.camera.metadata(number - 1, size),
        following=scene.camera.metadata(number + 1, size),
        solids=solids,
        bounds=tuple(project_bounds(solid, to_camera) for solid in solids),
        lights=_light_scene(scene, solids, number),
        cover=_make_hulls(solids, ZENITH, ZENITH_SOFTNESS, reach_m=ZENITH_REACH_M, shell=False),
    )


def render_rows(
    shot: RenderedShot, rows: range, wanted: tuple[Buffer, ...]
) -> dict[Buffer, Tensor]:
    """Buffers (channels, rows, width) of some rows."""
    rays = strip_rays(shot.camera, shot.size, rows)
    hits = trace(rays, shot.solids, shot.bounds)
    values = surfaces.shade_surfaces(rays, hits, shot.solids, shot.texture_pixel)
    values[surfaces.EMISSION] *= shot.scene.exposure
    sky = hits.index == NOTHING
    position = rays.world(hits.depth_m.masked_fill(sky, 0.0))
    out: dict[Buffer, Tensor] = {}
    for buffer in wanted:
        if buffer in SURFACE_ROWS:
            out[buffer] = values[SURFACE_ROWS[buffer]]
    if Buffer.DEPTH in wanted:
        out[Buffer.DEPTH] = hits.depth_m.clamp(max=SKY_DEPTH_M)[None]
    if Buffer.OBJECT_ID in wanted:
        out[Buffer.OBJECT_ID] = values[surfaces.OBJECT_ID][None].int()
    if Buffer.POSITION in wanted:
        out[Buffer.POSITION] = torch.stack([p.masked_fill(sky, 0.0) for p in position])
    out |= _render_motion(shot, rays, hits, wanted)
    if Buffer.COLOR in wanted:
        out[Buffer.COLOR] = _render_radiance(shot, rays, hits, values=values, position=position)
    return {buffer: rays.image(value) for buffer, value in out.items()}


def _render_motion(
    shot: RenderedShot, rays: Rays, hits: Hits, wanted: tuple[Buffer, ...]
) -> dict[Buffer, Tensor]:
    others = {Buffer.MOTION: shot.previous, Buffer.FORWARD: shot.following}
    return {
        buffer: motion_px(
            rays,
            hits,
            shot.solids,
            (shot.camera, other),
            display=shot.size,
            forward=buffer is Buffer.FORWARD,
        )
        for buffer, other in others.items()
        if buffer in wanted
    }


def _render_radiance(
    shot: RenderedShot, rays: Rays, hits: Hits, *, values: Tensor, position: Vector
) -> Tensor:
    """Radiance (3, tiles, pixels of a tile), exposure applied."""
    scene = shot.scene
    x, y, z = (rays.x * r + rays.y * u + f for r, u, f in rays.basis.T.tolist())
    direction = unit_vector((x, y, z))
    out = torch.zeros(3, *rays.x.shape)
    sky = hits.index == NOTHING
    seen = sky.any(1).nonzero()[:, 0]
    if len(seen):
        dx, dy, dz = (d.index_select(0, seen) for d in direction)
        out.index_copy_(1, seen, sky_radiance(scene.sky, (dx, dy, dz), shot.sun))
    solid = (~sky).any(1).nonzero()[:, 0]
    if len(solid):
        to_eye = (-direction[0], -direction[1], -direction[2])
        points = SurfacePoints(values, position, to_eye, hits.index).tiles(solid)
        lit = _light_points(shot, points)
        background = out.index_select(1, solid)
        out.index_copy_(1, solid, torch.where(sky.index_select(0, solid), background, lit))
    out *= scene.exposure
    out += values[surfaces.EMISSION]
    return out


def _light_points(shot: RenderedShot, points: SurfacePoints) -> Tensor:
    """Radiance of surface points before exposure, without emission."""
    nov = dot(points.vector(surfaces.NORMAL), points.to_eye).clamp_(1e-3, 1.0)
    covered = trace_shadows(points, shot.cover, ZENITH)
    open_share = covered * (1.0 - COVERED) + COVERED
    if shot.scene.room_m is not None:
        open_share *= corner_share(points.position, shot.scene.room_m)
    total = shade_ambient(points, shot.scene.ambient, nov, open_share)
    for lighting in shot.lights:
        total += shade_direct(points, lighting, nov)
    return total


def _map_strips(
    shot: RenderedShot, work: Callable[[range], dict[Buffer, Tensor]], multiple: int, threads: int
) -> Iterator[tuple[range, dict[Buffer, Tensor]]]:
    strips = cut_pixels(shot.size, STRIP_PIXELS, multiple=multiple)
    # a thread a strip: torch's own threads would split every small operation
    with worker_pool(threads, "rtsr-synth") as pool:
        yield from zip(strips, pool.map(work, strips), strict=True)


def render_frame(
    scene: Scene,
    number: int,
    size: Size,
    *,
    jitter_px: Jitter = (0.0, 0.0),
    buffers: tuple[Buffer, ...] = ALL_BUFFERS,
    threads: int = THREADS,
) -> Frame:
    """Render a frame by one sample a pixel.

    Args:
        scene: what to render.
        number: any frame number; frames do not depend on each other.
        size: (height, width).
        jitter_px: sample position minus pixel centre, x right, y down. Motion is free of it.
        buffers: which to render.
        threads: strips at a time; the result does not depend on it.
    """
    shot = prepare_shot(scene, number, size, jitter_px)
    tensors = {
        b: torch.empty(
            1,
            BUFFER_SPECS[b].channels,
            *size,
            dtype=torch.int32 if b is Buffer.OBJECT_ID else torch.float32,
        )
        for b in buffers
    }
    strips = _map_strips(shot, lambda rows: render_rows(shot, rows, buffers), 1, threads)
    for rows, values in strips:
        for buffer, value in values.items():
            tensors[buffer][0, :, rows.start : rows.stop] = value
    return Frame(
        number=number,
        gbuffer=GBuffer(tensors, f"synth {scene.seed}, frame {number}"),
        camera=shot.camera,
        view=View(display=size),
    )


def render_reference(
    scene: Scene, number: int, size: Size, *, samples: int, threads: int = THREADS
) -> Color:
    """Radiance of a frame, each pixel the mean of `samples` x `samples` (box filter).

    Args:
        scene, number, size: as for `render_frame`.
        samples: along an axis.
        threads: strips at a time.
    """
    shot = prepare_shot(scene, number, (size[0] * samples, size[1] * samples))
    image = torch.empty(1, 3, *size)

    def work(rows: range) -> dict[Buffer, Tensor]:
        dense = render_rows(shot, rows, (Buffer.COLOR,))[Buffer.COLOR]
        return {Buffer.COLOR: box_mean(dense[None], samples)[0]}

    for rows, values in _map_strips(shot, work, samples, threads):
        image[0, :, rows.start // samples : rows.stop // samples] = values[Buffer.COLOR]
    return image
