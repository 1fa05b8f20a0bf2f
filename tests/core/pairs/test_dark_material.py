"""Surfaces far too bright for their material: undivided, with what is dark around them."""

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
from rtsr_cli.core.pairs.dark_material import (
    find_outshining,
    leave_colour_lost_at_lr,
    leave_glaring,
    leave_outshining,
)
from rtsr_cli.core.pairs.held_samples import HeldSamples, hold_samples

SCALE, SIZE = 4, (96, 128)
BRIGHT = 0.6
GOLD = 0.4
"""Radiance of the thing whose material is gone."""


def make_pair(
    left: float | Tensor,
    radiance: float = GOLD,
    wall: tuple[float, float, float] = (BRIGHT, BRIGHT, BRIGHT),
) -> tuple[Frame, Frame]:
    """A wall, and a square thing before it whose material is `left`."""
    material = torch.tensor(wall).view(1, 3, 1, 1).repeat(1, 1, *SIZE)
    color = torch.full((1, 3, *SIZE), 0.5)
    material[..., 24:72, 32:96] = left
    color[..., 24:72, 32:96] = radiance
    sky = torch.zeros(1, 1, *SIZE)
    camera = CameraMetadata()
    small = [decimate(t, SCALE, (2, 2)) for t in (color, material, sky)]
    parts = demodulate(small[0], small[1], sky=small[2])
    lr = GBuffer(
        {
            Buffer.SKY: small[2],
            Buffer.MATERIAL: parts.material,
            Buffer.LIGHTING: parts.lighting,
            Buffer.LIGHTING_MASK: parts.mask,
        },
        "made by a test",
    )
    scale = lighting_scale(parts.lighting, parts.mask)
    hr = GBuffer({Buffer.MATERIAL: material, Buffer.SKY: sky}, "made by a test")
    return (
        Frame(
            number=1,
            gbuffer=lr,
            camera=camera,
            view=View(display=lr.size),
            lighting_scale=scale,
        ),
        Frame(number=1, gbuffer=hr, camera=camera, view=View(display=hr.size)),
    )


def grazing() -> Tensor:
    """What is left of a specular term: a hundredfold more at the edge."""
    steps = torch.full((64,), 1e-4)
    steps[48:] = torch.logspace(-4, -0.8, 16)
    return steps.expand(48, 64).clone()


@pytest.mark.parametrize("left", [0.0, 0.006, grazing()], ids=["zero", "tiny", "grazing"])
def test_all_of_the_thing_is_left_undivided_and_the_wall_is_not(left: float | Tensor) -> None:
    lr, hr = leave_outshining(*make_pair(left), SCALE)
    bare = (hr.gbuffer[Buffer.MATERIAL] == 0.0).all(1)[0]
    assert bool(bare[24:72, 32:96].all())
    assert float(bare.float().mean()) == pytest.approx(48 * 64 / (96 * 128))
    mask = lr.gbuffer[Buffer.LIGHTING_MASK][0, 0]
    assert float(mask.mean()) == pytest.approx(1.0 - 48 * 64 / (96 * 128))
    # lighting of what is undivided is its radiance
    assert float(lr.gbuffer[Buffer.LIGHTING].max()) < 1.0
    assert lr.lighting_scale == pytest.approx(0.5 / BRIGHT, rel=0.01)


def red_metal() -> Tensor:
    """Green and blue of 0, but for an edge where everything shines."""
    steps = torch.tensor([0.6, 0.0, 0.0]).view(3, 1, 1).repeat(1, 48, 64)
    steps[1:, :, 48:] = torch.logspace(-2.2, -1.1, 16)
    return steps


def test_metal_of_a_saturated_colour_goes_with_its_edges() -> None:
    lr, hr = leave_outshining(*make_pair(red_metal()), SCALE)
    bare = (hr.gbuffer[Buffer.MATERIAL] == 0.0).all(1)[0]
    assert bool(bare[24:72, 32:96].all())
    assert float(bare.float().mean()) == pytest.approx(48 * 64 / (96 * 128))
    assert float(lr.gbuffer[Buffer.LIGHTING].max()) < 1.0


def test_pixels_of_the_thing_beside_samples_of_the_wall_go_with_it() -> None:
    """One pixel more of the thing than samples see: its edge, where it shines a little."""
    lr, hr = make_pair(red_metal())
    hr.gbuffer[Buffer.MATERIAL][..., 24:72, 31] = torch.tensor([0.6, 0.03, 0.03]).view(1, 3, 1)
    _, left = leave_outshining(lr, hr, SCALE)
    assert bool((left.gbuffer[Buffer.MATERIAL][..., 24:72, 31] == 0.0).all())


def test_a_lamp_in_a_dark_glossy_surface_begins_no_group() -> None:
    lr, hr = make_pair(0.04, 2.0)
    assert float(lr.gbuffer[Buffer.LIGHTING].max()) > 8.0 * lr.lighting_scale
    assert leave_outshining(lr, hr, SCALE) == (lr, hr)


def test_a_wall_of_a_saturated_colour_keeps_its_material_beside_it() -> None:
    """A red wall has two dark channels; what is dark is so in all of them, or black in one."""
    lr, hr = make_pair(0.0, wall=(0.8, 0.1, 0.1))
    _, left = leave_outshining(lr, hr, SCALE)
    bare = (left.gbuffer[Buffer.MATERIAL] == 0.0).all(1)
    assert float(bare.float().mean()) == pytest.approx(48 * 64 / (96 * 128))


@pytest.mark.parametrize(
    ("left", "radiance"),
    [(0.04, 0.1), (0.006, 0.01), (0.0, 0.0), (0.3, 4.0)],
    ids=["black plastic", "black metal", "a hole", "a lit wall"],
)
def test_what_is_as_dark_as_its_material_keeps_it(left: float, radiance: float) -> None:
    lr, hr = make_pair(left, radiance)
    assert find_outshining(lr) is None
    assert leave_outshining(lr, hr, SCALE) == (lr, hr)


def test_a_highlight_on_a_dark_surface_is_none() -> None:
    lr, _ = make_pair(0.01, 0.01)
    lr.gbuffer[Buffer.LIGHTING][..., 10, 15] = 100.0
    assert find_outshining(lr) is None


@pytest.mark.parametrize(("light", "kept"), [((1.0, 0.9, 0.8), True), ((0.3, 1.0, 1.0), False)])
def test_grey_surfaces_under_a_lamp_hang_together_with_no_group(
    light: tuple[float, float, float], kept: bool
) -> None:
    """Beside a thing without material, a wall that is lit six times as brightly."""
    lr, hr = make_pair(0.0)
    lamp = torch.zeros(1, 1, *lr.size, dtype=torch.bool)
    lamp[..., 6:18, 24:] = True
    values = lr.gbuffer
    lit = 6.0 * lr.lighting_scale * torch.tensor(light).view(1, 3, 1, 1)
    lr = replace(
        lr,
        gbuffer=values.with_buffers(
            {
                Buffer.MATERIAL: values[Buffer.MATERIAL].masked_fill(lamp, 0.24),
                Buffer.LIGHTING: torch.where(lamp, lit, values[Buffer.LIGHTING]),
            }
        ),
    )
    left, _ = leave_outshining(lr, hr, SCALE)
    beyond = left.gbuffer[Buffer.LIGHTING_MASK][..., 6:18, 29:]
    assert bool((beyond > 0.5).all()) is kept


def with_base_colour(frame: Frame, thing: float) -> Frame:
    """The square thing has a base colour of `thing`, the wall one of its material."""
    material = frame.gbuffer[Buffer.MATERIAL]
    albedo = torch.where(material < BRIGHT, torch.tensor(thing), material)
    return replace(frame, gbuffer=frame.gbuffer.with_buffers({Buffer.ALBEDO: albedo}))


@pytest.mark.parametrize(("base_colour", "kept"), [(0.0, False), (0.05, True)])
def test_what_a_base_colour_of_0_leaves_is_no_divisor(base_colour: float, kept: bool) -> None:
    """Black plastic, which mirrors lamps, has the same divisor; but it has some base colour."""
    lr, hr = (with_base_colour(frame, base_colour) for frame in make_pair(0.04, 0.5))
    small, large = leave_outshining(lr, hr, SCALE)
    thing = large.gbuffer[Buffer.MATERIAL][..., 24:72, 32:96]
    assert bool((thing > 0.0).all()) is kept
    assert bool((thing == 0.0).all()) is not kept
    assert float(small.gbuffer[Buffer.LIGHTING_MASK].mean()) == pytest.approx(1.0 if kept else 0.75)
    # the wall keeps its material
    assert bool((large.gbuffer[Buffer.MATERIAL][..., :24, :] == BRIGHT).all())


def test_a_single_sample_as_bright_as_lamps_lights_nothing() -> None:
    lr, hr = make_pair(0.5)
    values = lr.gbuffer
    lighting, material = values[Buffer.LIGHTING].clone(), values[Buffer.MATERIAL].clone()
    lighting[..., 10, 15], material[..., 10, 15] = 500.0, 0.005
    changed = {Buffer.LIGHTING: lighting, Buffer.MATERIAL: material}
    lr = replace(lr, gbuffer=values.with_buffers(changed))
    left = leave_glaring(lr)
    mask = left.gbuffer[Buffer.LIGHTING_MASK]
    assert float(mask[0, 0, 10, 15]) == 0.0
    assert float(mask.sum()) == mask.numel() - 1
    # no pixel loses its material for it
    assert leave_outshining(lr, hr, SCALE)[1] is hr


def test_samples_that_are_known_begin_no_group() -> None:
    lr, _ = make_pair(0.0)
    found = find_outshining(lr)
    assert found is not None
    assert find_outshining(lr, found) is None


def test_a_thin_part_that_no_sample_hits_goes_with_what_outshines() -> None:
    """Posts of a fence without base colour: slivers of some are seen far from any sample."""
    lr, hr = (with_base_colour(frame, 0.0) for frame in make_pair(0.04, 0.5))
    albedo, material = (hr.gbuffer[b].clone() for b in (Buffer.ALBEDO, Buffer.MATERIAL))
    albedo[..., 4:20, 120], material[..., 4:20, 120] = 0.0, 0.04
    changed = {Buffer.ALBEDO: albedo, Buffer.MATERIAL: material}
    hr = replace(hr, gbuffer=hr.gbuffer.with_buffers(changed))
    _, left = leave_outshining(lr, hr, SCALE)
    assert bool((left.gbuffer[Buffer.MATERIAL][..., 4:20, 120] == 0.0).all())
    assert bool((left.gbuffer[Buffer.MATERIAL][..., 4:20, 121] == BRIGHT).all())


def test_a_base_colour_missing_on_thin_things_is_voted_for_by_samples_of_them() -> None:
    """Bars that few samples hit, one that none does, and a black thing that is right."""
    bars = torch.zeros(1, 1, *SIZE, dtype=torch.bool)
    for top in range(0, SIZE[0], 2 * SCALE):
        bars[..., top : top + SCALE, 41:44] = True
        bars[..., top + SCALE : top + 2 * SCALE, 43:44] = True
    bars[..., 83:84] = True
    black = torch.zeros_like(bars)
    black[..., 20:60, 60:76] = True
    albedo = torch.full((1, 3, *SIZE), BRIGHT).masked_fill(bars | black, 0.0)
    color = torch.full((1, 3, *SIZE), 0.5).masked_fill(black, 0.02)
    depth = torch.full((1, 1, *SIZE), 9.0).masked_fill(bars, 5.0)
    sky = torch.zeros(1, 1, *SIZE)
    images = (color, albedo + 0.03, sky, albedo, depth)
    small = [decimate(image, SCALE, (2, 2)) for image in images]
    parts = demodulate(small[0], small[1], sky=small[2])
    lr = GBuffer(
        {
            Buffer.SKY: small[2],
            Buffer.MATERIAL: parts.material,
            Buffer.LIGHTING: parts.lighting,
            Buffer.LIGHTING_MASK: parts.mask,
            Buffer.ALBEDO: small[3],
            Buffer.DEPTH: small[4],
        },
        "made by a test",
    )
    hr = GBuffer(
        dict(
            zip((Buffer.MATERIAL, Buffer.SKY, Buffer.ALBEDO, Buffer.DEPTH), images[1:], strict=True)
        ),
        "made by a test",
    )
    frames = [
        Frame(number=1, gbuffer=g, camera=CameraMetadata(), view=View(display=g.size))
        for g in (lr, hr)
    ]
    frames[0] = replace(frames[0], lighting_scale=lighting_scale(parts.lighting, parts.mask))
    left, bare = leave_outshining(frames[0], frames[1], SCALE)
    lost = (bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert bool(lost[bars].all())
    assert not bool(lost[black].any())
    undivided = left.gbuffer[Buffer.LIGHTING_MASK] < 0.5
    assert torch.equal(undivided, decimate(bars, SCALE, (2, 2)))


def make_wires(left: float, radiance: float) -> HeldSamples:
    """Wires of two pixels before a wall, whose base colour LR has as a share of HR's."""
    column = torch.arange(SIZE[1]).remainder(16)
    wires = (column >= 2) & (column < 4)
    depth = torch.where(wires, 5.0, 10.0).expand(1, 1, *SIZE)
    color = torch.where(wires, radiance, 0.5).expand(1, 3, *SIZE)
    albedo = torch.full((1, 3, *SIZE), BRIGHT)
    sky = torch.zeros(1, 1, *SIZE)

    def make(colour: Tensor, planes: dict[Buffer, Tensor]) -> Frame:
        gbuffer = GBuffer({Buffer.ALBEDO: colour, Buffer.MATERIAL: colour, **planes}, "a test")
        return Frame(
            number=1, gbuffer=gbuffer, camera=CameraMetadata(), view=View(display=gbuffer.size)
        )

    small = {b: decimate(t, SCALE, (2, 2)) for b, t in ((Buffer.SKY, sky), (Buffer.DEPTH, depth))}
    lost = decimate(torch.where(wires, left * albedo, albedo), SCALE, (2, 2))
    parts = demodulate(decimate(color, SCALE, (2, 2)), lost, sky=small[Buffer.SKY])
    divided = {Buffer.LIGHTING: parts.lighting, Buffer.LIGHTING_MASK: parts.mask}
    lr = replace(
        make(lost, small | divided), lighting_scale=lighting_scale(parts.lighting, parts.mask)
    )
    return hold_samples(lr, make(albedo, {Buffer.SKY: sky, Buffer.DEPTH: depth}), SCALE)


def test_thin_things_that_lost_their_base_colour_at_lr_lose_it_at_hr_too() -> None:
    held = make_wires(left=0.0, radiance=0.5)
    left, bare, gone = leave_colour_lost_at_lr(held)
    wires = held.hr.gbuffer[Buffer.DEPTH] < 7.0
    assert gone is not None
    assert torch.equal(gone, held.lr.gbuffer[Buffer.DEPTH] < 7.0)
    assert torch.equal(bare.gbuffer[Buffer.MATERIAL] == 0.0, wires.expand(-1, 3, -1, -1))
    assert not left.gbuffer[Buffer.LIGHTING_MASK][gone].any()


@pytest.mark.parametrize(("left", "radiance"), [(1.0, 0.5), (0.0, 0.0)])
def test_wires_that_have_their_colour_or_are_dark_keep_their_material(
    left: float, radiance: float
) -> None:
    held = make_wires(left, radiance)
    assert leave_colour_lost_at_lr(held) == (held.lr, held.hr, None)
