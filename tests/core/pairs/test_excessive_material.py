"""Material that no surface reflects: its whole surface is undivided, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.doubted_material import leave_doubted
from rtsr_cli.core.pairs.excessive_material import EXCESSIVE, find_excessive, leave_excessive
from tests.core.pairs.test_dark_material import GOLD, SCALE, SIZE, make_pair

THING = (slice(None), slice(None), slice(24, 72), slice(32, 96))
SAMPLES = (slice(None), slice(None), slice(6, 18), slice(8, 24))


def conductor(most: float) -> Tensor:
    """What Mitsuba calls albedo of metal, from facing the camera to its rim; 2 at most."""
    return torch.logspace(0.9, -1.5, 64).clamp(max=most).expand(48, 64).clone()


def make_deep_pair(left: Tensor) -> tuple[Frame, Frame]:
    """The wall is behind the thing."""
    depth = torch.full((1, 1, *SIZE), 8.0)
    depth[THING] = 4.0
    lr, hr = (
        replace(frame, gbuffer=frame.gbuffer.with_buffers({Buffer.DEPTH: image}))
        for frame, image in zip(
            make_pair(left), (decimate(depth, SCALE, (2, 2)), depth), strict=True
        )
    )
    return lr, hr


def test_all_of_the_surface_is_left_undivided_and_the_wall_is_not() -> None:
    lr, hr = make_deep_pair(conductor(2.0))
    left, bare, found = leave_excessive(lr, hr, SCALE)
    assert found is not None
    thing = torch.zeros_like(found)
    thing[SAMPLES] = True
    assert torch.equal(found, thing)
    assert torch.equal(left.gbuffer[Buffer.LIGHTING_MASK] < 0.5, thing)
    assert left.gbuffer[Buffer.LIGHTING][SAMPLES].sub(GOLD).abs().max() < 1e-6
    assert (bare.gbuffer[Buffer.MATERIAL][THING] == 0.0).all()
    pair = leave_doubted(lr, hr, SCALE, divided=True)
    assert torch.equal(pair.doubted[EXCESSIVE], thing)


@pytest.mark.parametrize("most", [1.9, 1.0])
def test_material_that_surfaces_may_have_is_left_as_it_is(most: float) -> None:
    lr, hr = make_pair(conductor(most))
    assert find_excessive(lr) is None
    assert leave_excessive(lr, hr, SCALE) == (lr, hr, None)


def lit_texture(bright: int) -> Frame:
    """A texture that light was multiplied by, with so many samples a side of 2 in it."""
    torch.manual_seed(4)
    material = 0.2 + 0.7 * torch.rand(1, 3, 12, 16).repeat_interleave(4, 2).repeat_interleave(4, 3)
    material[..., 16 : 16 + 4 * bright, 16 : 16 + 4 * bright] = 2.0
    lr, _ = make_pair(material[0, 0])
    small = decimate(material, SCALE, (2, 2))
    lr.gbuffer[Buffer.MATERIAL][SAMPLES] = small
    lr.gbuffer[Buffer.LIGHTING][SAMPLES] = 0.5
    return lr


def test_a_surface_that_radiance_follows_keeps_its_material_beside_what_is_too_bright() -> None:
    found = find_excessive(lit_texture(bright=3))
    assert found is not None
    assert int(found.sum()) == 9
    # single samples are no surface
    assert find_excessive(lit_texture(bright=1)) is None
