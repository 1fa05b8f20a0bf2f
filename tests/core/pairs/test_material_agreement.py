"""Material of LR frames held against that of HR frames."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import decimate, sample_jitter
from rtsr_cli.core.pairs import (
    colourless_material,
    doubted_material,
    material_agreement,
    material_causes,
    surface_factors,
)
from rtsr_cli.core.pairs.colourless_material import leave_colourless
from rtsr_cli.core.pairs.held_samples import HeldSamples, hold_samples, is_colourless
from rtsr_cli.core.pairs.material_agreement import find_contradicting, leave_contradicting
from rtsr_cli.core.pairs.material_causes import DARKER_AT_HR, DARKER_AT_LR, UNSAID, name_darker
from rtsr_cli.core.pairs.material_removal import find_taken

SCALE, SIZE = 4, (96, 128)
SPECULAR = 0.05
"""What is left of a material whose base colour is 0."""


def textured() -> Tensor:
    """Stripes of many colours, and a bright thing of an LR pixel's width before them."""
    torch.manual_seed(5)
    stripes = SPECULAR + 0.8 * torch.rand(1, 3, 1, SIZE[1] // 4).repeat_interleave(4, dim=3)
    material = stripes.expand(1, 3, *SIZE).clone()
    material[..., 60:64] = 0.9
    return material


def frame(material: Tensor, jitter_px: Jitter = (0.0, 0.0), **more: Tensor) -> Frame:
    sky = torch.zeros_like(material[:, :1])
    buffers = {Buffer.MATERIAL: material, Buffer.SKY: sky}
    gbuffer = GBuffer(buffers | {Buffer(name): t for name, t in more.items()}, "made by a test")
    camera = CameraMetadata(jitter_px=jitter_px)
    return Frame(number=1, gbuffer=gbuffer, camera=camera, view=View(display=gbuffer.size))


def pair(small: Tensor, large: Tensor, offset: tuple[int, int] = (2, 2)) -> tuple[Frame, Frame]:
    """LR samples of one image, HR pixels of another."""
    jitter_px = (sample_jitter(offset[0], SCALE), sample_jitter(offset[1], SCALE))
    return frame(decimate(small, SCALE, offset), jitter_px), frame(large)


def take_colour(material: Tensor, where: Tensor) -> Tensor:
    return material.masked_fill(where, SPECULAR)


def region(top: int, bottom: int, left: int, right: int) -> Tensor:
    where = torch.zeros(1, 1, *SIZE, dtype=torch.bool)
    where[..., top:bottom, left:right] = True
    return where


EVERYWHERE = region(0, SIZE[0], 0, SIZE[1])
PART = region(20, 76, 40, 100)
THIN = region(8, 90, 60, 64)


def test_one_material_at_both_sizes_agrees() -> None:
    right = textured()
    for known in (right, take_colour(right, PART)):
        for offset in ((2, 2), (0, 3)):
            assert find_contradicting(*pair(known, known, offset), SCALE) is None


@pytest.mark.parametrize("where", [EVERYWHERE, PART, THIN], ids=["everywhere", "part", "thin"])
@pytest.mark.parametrize("size", ["lr", "hr"])
def test_base_colour_of_one_size_contradicts_where_it_is_gone(where: Tensor, size: str) -> None:
    right, bare = textured(), take_colour(textured(), where)
    sides = (bare, right) if size == "lr" else (right, bare)
    found = find_contradicting(*pair(*sides), SCALE)
    assert found is not None
    assert torch.equal(found, decimate(where, SCALE, (2, 2)))


def test_black_textures_do_not_hide_that_a_pass_is_empty() -> None:
    """Every sample has black pixels beside it, whose material is that of no colour."""
    checks = torch.zeros(1, 3, *SIZE)
    rows, columns = torch.meshgrid(*(torch.arange(side) // 3 for side in SIZE), indexing="ij")
    checks[:] = SPECULAR + 0.5 * ((rows + columns) % 2)
    found = find_contradicting(*pair(take_colour(checks, EVERYWHERE), checks), SCALE)
    seen = decimate(checks, SCALE, (2, 2))[:, :1] > SPECULAR
    assert bool(seen.any())
    assert found is not None
    assert torch.equal(found, seen)


def test_samples_that_lie_elsewhere_than_is_known_agree() -> None:
    """LR frames whose jitter nobody declared: other pixels of the same surfaces."""
    right = textured()
    small = frame(decimate(right, SCALE, (0, 0)))
    assert find_contradicting(small, frame(right), SCALE) is None
    # and what is bare beside them is found all the same
    found = find_contradicting(small, frame(take_colour(right, PART)), SCALE)
    assert found is not None
    assert bool(found[..., 7:17, 12:23].all())


def test_means_of_surfaces_agree() -> None:
    """A filter went over the LR frame's buffers."""
    right = textured()
    mean = torch.nn.functional.avg_pool2d(right, SCALE)
    assert find_contradicting(frame(mean), frame(right), SCALE) is None


def test_single_samples_of_what_no_hr_pixel_saw_agree_off_centres() -> None:
    right = textured()
    small = decimate(right, SCALE, (2, 2)).clone()
    small[..., 5, 5] = small[..., 15, 20] = 3.0
    assert find_contradicting(frame(small), frame(right), SCALE) is None


def test_samples_on_joints_thinner_than_pixels_agree() -> None:
    """Bricks: whole columns of LR samples see upright joints that no HR pixel near them sees."""
    right = textured()
    small = decimate(right, SCALE, (2, 2)).clone()
    wall, samples = slice(32, 56), slice(8, 14)
    places = (torch.arange(SIZE[1]) + 0.5, (torch.arange(SIZE[1] // SCALE) + 0.5) * SCALE)
    joints, seen = (torch.where(x % 4.1 < 0.5, 0.8, 0.15) for x in places)
    right[..., wall, :], small[..., samples, :] = joints, seen
    right[..., 32:56:8, :] = 0.8
    assert find_contradicting(frame(small), frame(right), SCALE) is None


def test_what_contradicts_is_left_undivided() -> None:
    right = textured()
    bare = decimate(take_colour(right, PART), SCALE, (2, 2))
    radiance = 2.0 * decimate(right, SCALE, (2, 2))
    jitter_px = (sample_jitter(2, SCALE),) * 2
    divided = frame(
        bare, jitter_px, lighting=radiance / bare, lighting_mask=torch.ones_like(bare[:, :1])
    )
    kept, large = leave_contradicting(divided, frame(right), SCALE)
    gone = decimate(PART, SCALE, (2, 2))
    lighting, mask = kept.gbuffer[Buffer.LIGHTING], kept.gbuffer[Buffer.LIGHTING_MASK]
    assert torch.equal(mask < 0.5, gone)
    assert torch.allclose(lighting, torch.where(gone, radiance, torch.tensor(2.0)), rtol=1e-5)
    assert not kept.gbuffer[Buffer.MATERIAL].masked_select(gone).any()
    # HR pixels up to four LR pixels from it have no material, the others theirs
    bare = (large.gbuffer[Buffer.MATERIAL] == 0).all(1, keepdim=True)
    assert torch.equal(bare, region(4, 92, 24, 116))
    # the scale of lighting is that of what is left
    assert kept.lighting_scale == pytest.approx(2.0, rel=1e-2)


def seen_from_front(one: Frame, depth: Tensor) -> Frame:
    """Add what tells surfaces apart: all face the camera, at some depths."""
    normal = torch.zeros_like(one.gbuffer[Buffer.MATERIAL])
    normal[:, 2] = 1.0
    return replace(
        one, gbuffer=one.gbuffer.with_buffers({Buffer.NORMAL: normal, Buffer.DEPTH: depth})
    )


def test_a_strip_between_bright_things_does_not_hide_that_it_is_black() -> None:
    """A wall of two samples' width between a bright box and a moving thing: no pixel is like it,
    but it is never brighter than all around."""
    strip = region(0, SIZE[0], 40, 48)
    right = torch.full((1, 3, *SIZE), 0.8).masked_fill(strip, 0.5)
    depth = torch.full((1, 1, *SIZE), 5.0).masked_fill(strip, 7.0)
    large = seen_from_front(frame(take_colour(right, strip)), depth)
    jitter_px = (0.05, -0.1)
    small = seen_from_front(
        frame(decimate(right, SCALE, (2, 2)), jitter_px), decimate(depth, SCALE, (2, 2))
    )
    found = find_contradicting(small, large, SCALE)
    assert found is not None
    assert torch.equal(found, decimate(strip, SCALE, (2, 2)))


@pytest.mark.parametrize("guided", [False, True])
def test_a_line_that_no_hr_pixel_sees_agrees(guided: bool) -> None:
    """A joint thinner than HR pixels, which a whole column of LR samples hits."""
    right = torch.full((1, 3, *SIZE), 0.5)
    small = decimate(right, SCALE, (2, 2)).clone()
    small[..., 4:20, 12] = 0.05
    pair = frame(small, (0.05, -0.1)), frame(right)
    if guided:
        depths = torch.full((1, 1, *SIZE), 5.0)
        pair = (
            seen_from_front(pair[0], decimate(depths, SCALE, (2, 2))),
            seen_from_front(pair[1], depths),
        )
    assert find_contradicting(*pair, SCALE) is None


def test_a_base_colour_of_0_at_one_size_contradicts_in_narrow_strips() -> None:
    """Where it is known that no base colour is left, one column of samples does."""
    strip = region(0, SIZE[0], 40, 44)
    right = torch.full((1, 3, *SIZE), 0.8).masked_fill(strip, 0.5)
    depth = torch.full((1, 1, *SIZE), 5.0).masked_fill(strip, 7.0)
    small = seen_from_front(
        frame(decimate(right, SCALE, (2, 2)), (0.05, -0.1)), decimate(depth, SCALE, (2, 2))
    )
    large = seen_from_front(frame(take_colour(right, strip)), depth)
    assert find_contradicting(small, large, SCALE) is None
    albedo = {Buffer.ALBEDO: right.masked_fill(strip, 0.0)}
    large = replace(large, gbuffer=large.gbuffer.with_buffers(albedo))
    found = find_contradicting(small, large, SCALE)
    assert found is not None
    assert torch.equal(found, decimate(strip, SCALE, (2, 2)))


@pytest.mark.parametrize(("size", "named"), [("lr", DARKER_AT_LR), ("hr", DARKER_AT_HR)])
def test_the_size_whose_material_is_the_darker_one_is_named(size: str, named: str) -> None:
    right, bare = textured(), take_colour(textured(), PART)
    lr, hr = pair(*((bare, right) if size == "lr" else (right, bare)))
    left, _ = leave_contradicting(lr, hr, SCALE)
    taken = find_taken(lr, left)
    assert torch.equal(taken, decimate(PART, SCALE, (2, 2)))
    assert name_darker(lr, hr, SCALE, taken) == named


def coloured(albedo: Tensor) -> Tensor:
    """Material of a base colour: that, and a specular remainder."""
    return albedo + SPECULAR


@pytest.mark.parametrize("size", ["lr", "hr"])
def test_a_base_colour_of_0_at_one_size_is_taken_out_however_thin_it_is(size: str) -> None:
    right = textured()
    black = right.masked_fill(THIN, 0.0)
    small, large = (black, right) if size == "lr" else (right, black)
    lr, hr = pair(coloured(small), coloured(large))
    lr = replace(lr, gbuffer=lr.gbuffer.with_buffers({Buffer.ALBEDO: decimate(small, 4, (2, 2))}))
    # the thing stands before the wall
    depth = torch.full((1, 1, *SIZE), 5.0).masked_fill(THIN, 3.0)
    normal = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(1, 3, *SIZE)
    guides = {Buffer.ALBEDO: large, Buffer.DEPTH: depth, Buffer.NORMAL: normal}
    hr = replace(hr, gbuffer=hr.gbuffer.with_buffers(guides))
    left, bare, said = leave_colourless(lr, hr, SCALE)
    # the thing is one sample wide: no group, which is not talked of
    assert list(said) == [UNSAID]
    taken, gone = (
        (frame.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True) for frame in (left, bare)
    )
    assert torch.equal(taken, decimate(THIN, 4, (2, 2)) if size == "lr" else taken & False)
    assert torch.equal(gone, THIN if size == "hr" else gone & False)


def test_a_thing_without_base_colour_at_hr_is_said_where_it_is_a_group() -> None:
    right, thing = textured(), region(20, 60, 40, 60)
    lr, hr = pair(coloured(right), coloured(right))
    lr = replace(lr, gbuffer=lr.gbuffer.with_buffers({Buffer.ALBEDO: decimate(right, 4, (2, 2))}))
    hr = seen_from_front(hr, torch.full((1, 1, *SIZE), 5.0).masked_fill(thing, 3.0))
    bare = {Buffer.ALBEDO: right.masked_fill(thing, 0.0)}
    _, left, said = leave_colourless(lr, replace(hr, gbuffer=hr.gbuffer.with_buffers(bare)), SCALE)
    assert list(said) == [DARKER_AT_HR]
    gone = (left.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(gone, thing)


def test_black_joints_of_a_wall_that_no_sample_hits_are_left() -> None:
    right = textured()
    lr, hr = pair(coloured(right), coloured(right))
    lr = replace(lr, gbuffer=lr.gbuffer.with_buffers({Buffer.ALBEDO: decimate(right, 4, (2, 2))}))
    flat = torch.ones(1, 1, *SIZE), torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    guides = {Buffer.DEPTH: flat[0], Buffer.NORMAL: flat[1].expand(1, 3, *SIZE)}
    guides[Buffer.ALBEDO] = right.masked_fill(THIN, 0.0)
    hr = replace(hr, gbuffer=hr.gbuffer.with_buffers(guides))
    assert leave_colourless(lr, hr, SCALE) == (lr, hr, {})


def test_a_base_colour_of_0_at_both_sizes_is_left() -> None:
    black = textured().masked_fill(PART, 0.0)
    lr, hr = pair(coloured(black), coloured(black))
    assert leave_colourless(lr, hr, SCALE) == (lr, hr, {})
    lr = replace(lr, gbuffer=lr.gbuffer.with_buffers({Buffer.ALBEDO: decimate(black, 4, (2, 2))}))
    hr = replace(hr, gbuffer=hr.gbuffer.with_buffers({Buffer.ALBEDO: black}))
    left, bare, said = leave_colourless(lr, hr, SCALE)
    assert left is lr
    assert bare is hr
    assert not said


def wall_with_things(bare: Tensor) -> tuple[Frame, Frame]:
    """HR base colour is 0 on things before a wall, LR's is right."""
    right = textured()
    lr, hr = pair(coloured(right), coloured(right.masked_fill(bare, 0.0)))
    depth = torch.full((1, 1, *SIZE), 5.0).masked_fill(bare, 3.0)
    hr = seen_from_front(hr, depth)
    lr = seen_from_front(lr, decimate(depth, SCALE, (2, 2)))
    small = {Buffer.ALBEDO: decimate(right, SCALE, (2, 2))}
    large = {Buffer.ALBEDO: right.masked_fill(bare, 0.0)}
    return (
        replace(lr, gbuffer=lr.gbuffer.with_buffers(small)),
        replace(hr, gbuffer=hr.gbuffer.with_buffers(large)),
    )


def test_a_few_bare_pixels_that_no_sample_hits_are_left() -> None:
    """Joints of bricks before the wall behind: finer than pixels, whose samples have colour."""
    joints = region(22, 23, 30, 80)
    lr, hr = wall_with_things(joints)
    assert leave_colourless(lr, hr, SCALE) == (lr, hr, {})


@pytest.mark.parametrize("thing", [region(40, 47, 40, 47), region(0, 96, 61, 63)])
def test_a_small_or_thin_thing_is_told_by_the_samples_that_hit_it(thing: Tensor) -> None:
    if int(thing.sum()) > 100:
        # as many posts as chance would not miss
        thing = reduce(torch.logical_or, [thing.roll(12 * k, 3) for k in range(-3, 4)])
    _, bare, _ = leave_colourless(*wall_with_things(thing), SCALE)
    assert torch.equal((bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True), thing)


def test_diffuse_colour_of_0_is_metal_s_where_f0_is_high() -> None:
    black = torch.zeros(1, 3, *SIZE)
    for f0, bare in ((0.04, True), (0.9, False)):
        one = frame(textured(), albedo=black, specular=torch.full_like(black, f0))
        assert bool(is_colourless(one.gbuffer).all()) is bare


def test_pixels_behind_a_thing_keep_their_material() -> None:
    """Only the thing itself loses division, not the wall four LR pixels around it."""
    right, depth = textured(), torch.full((1, 1, *SIZE), 5.0).masked_fill(PART, 3.0)
    small, large = pair(right, take_colour(right, PART))
    small = seen_from_front(small, decimate(depth, SCALE, (2, 2)))
    left, bare = leave_contradicting(small, seen_from_front(large, depth), SCALE)
    gone = (bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(gone, PART)
    assert torch.equal(find_taken(small, left), decimate(PART, SCALE, (2, 2)))


def test_means_of_thin_leaves_agree() -> None:
    """A filter went over LR's material; the pixels in the middle of blocks see the wall alone."""
    leaves = region(16, 80, 24, 104) & ((torch.arange(SIZE[1]) % 4) != 2)
    right = torch.full((1, 3, *SIZE), 0.05).masked_fill(leaves, 0.9)
    mean = F.avg_pool2d(right, SCALE)
    assert find_contradicting(frame(mean), frame(right), SCALE) is None


def wire(left: float, at_lr: bool) -> tuple[Frame, Frame]:
    """A round wire of an LR pixel's width, whose normals turn from pixel to pixel."""
    strip = region(0, SIZE[0], 40, 44)
    right = torch.full((1, 3, *SIZE), 0.5).masked_fill(strip, 0.8)
    wrong = right.masked_fill(strip, left)
    depth = torch.full((1, 1, *SIZE), 10.0).masked_fill(strip, 5.0)
    frames = []
    for size, albedo in (("lr", wrong if at_lr else right), ("hr", right if at_lr else wrong)):
        turned = torch.tensor([0.8 if size == "lr" else -0.8, 0.0, 0.6]).view(1, 3, 1, 1)
        normal = torch.where(strip, turned, torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1))
        images = [albedo + 0.005, albedo, normal, depth]
        if size == "lr":
            images = [decimate(image, SCALE, (2, 2)) for image in images]
        material, *guides = images
        names = ("albedo", "normal", "depth")
        jitter = (0.05, -0.1) if size == "lr" else (0.0, 0.0)
        frames.append(frame(material, jitter, **dict(zip(names, guides, strict=True))))
    return frames[0], frames[1]


@pytest.mark.parametrize("at_lr", [False, True])
def test_a_wire_whose_base_colour_is_lost_at_one_size_contradicts(at_lr: bool) -> None:
    """It is found by its depth, and all of its HR pixels go with it."""
    strip = region(0, SIZE[0], 40, 44)
    assert find_contradicting(*wire(0.8, at_lr), SCALE) is None
    lr, hr = wire(0.02, at_lr)
    found = find_contradicting(lr, hr, SCALE)
    assert found is not None
    assert torch.equal(found, decimate(strip, SCALE, (2, 2)))
    _, bare = leave_contradicting(lr, hr, SCALE)
    assert torch.equal((bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True), strip)


def test_parts_without_samples_go_with_things_of_their_colour() -> None:
    """A second wire, between the samples; the same colour where both sizes have it is right."""
    lr, hr = wire(0.02, at_lr=False)
    beside, known = region(0, SIZE[0], 83, 84), region(40, 60, 100, 124)
    for name, value in ((Buffer.ALBEDO, 0.02), (Buffer.MATERIAL, 0.025)):
        changed = hr.gbuffer[name].masked_fill(beside | known, value)
        hr = replace(hr, gbuffer=hr.gbuffer.with_buffers({name: changed}))
        small = lr.gbuffer[name].masked_fill(decimate(known, SCALE, (2, 2)), value)
        lr = replace(lr, gbuffer=lr.gbuffer.with_buffers({name: small}))
    _, left = leave_contradicting(lr, hr, SCALE)
    bare = (left.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert bool(bare[beside].all())
    assert not bool(bare[known].any())


def test_a_texture_that_both_sizes_have_is_no_group_for_a_few_samples() -> None:
    """Four samples are darker than all pixels around; those beside are as dark as some."""
    large = torch.full((1, 3, *SIZE), 0.6)
    large[..., ::SCALE, ::SCALE] = 0.2
    small = torch.full((1, 3, SIZE[0] // SCALE, SIZE[1] // SCALE), 0.6)
    small[..., 6:18, 8:20] = 0.14
    small[..., 11:13, 13:15] = 0.13
    # most of the frame tells, as it does of right frames
    assert find_contradicting(frame(small, (0.05, -0.1)), frame(large), SCALE) is None


def test_samples_are_held_against_hr_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every rule of right frames looks at the same samples."""
    calls = []

    def hold(lr: Frame, hr: Frame, scale: int) -> HeldSamples:
        calls.append(scale)
        return hold_samples(lr, hr, scale)

    for module in (
        colourless_material,
        doubted_material,
        material_agreement,
        material_causes,
        surface_factors,
    ):
        monkeypatch.setattr(module, "hold_samples", hold)
    lr, hr = wire(0.8, at_lr=False)
    assert doubted_material.leave_doubted(lr, hr, SCALE, divided=False).doubted == {}
    assert calls == [SCALE]


def test_a_texture_that_both_sizes_have_is_no_thin_thing() -> None:
    """As above, with base colours and one depth: eight samples alone tell nothing among many."""
    large = torch.full((1, 3, *SIZE), 0.6)
    large[..., ::SCALE, ::SCALE] = 0.2
    small = torch.full((1, 3, SIZE[0] // SCALE, SIZE[1] // SCALE), 0.6)
    small[..., 6:18, 8:20] = 0.14
    small[..., 11:13, 12:16] = 0.13
    pairs = zip((small, large), ((0.05, -0.1), (0.0, 0.0)), strict=True)
    lr, hr = (
        frame(m, jitter, albedo=m, depth=torch.full_like(m[:, :1], 5.0)) for m, jitter in pairs
    )
    assert find_contradicting(lr, hr, SCALE) is None
