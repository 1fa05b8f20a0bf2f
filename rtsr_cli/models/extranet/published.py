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
from rtsr_cli.core.imaging.holes import find_holes
from rtsr_cli.core.imaging.warping import backward_warp, inside_frame
from rtsr_cli.core.lighting.past_lighting import find_rendered
from rtsr_cli.core.shapes import Plane
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.models.extranet.config import (
    PLACES,
    ExtraNetConfig,
    ExtraNetSurroundings,
    PastPictures,
)
from rtsr_cli.models.extranet.history import encode_past, make_empty, order_history

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
    now, rendered = window.current, window.lr[find_rendered(window)]
    moved = []
    for place in PLACES:
        if place >= len(window.lr):
            break
        then = window.lr[place]
        if Buffer.COLOR not in then.gbuffer:
            moved.append(make_empty(now))
            continue
        holes = find_holes(window.lr[: place + 1])
        image, _ = backward_warp(encode_past(then, rendered, keep_unit(then)), holes.motion_px)
        moved.append((image * inside_frame(holes.motion_px), 1.0 - holes.union))
    (warped, known), holes_mask = moved[0], 1.0 - moved[0][1]
    occluded = warped * known
    if config.occlusion:
        motion = find_holes(window.lr[:2]).motion_px
        occlusion = find_occlusion_motion(window.lr[:2], motion)
        encoded = encode_past(rendered, rendered, keep_unit(rendered))
        occluded = fill_by_occlusion(encoded, motion, occlusion, holes_mask)
    return PastPictures(
        base=warped,
        second=occluded,
        holes=holes_mask,
        second_known=known,
        moved=order_history(moved, now),
    )


PUBLISHED = ExtraNetSurroundings(
    look_back=look_back_as_published,
    scale_of=keep_unit,
    show_depth=stretch_depth,
    demodulation=DemodulationMode.ALBEDO,
)
