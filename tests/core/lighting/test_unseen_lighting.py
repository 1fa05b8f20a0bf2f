"""Lighting of what nothing seen belongs to: of what lies near, and faces as it does."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.enlargement import AVERAGE_LOG_LIGHTING
from rtsr_cli.core.imaging.surfaces import Surfaces, describe_surfaces
from rtsr_cli.core.lighting.unseen_lighting import GRID_PIXELS, find_grid, guess_lighting

SIZE = (20, 30)
UP, AHEAD = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def surfaces(floor: Tensor, across: float = 0.1) -> Surfaces:
    """A floor where `floor` is 1, else a wall; pixels lie `across` metres apart, 2 m away."""
    up, ahead = (torch.tensor(v).view(1, 3, 1, 1) for v in (UP, AHEAD))
    y, x = torch.meshgrid(*(torch.arange(float(s)) for s in SIZE), indexing="ij")
    position = torch.stack([across * x, across * y, torch.zeros(SIZE)])[None]
    buffers = {
        Buffer.NORMAL: torch.where(floor > 0.5, up, ahead),
        Buffer.DEPTH: torch.full((1, 1, *SIZE), 2.0),
        Buffer.POSITION: position,
    }
    frame = Frame(
        number=1,
        gbuffer=GBuffer(buffers, "test"),
        camera=CameraMetadata(),
        view=View(display=SIZE),
    )
    return describe_surfaces(frame, torch.ones(1, 1, *SIZE))


def index(row: int, column: int) -> Tensor:
    return torch.tensor([row * SIZE[1] + column])


def test_what_faces_the_same_way_lights_what_is_not_seen() -> None:
    """The upper half is a wall, the lower one a floor of other light; what is sought lies between,
    nearer to the wall.
    """
    floor = torch.zeros(1, 1, *SIZE)
    floor[..., 10:, :] = 1.0
    encoded = torch.where(floor > 0.5, 1.5, 0.3).expand(1, 3, *SIZE).clone()
    floor[..., 5, 5] = 1.0
    known = torch.ones(1, 1, *SIZE)
    known[..., 5, 5] = 0.0
    encoded[..., 5, 5] = 7.0
    guessed = guess_lighting(encoded, known, surfaces(floor), index(5, 5))
    torch.testing.assert_close(guessed, torch.full((3, 1), 1.5), rtol=0, atol=1e-3)


def test_what_lies_near_counts_more() -> None:
    wall = surfaces(torch.zeros(1, 1, *SIZE))
    encoded = torch.full((1, 3, *SIZE), 0.2)
    encoded[..., 15:] = 1.0
    known = torch.ones(1, 1, *SIZE)
    left, right = (guess_lighting(encoded, known, wall, index(10, x))[0, 0] for x in (2, 27))
    assert 0.2 < left < 0.5 < right < 1.0


def test_it_is_a_mean_of_roots_by_distance() -> None:
    """Two pixels are known, 0.3 m and 0.6 m away at a depth of 2 m."""
    wall = surfaces(torch.zeros(1, 1, *SIZE))
    known = torch.zeros(1, 1, *SIZE)
    known[..., 10, [13, 16]] = 1.0
    encoded = torch.zeros(1, 3, *SIZE)
    encoded[..., 10, 13], encoded[..., 10, 16] = 0.25, 1.0
    near, far = (1.0 / (0.14**2 + (d / 2.0) ** 2) for d in (0.3, 0.6))
    expected = ((0.5 * near + 1.0 * far) / (near + far)) ** 2
    guessed = guess_lighting(encoded, known, wall, index(10, 10))
    assert guessed[:, 0].tolist() == pytest.approx([expected] * 3, rel=1e-4)


def test_where_nothing_is_known_lighting_is_average() -> None:
    wall = surfaces(torch.zeros(1, 1, *SIZE))
    none = torch.zeros(1, 1, *SIZE)
    guessed = guess_lighting(torch.ones(1, 3, *SIZE), none, wall, index(0, 0))
    assert guessed[:, 0].tolist() == pytest.approx([AVERAGE_LOG_LIGHTING] * 3)


@pytest.mark.parametrize("size", [(1, 1), SIZE, (288, 480), (720, 1280), (9000, 2)])
def test_the_grid_has_about_so_many_pixels_at_any_size(size: tuple[int, int]) -> None:
    grid = find_grid(torch.ones(1, 1, *size))
    whole = math.prod(size)
    assert min(whole, GRID_PIXELS / 2) <= len(grid) <= min(whole, 2 * GRID_PIXELS)
    assert int(grid.max()) < whole
