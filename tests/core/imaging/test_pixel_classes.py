"""Classes of pixels against what is known of drawn scenes: edges, shadows and checkers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.pixel_classes import (
    AliasingConfig,
    ClassConfig,
    GhostingConfig,
    classify_pixels,
    find_aliasing,
    measure_overlap,
    open_mask,
)
from rtsr_cli.core.imaging.sample_ranges import (
    gather_ranges,
    join_samples,
    pick_nearest,
    reverse_depth,
    split_samples,
)

SIZE = (40, 64)
"""Of the output, pixels."""

WALL_M, SQUARE_M = 8.0, 4.0
ROWS = (10.0, 30.0)
"""Of the square, pixels."""

DARK = 0.3
"""Share of the light that is left in a shadow."""


@dataclass(frozen=True)
class Drawing:
    """A wall that stands still, a square before it, a shadow and a checker on the wall.

    Columns in pixels of the output: `square` and `shadow` are (left, right), `step` and
    `shadow_step` how far each goes to the right a frame, `checker` the side of the checker's fields
    in the bottom rows, 0 for none, `slope` how many metres deeper the wall gets a column.
    """

    square: tuple[float, float] = (20.25, 36.5)
    step: float = 3.25
    shadow: tuple[float, float] = (0.0, 0.0)
    shadow_step: float = 0.0
    checker: float = 0.0
    slope: float = 0.0
    sky: bool = False
    dropped: tuple[Buffer, ...] = ()

    def draw(self, number: int, k: int = 2) -> Frame:
        """Render frame `number` at k x k samples a pixel."""
        height, width = SIZE[0] * k, SIZE[1] * k
        x = ((torch.arange(width) + 0.5) / k).view(1, 1, 1, -1).expand(1, 1, height, width)
        y = ((torch.arange(height) + 0.5) / k).view(1, 1, -1, 1).expand(1, 1, height, width)
        moved = number * self.step
        square = (x >= self.square[0] + moved) & (x < self.square[1] + moved)
        square = square & (y >= ROWS[0]) & (y < ROWS[1])
        # 1 / z of a plane is linear on the screen
        wall = torch.full_like(x, SKY_DEPTH_M) if self.sky else 1.0 / (1 / WALL_M - self.slope * x)
        tone = 0.5 + 0.05 * torch.sin(0.4 * x + 0.3 * y)
        if self.checker:
            field = ((x / self.checker).floor() + (y / self.checker).floor()) % 2
            tone = torch.where((field > 0) & (y >= ROWS[1] + 4), 0.02, tone)
        shift = number * self.shadow_step
        dark = (x >= self.shadow[0] + shift) & (x < self.shadow[1] + shift)
        light = torch.where(dark, DARK, 1.0)
        facing = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(1, 3, height, width)
        motion = torch.where(square, -self.step * k, 0.0)
        buffers = {
            Buffer.COLOR: torch.where(square, 0.8, tone * light).expand(1, 3, -1, -1),
            Buffer.DEPTH: torch.where(square, SQUARE_M, wall),
            Buffer.MOTION: torch.cat([motion, torch.zeros_like(motion)], dim=1),
            Buffer.NORMAL: facing,
            Buffer.GEONORMAL: facing,
            Buffer.OBJECT_ID: torch.where(square, 2, 1).int(),
        }
        kept = {b: image for b, image in buffers.items() if b not in self.dropped}
        return Frame(
            number=number,
            gbuffer=GBuffer(kept, "drawn"),
            camera=CameraMetadata(),
            view=View(display=(height, width)),
        )

    def frames(self, k: int = 2) -> list[Frame]:
        return [self.draw(2, k), self.draw(1, k)]


def columns_that_overlap(left: float, right: float) -> Tensor:
    """True for pixels whose area and [left, right) share more than nothing."""
    x = torch.arange(SIZE[1]).view(1, 1, 1, -1).expand(1, 1, *SIZE)
    return (x + 1 > left) & (x < right)


def rows_between(top: float, bottom: float) -> Tensor:
    y = torch.arange(SIZE[0]).view(1, 1, -1, 1).expand(1, 1, *SIZE)
    return (y >= top) & (y < bottom)


def covered_by(drawing: Drawing, number: int) -> Tensor:
    """True for pixels that show some of the square."""
    moved = number * drawing.step
    return columns_that_overlap(drawing.square[0] + moved, drawing.square[1] + moved) & (
        rows_between(*ROWS)
    )


def judge(found: Tensor, true: Tensor, judged: Tensor | None = None) -> tuple[float, float]:
    """Precision and recall, of the judged pixels."""
    where = torch.ones_like(true) if judged is None else judged
    hits = float(((found > 0) & true & where).sum())
    return hits / float(((found > 0) & where).sum()), hits / float((true & where).sum())


def rim_of(mask: Tensor) -> Tensor:
    """True within a pixel of an edge of a mask."""
    spread = [
        torch.nn.functional.max_pool2d(m.float(), 3, stride=1, padding=1) for m in (mask, ~mask)
    ]
    return (spread[0] > 0) & (spread[1] > 0)


@pytest.mark.parametrize("k", [2, 4])
@pytest.mark.parametrize("step", [1.25, 3.25, -4.5])
def test_what_a_moving_square_uncovers_is_visibility_ghosting(k: int, step: float) -> None:
    drawing = Drawing(step=step)
    classes = classify_pixels(drawing.frames(k), k)
    true = covered_by(drawing, 1) & ~covered_by(drawing, 2)
    precision, recall = judge(classes.visibility, true)
    assert min(precision, recall) >= 0.95
    # what it covers is a nearer surface, which history shows elsewhere
    assert not (classes.shading * classes.visibility).any()


def test_uncovered_sky_is_visibility_ghosting_too() -> None:
    drawing = Drawing(sky=True)
    true = covered_by(drawing, 1) & ~covered_by(drawing, 2)
    assert min(judge(classify_pixels(drawing.frames(), 2).visibility, true)) >= 0.95


def test_slow_motion_is_told_by_depth_alone() -> None:
    drawing = Drawing(square=(20.5, 36.5), step=0.75)
    true = covered_by(drawing, 1) & ~covered_by(drawing, 2)
    assert not classify_pixels(drawing.frames(), 2).visibility.any()
    config = ClassConfig(ghosting=GhostingConfig(depth_only=True))
    assert min(judge(classify_pixels(drawing.frames(), 2, config).visibility, true)) >= 0.95


def test_a_label_grows_from_a_surface_to_what_lies_behind_and_moves_otherwise() -> None:
    now, before = Drawing(step=0.0).frames()
    motion = torch.zeros_like(before.gbuffer[Buffer.MOTION])
    # the square was behind a nearer screen, which came 9 pixels to the left
    motion[:, 0] = 18.0
    screen = replace(
        before,
        gbuffer=before.gbuffer.with_buffers(
            {
                Buffer.DEPTH: torch.where(before.gbuffer[Buffer.DEPTH] == SQUARE_M, 2.0, WALL_M),
                Buffer.MOTION: motion,
            }
        ),
    )
    still = now.gbuffer[Buffer.DEPTH] == SQUARE_M
    moving = torch.cat([torch.where(still, 0.0, 2.5), torch.zeros_like(motion[:, :1])], dim=1)
    now = replace(now, gbuffer=now.gbuffer.with_buffers({Buffer.MOTION: moving}))
    square = covered_by(Drawing(step=0.0), 1)
    classes = classify_pixels([now, screen], 2)
    around = torch.nn.functional.max_pool2d(square.float(), 3, stride=1, padding=1)
    assert torch.equal(classes.visibility * (1 - classes.outside), around * (1 - classes.outside))


@pytest.mark.parametrize(("width", "step"), [(8.0, 8.0), (12.5, 10.0), (9.0, -9.0)])
def test_a_moving_shadow_is_shading_ghosting_where_it_comes_and_where_it_goes(
    width: float, step: float
) -> None:
    drawing = Drawing(square=(0.0, 0.0), shadow=(26.0, 26.0 + width), shadow_step=step)
    there, gone = (columns_that_overlap(26.0 + n * step, 26.0 + width + n * step) for n in (2, 1))
    true = there ^ gone
    classes = classify_pixels(drawing.frames(), 2)
    for part in (there & ~gone, gone & ~there):
        assert judge(classes.shading, part, ~rim_of(part) & (part | ~true))[1] >= 0.95
    assert min(judge(classes.shading, true, ~rim_of(true))) >= 0.95


def test_a_change_of_exposure_is_none_of_light() -> None:
    now, before = Drawing(square=(0.0, 0.0)).frames()
    brighter = now.gbuffer.with_buffers({Buffer.COLOR: 4.0 * now.gbuffer[Buffer.COLOR]})
    assert classify_pixels([replace(now, gbuffer=brighter), before], 2).shading.mean() > 0.9
    exposed = replace(now, gbuffer=brighter, camera=CameraMetadata(pre_exposure=4.0))
    assert not classify_pixels([exposed, before], 2).shading.any()


@pytest.mark.parametrize("dropped", [(), (Buffer.GEONORMAL,), (Buffer.GEONORMAL, Buffer.OBJECT_ID)])
def test_edges_are_geometry_and_checkers_are_texture(dropped: tuple[Buffer, ...]) -> None:
    k = 4
    drawing = Drawing(checker=1.5, dropped=dropped)
    geometry, texture = find_aliasing(gather_ranges(drawing.draw(1, k), k), AliasingConfig())
    left, right = (edge + drawing.step for edge in drawing.square)
    edges = (columns_that_overlap(left, left) | columns_that_overlap(right, right)) & (
        rows_between(*ROWS)
    )
    assert min(judge(geometry, edges)) >= 0.95
    floor = rows_between(ROWS[1] + 4, SIZE[0])
    x, y = (torch.arange(side) % 3 == 1 for side in (SIZE[1], SIZE[0]))
    # fields of 1.5 pixels: of three pixels the one in the middle holds two of them
    mixed = x.view(1, 1, 1, -1) | y.view(1, 1, -1, 1)
    assert min(judge(texture, mixed & floor)) >= 0.95
    assert not (geometry * texture).any()


@pytest.mark.parametrize("dropped", [(), (Buffer.GEONORMAL,)])
def test_a_slanted_plane_is_one_surface_except_as_printed(dropped: tuple[Buffer, ...]) -> None:
    steep = gather_ranges(Drawing(square=(0.0, 0.0), slope=1.8e-3, dropped=dropped).draw(1), 2)
    for mask in find_aliasing(steep, AliasingConfig()):
        assert not mask.any()
    printed, _ = find_aliasing(steep, AliasingConfig(planes=False))
    assert printed.mean() > 0.2


def test_a_slanted_plane_is_one_surface_wherever_the_samples_lie() -> None:
    # four samples in other places of the pixel than the blocks of a capture have them
    drawn = Drawing(square=(0.0, 0.0), slope=1.8e-3).draw(1, 4)
    places = ((0, 1), (1, 3), (2, 0), (3, 2))
    depth = drawn.gbuffer[Buffer.DEPTH]
    layers = torch.stack([depth[..., y::4, x::4] for y, x in places], dim=2)
    frame = Drawing(square=(0.0, 0.0)).draw(1, 2)
    buffers = {Buffer.DEPTH: join_samples(layers, 2)}
    rotated = replace(frame, gbuffer=frame.gbuffer.with_buffers(buffers))
    config = AliasingConfig()
    on_grid, _ = find_aliasing(gather_ranges(rotated, 2), config)
    anywhere, _ = find_aliasing(gather_ranges(rotated, 2, on_grid=False), config)
    assert on_grid.mean() > 0.2
    assert not anywhere.any()


def test_a_bend_of_the_normal_map_alone_is_texture() -> None:
    frame = Drawing(square=(0.0, 0.0)).draw(1)
    normal = frame.gbuffer[Buffer.NORMAL].clone()
    normal[..., ::2, ::2] = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1)
    bumpy = replace(frame, gbuffer=frame.gbuffer.with_buffers({Buffer.NORMAL: normal}))
    geometry, texture = find_aliasing(gather_ranges(bumpy, 2), AliasingConfig())
    assert not geometry.any()
    assert texture.all()


def test_without_a_frame_before_all_is_visibility_ghosting() -> None:
    classes = classify_pixels([Drawing().draw(1)], 2)
    assert classes.visibility.all()
    assert classes.ghosting.unique().tolist() == [1.0]
    assert not classes.outside.any()
    assert classes.geometry.any()


def test_what_was_outside_is_visibility_ghosting() -> None:
    now, before = Drawing(square=(0.0, 0.0)).frames()
    motion = torch.zeros_like(now.gbuffer[Buffer.MOTION])
    motion[:, 0] = -6.0
    panned = replace(now, gbuffer=now.gbuffer.with_buffers({Buffer.MOTION: motion}))
    classes = classify_pixels([panned, before], 2)
    expected = columns_that_overlap(0.0, 3.0)
    assert torch.equal(classes.outside > 0, expected)
    assert torch.equal(classes.visibility > 0, expected)


def test_nothing_grows_from_what_was_outside() -> None:
    # a near strip enters at the left, far before what the border showed; the wall beside it moves
    # otherwise, lies behind it, and was seen
    now, before = Drawing(square=(0.0, 0.0)).frames()
    strip = columns_that_overlap(0.0, 2.0).repeat_interleave(2, 2).repeat_interleave(2, 3)
    motion = torch.zeros_like(now.gbuffer[Buffer.MOTION])
    motion[:, 0:1] = torch.where(strip, -12.0, 0.0)
    depth = torch.where(strip, SQUARE_M, now.gbuffer[Buffer.DEPTH])
    entering = now.gbuffer.with_buffers({Buffer.MOTION: motion, Buffer.DEPTH: depth})
    # what the border showed, another surface that is nearer still, moves otherwise, too
    shown = torch.where(strip, 1.0, before.gbuffer[Buffer.DEPTH])
    moved = torch.zeros_like(motion)
    border = before.gbuffer.with_buffers({Buffer.MOTION: moved, Buffer.DEPTH: shown})
    classes = classify_pixels([replace(now, gbuffer=entering), replace(before, gbuffer=border)], 2)
    assert torch.equal(classes.outside > 0, columns_that_overlap(0.0, 2.0))
    assert torch.equal(classes.visibility, classes.outside)


def test_the_depth_of_what_stands_still_is_that_of_the_camera_before() -> None:
    # the camera steps 1 m towards the wall: without it, all of the wall would lie behind itself
    def camera(at: float) -> CameraMetadata:
        to_camera = torch.eye(4, dtype=torch.float64)
        to_camera[3, 2] = at
        lens = torch.zeros(4, 4, dtype=torch.float64)
        lens[0, 0], lens[1, 1], lens[2, 3] = 2.0, 2.0 * SIZE[1] / SIZE[0], -1.0
        lens[2, 2], lens[3, 2] = -1.0, -0.2
        return CameraMetadata(world_to_camera=to_camera, world_to_ndc=to_camera @ lens)

    def see(number: int, depth: float) -> Frame:
        frame = Drawing(square=(0.0, 0.0)).draw(number)
        height, width = frame.size
        x = torch.arange(width).view(1, 1, 1, -1).expand(1, 1, height, width) + 0.5 - width / 2
        y = torch.arange(height).view(1, 1, -1, 1).expand(1, 1, height, width) + 0.5 - height / 2
        zoom = 8.0 / 9.0 - 1.0
        buffers = {
            Buffer.DEPTH: torch.full((1, 1, height, width), depth),
            Buffer.MOTION: torch.cat([x, y], dim=1) * zoom,
        }
        return replace(frame, gbuffer=frame.gbuffer.with_buffers(buffers))

    now = replace(see(2, 8.0), camera=camera(0.0))
    before = replace(see(1, 9.0), camera=camera(-1.0))
    alone = ClassConfig(ghosting=GhostingConfig(depth_only=True))
    assert not classify_pixels([now, before], 2, alone).visibility.any()
    # the other way round the wall came nearer in the frame before: only the camera tells why
    back = replace(see(2, 9.0), camera=camera(-1.0))
    ahead = replace(see(1, 8.0), camera=camera(0.0))
    turned = back.gbuffer.with_buffers({Buffer.MOTION: now.gbuffer[Buffer.MOTION] * -9.0 / 8.0})
    back = replace(back, gbuffer=turned)
    classes = classify_pixels([back, ahead], 2, alone)
    assert torch.equal(classes.visibility, classes.outside)
    unknown = [replace(frame, camera=CameraMetadata()) for frame in (back, ahead)]
    assert classify_pixels(unknown, 2, alone).visibility.all()


def test_boxes_overlap_by_the_share_of_their_union() -> None:
    def box(low: float, high: float) -> tuple[Tensor, Tensor]:
        return torch.full((1, 3, 1, 1), low), torch.full((1, 3, 1, 1), high)

    flat = measure_overlap(*box(0.5, 0.5), *box(0.5, 0.5), margin=0.004)
    assert float(flat) == pytest.approx(1.0)
    half = measure_overlap(*box(0.0, 0.2), *box(0.1, 0.3), margin=1e-9)
    # 0.1^3 of 2 * 0.2^3 - 0.1^3
    assert float(half) == pytest.approx(1.0 / 15.0, rel=1e-4)
    assert float(measure_overlap(*box(0.0, 0.1), *box(0.5, 0.6), margin=0.004)) == 0.0


def test_an_opening_twice_takes_what_is_thinner_than_five_pixels() -> None:
    mask = torch.zeros(1, 1, 20, 40)
    mask[..., 0:4], mask[..., 10:15], mask[..., 8, 30] = 1.0, 1.0, 1.0
    opened = open_mask(mask, 2)
    # beyond the border lies nothing that would erode: four columns there stay
    assert opened[0, 0, 0].nonzero().flatten().tolist() == [0, 1, 2, 3, *range(10, 15)]
    assert not opened[..., 20:].any()


def test_samples_are_taken_row_by_row_and_the_nearest_one_is_picked() -> None:
    capture = torch.arange(16.0).view(1, 1, 4, 4)
    assert split_samples(capture, 2)[0, 0, :, 1, 0].tolist() == [8.0, 9.0, 12.0, 13.0]
    depth = torch.full((1, 1, 4, 4), SKY_DEPTH_M)
    depth[0, 0, 3, 1] = 2.0
    assert pick_nearest(capture, depth, 2)[0, 0].tolist() == [[0.0, 2.0], [13.0, 10.0]]
    held = torch.tensor([[[[4.0, 1e10, float("nan"), 0.0]]]])
    assert reverse_depth(held)[0, 0, 0].tolist() == [0.25, 0.0, 0.0, 0.0]
