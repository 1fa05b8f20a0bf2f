"""Points in the world, and the camera's own motion."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.camera_motion import (
    differs_from_camera,
    find_camera_motion,
    locate_points,
)

SIZE = (4, 8)


def frame_of(depth_m: float, camera: CameraMetadata) -> Frame:
    depth = torch.full((1, 1, *SIZE), depth_m)
    view = View(display=SIZE)
    return Frame(number=1, gbuffer=GBuffer({Buffer.DEPTH: depth}, "test"), camera=camera, view=view)


def camera_with(projection: torch.Tensor, x_m: float = 0.0, z_m: float = 0.0) -> CameraMetadata:
    """A camera at (x, 0, z) that looks along -z."""
    to_camera = torch.eye(4, dtype=torch.float64)
    to_camera[3, 0], to_camera[3, 2] = -x_m, -z_m
    return CameraMetadata(world_to_camera=to_camera, world_to_ndc=to_camera @ projection)


def perspective() -> torch.Tensor:
    """4 m wide at a depth of 2 m: half a metre a pixel."""
    p = torch.zeros(4, 4, dtype=torch.float64)
    p[0, 0], p[1, 1], p[2, 2], p[2, 3], p[3, 2] = 1.0, 2.0, -1.0, -1.0, -0.1
    return p


def orthographic() -> torch.Tensor:
    """4 m wide at every depth."""
    p = torch.eye(4, dtype=torch.float64)
    p[0, 0], p[1, 1], p[2, 2] = 0.5, 1.0, -0.01
    return p


@pytest.mark.parametrize("projection", [perspective(), orthographic()], ids=["pinhole", "parallel"])
def test_points_lie_where_pixels_show_them(projection: torch.Tensor) -> None:
    points = locate_points(frame_of(2.0, camera_with(projection, x_m=10.0)))
    assert points is not None
    columns = 10.0 - 2.0 + 0.5 * (torch.arange(8) + 0.5)
    torch.testing.assert_close(points[0, 0, 0], columns)
    torch.testing.assert_close(points[0, 2], torch.full(SIZE, -2.0))


@pytest.mark.parametrize("projection", [perspective(), orthographic()], ids=["pinhole", "parallel"])
def test_a_camera_that_went_half_a_metre_left_moves_all_by_a_pixel(
    projection: torch.Tensor,
) -> None:
    points = locate_points(frame_of(2.0, camera_with(projection, x_m=-0.5)))
    assert points is not None
    motion = find_camera_motion(points, frame_of(2.0, camera_with(projection)))
    assert motion is not None
    torch.testing.assert_close(motion[0, 0], torch.full(SIZE, -1.0))
    torch.testing.assert_close(motion[0, 1], torch.zeros(SIZE))
    still = torch.tensor([-1.2, 0.2]).view(1, 2, 1, 1).expand_as(motion)
    assert differs_from_camera(still, motion).max() == 0.0
    assert differs_from_camera(still - 0.1, motion).min() == 1.0


def test_what_lay_behind_the_camera_was_seen_nowhere() -> None:
    points = locate_points(frame_of(2.0, camera_with(perspective())))
    assert points is not None
    motion = find_camera_motion(points, frame_of(2.0, camera_with(perspective(), z_m=-5.0)))
    assert motion is not None
    assert motion.isnan().all()


def test_without_a_camera_nothing_is_located() -> None:
    frame = frame_of(2.0, CameraMetadata())
    assert locate_points(frame) is None
    assert find_camera_motion(torch.zeros(1, 3, *SIZE), frame) is None
