"""Past frames as the current one sees them: motion between samples, dual motion, brightness.

A sample of frame t lies at pixel + jitter(t). Motion vectors are those of surfaces, without
jitter; between pixels of two frames, and so between their tensors, jitter joins in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.disocclusion import bound_depth
from rtsr_cli.core.imaging.splatting import (
    dual_motion,
    forward_motion_by_splat,
    unreliable_mask,
)
from rtsr_cli.core.imaging.warping import (
    backward_warp,
    compose_motion,
    fetch_nearest,
    find_nearest_pixels,
    inside_frame,
    own_index,
    require_same_size,
    warp_pixels,
)
from rtsr_cli.core.shapes import Image, Mask, MotionPx, Plane

IN_FRONT = 0.8
"""Share of a surface's depth below which what was seen in its place lay in front of it."""


def add_jitter_change(vectors_px: Image, now: Frame, then: Frame) -> Image:
    """Vectors from surface points of `now` to those of `then` -> from sample to sample.

    v + jitter(now) - jitter(then), pixels
    """
    shift = [a - b for a, b in zip(now.camera.jitter_px, then.camera.jitter_px, strict=True)]
    return vectors_px + vectors_px.new_tensor(shift).view(1, 2, 1, 1)


def sample_motion(now: Frame, before: Frame) -> MotionPx:
    """Motion between samples: mv + jitter - jitter_prev, pixels."""
    return add_jitter_change(now.gbuffer[Buffer.MOTION], now, before)


def chain_motion(frames: Sequence[Frame]) -> MotionPx:
    """Motion between the samples of the first frame and those of the last, frame after frame.

        m(x) = m_t(x) + m_t-1(x + m_t(x)) + ...

    Args:
        frames: successive ones, newest first, two or more; all but the last hold motion.
    """
    return chain_motions(frames)[-1]


def chain_motions(frames: Sequence[Frame]) -> list[MotionPx]:
    """`chain_motion` to each of the frames but the first, in turn."""
    motions = [sample_motion(frames[0], frames[1])]
    for now, before in pairwise(frames[1:]):
        motions.append(compose_motion(motions[-1], sample_motion(now, before))[0])
    return motions


def chain_motions_of_pixels(frames: Sequence[Frame], pixels: Tensor) -> list[Tensor]:
    """`chain_motions` of some pixels alone, by index where rows follow each other: 2 k each."""
    motions = [sample_motion(frames[0], frames[1])[0].flatten(1)[:, pixels]]
    for now, before in pairwise(frames[1:]):
        older = warp_pixels(sample_motion(now, before), motions[-1], pixels)
        motions.append(motions[-1] + older)
    return motions


def chain_motion_as_published(frames: Sequence[Frame]) -> MotionPx:
    """Motion as `chain_motion`, composed in the order of ExtraNet's published code.

        m(x) = m_oldest(x), then, towards newer fields,  m(x) += longest of field(trunc(x + m(x)))

    It looks newer fields up at places of older frames, in whole pixels at that, and takes the
    longest of the four vectors there, or 0 if one of them is 0. For weights that were trained so.

    Args:
        frames: as `chain_motion`.
    """
    motion = sample_motion(frames[-2], frames[-1])
    for before, now in pairwise(reversed(frames[:-1])):
        motion = motion + _fetch_longest(sample_motion(now, before), motion)
    return motion


def _fetch_longest(field_px: MotionPx, motion_px: MotionPx) -> MotionPx:
    """The longest of the four vectors from trunc(x + motion) on; 0 where one of them is 0."""
    own = [own_index(motion_px, axis).expand_as(motion_px[:, :1]) for axis in (0, 1)]
    place = torch.cat(own, dim=1).to(motion_px)
    whole = (place + motion_px).trunc() - place
    steps = (motion_px.new_tensor(s).view(1, 2, 1, 1) for s in product((0.0, 1.0), repeat=2))
    fetched = torch.stack([fetch_nearest(field_px, whole + step) for step in steps])
    lengths = fetched.square().sum(2, keepdim=True)
    longest = lengths.argmax(0, keepdim=True).expand(-1, -1, 2, -1, -1)
    return fetched.gather(0, longest)[0] * (lengths.amin(0) > 0)


def exposure_ratio(now: Frame, before: Frame) -> float:
    """What radiance of the frame before is to be multiplied by: ratio of the pre-exposures."""
    return now.camera.pre_exposure / before.camera.pre_exposure


@dataclass(frozen=True)
class DualMotion:
    """Motion of a surface, and of what its old position showed; samples, pixels.

    Attributes:
        motion_px: TMV.
        dual_px: DMV; TMV where it is not known.
        known: 1 where it is.
    """

    motion_px: MotionPx
    dual_px: MotionPx
    known: Mask

    @property
    def unreliable(self) -> Mask:
        """1 where the frame before shows another surface, or none at all."""
        return unreliable_mask(self.motion_px, self.dual_px, self.known)


def find_dual_motion(now: Frame, before: Frame) -> DualMotion:
    """Dual motion by the forward vectors of the frame before, by a splat where it has none.

    A splat is of what this frame shows: a surface that left the frame, or is itself hidden now, has
    no vector. Where it lay in front it is told by its depth, and taken to move on as it came.
    """
    motion = sample_motion(now, before)
    if Buffer.FORWARD in before.gbuffer:
        forward = add_jitter_change(before.gbuffer[Buffer.FORWARD], before, now)
        return DualMotion(motion, *dual_motion(motion, forward))
    return _find_dual_by_splat((now, before), motion)


def _find_dual_by_splat(
    frames: Sequence[Frame], motion_px: MotionPx, *, spread: bool = False
) -> DualMotion:
    """Dual motion to the last of some frames, without its forward vectors."""
    depth, there = _splat_forward(frames, motion_px, spread=spread)
    # a pixel's channels are one row: fetched at once
    packed = torch.cat(there, dim=1).contiguous(memory_format=torch.channels_last)
    fetched = fetch_nearest(packed, motion_px)
    return _choose_dual(frames, motion_px, depth, fetched, inside_frame(motion_px))


def _splat_forward(
    frames: Sequence[Frame], motion_px: MotionPx, *, spread: bool
) -> tuple[Plane, list[Image]]:
    """Depth of the first of some frames, and on the grid of the last one: forward motion and where
    it is known, depth, motion.
    """
    now, then = frames[0], frames[-1]
    depth = bound_depth(now.gbuffer[Buffer.DEPTH])
    forward = forward_motion_by_splat(motion_px, depth, spread=spread)
    return depth, [*forward, bound_depth(then.gbuffer[Buffer.DEPTH]), then.gbuffer[Buffer.MOTION]]


def _choose_dual(
    frames: Sequence[Frame], motion_px: MotionPx, depth: Plane, fetched: Image, inside: Mask
) -> DualMotion:
    """Dual motion where `_splat_forward` says `fetched` at the old positions."""
    known = fetched[:, 2:3] * inside
    dual = torch.where(known > 0, -fetched[:, :2], motion_px)
    came = add_jitter_change((len(frames) - 1) * fetched[:, 4:], frames[0], frames[-1])
    in_front = fetched[:, 3:4] < IN_FRONT * depth
    return DualMotion(motion_px, torch.where(in_front, came, dual), known)


def find_occlusion_motion(frames: Sequence[Frame], motion_px: MotionPx) -> MotionPx:
    """Occlusion motion vectors: where the background beside a hole's occluder was.

        y = x + m(x) shows the occluder, which moves on to z:   mv_occ(x) = y + (x - z) - x

    The displacement is the occluder's own, so that a fetch at x + mv_occ(x) gives what lies beside
    it, in place of the occluder. Where the past frame shows the surface, and where no vector is
    known, it is m. Vectors are splat onto the four pixels around.   [Zeng et al. 2021; ExtraNet]

    Args:
        frames: successive ones, newest first, two or more: the first is the frame, the last the
            past one, which both hold depth, and the latter motion.
        motion_px: m, from the samples of the frame to those of the past one.

    Raises:
        MissingBufferError: one is not there.
    """
    return _find_dual_by_splat(frames, motion_px, spread=True).dual_px


def find_occlusion_motion_of_pixels(
    frames: Sequence[Frame], motion_px: MotionPx, pixels: Tensor
) -> Tensor:
    """`find_occlusion_motion` of some pixels alone, by index where rows follow each other: 2 k."""
    depth, there = _splat_forward(frames, motion_px, spread=True)
    # an image of one row
    own, own_depth = (image[0].flatten(1)[None, :, None, pixels] for image in (motion_px, depth))
    size = (motion_px.shape[2], motion_px.shape[3])
    place, inside = find_nearest_pixels(own[0, :, 0], pixels, size)
    fetched = [image[0].flatten(1).index_select(1, place) for image in there]
    row = torch.cat(fetched)[None, :, None]
    return _choose_dual(frames, own, own_depth, row, inside.view_as(own_depth)).dual_px[0, :, 0]


def fill_by_occlusion(
    image: Image, motion_px: MotionPx, occlusion_px: MotionPx, holes: Mask
) -> Image:
    """A past image along its vectors, in holes along the occlusion vectors; the border repeated.

    Args:
        image: of the past frame.
        motion_px: to its samples.
        occlusion_px: the same, of `find_occlusion_motion`.
        holes: 1 where vectors lead to another surface.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    require_same_size(motion_px=motion_px, occlusion_px=occlusion_px, holes=holes)
    vectors = torch.where(holes > 0, occlusion_px, motion_px)
    return backward_warp(image, vectors)[0]
