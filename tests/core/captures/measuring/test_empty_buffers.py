"""Buffers that say nothing of surfaces: what is seen, where, and the share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.captures.bound_channels import (
    BoundBuffer,
    BoundChannel,
    BoundSum,
    bind_channels,
)
from rtsr_cli.core.captures.buffer_expressions import parse_expression
from rtsr_cli.core.captures.measuring.empty_buffers import BufferFault, find_faults
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention, NormalConvention, SkyRule

SIZE = (40, 60)
PLAIN = Conventions()


BINDING = {
    Buffer.ROUGHNESS: bind_channels(BoundChannel(stream="", channel="Rough")),
    Buffer.METALLIC: bind_channels(BoundChannel(stream="", channel="Two Words")),
    Buffer.NOV: BoundBuffer(
        (BoundSum(terms=(BoundChannel(stream="", channel="tilt", factor=-1.0),), constant=1.0),)
    ),
    Buffer.ALBEDO: bind_channels(*(BoundChannel(stream="", channel=f"base.{c}") for c in "RGB")),
    Buffer.NORMAL: bind_channels(*(BoundChannel(stream="", channel=f"N.{c}") for c in "XYZ")),
}


def room(seed: int = 1) -> dict[Buffer, Tensor]:
    """Surfaces of every kind below a sky that fills a quarter."""
    torch.manual_seed(seed)
    depth = 4.0 + 16.0 * torch.rand(1, 1, *SIZE)
    depth[..., :10, :] = SKY_DEPTH_M
    normal = torch.nn.functional.normalize(torch.randn(1, 3, *SIZE), dim=1)
    normal[..., :10, :] = 0.0
    frame = {Buffer.DEPTH: depth, Buffer.NORMAL: normal, Buffer.ALBEDO: torch.rand(1, 3, *SIZE)}
    for buffer in (Buffer.ROUGHNESS, Buffer.METALLIC, Buffer.NOV):
        frame[buffer] = torch.rand(1, 1, *SIZE)
    frame[Buffer.MOTION] = torch.randn(1, 2, *SIZE)
    return frame


def look(
    *frames: Mapping[Buffer, Tensor], conventions: Conventions = PLAIN, still: bool = False
) -> tuple[BufferFault, ...]:
    """Faults of frames 1, 2, ..., whose camera moves on."""
    cameras = {}
    for number in range(1, len(frames) + 1):
        pose = torch.eye(4)
        pose[3, 0] = 0.0 if still else float(number)
        cameras[number] = CameraMetadata(world_to_camera=pose)
    return find_faults(dict(enumerate(frames, 1)), conventions, cameras, 1, BINDING)


def test_frames_that_are_whole_have_none() -> None:
    assert look(room(1), room(2), room(3)) == ()


@pytest.mark.parametrize("buffer", [Buffer.NORMAL, Buffer.ALBEDO, Buffer.ROUGHNESS, Buffer.NOV])
def test_a_pass_of_0_is_said_with_buffer_frames_and_share(buffer: Buffer) -> None:
    whole, empty = room(1), room(2)
    empty[buffer] = torch.zeros_like(empty[buffer])
    (fault,) = look(whole, empty, empty | {Buffer.MOTION: torch.randn(1, 2, *SIZE)})
    assert (fault.buffer, fault.frames) == (buffer, (2, 3))
    assert fault.text.startswith(f"'{buffer}' is 0 on 100.0% of the surfaces of frames 2-3: ")
    assert "render that pass again" in fault.text


def test_normals_of_0_on_part_of_the_surfaces_are_said_and_sky_does_not_count() -> None:
    frame = room()
    frame[Buffer.NORMAL][..., 25:28, :] = 0.0
    (fault,) = look(frame)
    # 3 of the 30 rows below the sky
    assert "is 0 on 10.0% of the surfaces of frame 1" in fault.text


def test_a_metal_without_roughness_and_black_objects_are_no_fault() -> None:
    frame = room()
    for buffer in (Buffer.ALBEDO, Buffer.ROUGHNESS, Buffer.METALLIC):
        frame[buffer][..., 10:30, :] = 0.0
    assert look(frame) == ()


@pytest.mark.parametrize(
    ("buffer", "line"),
    [
        (Buffer.ROUGHNESS, 'roughness = "0.00392157 * Rough"'),
        (Buffer.METALLIC, 'metallic = "0.00392157 * Two Words"'),
        (Buffer.NOV, 'nov = "0.00392157 - 0.00392157 * tilt"'),
    ],
)
def test_shares_out_of_their_range_are_said_with_a_line_to_paste(buffer: Buffer, line: str) -> None:
    frame = room()
    frame[buffer] = frame[buffer] * 255.0
    (fault,) = look(frame)
    assert fault.buffer is buffer
    assert "is outside of 0..1" in fault.text
    assert f"[buffers] {line}" in fault.text
    assert parse_expression(line.partition('"')[2].removesuffix('"'), 1)
    # of what is below 0 nothing is known
    frame[buffer] = -frame[buffer]
    (fault,) = look(frame)
    assert "is outside of 0..1" in fault.text
    assert "[buffers]" not in fault.text


@pytest.mark.parametrize(("most", "factor"), [(255, "0.00392157"), (65535, "1.5259e-05")])
def test_base_colours_of_bits_are_said_with_their_range_and_a_line(most: int, factor: str) -> None:
    frames = [room(seed) for seed in (1, 2)]
    bits = [f | {Buffer.ALBEDO: f[Buffer.ALBEDO] * most} for f in frames]
    # objects that are black, and the sky, tell nothing
    for frame in bits:
        frame[Buffer.ALBEDO][..., :35, :] = 0.0
    (fault,) = look(*bits)
    assert fault.buffer is Buffer.ALBEDO
    assert "'albedo' is above 1 (" in fault.text
    assert f" to {most:.3g}) on 1" in fault.text or f" to {0.999 * most:.3g}) on" in fault.text
    assert f'[buffers] albedo = "{factor} * base.RGB"' in fault.text
    # where other frames are right, the line would spoil them
    (fault,) = look(frames[0], bits[1])
    assert fault.frames == (2,)
    assert "render it again as 0..1, linear" in fault.text
    assert "[buffers]" not in fault.text


def test_single_highlights_in_base_colours_and_bright_walls_are_no_fault() -> None:
    frame = room()
    frame[Buffer.ALBEDO][..., 10:20, :] = 24.0
    frame[Buffer.ALBEDO][..., 20:, :] *= 1.5
    assert look(frame) == ()


def test_one_vector_on_several_surfaces_is_said_and_on_one_wall_it_is_not() -> None:
    frame = room()
    frame[Buffer.NORMAL] = torch.tensor([0.0, 0.6, 0.8]).view(1, 3, 1, 1).expand(1, 3, *SIZE)
    (fault,) = look(frame)
    assert fault.buffer is Buffer.NORMAL
    assert "is one vector on 100.0% of the surfaces" in fault.text
    # a floor: the inverse of its depth is affine in the row
    row = torch.arange(SIZE[0]).view(1, 1, -1, 1).expand(1, 1, *SIZE)
    assert look(frame | {Buffer.DEPTH: 1.0 / (0.02 + 0.01 * row)}) == ()
    assert look(frame | {Buffer.DEPTH: torch.full((1, 1, *SIZE), 5.0)}) == ()


@pytest.mark.parametrize(("depth", "faults"), [(1e10, 0), (0.0, 1)])
def test_normals_of_0_are_right_where_depth_shows_nothing_but_sky(
    depth: float, faults: int
) -> None:
    frame = room()
    frame[Buffer.NORMAL] = torch.zeros_like(frame[Buffer.NORMAL])
    frame[Buffer.DEPTH] = torch.full_like(frame[Buffer.DEPTH], depth)
    cleared = replace(PLAIN, depth=DepthConvention(sky=0.0))
    found = look(frame, conventions=PLAIN if depth else cleared)
    assert [fault.text.count("is 0 in every pixel") for fault in found] == [1] * faults


def test_one_depth_on_surfaces_that_face_several_ways_is_said() -> None:
    frame = room()
    frame[Buffer.DEPTH] = torch.where(frame[Buffer.DEPTH] < SKY_DEPTH_M, 5.0, SKY_DEPTH_M)
    (fault,) = look(frame)
    assert "'depth' is one value on 100.0% of the surfaces of frame 1" in fault.text


@pytest.mark.parametrize(("length", "factor"), [(0.3, "3.33"), (2.0, "0.5")])
def test_normals_of_another_length_are_said_with_a_line_to_paste(
    length: float, factor: str
) -> None:
    frame = room()
    frame[Buffer.NORMAL] = frame[Buffer.NORMAL] * length
    (fault,) = look(frame)
    assert f'[buffers] normal = "{factor} * N.XYZ"' in fault.text
    assert f"has a length of {length:g}, not 1" in fault.text
    packed = room()
    packed[Buffer.NORMAL] = (packed[Buffer.NORMAL] + 1.0) / 2.0
    assert look(packed, conventions=replace(PLAIN, normal=NormalConvention(packed=True))) == ()


def test_lengths_that_hardly_differ_are_said_once_of_all_frames() -> None:
    frames = [room(seed) for seed in (1, 2)]
    for frame, length in zip(frames, (0.304, 0.301), strict=True):
        frame[Buffer.NORMAL] = frame[Buffer.NORMAL] * length
    (fault,) = look(*frames)
    assert fault.frames == (1, 2)
    assert "has a length of 0.3, not 1" in fault.text
    assert '[buffers] normal = "3.29 * N.XYZ"' in fault.text


def test_motion_of_0_one_vector_or_another_frames_is_said_where_the_camera_moves() -> None:
    first, second, third = room(1), room(2), room(3)
    for motion, said in (
        (torch.zeros(1, 2, *SIZE), "is zero in every pixel of frame 2"),
        (torch.full((1, 2, *SIZE), 1.5), "is one vector in every pixel of frame 2"),
        (first[Buffer.MOTION], "is that of the frame before in every pixel of frame 2"),
    ):
        (fault,) = look(first, second | {Buffer.MOTION: motion}, third)
        assert fault.buffer is Buffer.MOTION
        assert said in fault.text
    nothing = {Buffer.MOTION: torch.zeros(1, 2, *SIZE)}
    assert look(first | nothing, second | nothing, still=True) == ()


def test_normals_of_0_are_sky_where_there_is_no_depth_and_that_is_said_of_all() -> None:
    frame = room()
    del frame[Buffer.DEPTH]
    assert look(frame) == ()
    frame[Buffer.NORMAL] = torch.zeros_like(frame[Buffer.NORMAL])
    (fault,) = look(frame)
    assert "is 0 in every pixel of frame 1: all of it is taken for sky" in fault.text


def test_what_is_declared_to_be_sky_is_no_surface() -> None:
    frame = room()
    frame[Buffer.NORMAL][..., 25:28, :] = 0.0
    declared = replace(PLAIN, depth=DepthConvention(sky=SkyRule.NORMAL))
    assert look(frame, conventions=declared) == ()
    frame[Buffer.DEPTH][..., 25:28, :] = math.nan
    declared = replace(PLAIN, depth=DepthConvention(sky=SkyRule.NAN))
    assert look(frame, conventions=declared) == ()


def test_normals_of_8_bits_are_said_with_a_line_to_paste() -> None:
    frame = room()
    frame[Buffer.NORMAL] = (127.5 * (frame[Buffer.NORMAL] + 1.0)).round()
    texts = [fault.text for fault in look(frame)]
    assert any('[buffers] normal = "0.00784314 * N.XYZ - 1"' in text for text in texts), texts
