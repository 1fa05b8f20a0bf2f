"""Parts of a frame that say why a method wins: disoccluded, edges, lighting detail, sky.

A region that the buffers cannot make is None, never an empty mask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.geometry_finder import (
    project_points,
    sample_positions,
    unproject_depth,
)
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import luminance
from rtsr_cli.core.imaging.demodulation import LIGHTING_FLOOR, floor_material
from rtsr_cli.core.imaging.derived_geometry import derive_sky
from rtsr_cli.core.imaging.disocclusion import (
    DisocclusionThresholds,
    SurfaceBuffers,
    disocclusion_mask,
)
from rtsr_cli.core.imaging.warping import inside_frame
from rtsr_cli.core.shapes import Color, Mask, Plane


class Region(StrEnum):
    """Parts of a frame that are scored apart."""

    ALL = "all"
    DISOCCLUDED = "disoccluded"
    OFF_SCREEN = "off-screen"
    EDGES = "edges"
    LIGHTING = "shadows-and-highlights"
    SKY = "sky"


REGION_MEANINGS = {
    Region.ALL: "every pixel that is judged",
    Region.DISOCCLUDED: "another surface is where this one was in the previous frame (motion, "
    "depth, object id)",
    Region.OFF_SCREEN: "this surface lay outside of the previous frame (motion)",
    Region.EDGES: "a neighbour is another object, 10 % farther, or turned by more than 37 degrees "
    "(by normals without normal map; others count only where there is neither depth nor id)",
    Region.LIGHTING: "the tenth of the other surface pixels where log lighting changes most",
    Region.SKY: "the ray left the scene",
}
"""What the report says of each."""

REGION_BUFFERS = frozenset(
    {
        Buffer.DEPTH,
        Buffer.NORMAL,
        Buffer.GEONORMAL,
        Buffer.OBJECT_ID,
        Buffer.MOTION,
        Buffer.ALBEDO,
    }
)
"""What regions are made of, as far as it is there."""

DEPTH_STEP = 0.1
"""Share of the nearer depth by which neighbours differ at an edge."""

EDGE_COSINE = 0.8
"""Neighbouring normals at an edge: about 37 degrees."""

STILL_PX = 0.25
"""A point whose motion is the camera's to within so much stands still."""

MOVING_DEPTH = 0.25
"""Share by which the depth of a moving object may change from frame to frame."""

LIGHTING_SHARE = 0.1
"""Share of the surface pixels, edges apart, that lighting detail takes."""


def find_regions(
    current: Frame | None, previous: Frame | None, radiance: Color
) -> dict[Region, Mask | None]:
    """Make every region but `ALL` of one frame.

    Args:
        current: buffers of the frame, None where there are none.
        previous: buffers of the frame that its motion leads to, None after a cut.
        radiance: the reference, linear.

    Returns:
        1 x 1 x h x w booleans.
    """
    masks: dict[Region, Mask | None] = dict.fromkeys(r for r in Region if r is not Region.ALL)
    if current is None:
        return masks
    gbuffer = current.gbuffer
    if Buffer.DEPTH in gbuffer or Buffer.NORMAL in gbuffer:
        masks[Region.SKY] = derive_sky(gbuffer) > 0
    masks[Region.EDGES] = find_edges(gbuffer)
    if previous is not None and Buffer.MOTION in gbuffer:
        inside = inside_frame(gbuffer[Buffer.MOTION]) > 0
        hidden = find_disoccluded(current, previous)
        masks[Region.OFF_SCREEN] = ~inside
        masks[Region.DISOCCLUDED] = None if hidden is None else hidden & inside
    if Buffer.ALBEDO in gbuffer:
        apart = [m for m in (masks[Region.SKY], masks[Region.EDGES]) if m is not None]
        surface = torch.ones_like(radiance[:, :1], dtype=torch.bool)
        for mask in apart:
            surface = surface & ~mask
        masks[Region.LIGHTING] = find_lighting_detail(radiance, gbuffer[Buffer.ALBEDO], surface)
    return masks


def find_disoccluded(current: Frame, previous: Frame) -> Mask | None:
    """Pixels that the previous frame does not show; None without motion, or depth and ids.

    Points that stand still must lie at the depth that the previous camera saw them at. How deep a
    moving object lay nobody stored: its id must agree, or its depth roughly where there are no ids.
    """
    now, then = current.gbuffer, previous.gbuffer
    if Buffer.MOTION not in now or not {Buffer.DEPTH, Buffer.OBJECT_ID} & set(now):
        return None
    motion = now[Buffer.MOTION]
    marked = disocclusion_mask(motion, current=_read_ids(now), previous=_read_ids(then)) > 0
    if Buffer.DEPTH not in now:
        return marked
    depth, before = (SurfaceBuffers(depth_m=g[Buffer.DEPTH]) for g in (now, then))
    still = reproject_still(current, previous.camera)
    if still is None:
        return marked | (disocclusion_mask(motion, current=depth, previous=before) > 0)
    expected = torch.where(still.where, still.depth_m, now[Buffer.DEPTH])
    moved_limits = DisocclusionThresholds(depth_relative=MOVING_DEPTH)
    strict, loose = (
        disocclusion_mask(
            motion, current=depth, previous=before, expected_depth_prev_m=expected, thresholds=t
        )
        > 0
        for t in (DisocclusionThresholds(), moved_limits)
    )
    moving = torch.zeros_like(loose) if Buffer.OBJECT_ID in now else loose
    return marked | torch.where(still.where, strict, moving)


def _read_ids(gbuffer: GBuffer) -> SurfaceBuffers:
    return SurfaceBuffers(object_id=gbuffer.buffers.get(Buffer.OBJECT_ID))


@dataclass(frozen=True, kw_only=True)
class StillScene:
    """What would be if nothing but the camera moved.

    Attributes:
        where: pixels whose motion says so, sky included.
        depth_m: planar depth of every point as the previous camera saw it.
    """

    where: Mask
    depth_m: Plane


def reproject_still(frame: Frame, before: CameraMetadata) -> StillScene | None:
    """Carry the surface points of a frame into the previous camera; None without matrices."""
    depth_m, motion = frame.gbuffer[Buffer.DEPTH], frame.gbuffer[Buffer.MOTION]
    world = unproject_depth(depth_m, frame.camera, frame.view)
    if world is None or before.world_to_camera is None:
        return None
    seen = project_points(world, before, frame.view)
    if seen is None:
        return None
    # row vectors: z of the previous camera's space, which looks along -z
    m = before.world_to_camera.to(torch.float32)
    z = m[3, 2] + sum(world[:, i : i + 1] * m[i, 2] for i in range(3))
    sky = derive_sky(frame.gbuffer) > 0
    off = (seen - sample_positions(frame.size) - motion).abs().amax(1, keepdim=True)
    return StillScene(where=sky | (off < STILL_PX), depth_m=torch.where(sky, depth_m, -z))


def _neighbour_pairs(image: Tensor) -> Iterator[tuple[int, Tensor, Tensor]]:
    """(dimension, pixels, their right or lower neighbours)."""
    for dim in (2, 3):
        size = image.shape[dim]
        yield dim, image.narrow(dim, 0, size - 1), image.narrow(dim, 1, size - 1)


def _mark_pairs(edges: Tensor, dim: int, differs: Tensor) -> None:
    """Mark both pixels of every pair that differs."""
    edges.narrow(dim, 0, differs.shape[dim]).logical_or_(differs)
    edges.narrow(dim, 1, differs.shape[dim]).logical_or_(differs)


def _depth_differs(one: Tensor, other: Tensor) -> Tensor:
    return (one - other).abs() > DEPTH_STEP * torch.minimum(one, other)


def _normal_differs(one: Tensor, other: Tensor) -> Tensor:
    return (one * other).sum(1, keepdim=True) < EDGE_COSINE


_DIFFERS: Mapping[Buffer, Callable[[Tensor, Tensor], Tensor]] = {
    Buffer.OBJECT_ID: torch.ne,
    Buffer.DEPTH: _depth_differs,
    Buffer.GEONORMAL: _normal_differs,
    Buffer.NORMAL: _normal_differs,
}
"""What tells neighbours of different surfaces, by buffer."""


def find_edges(gbuffer: GBuffer) -> Mask | None:
    """Pixels beside a neighbour of another surface; None without depth, normals and ids."""
    tests = {buffer: differs for buffer, differs in _DIFFERS.items() if buffer in gbuffer}
    if len(tests) > 1:
        # every bump of a normal map would be an edge
        tests.pop(Buffer.NORMAL, None)
    if not tests:
        return None
    mask = torch.zeros_like(gbuffer[next(iter(tests))][:, :1], dtype=torch.bool)
    for buffer, differs in tests.items():
        for dim, one, other in _neighbour_pairs(gbuffer[buffer]):
            _mark_pairs(mask, dim, differs(one, other))
    return mask & ~_erode_sky(derive_sky(gbuffer) > 0)


def _erode_sky(sky: Mask) -> Mask:
    """Sky pixels all around which is sky: their zero normals are no edge."""
    near = torch.nn.functional.max_pool2d((~sky).float(), 3, stride=1, padding=1)
    return near == 0


def find_lighting_detail(radiance: Color, albedo: Color, surface: Mask) -> Mask | None:
    """Surface pixels whose log(luminance of radiance / albedo) differs most from a neighbour's."""
    lighting = luminance(radiance.clamp(min=0.0) / floor_material(albedo))
    logs = torch.log(lighting + LIGHTING_FLOOR)
    change = torch.zeros_like(logs)
    for dim, one, other in _neighbour_pairs(logs):
        step = (one - other).abs()
        for start in (0, 1):
            part = change.narrow(dim, start, step.shape[dim])
            torch.maximum(part, step, out=part)
    values = change[surface]
    if values.numel() == 0:
        return None
    count = max(1, round(LIGHTING_SHARE * values.numel()))
    least = values.kthvalue(values.numel() - count + 1).values
    return surface & (change >= least) & (change > 0)
