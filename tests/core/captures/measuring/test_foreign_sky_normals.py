"""Normals of the sky are no directions: whatever they were cleared to, they take no part."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.normal_finder import find_normals
from rtsr_cli.core.captures.measuring.sky_finder import leave_out_sky
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention, NormalSpace, SkyRule

SIZE = (40, 60)
CLEARED = (0.0, 0.0, 1.0)


def look_down() -> CameraMetadata:
    """A camera whose backward axis is the world's x."""
    view = torch.eye(4)
    view[:3, :3] = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    projection = torch.diag(torch.tensor([1.5, 1.5, -1.0, 0.0]))
    projection[2, 3], projection[3, 2] = -1.0, -0.1
    return CameraMetadata(world_to_camera=view, world_to_ndc=view @ projection)


def make_frame(mark: Buffer | None, *, packed: bool = False) -> dict[Buffer, Tensor]:
    """Surfaces that face the camera in world space, below a sky of (0, 0, 1)."""
    torch.manual_seed(3)
    normal = 0.6 * torch.randn(1, 3, *SIZE)
    normal[:, 0] = normal[:, 0].abs() + 0.5
    normal = torch.nn.functional.normalize(normal, dim=1)
    normal[..., :24, :] = torch.tensor(CLEARED).view(1, 3, 1, 1)
    frame = {Buffer.NORMAL: normal / 2 + 0.5 if packed else normal}
    frame[Buffer.DEPTH] = 3.0 + torch.rand(1, 1, *SIZE)
    if mark is not None:
        frame.setdefault(mark, torch.ones(1, 1, *SIZE))[..., :24, :] = 0.0
    return frame


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("mark", "sky"),
    [
        (Buffer.DEPTH, 0.0),
        (Buffer.ALPHA, SkyRule.ALPHA),
        (Buffer.OBJECT_ID, SkyRule.OBJECT_ID),
        (Buffer.ALPHA, None),
        (Buffer.OBJECT_ID, None),
    ],
)
def test_the_space_is_that_of_the_surfaces(
    mark: Buffer, sky: float | SkyRule | None, packed: bool
) -> None:
    conventions = Conventions(depth=DepthConvention(sky=sky))
    frame = leave_out_sky(make_frame(mark, packed=packed), conventions)
    found = find_normals(frame[Buffer.NORMAL], look_down(), View(display=SIZE))
    assert found.packed is packed
    assert found.space is NormalSpace.WORLD
    assert found.facing["world"] > 0.95


def test_without_that_the_sky_would_tell_another_space() -> None:
    frame = make_frame(Buffer.DEPTH)
    found = find_normals(frame[Buffer.NORMAL], look_down(), View(display=SIZE))
    assert found.space is NormalSpace.VIEW


def test_ids_that_are_0_everywhere_leave_out_nothing() -> None:
    frame = make_frame(None) | {Buffer.OBJECT_ID: torch.zeros(1, 1, *SIZE)}
    kept = leave_out_sky(frame, Conventions())
    assert torch.equal(kept[Buffer.NORMAL], frame[Buffer.NORMAL])
