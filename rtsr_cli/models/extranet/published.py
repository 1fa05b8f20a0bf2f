"""What the paper and its code surround ExtraNet's layers with, for the preset `paper`.

e = log(1 + q) of lighting over albedo, moved along the vectors, 0 outside; holes by the code's
tests of object, normal and position; depth between the least and the greatest of the image. Where
the published code pastes the target's own sky, which is never seen here, the sky of the last
rendered frame is moved and corrected like all else.
"""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.choices import DemodulationMode
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import fill_by_occlusion, find_occlusion_motion
from rtsr_cli.core.imaging.holes import Holes, find_holes
from rtsr_cli.core.imaging.warping import backward_warp, inside_frame
from rtsr_cli.core.lighting.past_lighting import encode_past, find_rendered
from rtsr_cli.core.shapes import Image, Mask, Plane
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.models.extranet.config import (
    PLACES,
    ExtraNetConfig,
    ExtraNetSurroundings,
    PastPictures,
)

FARTHEST_M = 1e4
"""Depth from which it counts as 0: 100 of the exported unit, 100 m   [ExtraNet, code]."""

LEAST_RANGE = 1e-6


def keep_unit(rendered: Frame) -> Tensor:
    """k = 1: lighting as it is."""
    return torch.ones(1, 1, 1, 1, device=rendered.gbuffer.device)


def stretch_depth(depth_m: Plane) -> Plane:
    """Depth from 0, the least of an image, to 1, the greatest; what is too far counts as 0."""
    near = torch.where(depth_m > FARTHEST_M, 0.0, depth_m)
    least, most = near.amin((1, 2, 3), keepdim=True), near.amax((1, 2, 3), keepdim=True)
    return (near - least) / (most - least).clamp(min=LEAST_RANGE)


def look_back_as_published(config: ExtraNetConfig, window: FrameWindow) -> PastPictures:
    """Warped lighting as the base; masks by the code's tests."""
    places = [place for place in PLACES if place < len(window.lr)]
    (warped, known), holes = _look_at(window, places[0])
    older = (
        _look_at(window, place)[0] if Buffer.COLOR in window.lr[place].gbuffer else None
        for place in places[1:]
    )
    second = warped * known
    if config.occlusion:
        rendered, motion = window.lr[places[0]], holes.motion_px
        occlusion = find_occlusion_motion(window.lr[: places[0] + 1], motion)
        encoded = encode_past(rendered, rendered, keep_unit(rendered))
        second = fill_by_occlusion(encoded, motion, occlusion, 1.0 - known)
    return PastPictures(
        base=warped,
        second=second,
        holes=1.0 - known,
        second_known=known,
        moved=((warped, known), *older),
    )


def _look_at(window: FrameWindow, place: int) -> tuple[tuple[Image, Mask], Holes]:
    """e of a rendered frame along the vectors and 1 where it is of the surface; its holes."""
    then, rendered = window.lr[place], window.lr[find_rendered(window)]
    holes = find_holes(window.lr[: place + 1])
    image, _ = backward_warp(encode_past(then, rendered, keep_unit(then)), holes.motion_px)
    return (image * inside_frame(holes.motion_px), 1.0 - holes.union), holes


PUBLISHED = ExtraNetSurroundings(
    look_back=look_back_as_published,
    scale_of=keep_unit,
    show_depth=stretch_depth,
    demodulation=DemodulationMode.ALBEDO,
)
