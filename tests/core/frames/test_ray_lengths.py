"""Ray distances made planar by world positions alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.conventions import DepthConvention, DepthKind, depth_to_metres
from rtsr_cli.core.frames.ray_lengths import measure_ray_lengths

MakeCamera = Callable[..., CameraMetadata]
Unproject = Callable[[CameraMetadata, tuple[int, int], np.ndarray], np.ndarray]

SIZE = (24, 30)
PLACE = (3.0, 7.0, -2.0)


def look(
    make_camera: MakeCamera, unproject: Unproject, **lens: object
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Planar depth, distance and position of a frame; a strip of sky."""
    camera = make_camera(position=PLACE, yaw=0.7, pitch=-0.3, **lens)
    depth = np.random.default_rng(4).uniform(1.0, 30.0, SIZE)
    points = unproject(camera, SIZE, depth)
    distance = np.linalg.norm(points - np.asarray(PLACE), axis=-1)
    position = torch.from_numpy(points).permute(2, 0, 1)[None].float()
    planar, along = (torch.from_numpy(plane)[None, None].float() for plane in (depth, distance))
    position[..., :2, :] = 0.0
    along[..., :2, :] = 0.0
    planar[..., :2, :] = SKY_DEPTH_M
    return planar, along, position


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.35, -0.2)])
def test_distances_become_planar(
    make_camera: MakeCamera, unproject: Unproject, shift: tuple[float, float]
) -> None:
    planar, along, position = look(make_camera, unproject, shift=shift)
    convention = DepthConvention(kind=DepthKind.RAY, sky=0.0)
    found = depth_to_metres(
        along, convention, CameraMetadata(), View(display=SIZE), where="", position_m=position
    )
    assert torch.allclose(found, planar, rtol=1e-4)


def test_distances_that_begin_at_the_near_plane_become_planar_as_well(
    make_camera: MakeCamera, unproject: Unproject
) -> None:
    planar, along, position = look(make_camera, unproject)
    near = 0.05
    begun = along * (1.0 - near / planar)
    found = measure_ray_lengths(begun, position)
    assert found is not None
    assert found.start_m == pytest.approx(near, abs=1e-3)
    depth = begun / found.length + found.start_m
    assert torch.allclose(depth[..., 2:, :], planar[..., 2:, :], rtol=1e-4)


def test_what_a_pixel_filter_mixed_at_edges_does_not_count(
    make_camera: MakeCamera, unproject: Unproject
) -> None:
    planar, along, position = look(make_camera, unproject)
    edges = torch.rand(SIZE, generator=torch.Generator().manual_seed(1)) < 0.1
    position[..., edges] *= 0.5
    lengths = measure_ray_lengths(along, position)
    assert lengths is not None
    found = along / lengths.length + lengths.start_m
    assert torch.allclose(found[..., 2:, :], planar[..., 2:, :], rtol=1e-3)


def test_positions_that_are_not_at_these_distances_are_refused(
    make_camera: MakeCamera, unproject: Unproject
) -> None:
    planar, along, position = look(make_camera, unproject)
    assert measure_ray_lengths(planar * (planar < SKY_DEPTH_M), position) is None
    assert measure_ray_lengths(torch.zeros_like(along), position) is None
    convention = DepthConvention(kind=DepthKind.RAY)
    with pytest.raises(MissingBufferError, match="in, frame 3: depth is ray distance, and"):
        depth_to_metres(
            torch.zeros_like(along),
            convention,
            CameraMetadata(),
            View(display=SIZE),
            where="in, frame 3",
            position_m=position,
        )
