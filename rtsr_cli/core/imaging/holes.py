"""Holes: what a past frame does not show of the surfaces of a frame that was never shaded.

Three tests, after ExtraNet [Guo et al. 2021], between a frame and a past one along the motion m
from samples to samples:

    stencil     the object at x + m is another one, or one of both is sky; nearest pixel
    normal      n . n_past < 0.98, on what moves by itself
    position    |P - P_past| > T_d at any bilinear tap, on what stands still

T_d = 0.075 |NoV| + 0.45 (1 - |NoV|) + 0.005 z, metres, and a pixel's own slope on top: taps of a
floor far away lie farther apart than T_d (at 30 m and 720 lines, say). The paper marks where
n . n_past > T, which is a slip; its plain union of the tests, on T_d alone, is an option.

Where something is missing, what is there takes its place, the depth at x + m:

    depth       |z_past - z| > 0.05 k z and a pixel's own slope, k frames apart

on what moves if there are no object ids or no normals, and everywhere if no camera tells what
moves, or no position is known.

m is composed, frame after frame, where something moves by itself. What stands still is where the
camera says, so that a point that is hidden for a frame is found again in the frames before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, sky_mask
from rtsr_cli.core.frames.camera import view_cosine_from_camera
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.camera_motion import (
    differs_from_camera,
    find_camera_motion,
    locate_points,
)
from rtsr_cli.core.imaging.disocclusion import (
    DisocclusionThresholds,
    SurfaceBuffers,
    SurfaceDifferences,
    compare_surfaces,
)
from rtsr_cli.core.imaging.frame_motion import (
    chain_motion,
    chain_motion_as_published,
    sample_motion,
)
from rtsr_cli.core.imaging.warping import fetch_nearest
from rtsr_cli.core.shapes import Mask, MotionPx

DEPTH_PER_FRAME = 0.05
"""How much the depth of a surface may change in a frame, where no position says it exactly."""


class HoleTest(StrEnum):
    """What tells that a past frame shows something else."""

    STENCIL = "stencil"
    NORMAL = "normal"
    POSITION = "position"
    DEPTH = "depth"


@dataclass(frozen=True, kw_only=True)
class HoleConfig:
    """How holes are found.

    Attributes:
        paper: every test on every pixel, T_d alone, and composed motion everywhere, as the paper
            has it; else normals where something moves by itself, positions where it does not, as
            its code.
        compat: vectors of several frames are composed in the published code's order.
    """

    paper: bool = False
    compat: bool = False


@dataclass(frozen=True, kw_only=True)
class Holes:
    """What a past frame does not show.

    Attributes:
        motion_px: from the samples of the frame to those of the past one.
        outside: 1 where they lie outside of the past frame, or motion is not a number.
        tests: 1 where it shows another surface; each test that could be made. 0 outside.
        dynamic: 1 on what moves by itself; None where no camera tells.
    """

    motion_px: MotionPx
    outside: Mask
    tests: Mapping[HoleTest, Mask]
    dynamic: Mask | None

    @property
    def disoccluded(self) -> Mask:
        """1 where any test says so."""
        found = torch.zeros_like(self.outside)
        for marked in self.tests.values():
            found = torch.maximum(found, marked)
        return found

    @property
    def union(self) -> Mask:
        """1 where there is no valid history, outside or disoccluded."""
        return torch.maximum(self.outside, self.disoccluded)


_DEFAULT = HoleConfig()


def find_holes(frames: Sequence[Frame], config: HoleConfig = _DEFAULT) -> Holes:
    """Find what a past frame does not show of a frame.

    Args:
        frames: successive ones, newest first, two or more: the first is the frame, the last the
            past one. All but the last hold motion, these two depth, and what is known of object
            ids, normals, positions and view cosines.
        config: how.

    Raises:
        MissingBufferError: motion or depth is not there.
        ShapeMismatchError: sizes differ.
    """
    now, then = frames[0], frames[-1]
    follows = _follow_camera(now, frames[1])
    motion = _find_past_motion(frames, follows, config)
    thresholds = DisocclusionThresholds(
        depth_relative=DEPTH_PER_FRAME * (len(frames) - 1),
        position_slope_px=0.0 if config.paper else 1.0,
    )
    differ = compare_surfaces(
        motion,
        current=_read_surfaces(now),
        previous=_read_surfaces(then),
        thresholds=thresholds,
    )
    sky, sky_then = (sky_mask(frame.gbuffer[Buffer.DEPTH]) for frame in (now, then))
    dynamic = None if follows is None else (1.0 - follows) * (1.0 - sky)
    tests = _share_tests(differ, dynamic, paper=config.paper)
    tests = {test: marked & (sky == 0) for test, marked in tests.items()}
    other_kind = fetch_nearest(sky_then, motion) != sky
    tests[HoleTest.STENCIL] = tests[HoleTest.STENCIL] | other_kind
    return Holes(
        motion_px=motion,
        outside=differ.outside.to(motion),
        tests={test: (marked & ~differ.outside).to(motion) for test, marked in tests.items()},
        dynamic=dynamic,
    )


def _follow_camera(now: Frame, before: Frame) -> Mask | None:
    """1 where vectors are those of the camera; None where no camera or position tells."""
    position = locate_points(now)
    camera_px = None if position is None else find_camera_motion(position, before)
    if camera_px is None:
        return None
    return 1.0 - differs_from_camera(sample_motion(now, before), camera_px)


def _find_past_motion(
    frames: Sequence[Frame], follows: Mask | None, config: HoleConfig
) -> MotionPx:
    """Motion from the samples of the first frame to those of the last."""
    if config.compat:
        return chain_motion_as_published(frames)
    motion = chain_motion(frames)
    if config.paper or follows is None or len(frames) == 2:
        return motion
    position = locate_points(frames[0])
    camera_px = None if position is None else find_camera_motion(position, frames[-1])
    return motion if camera_px is None else torch.where(follows > 0, camera_px, motion)


def _read_surfaces(frame: Frame) -> SurfaceBuffers:
    """Surfaces of a frame; sky lies nowhere."""
    gbuffer, position = frame.gbuffer, locate_points(frame)
    depth, normal = gbuffer[Buffer.DEPTH], gbuffer.buffers.get(Buffer.NORMAL)
    cosine = gbuffer.buffers.get(Buffer.NOV)
    if cosine is None and normal is not None:
        jitter = frame.camera.jitter_px
        cosine = view_cosine_from_camera(normal, frame.camera, frame.view, jitter_px=jitter)
    if position is not None:
        position = position.masked_fill(sky_mask(depth) > 0, torch.inf)
    return SurfaceBuffers(
        depth_m=depth,
        normal=normal,
        position_m=position,
        n_dot_v=cosine,
        object_id=gbuffer.buffers.get(Buffer.OBJECT_ID),
    )


def list_tests(
    *, ids: bool, normals: bool, positions: bool, tells_motion: bool, paper: bool
) -> tuple[HoleTest, ...]:
    """Return the tests that can be made of frames.

    Args:
        ids, normals, positions: what is known of both frames; positions stored, or by camera.
        tells_motion: whether positions and a camera tell what moves by itself.
        paper: as in `HoleConfig`.
    """
    tests = [HoleTest.STENCIL]
    if normals:
        tests.append(HoleTest.NORMAL)
    if positions and (paper or tells_motion):
        tests.append(HoleTest.POSITION)
    moving_is_told = not tells_motion or (ids and normals)
    if HoleTest.POSITION not in tests or not moving_is_told:
        tests.append(HoleTest.DEPTH)
    return tuple(tests)


def _share_tests(
    differ: SurfaceDifferences, dynamic: Mask | None, *, paper: bool
) -> dict[HoleTest, Tensor]:
    """What each test marks where it is the one to ask; the depth stands in for what is missing."""
    ids, normal, position = differ.object_id, differ.normal, differ.position
    everywhere = torch.ones_like(differ.outside)
    moves = everywhere if dynamic is None else dynamic > 0
    where = {
        HoleTest.STENCIL: everywhere,
        HoleTest.NORMAL: everywhere if paper else moves,
        HoleTest.POSITION: everywhere if paper else ~moves,
        HoleTest.DEPTH: everywhere if position is None else moves,
    }
    marked = {
        HoleTest.STENCIL: ids,
        HoleTest.NORMAL: normal,
        HoleTest.POSITION: position,
        HoleTest.DEPTH: differ.depth,
    }
    made = list_tests(
        ids=ids is not None,
        normals=normal is not None,
        positions=position is not None,
        tells_motion=dynamic is not None,
        paper=paper,
    )
    nowhere = ~everywhere
    return {
        test: nowhere if (found := marked[test]) is None else found & where[test] for test in made
    }
