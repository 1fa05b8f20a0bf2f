"""Holes against what rays to the past positions meet, and what occlusion vectors fill them with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import (
    chain_motion,
    chain_motion_as_published,
    fill_by_occlusion,
    find_occlusion_motion,
    find_occlusion_motion_of_pixels,
)
from rtsr_cli.core.imaging.holes import HoleConfig, HoleTest, find_holes
from rtsr_cli.core.imaging.splatting import forward_motion_by_splat
from rtsr_cli.core.imaging.warping import backward_warp

SIZE = (48, 80)
WALL_M, POST_M = 8.0, 4.0
FOCAL_PX = 60.0
STEP_M = 0.4
"""Of the post, to the right, a frame: 6 pixels at 4 m."""

PAN_M = 0.1
"""Of the camera, to the left, a frame: 1.5 pixels at 4 m, 0.75 at 8 m, to the right."""

POST_COLUMNS = (20, 30)
"""Of the post in frame 0."""


def camera_at(frame: int) -> CameraMetadata:
    """A pinhole that looks along -z, moved to the left by PAN_M a frame."""
    height, width = SIZE
    to_camera = torch.eye(4, dtype=torch.float64)
    to_camera[3, 0] = PAN_M * frame
    projection = torch.zeros(4, 4, dtype=torch.float64)
    projection[0, 0], projection[1, 1] = 2 * FOCAL_PX / width, 2 * FOCAL_PX / height
    projection[2, 2], projection[2, 3], projection[3, 2] = -1.0, -1.0, -0.2
    return CameraMetadata(world_to_camera=to_camera, world_to_ndc=to_camera @ projection)


def post_range(frame: int, moves: bool) -> tuple[float, float]:
    """Left and right edge of the post, columns of a frame."""
    shift = frame * FOCAL_PX / POST_M * (PAN_M + (STEP_M if moves else 0.0))
    return POST_COLUMNS[0] + shift, POST_COLUMNS[1] + shift


def draw(
    frame: int, *, moves: bool = True, without: Iterable[Buffer] = (), camera: bool = True
) -> Frame:
    """A wall with stripes and a post before it, in one frame."""
    height, width = SIZE
    left, right = post_range(frame, moves)
    column = torch.arange(width).view(1, 1, 1, -1).expand(1, 1, height, width) + 0.5
    post = (column >= left) & (column < right)
    depth = torch.where(post, POST_M, WALL_M)
    wall_x = column - frame * FOCAL_PX / WALL_M * PAN_M
    motion = torch.zeros(1, 2, height, width)
    per_frame = PAN_M + (STEP_M if moves else 0.0)
    motion[:, 0:1] = -torch.where(post, FOCAL_PX / POST_M * per_frame, FOCAL_PX / WALL_M * PAN_M)
    normal = torch.zeros(1, 3, height, width)
    normal[:, 2] = 1.0
    buffers = {
        Buffer.COLOR: torch.where(post, 9.0, torch.sin(0.2 * wall_x)).expand(1, 3, -1, -1).clone(),
        Buffer.DEPTH: depth,
        Buffer.MOTION: motion,
        Buffer.NORMAL: normal,
        Buffer.OBJECT_ID: torch.where(post, 2, 1).int(),
    }
    kept = {b: image for b, image in buffers.items() if b not in set(without)}
    return Frame(
        number=frame,
        gbuffer=GBuffer(kept, "drawn"),
        camera=camera_at(frame) if camera else CameraMetadata(),
        view=View(display=SIZE),
    )


def sequence(steps: int, **how: object) -> list[Frame]:
    return [draw(number, **how) for number in range(5, 4 - steps, -1)]  # type: ignore[arg-type]


def true_holes(steps: int, *, moves: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Columns of frame 5 outside of a past frame, hidden there as a whole, and wholly visible."""
    now = draw(5, moves=moves)
    post = now.gbuffer[Buffer.DEPTH][0, 0, 0] == POST_M
    moved = now.gbuffer[Buffer.MOTION][0, 0, 0] * steps
    then = torch.arange(SIZE[1]) + 0.5 + moved
    left, right = post_range(5 - steps, moves)
    covered = (then >= left) & (then < right)
    hidden = covered & ~post
    near = (then >= left - 1) & (then < right + 1)
    edge = ((then - left).abs() <= 1) | ((then - right).abs() <= 1)
    outside = (then < 0) | (then >= SIZE[1])
    return outside, hidden & ~edge & ~outside, ~outside & torch.where(post, ~edge, ~near)


ALL_CASES = [
    pytest.param({}, id="everything"),
    pytest.param({"without": (Buffer.OBJECT_ID,)}, id="no ids"),
    pytest.param({"without": (Buffer.NORMAL,)}, id="no normals"),
    pytest.param({"without": (Buffer.NORMAL, Buffer.OBJECT_ID)}, id="depth and camera"),
    pytest.param({"camera": False}, id="no camera"),
    pytest.param(
        {"camera": False, "without": (Buffer.NORMAL, Buffer.OBJECT_ID)}, id="depth by motion"
    ),
]


@pytest.mark.parametrize("moves", [True, False], ids=["moving post", "pan"])
@pytest.mark.parametrize("steps", [1, 3, 5])
@pytest.mark.parametrize("how", ALL_CASES)
def test_holes_are_what_the_post_hid(steps: int, moves: bool, how: dict[str, object]) -> None:
    holes = find_holes(sequence(steps, moves=moves, **how))
    outside, hidden, visible = true_holes(steps, moves=moves)
    assert torch.equal(holes.outside[0, 0, 0] > 0, outside)
    marked = holes.disoccluded[0, 0, 0] > 0
    assert hidden.sum() >= (4 if moves else steps // 3)
    assert marked[hidden].all()
    if "camera" in how:
        # composed vectors lead astray what was hidden in between
        for between in range(1, steps):
            visible &= ~true_holes(between, moves=moves)[1] & true_holes(between, moves=moves)[2]
    assert visible.sum() > 20
    assert not marked[visible].any()
    assert torch.equal(holes.union[0, 0, 0] > 0, marked | outside)


def test_tests_share_the_work_and_the_paper_takes_all_everywhere() -> None:
    frames = sequence(1)
    holes, paper = find_holes(frames), find_holes(frames, HoleConfig(paper=True))
    dynamic = holes.dynamic
    assert dynamic is not None
    assert torch.equal(dynamic, (frames[0].gbuffer[Buffer.DEPTH] == POST_M).float())
    assert set(holes.tests) == set(paper.tests) == set(HoleTest) - {HoleTest.DEPTH}
    moving = dynamic > 0
    assert holes.tests[HoleTest.POSITION][moving].max() == 0.0
    # the post lies elsewhere in the world now
    assert paper.tests[HoleTest.POSITION][moving].min() == 1.0
    # all normals are alike here
    assert holes.tests[HoleTest.NORMAL].max() == 0.0


@pytest.mark.parametrize(("cosine", "marked"), [(0.985, 0.0), (0.975, 1.0)])
def test_what_turned_by_more_than_the_cosine_is_marked(cosine: float, marked: float) -> None:
    now, before = sequence(1)
    turned = before.gbuffer[Buffer.NORMAL].clone()
    turned[:, 0], turned[:, 2] = (1.0 - cosine**2) ** 0.5, cosine
    before = replace(before, gbuffer=before.gbuffer.with_buffers({Buffer.NORMAL: turned}))
    holes = find_holes([now, before])
    post = now.gbuffer[Buffer.DEPTH] == POST_M
    assert (holes.tests[HoleTest.NORMAL][post] == marked).all()
    assert holes.tests[HoleTest.NORMAL][~post].max() == 0.0


@pytest.mark.parametrize(("farther_m", "marked"), [(0.11, 0.0), (0.13, 1.0)])
def test_the_position_tolerance_is_in_metres(farther_m: float, marked: float) -> None:
    """0.075 + 0.005 * 8 = 0.115 m at normal incidence."""
    now, before = draw(5, moves=False), draw(4, moves=False)
    stored = {}
    for frame, offset in ((now, 0.0), (before, farther_m)):
        wall = torch.zeros(1, 3, *SIZE)
        wall[:, 2] = -WALL_M - offset
        facing = torch.ones(1, 1, *SIZE)
        depth = torch.full((1, 1, *SIZE), WALL_M)
        still = torch.zeros(1, 2, *SIZE)
        still[:, 0] = -FOCAL_PX / WALL_M * PAN_M
        stored[frame.number] = frame.gbuffer.with_buffers(
            {
                Buffer.POSITION: wall,
                Buffer.NOV: facing,
                Buffer.DEPTH: depth,
                Buffer.MOTION: still,
                Buffer.OBJECT_ID: torch.ones(1, 1, *SIZE, dtype=torch.int32),
            }
        )
    now, before = (replace(f, gbuffer=stored[f.number]) for f in (now, before))
    # what does not move follows the camera's motion, whatever position says
    holes = find_holes([now, before], HoleConfig(paper=True))
    inside = holes.outside == 0
    assert (holes.tests[HoleTest.POSITION][inside] == marked).all()


def test_sky_is_no_hole_of_sky_and_one_of_everything_else() -> None:
    now, before = sequence(1, without=(Buffer.OBJECT_ID,))
    frames = []
    for frame in (now, before):
        depth = frame.gbuffer[Buffer.DEPTH]
        sky = depth == WALL_M
        parts = {
            Buffer.DEPTH: torch.where(sky, SKY_DEPTH_M, depth),
            Buffer.NORMAL: frame.gbuffer[Buffer.NORMAL] * ~sky,
        }
        frames.append(replace(frame, gbuffer=frame.gbuffer.with_buffers(parts)))
    outside, hidden, visible = true_holes(1, moves=True)
    marked = find_holes(frames).disoccluded[0, 0, 0] > 0
    assert marked[hidden].all()
    assert not marked[visible & ~outside].any()


def test_vectors_that_are_no_numbers_lead_outside() -> None:
    now, before = sequence(1)
    motion = now.gbuffer[Buffer.MOTION].clone()
    motion[0, 0, 3, 4] = torch.nan
    now = replace(now, gbuffer=now.gbuffer.with_buffers({Buffer.MOTION: motion}))
    holes = find_holes([now, before])
    assert holes.outside[0, 0, 3, 4] == 1.0
    assert holes.disoccluded[0, 0, 3, 4] == 0.0


@pytest.mark.parametrize("buffer", [Buffer.MOTION, Buffer.DEPTH])
def test_what_cannot_be_done_without_is_named(buffer: Buffer) -> None:
    with pytest.raises(MissingBufferError, match=buffer):
        find_holes(sequence(1, without=(buffer,)))


def test_the_published_order_is_the_right_one_where_motion_is_the_same_everywhere() -> None:
    """Whole vectors, of one length, everywhere: neither order nor rounding matters."""
    frames = []
    for number in range(3):
        base = draw(number)
        motion = torch.tensor([-2.0, 1.0]).view(1, 2, 1, 1).expand(1, 2, *SIZE).clone()
        frames.append(replace(base, gbuffer=base.gbuffer.with_buffers({Buffer.MOTION: motion})))
    published, correct = chain_motion_as_published(frames), chain_motion(frames)
    assert torch.equal(published, correct)
    assert torch.equal(correct[0, :, 20, 20], torch.tensor([-4.0, 2.0]))


def test_the_published_order_looks_newer_vectors_up_at_older_ends() -> None:
    """x + older(x) = 5.7 -> pixel 5; the longest of newer(5), newer(6) and the row below."""
    newer, older = torch.zeros(1, 2, 4, 12), torch.zeros(1, 2, 4, 12)
    newer[:, 0] = torch.arange(1.0, 13.0)
    older[:, 0] = -2.3
    base = draw(0)

    def frame(motion: Tensor) -> Frame:
        return replace(base, gbuffer=GBuffer({Buffer.MOTION: motion}, "test"))

    frames = [frame(newer), frame(older), frame(older)]
    assert chain_motion_as_published(frames)[0, 0, 1, 8].item() == pytest.approx(-2.3 + 7.0)
    newer[:, 0, 2, 5] = 0.0
    assert chain_motion_as_published(frames)[0, 0, 1, 8].item() == pytest.approx(-2.3)


@pytest.mark.parametrize("steps", [1, 2])
def test_holes_are_filled_with_the_background_beside(steps: int) -> None:
    """Along plain vectors a hole shows the post again; along occlusion vectors the wall."""
    frames = sequence(steps)
    holes = find_holes(frames)
    past = frames[-1].gbuffer[Buffer.COLOR]
    plain, _ = backward_warp(past, holes.motion_px)
    vectors = find_occlusion_motion(frames, holes.motion_px)
    filled = fill_by_occlusion(past, holes.motion_px, vectors, holes.union)
    _, hidden, visible = true_holes(steps, moves=True)
    assert (plain[..., hidden] > 8.0).all()
    assert (filled[..., hidden] <= 1.0).all()
    assert torch.equal(filled[..., visible], plain[..., visible])
    # displaced as the post was: 7.5 pixels a frame
    assert (vectors[0, 0][:, hidden] == -7.5 * steps).all()
    pixels = holes.union.flatten().nonzero()[:, 0]
    alone = find_occlusion_motion_of_pixels(frames, holes.motion_px, pixels)
    assert torch.equal(alone, vectors[0].flatten(1)[:, pixels])


def test_a_surface_that_grows_leaves_no_cracks() -> None:
    """Vectors that spread from the middle: every pixel of the past frame knows where it went."""
    column = torch.arange(40.0).view(1, 1, 1, -1).expand(1, 1, 6, 40)
    motion = torch.cat([0.5 * (column - 20.0), torch.zeros_like(column)], dim=1)
    depth = torch.ones(1, 1, 6, 40)
    _, landed = forward_motion_by_splat(motion, depth)
    _, spread = forward_motion_by_splat(motion, depth, spread=True)
    assert landed.mean() < 0.8
    assert spread.mean() == 1.0
