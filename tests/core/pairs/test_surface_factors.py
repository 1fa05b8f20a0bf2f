"""Surfaces whose material at one size is a multiple of that at the other."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.doubted_material import leave_doubted
from rtsr_cli.core.pairs.material_causes import DIFFERS
from rtsr_cli.core.pairs.surface_factors import bound_quotients, find_scaled, leave_scaled
from tests.core.pairs.test_material_agreement import (
    PART,
    SCALE,
    SIZE,
    THIN,
    frame,
    region,
    seen_from_front,
    textured,
)

JITTER = (0.05, -0.1)


def make_pair(small: Tensor, large: Tensor, thing: Tensor) -> tuple:
    """LR samples off pixel centres of one image, HR pixels of another; a thing before a wall."""
    depth = torch.full((1, 1, *SIZE), 5.0).masked_fill(thing, 3.0)
    lr = frame(decimate(small, SCALE, (2, 2)), JITTER)
    return (
        seen_from_front(lr, decimate(depth, SCALE, (2, 2))),
        seen_from_front(frame(large), depth),
    )


@pytest.mark.parametrize("factor", [0.5, 0.75, 1.4, 2.0])
@pytest.mark.parametrize("thing", [PART, THIN], ids=["part", "thin"])
@pytest.mark.parametrize("flat", [False, True])
def test_a_factor_on_one_thing_is_found(factor: float, thing: Tensor, flat: bool) -> None:
    right = torch.full((1, 3, *SIZE), 0.3) if flat else textured()
    changed = torch.where(thing, factor * right, right)
    for sizes in ((right, changed), (changed, right)):
        found = find_scaled(*make_pair(*sizes, thing), SCALE)
        assert found is not None
        assert torch.equal(found, decimate(thing, SCALE, (2, 2)))


def test_the_thing_loses_its_division_and_the_wall_behind_does_not() -> None:
    right = torch.full((1, 3, *SIZE), 0.3)
    lr, hr = make_pair(torch.where(PART, 0.5 * right, right), right, PART)
    left, bare = leave_scaled(lr, hr, SCALE)
    gone = (bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(gone, PART)
    taken = (left.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(taken, decimate(PART, SCALE, (2, 2)))
    assert list(leave_doubted(lr, hr, SCALE, divided=False).doubted) == [DIFFERS]


def test_textures_that_are_sampled_elsewhere_are_right() -> None:
    torch.manual_seed(3)
    noise = 0.1 + 0.8 * torch.rand(1, 3, *SIZE)
    none = region(0, 0, 0, 0)
    for offset in ((0, 0), (3, 1), (2, 2)):
        lr, hr = make_pair(noise, noise, none)
        small = {Buffer.MATERIAL: decimate(noise, SCALE, offset)}
        lr = replace(lr, gbuffer=lr.gbuffer.with_buffers(small))
        assert leave_scaled(lr, hr, SCALE) == (lr, hr)


def test_means_of_a_thin_thing_and_the_wall_are_right() -> None:
    """A filter went over LR material: along the thing every sample is a mixture."""
    right = torch.full((1, 3, *SIZE), 0.8).masked_fill(region(8, 90, 61, 63), 0.1)
    thing = region(8, 90, 60, 64)
    lr, hr = make_pair(right, right, thing)
    mean = {Buffer.MATERIAL: F.avg_pool2d(right, SCALE)}
    lr = replace(lr, gbuffer=lr.gbuffer.with_buffers(mean))
    assert find_scaled(lr, hr, SCALE) is None


def test_what_two_roundings_leave_is_no_factor() -> None:
    right = torch.full((1, 3, *SIZE), 0.3)
    assert (
        find_scaled(*make_pair(torch.where(PART, 1.19 * right, right), right, PART), SCALE) is None
    )


def test_a_few_samples_tell_no_factor() -> None:
    """Strips along edges of right things that no pixel shows."""
    tall = (4 * 30 * SCALE, 8 * SCALE)
    right = torch.full((1, 3, *tall), 0.3)
    found = []
    for rows in (5, 40):
        thing = torch.zeros((1, 1, *tall), dtype=torch.bool)
        thing[..., : rows * SCALE, 3 * SCALE : 4 * SCALE] = True
        depth = torch.full((1, 1, *tall), 5.0).masked_fill(thing, 3.0)
        small = torch.where(thing, 0.15, right)
        lr = seen_from_front(
            frame(decimate(small, SCALE, (2, 2)), JITTER), decimate(depth, SCALE, (2, 2))
        )
        found.append(find_scaled(lr, seen_from_front(frame(right), depth), SCALE) is not None)
    assert found == [False, True]


HUES = [(0.2, 1.4, 1.4), (1.0, 1.0, 0.4), (0.02, 1.3, 2.0)]


@pytest.mark.parametrize("hue", HUES)
@pytest.mark.parametrize("thing", [PART, THIN], ids=["part", "thin"])
@pytest.mark.parametrize("flat", [False, True])
def test_another_hue_of_one_thing_is_found(
    hue: tuple[float, ...], thing: Tensor, flat: bool
) -> None:
    """All channels together have nearly as much."""
    right = torch.full((1, 3, *SIZE), 0.3) if flat else textured()
    changed = torch.where(thing, torch.tensor(hue).view(1, 3, 1, 1) * right, right)
    for sizes in ((right, changed), (changed, right)):
        found = find_scaled(*make_pair(*sizes, thing), SCALE)
        assert found is not None
        assert torch.equal(found, decimate(thing, SCALE, (2, 2)))


def test_a_colour_in_place_of_a_texture_is_found() -> None:
    right, thing = textured(), PART
    changed = torch.where(thing, torch.tensor([0.004, 0.5, 1.2]).view(1, 3, 1, 1), right)
    for sizes in ((right, changed), (changed, right)):
        found = find_scaled(*make_pair(*sizes, thing), SCALE)
        assert found is not None
        assert float(found.float().mean()) == pytest.approx(float(thing.float().mean()), rel=0.1)


def test_a_line_of_samples_that_pixels_beside_are_like_tells_nothing() -> None:
    """Slats and edges: a sample sees the one half of a pixel, and the pixel's middle the other."""
    slat = region(0, SIZE[0], 60, 64)
    right = torch.full((1, 3, *SIZE), 0.2).masked_fill(slat, 0.5)
    depth = torch.full((1, 1, *SIZE), 3.2).masked_fill(slat, 3.0)
    wall = torch.full((1, 3, *SIZE), 0.2)
    lr = seen_from_front(
        frame(decimate(wall, SCALE, (2, 2)), JITTER), decimate(depth, SCALE, (2, 2))
    )
    assert find_scaled(lr, seen_from_front(frame(right), depth), SCALE) is None
    # of a colour that is nowhere at HR they do
    lr = seen_from_front(
        frame(decimate(right * 3.0, SCALE, (2, 2)), JITTER), decimate(depth, SCALE, (2, 2))
    )
    assert find_scaled(lr, seen_from_front(frame(right), depth), SCALE) is not None


@pytest.mark.parametrize("count", [4, 5, 8, 25])
def test_few_samples_of_a_texture_agree_on_no_factor_by_chance(count: int) -> None:
    torch.manual_seed(3)
    logs = torch.randn(100_000, count)
    middle, spread = logs.mean(1), logs.var(1, correction=0)
    bound = bound_quotients(torch.full((1,), count))
    assert float((count * middle**2 > bound * spread).double().mean()) <= 1e-4
