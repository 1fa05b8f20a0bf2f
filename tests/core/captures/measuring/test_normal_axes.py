"""In which axes normals stand on surfaces, in the room whose cameras are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.measuring.camera_evidence import NormalEvidence
from rtsr_cli.core.captures.measuring.camera_structure import SIGNED_AXES
from rtsr_cli.core.captures.measuring.normal_axes import NormalAxes, measure_axes
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
