"""Regions on a hand-made frame: a near square before a far wall, sky above."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.evaluation.regions import (
    Region,
    find_disoccluded,
    find_edges,
    find_lighting_detail,
    find_regions,
)
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame

HEIGHT, WIDTH = 24, 32
SKY_ROWS = 6
SQUARE = slice(10, 18)


def frame(left: int, motion_x: float = 0.0, drop: frozenset[Buffer] = frozenset()) -> Frame:
    """The square begins at column `left` and has moved by -`motion_x`."""
    depth = torch.full((1, 1, HEIGHT, WIDTH), 10.0)
    depth[..., :SKY_ROWS, :] = SKY_DEPTH_M
    depth[..., SQUARE, left : left + 8] = 2.0
    near = depth == 2.0
    ids = torch.where(near, 2, 1).to(torch.int32)
    ids[depth == SKY_DEPTH_M] = 0
    motion = torch.zeros(1, 2, HEIGHT, WIDTH)
    motion[:, :1][near] = motion_x
    normal = torch.zeros(1, 3, HEIGHT, WIDTH)
    normal[:, 2] = (depth[:, 0] < SKY_DEPTH_M).float()
    buffers = {
        Buffer.DEPTH: depth,
        Buffer.OBJECT_ID: ids,
        Buffer.MOTION: motion,
        Buffer.NORMAL: normal,
        Buffer.ALBEDO: torch.full((1, 3, HEIGHT, WIDTH), 0.5),
    }
    kept = {b: t for b, t in buffers.items() if b not in drop}
    return Frame(
        number=1, gbuffer=GBuffer(kept), camera=CameraMetadata(), view=View(display=(HEIGHT, WIDTH))
    )


def camera() -> CameraMetadata:
    """Look along -z, infinite far plane, row vectors."""
    projection = torch.zeros(4, 4, dtype=torch.float64)
    projection[0, 0], projection[1, 1] = HEIGHT / WIDTH, 1.0
    projection[2, 2], projection[2, 3], projection[3, 2] = -1.0, -1.0, -0.1
    return CameraMetadata(
        world_to_camera=torch.eye(4, dtype=torch.float64), world_to_ndc=projection
    )


def radiance() -> Tensor:
    """A shadow edge at column 4."""
    image = torch.ones(1, 3, HEIGHT, WIDTH)
    image[..., :4] = 0.05
    return image


def made(**changes: Any) -> dict[Region, Tensor | None]:
    drop = changes.get("drop", frozenset())
    return find_regions(frame(16, -4.0, drop), frame(12, 0.0, drop), radiance())


def test_sky_is_where_depth_says_so() -> None:
    sky = made()[Region.SKY]
    assert sky is not None
    assert sky[0, 0].nonzero()[:, 0].max() == SKY_ROWS - 1
    assert int(sky.sum()) == SKY_ROWS * WIDTH


def test_what_the_square_uncovered_is_disoccluded() -> None:
    found = made()[Region.DISOCCLUDED]
    assert found is not None
    expected = torch.zeros_like(found)
    expected[..., SQUARE, 12:16] = True
    assert found.equal(expected)


def test_what_lay_outside_of_the_frame_before_is_off_screen_and_not_disoccluded() -> None:
    """Everything moved by three columns: those on the right were not in the picture."""
    now, then = frame(16), frame(16)
    motion = torch.zeros(1, 2, HEIGHT, WIDTH)
    motion[:, 0] = 3.0
    now = replace(now, gbuffer=now.gbuffer.with_buffers({Buffer.MOTION: motion}))
    regions = find_regions(now, then, radiance())
    outside, hidden = regions[Region.OFF_SCREEN], regions[Region.DISOCCLUDED]
    assert outside is not None
    assert hidden is not None
    assert outside[..., :-3].sum() == 0
    assert bool(outside[..., -3:].all())
    assert not bool((outside & hidden).any())


@pytest.mark.parametrize(
    ("depth_then", "drop", "seen"),
    [
        (2.6, frozenset(), True),  # 30 % closer, the same object: it comes nearer
        (2.3, frozenset({Buffer.OBJECT_ID}), True),
        (2.6, frozenset({Buffer.OBJECT_ID}), False),  # nothing says that it is the same
    ],
)
def test_an_object_that_comes_nearer_is_no_other_surface(
    depth_then: float, drop: frozenset[Buffer], seen: bool
) -> None:
    now = replace(frame(16, -4.0, drop), camera=camera())
    then = replace(frame(12, 0.0, drop), camera=camera())
    depth = then.gbuffer[Buffer.DEPTH]
    moved = torch.where(depth == 2.0, depth_then, depth)
    then = replace(then, gbuffer=then.gbuffer.with_buffers({Buffer.DEPTH: moved}))
    found = find_disoccluded(now, then)
    assert found is not None
    assert bool(found[..., SQUARE, 16:24].any()) is not seen
    assert found[..., SQUARE, 12:16].all(), "what it uncovered"
    assert not found[..., SKY_ROWS:9, :].any(), "what stands still"


def test_edges_run_on_both_sides_of_the_square_and_along_the_sky() -> None:
    found = find_edges(frame(16).gbuffer)
    assert found is not None
    row = found[0, 0, 14]
    assert row.nonzero()[:, 0].tolist() == [15, 16, 23, 24]
    assert found[0, 0, SKY_ROWS - 1].all()
    assert found[0, 0, SKY_ROWS].all()
    assert not found[0, 0, : SKY_ROWS - 1].any()


def test_lighting_detail_is_the_shadow_edge_on_surfaces() -> None:
    found = made()[Region.LIGHTING]
    assert found is not None
    columns = found[0, 0].any(0).nonzero()[:, 0].tolist()
    assert columns == [3, 4]
    assert not found[0, 0, :SKY_ROWS].any()


def test_albedo_is_no_lighting() -> None:
    albedo = torch.full((1, 3, HEIGHT, WIDTH), 0.2)
    albedo[..., WIDTH // 2 :] = 0.8
    surface = torch.ones(1, 1, HEIGHT, WIDTH, dtype=torch.bool)
    found = find_lighting_detail(albedo * 3.0, albedo, surface)
    assert found is not None
    assert int(found.sum()) == 0


@pytest.mark.parametrize(
    ("drop", "region"),
    [
        ({Buffer.MOTION}, Region.DISOCCLUDED),
        ({Buffer.MOTION}, Region.OFF_SCREEN),
        ({Buffer.DEPTH, Buffer.OBJECT_ID}, Region.DISOCCLUDED),
        ({Buffer.ALBEDO}, Region.LIGHTING),
        ({Buffer.DEPTH, Buffer.NORMAL}, Region.SKY),
        ({Buffer.DEPTH, Buffer.NORMAL, Buffer.OBJECT_ID}, Region.EDGES),
    ],
)
def test_a_region_without_its_buffers_is_none(drop: set[Buffer], region: Region) -> None:
    assert made(drop=frozenset(drop))[region] is None


def test_without_buffers_or_a_previous_frame_regions_are_none() -> None:
    assert set(find_regions(None, None, radiance()).values()) == {None}
    assert find_regions(frame(16), None, radiance())[Region.DISOCCLUDED] is None
