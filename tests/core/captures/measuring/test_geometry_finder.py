"""Depth, position unit and normals, told by geometry on a slanted plane seen by two cameras."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_evidence import list_units
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import (
    StoredGeometry,
    find_depth,
    project_points,
    unproject_depth,
)
from rtsr_cli.core.captures.measuring.normal_finder import find_normals
from rtsr_cli.core.captures.measuring.position_evidence import PositionEvidence
from rtsr_cli.core.frames.camera import CameraMetadata, View, ray_axes
from rtsr_cli.core.frames.conventions import (
    DepthConvention,
    DepthKind,
    NormalSpace,
    depth_from_metres,
    depth_to_metres,
)

SIZE = (60, 80)
VIEW = View(display=SIZE)
NEAR_M = 0.1


def camera(x: float, turn: float = 0.0) -> CameraMetadata:
    """Look along -z from (x, 0, 0), turned about y, with an infinite far plane."""
    c, s = math.cos(turn), math.sin(turn)
    to_world_matrix = torch.tensor(
        [[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [x, 0, 0, 1]], dtype=torch.float64
    )
    focal = 1.2
    aspect = SIZE[1] / SIZE[0]
    projection = torch.tensor(
        [
            [focal, 0, 0, 0],
            [0, focal * aspect, 0, 0],
            [0, 0, -1, -1],
            [0, 0, -NEAR_M, 0],
        ],
        dtype=torch.float64,
    )
    to_camera = torch.linalg.inv(to_world_matrix)
    return CameraMetadata(world_to_camera=to_camera, world_to_ndc=to_camera @ projection)


def slope() -> Tensor:
    """Planar depth between 3 and 9 m."""
    rows = torch.linspace(3.0, 9.0, SIZE[0]).view(1, 1, -1, 1)
    return rows + torch.linspace(0.0, 2.0, SIZE[1]).view(1, 1, 1, -1)


def geometry(
    depth: Tensor, *, before: CameraMetadata, position: Tensor | None = None
) -> StoredGeometry:
    now = camera(0.3, 0.02)
    world = unproject_depth(slope(), now, VIEW)
    assert world is not None
    landed = project_points(world, before, VIEW)
    assert landed is not None
    y, x = torch.meshgrid(torch.arange(SIZE[0]) + 0.5, torch.arange(SIZE[1]) + 0.5, indexing="ij")
    motion = landed - torch.stack([x, y])[None]
    return StoredGeometry(
        depth=depth, motion_px=motion, position=position, camera=now, previous=before, view=VIEW
    )


def ray_lengths() -> Tensor:
    axes = ray_axes(camera(0.0), VIEW, SIZE)
    assert axes is not None
    return (1.0 + axes[0] ** 2 + axes[1] ** 2).sqrt()


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        (slope(), DepthConvention()),
        (slope() * 100.0, DepthConvention(unit_m=0.01)),
        (slope() * 0.01, DepthConvention(unit_m=100.0)),
        (slope() * ray_lengths(), DepthConvention(kind=DepthKind.RAY)),
        (1.0 - NEAR_M / slope(), DepthConvention(kind=DepthKind.DEVICE)),
        (NEAR_M / slope(), DepthConvention(kind=DepthKind.DEVICE, reversed=True)),
    ],
    ids=["metres", "centimetres", "100 m", "ray", "device", "device, reversed"],
)
def test_depth_is_the_reading_under_which_points_move_as_the_vectors_say(
    stored: Tensor, expected: DepthConvention
) -> None:
    finding = find_depth([geometry(stored, before=camera(-0.4))])
    assert finding.best is not None
    assert finding.best.convention == expected
    assert finding.best.error < 0.01
    assert finding.margin > 0.9


def test_depth_is_the_reading_under_which_points_lie_where_the_positions_say() -> None:
    now = camera(0.3, 0.02)
    position = unproject_depth(slope(), now, VIEW)
    stored = slope() * ray_lengths() * 1000.0
    finding = find_depth([geometry(stored, before=now, position=position)])
    assert finding.best is not None
    assert finding.best.convention == DepthConvention(kind=DepthKind.RAY, unit_m=0.001)
    assert finding.measure == "of the distance"


def test_distance_from_the_near_plane_is_recognised_and_exact() -> None:
    stored = (slope() - NEAR_M) * ray_lengths()
    finding = find_depth([geometry(stored, before=camera(-0.4))])
    assert finding.best is not None
    found = finding.best.convention
    assert (found.kind, found.from_near, found.unit_m) == (DepthKind.RAY, True, 1.0)
    assert found.near_m == pytest.approx(NEAR_M)
    metres = depth_to_metres(stored, found, camera(0.0), VIEW, where="")
    assert torch.allclose(metres, slope(), atol=1e-5)
    # declared without a number, the matrices tell where the plane is
    declared = DepthConvention(kind=DepthKind.RAY, from_near=True)
    assert torch.allclose(depth_to_metres(stored, declared, camera(0.0), VIEW, where=""), slope())
    back = depth_from_metres(metres, found, camera(0.0), VIEW, where="")
    assert torch.allclose(back, stored, atol=1e-4)


def test_a_camera_that_only_turns_tells_nothing_about_depth() -> None:
    finding = find_depth([geometry(slope(), before=camera(0.3, -0.02))])
    assert finding.best is None


def test_positions_are_in_the_unit_that_puts_them_on_their_own_pixels() -> None:
    now = camera(0.3, 0.02)
    world = unproject_depth(slope(), now, VIEW)
    assert world is not None
    frame = replace(geometry(slope(), before=now), position=world * 100.0, camera=now)
    evidence = PositionEvidence(frames={1: frame}, units=list_units(1.0), thinning=1)
    assert now.world_to_camera is not None
    assert now.world_to_ndc is not None
    cameras = {1: CameraMatrices(now.world_to_camera.numpy(), now.world_to_ndc.numpy())}
    assert evidence.choose_unit(cameras) == 0.01
    assert evidence.measure(cameras, closely=False)[1] < 0.01


def facing_normals(view_space: bool) -> Tensor:
    """Normals tilted up to 60 degrees from the direction to a camera that looks along +x."""
    tilt = torch.rand(1, 2, *SIZE, generator=torch.Generator().manual_seed(0)) * 1.6 - 0.8
    toward = torch.ones(1, 1, *SIZE)
    local = torch.cat([tilt, toward], dim=1)
    local = local / local.square().sum(1, keepdim=True).sqrt()
    if view_space:
        return local
    rotation = SIDEWAYS.world_to_camera
    assert rotation is not None
    return torch.einsum("nchw,dc->ndhw", local, rotation[:3, :3].float())


SIDEWAYS = camera(0.0, -math.pi / 2)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("space", list(NormalSpace))
def test_normals_are_told_by_length_and_by_what_faces_the_camera(
    space: NormalSpace, packed: bool
) -> None:
    normal = facing_normals(space is NormalSpace.VIEW)
    finding = find_normals(normal * 0.5 + 0.5 if packed else normal, SIDEWAYS, VIEW)
    assert finding.packed is packed
    assert finding.space is space
    assert finding.facing[space.value] > 0.95


def test_vectors_of_no_unit_length_are_no_normals() -> None:
    finding = find_normals(torch.full((1, 3, *SIZE), 3.0), SIDEWAYS, VIEW)
    assert finding.packed is None
