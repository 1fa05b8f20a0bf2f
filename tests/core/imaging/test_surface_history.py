"""Past values on the surfaces of a frame: fetched from one's own, filled from around."""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.surface_history import (
    fill_along_surfaces,
    warp_along_surfaces,
    warp_with_and_without,
)
from rtsr_cli.core.imaging.surfaces import Surfaces, describe_surfaces
from rtsr_cli.core.imaging.warping import backward_warp

SIZE = (24, 40)


def two_objects(border: int) -> Surfaces:
    """A wall of object 1, left of `border` covered by object 2, nearer."""
    height, width = SIZE
    ids = torch.ones(1, 1, height, width, dtype=torch.int32)
    ids[..., :border] = 2
    depth = torch.where(ids == 2, 2.0, 5.0)
    normal = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(1, 3, height, width)
    buffers = {Buffer.NORMAL: normal.clone(), Buffer.DEPTH: depth, Buffer.OBJECT_ID: ids}
    frame = Frame(
        number=1,
        gbuffer=GBuffer(buffers, "test"),
        camera=CameraMetadata(),
        view=View(display=SIZE),
    )
    return describe_surfaces(frame, torch.ones(1, 1, height, width))


def paint(border: int) -> Tensor:
    """1 on the object in front, 3 on the wall."""
    values = torch.full((1, 3, *SIZE), 3.0)
    values[..., :border] = 1.0
    return values


def fall_back(pixels: Tensor) -> Tensor:
    """What is no value of any picture."""
    return torch.full((3, len(pixels)), -9.0)


def test_without_motion_values_stay_as_they_are() -> None:
    surfaces = two_objects(15)
    carried = warp_along_surfaces(paint(15), torch.zeros(1, 2, *SIZE), surfaces, surfaces)
    torch.testing.assert_close(carried.values, paint(15))
    assert carried.weight.min() > 0.99


def test_half_a_pixel_of_motion_mixes_no_two_surfaces() -> None:
    surfaces = two_objects(15)
    motion = torch.zeros(1, 2, *SIZE)
    motion[:, 0] = 0.5
    carried = warp_along_surfaces(paint(15), motion, surfaces, surfaces)
    inside = carried.weight[0, 0] > 0.2
    torch.testing.assert_close(
        carried.values[..., inside], paint(15)[..., inside], rtol=0, atol=1e-5
    )


def test_what_was_hidden_is_a_hole_and_is_filled_from_its_own_surface() -> None:
    """The object in front went left by six pixels: what it uncovers is wall, not object."""
    now, past = two_objects(10), two_objects(16)
    motion = torch.zeros(1, 2, *SIZE)
    motion[:, 0, :, :10] = 6.0
    carried = warp_along_surfaces(paint(16), motion, now, past)
    holes = (carried.weight < 0.2).float()
    assert holes[..., 10:16].min() == 1.0
    assert holes[..., 16:].max() == 0.0
    filled = fill_along_surfaces(carried.values, holes, now, fallback=fall_back)
    torch.testing.assert_close(filled, paint(10), rtol=0, atol=1e-4)


def test_a_surface_that_was_never_seen_keeps_the_fallback() -> None:
    surfaces = two_objects(15)
    holes = torch.zeros(1, 1, *SIZE)
    holes[..., :15] = 1.0
    filled = fill_along_surfaces(paint(15), holes, surfaces, fallback=fall_back)
    assert (filled[..., :15] == -9.0).all()
    torch.testing.assert_close(filled[..., 15:], paint(15)[..., 15:])


def test_nearer_pixels_of_a_surface_outweigh_farther_ones() -> None:
    surfaces = two_objects(0)
    values = torch.zeros(1, 3, *SIZE)
    values[..., 20:] = torch.arange(20.0)
    holes = torch.zeros(1, 1, *SIZE)
    holes[..., :20] = 1.0
    filled = fill_along_surfaces(values, holes, surfaces, fallback=fall_back)
    # of 0 and 1 beside it, the nearer one more
    assert 0.0 < float(filled[0, 0, 12, 19]) < 0.5
    assert float(filled[0, 0, 12, 19]) < float(filled[0, 0, 12, 8])


def test_threads_change_no_bit() -> None:
    torch.manual_seed(1)
    surfaces = two_objects(15)
    holes = (torch.rand(1, 1, *SIZE) > 0.6).float()
    values = torch.rand(1, 3, *SIZE)
    one = fill_along_surfaces(values, holes, surfaces, fallback=fall_back)
    torch.set_num_threads(2)
    try:
        two = fill_along_surfaces(values, holes, surfaces, fallback=fall_back)
    finally:
        torch.set_num_threads(1)
    assert torch.equal(one, two)


def test_beside_it_stands_what_lies_there_whatever_surface_it_is_of() -> None:
    torch.manual_seed(2)
    motion, values = 3.0 * torch.randn(1, 2, *SIZE), torch.rand(1, 3, *SIZE)
    now, past = two_objects(16), two_objects(15)
    along, plain = warp_with_and_without(values, motion, now, past.pack())
    alone = warp_along_surfaces(values, motion, now, past)
    assert torch.equal(along.values, alone.values)
    assert torch.equal(along.weight, alone.weight)
    warped, inside = backward_warp(values, motion)
    torch.testing.assert_close(plain, warped, rtol=0, atol=1e-6)
    assert torch.equal(along.inside, inside)
    assert float(along.weight[inside == 0].max()) == 0.0
