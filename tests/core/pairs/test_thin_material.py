"""Things too thin for groups of samples, whose base colour is lost or another at one size."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.demodulation import demodulate, lighting_scale
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs import thin_material
from rtsr_cli.core.pairs.doubted_material import leave_doubted
from rtsr_cli.core.pairs.held_samples import hold_samples
from rtsr_cli.core.pairs.material_causes import UNSAID
from rtsr_cli.core.pairs.thin_material import find_lost_things

SCALE, SIZE = 4, (96, 128)
ROD, WALL, SPECULAR = 0.5, 0.6, 0.04
LOST, DARK, OTHER = (0.0, 0.0, 0.0), (0.02, 0.02, 0.02), (0.1, 0.5, 0.9)


def mark_rods() -> Tensor:
    """Rods of two pixels before the wall, with a sample of each in every fourth row."""
    rods = torch.zeros(1, 1, *SIZE, dtype=torch.bool)
    rods[..., 8:64, 30:32] = rods[..., 8:64, 66:68] = True
    return rods


def make_frames(at_lr: tuple[float, ...], at_hr: tuple[float, ...], light: float = 1.0):
    """Rods of grey `ROD` that are stored as these base colours."""
    rods = mark_rods()
    depth = torch.where(rods, 4.0, 8.0)
    color = torch.where(rods, light * (ROD + SPECULAR), WALL + SPECULAR).expand(-1, 3, -1, -1)
    sky = torch.zeros(1, 1, *SIZE)
    frames = []
    for colour in (at_lr, at_hr):
        albedo = torch.where(rods, torch.tensor(colour).view(1, 3, 1, 1), WALL)
        parts = {
            Buffer.SKY: sky,
            Buffer.DEPTH: depth,
            Buffer.ALBEDO: albedo,
            Buffer.MATERIAL: albedo + SPECULAR,
            Buffer.COLOR: color,
        }
        if not frames:
            parts = {name: decimate(image, SCALE, (2, 2)) for name, image in parts.items()}
            divided = demodulate(parts[Buffer.COLOR], parts[Buffer.MATERIAL], sky=parts[Buffer.SKY])
            parts |= {Buffer.LIGHTING: divided.lighting, Buffer.LIGHTING_MASK: divided.mask}
        buffers = GBuffer(parts, "made by a test")
        frame = Frame(
            number=1, gbuffer=buffers, camera=CameraMetadata(), view=View(display=buffers.size)
        )
        if not frames:
            k = lighting_scale(divided.lighting, divided.mask)
            frame = replace(frame, lighting_scale=k)
        frames.append(frame)
    return frames


@pytest.mark.parametrize(
    ("at_lr", "at_hr"),
    [
        (DARK, (ROD,) * 3),
        ((ROD,) * 3, DARK),
        (DARK, DARK),
        (LOST, LOST),
        (OTHER, (ROD,) * 3),
        ((ROD,) * 3, OTHER),
    ],
)
def test_thin_things_of_a_wrong_colour_have_no_material(at_lr, at_hr) -> None:
    lr, hr = make_frames(at_lr, at_hr)
    things = find_lost_things(hold_samples(lr, hr, SCALE))
    assert things is not None
    assert torch.equal(things.pixels, mark_rods())
    pair = leave_doubted(lr, hr, SCALE, divided=True)
    lost = (pair.hr.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(lost, mark_rods())
    rods = decimate(mark_rods(), SCALE, (2, 2))
    assert torch.equal(pair.lr.gbuffer[Buffer.LIGHTING_MASK] < 0.5, rods)
    assert pair.doubted


@pytest.mark.parametrize("colour", [LOST, DARK, OTHER])
def test_things_that_are_right_keep_their_material(colour) -> None:
    lr, hr = make_frames(colour, colour, light=0.05)
    assert find_lost_things(hold_samples(lr, hr, SCALE)) is None


def test_colours_that_are_as_near_as_those_of_a_texture_contradict_nothing() -> None:
    lr, hr = make_frames((ROD / 3.0,) * 3, (ROD,) * 3)
    assert find_lost_things(hold_samples(lr, hr, SCALE)) is None


def test_what_few_dark_samples_show_is_left_and_not_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thin_material, "MANY", 1000)
    lr, hr = make_frames(DARK, DARK)
    things = find_lost_things(hold_samples(lr, hr, SCALE))
    assert things is not None
    assert not things.sure
    assert things.samples[UNSAID].any()
    assert torch.equal(things.pixels, mark_rods())
    # what is said of pixels without material is said of those that have none in the files
    pair = leave_doubted(lr, hr, SCALE, divided=True)
    assert pair.bare is not None
    assert not pair.bare.any()


def test_tiles_hold_every_marked_pixel_once() -> None:
    where = torch.rand(1, 1, 200, 330, generator=torch.Generator().manual_seed(1)) < 0.2
    found = torch.zeros_like(where, dtype=torch.int32)
    side = thin_material.FURTHER * SCALE
    for some, top, left in thin_material._list_tiles(where, SCALE):
        rows, columns = some.T
        assert len(some) <= thin_material.AT_ONCE // 8
        assert bool(
            (
                (rows // side == top * SCALE // side) & (columns // side == left * SCALE // side)
            ).all()
        )
        found[0, 0, rows, columns] += 1
    assert torch.equal(found, where.int())
