"""Parts of a frame that say why a method wins: disoccluded, edges, lighting detail, sky.

A region that the buffers cannot make is None, never an empty mask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum

import torch
from torch import Tensor

from rtsr_cli.core.derive import derive_sky
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import luminance
from rtsr_cli.core.imaging.demodulation import LIGHTING_FLOOR, floored
from rtsr_cli.core.imaging.disocclusion import SurfaceBuffers, disocclusion_mask
from rtsr_cli.core.imaging.geometry_finder import to_world
from rtsr_cli.core.shapes import Color, Mask, Plane


class Region(StrEnum):
    """Parts of a frame that are scored apart."""

    ALL = "all"
    DISOCCLUDED = "disoccluded"
    EDGES = "edges"
    LIGHTING = "shadows-and-highlights"
    SKY = "sky"


REGION_MEANINGS = {
    Region.ALL: "every pixel that is judged",
    Region.DISOCCLUDED: "the previous frame does not show this surface (motion, depth, object id)",
    Region.EDGES: "a neighbour is another object, 10 % farther, or turned by more than 37 degrees",
    Region.LIGHTING: "the tenth of the other surface pixels where log lighting changes most",
    Region.SKY: "the ray left the scene",
}
"""What the report says of each."""

REGION_BUFFERS = frozenset(
    {Buffer.DEPTH, Buffer.NORMAL, Buffer.OBJECT_ID, Buffer.MOTION, Buffer.ALBEDO}
)
"""What regions are made of, as far as it is there."""

DEPTH_STEP = 0.1
"""Share of the nearer depth by which neighbours differ at an edge."""

EDGE_COSINE = 0.8
"""Neighbouring normals at an edge: about 37 degrees."""

LIGHTING_SHARE = 0.1
"""Share of the surface pixels, edges apart, that lighting detail takes."""


def frame_regions(
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
    found: dict[Region, Mask | None] = dict.fromkeys(r for r in Region if r is not Region.ALL)
    if current is None:
        return found
    gbuffer = current.gbuffer
    if Buffer.DEPTH in gbuffer or Buffer.NORMAL in gbuffer:
        found[Region.SKY] = derive_sky(gbuffer) > 0
    found[Region.EDGES] = edges(gbuffer)
    if previous is not None:
        found[Region.DISOCCLUDED] = disoccluded(current, previous)
    if Buffer.ALBEDO in gbuffer:
        apart = [m for m in (found[Region.SKY], found[Region.EDGES]) if m is not None]
        surface = torch.ones_like(radiance[:, :1], dtype=torch.bool)
        for mask in apart:
            surface = surface & ~mask
        found[Region.LIGHTING] = lighting_detail(radiance, gbuffer[Buffer.ALBEDO], surface)
    return found


def disoccluded(current: Frame, previous: Frame) -> Mask | None:
    """Pixels that the previous frame does not show; None without motion, or depth and ids."""
    now, then = current.gbuffer, previous.gbuffer
    if Buffer.MOTION not in now or not {Buffer.DEPTH, Buffer.OBJECT_ID} & set(now):
        return None
    expected = None
    if Buffer.DEPTH in now:
        expected = depth_before(now[Buffer.DEPTH], current, previous.camera)
    mask = disocclusion_mask(
        now[Buffer.MOTION],
        current=_surfaces(now),
        previous=_surfaces(then),
        expected_depth_prev_m=expected,
    )
    return mask > 0


def _surfaces(gbuffer: GBuffer) -> SurfaceBuffers:
    return SurfaceBuffers(
        depth_m=gbuffer.buffers.get(Buffer.DEPTH), object_id=gbuffer.buffers.get(Buffer.OBJECT_ID)
    )


def depth_before(depth_m: Plane, frame: Frame, before: CameraMetadata) -> Plane | None:
    """Planar depth of the same points, if they stand still, as the previous camera saw them."""
    world = to_world(depth_m, frame.camera, frame.view)
    if world is None or before.world_to_camera is None:
        return None
    # row vectors: z of the previous camera's space, which looks along -z
    m = before.world_to_camera.to(torch.float32)
    z = m[3, 2] + sum(world[:, i : i + 1] * m[i, 2] for i in range(3))
    sky = derive_sky(frame.gbuffer) > 0
    return torch.where(sky, depth_m, -z)


def _steps(image: Tensor) -> Iterator[tuple[int, Tensor, Tensor]]:
    """(dimension, pixels, their right or lower neighbours)."""
    for dim in (2, 3):
        size = image.shape[dim]
        yield dim, image.narrow(dim, 0, size - 1), image.narrow(dim, 1, size - 1)


def _mark(edges: Tensor, dim: int, differs: Tensor) -> None:
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
    Buffer.NORMAL: _normal_differs,
}
"""What tells neighbours of different surfaces, by buffer."""


def edges(gbuffer: GBuffer) -> Mask | None:
    """Pixels beside a neighbour of another surface; None without depth, normals and ids."""
    tests = {buffer: differs for buffer, differs in _DIFFERS.items() if buffer in gbuffer}
    if not tests:
        return None
    found = torch.zeros_like(gbuffer[next(iter(tests))][:, :1], dtype=torch.bool)
    for buffer, differs in tests.items():
        for dim, one, other in _steps(gbuffer[buffer]):
            _mark(found, dim, differs(one, other))
    return found & ~_inside_sky(derive_sky(gbuffer) > 0)


def _inside_sky(sky: Mask) -> Mask:
    """Sky pixels all around which is sky: their zero normals are no edge."""
    near = torch.nn.functional.max_pool2d((~sky).float(), 3, stride=1, padding=1)
    return near == 0


def lighting_detail(radiance: Color, albedo: Color, surface: Mask) -> Mask | None:
    """Surface pixels whose log(luminance of radiance / albedo) differs most from a neighbour's."""
    lighting = luminance(radiance.clamp(min=0.0) / floored(albedo))
    logs = torch.log(lighting + LIGHTING_FLOOR)
    change = torch.zeros_like(logs)
    for dim, one, other in _steps(logs):
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
