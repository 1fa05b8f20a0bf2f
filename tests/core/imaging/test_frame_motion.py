"""Dual motion between frames, against what rays to the exact positions meet."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import (
    chain_motions,
    chain_motions_of_pixels,
    exposure_ratio,
    find_dual_motion,
    sample_motion,
)
from rtsr_cli.core.imaging.splatting import UNRELIABLE_PX
from rtsr_cli.core.imaging.warping import inside_frame
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.point_motion import motion_px
from rtsr_cli.core.synth.rays import EVERYWHERE, TILE_PX, Rays, strip_rays, trace
from rtsr_cli.core.synth.render import RenderedShot, prepare_shot, render_frame
from rtsr_cli.core.synth.scene import Scene

SIZE = (136, 240)
BUFFERS = (Buffer.DEPTH, Buffer.MOTION, Buffer.FORWARD)
CONTRAST_PX = 1.0
"""Surfaces whose motion differs by less cannot be told apart by motion."""


def frames_of(scene: Scene, *, forward: bool) -> tuple[Frame, Frame]:
    now, before = (render_frame(scene, number, SIZE, buffers=BUFFERS) for number in (6, 5))
    if not forward:
        kept = {b: image for b, image in before.gbuffer.items() if b is not Buffer.FORWARD}
        before = replace(before, gbuffer=GBuffer(kept, "without forward vectors"))
    return now, before


def in_tiles(rays: Rays, vectors: Tensor) -> Tensor:
    """Inverse of `Rays.image` for (2, height, width)."""
    down, across = rays.grid
    padded = torch.zeros(2, down * TILE_PX, across * TILE_PX)
    padded[:, : SIZE[0], : SIZE[1]] = vectors
    tiled = padded.view(2, down, TILE_PX, across, TILE_PX).transpose(2, 3)
    return tiled.reshape(2, down * across, -1)


def separation_px(shot: RenderedShot, motion: Tensor, offset: tuple[float, float]) -> Tensor:
    """|x - z|: where what the frame before shows at x + motion + offset goes, from x."""
    rays = strip_rays(shot.camera, SIZE, range(SIZE[0]))
    shift = in_tiles(rays, motion + motion.new_tensor(offset).view(2, 1, 1))
    projection = shot.camera.projection
    assert projection is not None
    moved = replace(
        rays,
        x=(rays.x + 2.0 * shift[0] / SIZE[1] / float(projection[0, 0])).float(),
        y=(rays.y - 2.0 * shift[1] / SIZE[0] / float(projection[1, 1])).float(),
    )
    hits = trace(moved, shot.solids, tuple(EVERYWHERE for _ in shot.solids))
    cameras = (shot.camera, shot.following)
    forward = motion_px(moved, hits, shot.solids, cameras, display=SIZE, forward=True)
    return (motion + moved.image(forward)).abs().amax(0)


def true_visibility(scene: Scene, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels whose fetched area is hidden as a whole, by > 1 px of motion, or not at all."""
    shot = prepare_shot(scene, 5, SIZE)
    offsets = [(x, y) for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)]
    apart = torch.stack([separation_px(shot, motion, offset) for offset in offsets])
    inside = inside_frame(motion[None])[0, 0] > 0
    return (apart > CONTRAST_PX).all(0) & inside, (apart < UNRELIABLE_PX).all(0) & inside


@pytest.mark.parametrize("forward", [True, False], ids=["forward vectors", "splat"])
def test_unreliable_pixels_are_the_disocclusions(forward: bool) -> None:
    found = missed = wrong = 0
    for seed in (2, 3, 5, 9, 10):
        scene = draw_scene(seed)
        now, before = frames_of(scene, forward=forward)
        hidden, visible = true_visibility(scene, now.gbuffer[Buffer.MOTION][0])
        dual = find_dual_motion(now, before)
        marked = dual.unreliable[0, 0] > 0
        contrast = (dual.dual_px - dual.motion_px).abs().amax(1)[0] > CONTRAST_PX
        contrast |= dual.known[0, 0] == 0
        found += int((marked & hidden).sum())
        missed += int((~marked & hidden).sum())
        wrong += int((marked & visible & contrast).sum())
    assert found > 300
    assert found / (found + missed) >= 0.9
    assert found / (found + wrong) >= 0.9


def test_what_lay_in_front_and_left_the_frame_is_marked() -> None:
    """A bar leaves to the left, the wall behind stays: no vector of this frame is the bar's."""
    base = frames_of(draw_scene(2), forward=True)[0]
    wall, still = torch.full((1, 1, 4, 8), 5.0), torch.zeros(1, 2, 4, 8)
    with_bar, moving = wall.clone(), still.clone()
    with_bar[..., :2], moving[:, 0, :, :2] = 1.0, 3.0
    now = replace(base, gbuffer=GBuffer({Buffer.DEPTH: wall, Buffer.MOTION: still}, "now"))
    before = replace(base, gbuffer=GBuffer({Buffer.DEPTH: with_bar, Buffer.MOTION: moving}, "then"))
    unreliable = find_dual_motion(now, before).unreliable[0, 0] > 0
    assert unreliable[:, :2].all()
    assert not unreliable[:, 2:].any()


def jittered_frame(jitter_px: tuple[float, float], motion: float, exposure: float = 1.0) -> Frame:
    base = frames_of(draw_scene(2), forward=True)[0]
    buffers = {
        Buffer.DEPTH: torch.full((1, 1, 4, 6), 3.0),
        Buffer.MOTION: torch.full((1, 2, 4, 6), motion),
        Buffer.FORWARD: torch.full((1, 2, 4, 6), -motion),
    }
    camera = CameraMetadata(jitter_px=jitter_px, pre_exposure=exposure)
    return replace(base, gbuffer=GBuffer(buffers, "jittered"), camera=camera)


def test_motion_between_samples_holds_the_change_of_jitter() -> None:
    now, before = jittered_frame((0.25, -0.5), 1.0), jittered_frame((-0.25, 0.0), 1.0)
    motion = sample_motion(now, before)
    assert torch.equal(motion[0, :, 0, 0], torch.tensor([1.5, 0.5]))


@pytest.mark.parametrize("jitter_px", [(0.0, 0.0), (0.4, -0.3)])
def test_jitter_marks_nothing(jitter_px: tuple[float, float]) -> None:
    now, before = jittered_frame(jitter_px, 0.0), jittered_frame((-0.2, 0.1), 0.0)
    dual = find_dual_motion(now, before)
    assert not dual.unreliable[..., 1:-1, 1:-1].any()


def test_brightening_is_the_ratio_of_exposures() -> None:
    assert exposure_ratio(jittered_frame((0, 0), 0, 4.0), jittered_frame((0, 0), 0, 2.0)) == 2.0


def test_vectors_of_some_pixels_are_chained_as_all_are() -> None:
    scene = draw_scene(3)
    frames = [render_frame(scene, n, (34, 60), buffers=(Buffer.MOTION,)) for n in (6, 5, 4, 3)]
    pixels = torch.arange(1, 34 * 60, 7)
    for some, every in zip(
        chain_motions_of_pixels(frames, pixels), chain_motions(frames), strict=True
    ):
        assert torch.equal(some, every[0].flatten(1)[:, pixels])
