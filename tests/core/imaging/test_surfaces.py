"""Telling surfaces apart, by how they face, where they lie and what they are."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.surfaces import (
    FACING,
    PLANE_SHARE,
    Surfaces,
    describe_surfaces,
    find_moving,
    weigh_likeness,
)
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.render import render_frame

SIZE = (72, 96)
Camera = Callable[..., CameraMetadata]


def frame_of(
    normal: tuple[float, float, float], depth: Tensor, camera: CameraMetadata, object_id: int = 1
) -> Frame:
    height, width = depth.shape[2:]
    normals = torch.tensor(normal).view(1, 3, 1, 1).expand(1, 3, height, width).clone()
    ids = torch.full((1, 1, height, width), object_id, dtype=torch.int32)
    buffers = {Buffer.NORMAL: normals, Buffer.DEPTH: depth, Buffer.OBJECT_ID: ids}
    return Frame(
        number=1,
        gbuffer=GBuffer(buffers, "test"),
        camera=camera,
        view=View(display=(height, width)),
    )


def describe(frame: Frame) -> Surfaces:
    return describe_surfaces(frame, torch.ones_like(frame.gbuffer[Buffer.DEPTH]))


def test_a_pixel_is_like_itself() -> None:
    surfaces = describe(frame_of((0.0, 0.0, 1.0), torch.full((1, 1, 4, 6), 3.0), CameraMetadata()))
    torch.testing.assert_close(weigh_likeness(surfaces, surfaces.pack()), torch.ones(1, 1, 4, 6))


def test_likeness_falls_with_the_angle_and_with_the_distance_from_the_plane() -> None:
    """exp(-a (1 - cos)) and exp(-distance / (c z))."""
    depth = torch.full((1, 1, 1, 1), 10.0)
    own = describe(frame_of((0.0, 0.0, 1.0), depth, CameraMetadata()))
    cosine = 0.98
    turned = describe(frame_of((math.sqrt(1 - cosine**2), 0.0, cosine), depth, CameraMetadata()))
    behind = describe(frame_of((0.0, 0.0, 1.0), depth + 0.3, CameraMetadata()))
    assert weigh_likeness(own, turned.pack()).item() == pytest.approx(
        math.exp(-FACING * (1 - cosine)), rel=1e-4
    )
    assert weigh_likeness(own, behind.pack()).item() == pytest.approx(
        math.exp(-0.3 / (PLANE_SHARE * 10.0)), rel=1e-4
    )


def test_other_objects_and_what_is_not_divided_are_never_alike() -> None:
    depth = torch.full((1, 1, 1, 1), 10.0)
    frame = frame_of((0.0, 0.0, 1.0), depth, CameraMetadata())
    other = frame_of((0.0, 0.0, 1.0), depth, CameraMetadata(), object_id=2)
    own = describe(frame)
    assert weigh_likeness(own, describe(other).pack()).item() == 0.0
    undivided = describe_surfaces(frame, torch.zeros_like(depth))
    assert weigh_likeness(own, undivided.pack()).item() == 0.0


@pytest.mark.parametrize("known", ["neither", "own", "other"])
def test_normals_of_0_say_nothing_and_depth_tells(known: str) -> None:
    """exp(-|z(q) - z(p)| / (c z(p))), as of walls that face the camera."""
    depth = torch.full((1, 1, 1, 1), 10.0)
    nothing, facing = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    own = describe(frame_of(facing if known == "own" else nothing, depth, CameraMetadata()))
    other = facing if known == "other" else nothing
    beside, behind = (
        describe(frame_of(other, depth + apart, CameraMetadata())).pack() for apart in (0.0, 0.3)
    )
    assert weigh_likeness(own, beside).item() == 1.0
    assert weigh_likeness(own, behind).item() == pytest.approx(
        math.exp(-0.3 / (PLANE_SHARE * 10.0)), rel=1e-4
    )


def test_where_the_camera_is_known_depth_is_measured_along_it(make_camera: Camera) -> None:
    """Points of one depth lie in a plane across the camera's axis, wherever it looks."""
    depth = torch.full((1, 1, 6, 8), 10.0)
    level = describe(frame_of((0.0, 0.0, 0.0), depth, make_camera()))
    behind = describe(frame_of((0.0, 0.0, 0.0), depth + 0.3, make_camera()))
    mirrored = level.pack().flip(3)
    assert weigh_likeness(level, mirrored).min().item() == pytest.approx(1.0, abs=1e-4)
    expected = math.exp(-0.3 / (PLANE_SHARE * 10.0))
    assert weigh_likeness(level, behind.pack()).amax().item() == pytest.approx(expected, rel=1e-3)


def test_sky_is_like_sky_alone() -> None:
    depth = torch.full((1, 1, 1, 2), SKY_DEPTH_M)
    sky = describe_surfaces(
        frame_of((0.0, 0.0, 0.0), depth, CameraMetadata(), object_id=0), torch.zeros_like(depth)
    )
    wall = describe_surfaces(
        frame_of((0.0, 0.0, 1.0), depth.clamp(max=5.0), CameraMetadata(), object_id=0),
        torch.zeros_like(depth),
    )
    assert weigh_likeness(sky, sky.pack()).min().item() == 1.0
    bare = describe_surfaces(
        frame_of((0.0, 0.0, 0.0), depth.clamp(max=5.0), CameraMetadata(), object_id=0),
        torch.zeros_like(depth),
    )
    for surface in (wall, bare):
        assert weigh_likeness(sky, surface.pack()).max().item() == 0.0
        assert weigh_likeness(surface, sky.pack()).max().item() == 0.0


def test_a_slanted_plane_is_one_surface_where_the_camera_is_known() -> None:
    """Two ends of a floor differ by metres in depth and not at all in their plane."""
    scene = draw_scene(3)
    frame = render_frame(scene, 5, SIZE, buffers=(Buffer.DEPTH, Buffer.NORMAL, Buffer.GEONORMAL))
    normal = frame.gbuffer[Buffer.GEONORMAL]
    depth = frame.gbuffer[Buffer.DEPTH]
    seen = depth < SKY_DEPTH_M
    buffers = {Buffer.NORMAL: normal, Buffer.DEPTH: depth}
    surfaces = describe(
        Frame(number=5, gbuffer=GBuffer(buffers, "synth"), camera=frame.camera, view=frame.view)
    )
    right = torch.roll(surfaces.pack(), -1, dims=3)
    flat = (normal * torch.roll(normal, -1, dims=3)).sum(1, keepdim=True) > 0.9999
    like = weigh_likeness(surfaces, right)[..., :-1]
    pairs = (flat & seen & torch.roll(seen, -1, dims=3))[..., :-1]
    assert pairs.float().mean() > 0.2
    assert (like[pairs] > 0.9).float().mean() > 0.97


def test_what_moves_by_itself_is_told_from_the_cameras_motion() -> None:
    scene = draw_scene(3)
    buffers = (Buffer.DEPTH, Buffer.NORMAL, Buffer.MOTION, Buffer.OBJECT_ID)
    now, before = (render_frame(scene, number, SIZE, buffers=buffers) for number in (6, 5))
    surfaces = describe(now)
    moving = find_moving(surfaces, now.gbuffer[Buffer.MOTION], before)
    assert 0.0 < moving.mean() < 0.5
    # the same motion, one pixel off, is of no static surface
    off = find_moving(surfaces, now.gbuffer[Buffer.MOTION] + 1.0, before)
    seen = now.gbuffer[Buffer.DEPTH] < SKY_DEPTH_M
    assert off[seen].mean() > 0.9


def test_without_a_camera_everything_may_move() -> None:
    frame = frame_of((0.0, 0.0, 1.0), torch.full((1, 1, 4, 6), 3.0), CameraMetadata())
    moving = find_moving(describe(frame), torch.zeros(1, 2, 4, 6), frame)
    assert moving.min() == 1.0
