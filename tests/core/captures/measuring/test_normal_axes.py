"""In which axes normals stand on surfaces, in the room whose cameras are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.measuring.camera_structure import SIGNED_AXES, CameraMatrices
from rtsr_cli.core.captures.measuring.normal_axes import NormalAxes, describe_axes, measure_axes
from rtsr_cli.core.captures.measuring.normal_evidence import NormalEvidence
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import NormalSpace
from tests.core.captures.measuring.test_camera_check import Room, build, roughen


@pytest.fixture(scope="module")
def room() -> Room:
    return build()


def measure(room: Room, normals: dict[int, torch.Tensor]) -> NormalAxes:
    evidence = NormalEvidence(frames=room.frames, normals=normals)
    found = measure_axes(evidence, room.cameras, Buffer.NORMAL)
    assert found is not None
    return found


def turn(normals: torch.Tensor, matrix: np.ndarray) -> torch.Tensor:  # type: ignore[type-arg]
    axes = torch.from_numpy(matrix[:3, :3]).to(normals)
    return torch.einsum("nihw,ij->njhw", normals, axes)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_right_normals_have_no_other_axes(room: Room, share: float) -> None:
    found = measure(room, (roughen(room, share) if share else room).normals)
    assert found.find_other(NormalSpace.WORLD) is None
    assert found.apart[NormalSpace.WORLD] < found.turned


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_normals_of_the_view_are_told_from_those_of_the_world(room: Room, share: float) -> None:
    held = (roughen(room, share) if share else room).normals
    seen = {n: turn(normal, room.cameras[n].view) for n, normal in held.items()}
    found = measure(replace(room, normals=seen), seen)
    assert found.find_other(NormalSpace.WORLD) is NormalSpace.VIEW
    assert found.find_other(NormalSpace.VIEW) is None


@pytest.mark.parametrize("index", [1, 9, 22, 40])
def test_normals_of_another_world_name_its_axes(room: Room, index: int) -> None:
    axes = SIGNED_AXES[index]
    found = measure(room, {n: turn(normal, axes.T) for n, normal in room.normals.items()})
    other = found.find_other(NormalSpace.WORLD)
    assert isinstance(other, np.ndarray)
    # walls that are not in view leave open which way an axis points
    assert found.turned == pytest.approx(measure(room, room.normals).apart[NormalSpace.WORLD])


def rotate(degrees: float) -> np.ndarray:  # type: ignore[type-arg]
    """A rotation about y."""
    angle = np.radians(degrees)
    turned = np.eye(4)
    turned[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return turned


def in_other_world(room: Room, world: np.ndarray) -> Room:  # type: ignore[type-arg]
    """The same room; a point p of its world is p . W in another."""
    back = np.linalg.inv(world)
    cameras = {
        n: CameraMatrices(back @ camera.view, back @ camera.ndc)
        for n, camera in room.cameras.items()
    }
    normals = {n: turn(normal, world) for n, normal in room.normals.items()}
    return replace(room, cameras=cameras, normals=normals)


def look_along(room: Room, axes: np.ndarray, degrees: float) -> Room:  # type: ignore[type-arg]
    """The room in a world whose axes are nearly those of the last camera, named by A."""
    world = np.eye(4)
    world[:3, :3] = room.cameras[max(room.cameras)].view[:3, :3]
    return in_other_world(room, world @ rotate(degrees) @ axes)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_spaces_of_a_camera_that_hardly_turns_are_told_by_how_normals_lean(
    room: Room, share: float
) -> None:
    near = look_along(roughen(room, share) if share else room, np.eye(4), 4.0)
    found = measure(near, near.normals)
    assert abs(found.apart[NormalSpace.WORLD] - found.apart[NormalSpace.VIEW]) < 8.0
    assert found.find_other(NormalSpace.WORLD) is None
    assert found.find_other(NormalSpace.VIEW) is NormalSpace.WORLD
    seen = {n: turn(normal, near.cameras[n].view) for n, normal in near.normals.items()}
    found = measure(replace(near, normals=seen), seen)
    assert found.find_other(NormalSpace.WORLD) is NormalSpace.VIEW
    assert found.find_other(NormalSpace.VIEW) is None
    assert found.lean[NormalSpace.WORLD] > 2.0


@pytest.mark.parametrize("index", [9, 40])
def test_axes_near_to_the_cameras_are_told_from_its_own(room: Room, index: int) -> None:
    axes = SIGNED_AXES[index]
    near = look_along(room, axes, 5.0)
    turned = {n: turn(normal, axes.T) for n, normal in near.normals.items()}
    found = measure(replace(near, normals=turned), turned)
    if np.linalg.det(axes) > 0.0:
        assert found.find_other(NormalSpace.WORLD) is NormalSpace.VIEW
    assert found.is_nearly(NormalSpace.VIEW)
    assert found.is_mirrored == (np.linalg.det(axes) < 0.0)
    seen = {n: turn(normal, near.cameras[n].view) for n, normal in near.normals.items()}
    assert not measure(replace(near, normals=seen), seen).is_nearly(NormalSpace.VIEW)


def test_axes_are_written_as_the_parts_of_normals() -> None:
    assert describe_axes(np.eye(4)) == "x, y, z"
    turned = np.eye(4)[[0, 2, 1, 3]]
    turned[1] *= -1.0
    assert describe_axes(turned) == "x, z, -y"
