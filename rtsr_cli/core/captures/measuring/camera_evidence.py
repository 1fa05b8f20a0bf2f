"""What camera matrices are held against, and what its kinds share.

`position_evidence`, `vector_evidence` (motion along depth), `normal_evidence` (normals along
depth): each kind gives an error for a frame and the matrices of all frames; medians, so that
movers, sky and edges do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_refinement import NearbyView
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import (
    DEPTH_UNITS_M,
    LEAST_POINTS,
    StoredGeometry,
    ThinnedFrame,
    list_depth_hypotheses,
    take_offset,
)
from rtsr_cli.core.frames.camera import (
    CameraMetadata,
    list_near_planes,
)
from rtsr_cli.core.frames.conventions import DepthConvention, DepthKind
from rtsr_cli.core.shapes import MotionPx

MOST_PIXELS = 1 << 12
"""Pixels of a frame that positions and motion are compared at."""

MOST_SURFACE_PIXELS = 1 << 14
"""Pixels of a frame whose depths are compared with those beside them."""

FAR_PX = 8.0
"""Of errors in pixels, those beyond are alike: whatever a frame was read as, it is wrong."""

LAST_DIGITS_PX = 1e-3
"""What the digits of single matrices move pixels by."""

SURFACE_DEPTHS = (
    DepthConvention(kind=DepthKind.PLANAR),
    DepthConvention(kind=DepthKind.RAY),
    DepthConvention(kind=DepthKind.DEVICE),
    DepthConvention(kind=DepthKind.DEVICE, reversed=True),
)
"""Readings of depth under which surfaces have other directions; units have no part in that."""

Errors = Mapping[int, float]
"""By frame number; frames that tell nothing are not there."""


class CameraEvidence(Protocol):
    """Something that the matrices have to agree with."""

    @property
    def name(self) -> str:
        """What it is, for the user."""

    @property
    def unit(self) -> str:
        """What errors are measured in."""

    @property
    def limit(self) -> float:
        """Errors up to this are those of right matrices."""

    @property
    def sure(self) -> float:
        """Errors up to this are no chance: another reading has to be as good to be believed."""

    @property
    def slack(self) -> float:
        """Errors that differ less than this are alike."""

    @property
    def factor(self) -> float:
        """Errors that are not so many times another one are like it."""

    @property
    def tells_world(self) -> bool:
        """Whether it tells how the axes of the world are named."""

    @property
    def tells_step(self) -> bool:
        """Whether it tells a frame's camera from that of the frame beside it."""

    @property
    def tells_lens(self) -> bool:
        """Whether it tells the field of view of a camera that rests."""

    def measure(self, cameras: Cameras, *, closely: bool) -> Errors:
        """Errors of a reading of the matrices.

        Args:
            cameras: the reading, by frame.
            closely: only under the reading of other buffers that fits the matrices as given best.
        """

    def view_nearby(self, given: Cameras) -> NearbyView | None:
        """What holds it against cameras beside the matrices as given; None where nothing can."""


def bind_camera(camera: CameraMetadata, matrices: CameraMatrices) -> CameraMetadata:
    """Return a camera with other matrices."""
    return replace(
        camera,
        world_to_camera=torch.from_numpy(np.ascontiguousarray(matrices.view)),
        world_to_ndc=torch.from_numpy(np.ascontiguousarray(matrices.ndc)),
    )


def mean_error(errors: Iterable[float]) -> float:
    """Mean of some frames' errors, infinite if there are none."""
    listed = list(errors)
    return sum(listed) / len(listed) if listed else math.inf


def pick_best(trials: Sequence[Errors], *, most: float = math.inf) -> int:
    """Index of the trial with the smallest mean error.

    Args:
        trials: to choose from.
        most: errors beyond it count as it, so that no single frame decides.
    """

    def measure(errors: Errors) -> float:
        return mean_error(min(error, most) for error in errors.values())

    return min(range(len(trials)), key=lambda i: measure(trials[i]))


def list_rows(difference: MotionPx, valid: Tensor, thinning: int) -> Tensor:
    """Differences less a constant one, n x 2, pixels of the frame; NaN where they are not known."""
    known = valid & torch.isfinite(difference).all(1, keepdim=True)
    if int(known.sum()) >= LEAST_POINTS:
        difference = take_offset(difference, known, thinning)
    return difference[valid.expand_as(difference)].view(2, -1).T * thinning


def list_units(likely: float) -> tuple[float, ...]:
    """Units of length, a likely one first."""
    return tuple(dict.fromkeys((likely, *DEPTH_UNITS_M)))


def list_likely_depths(presumed: DepthConvention) -> tuple[DepthConvention, ...]:
    """A few readings of depth, the presumed one first."""
    plain = replace(presumed, sky=None)
    centimetres = [replace(d, unit_m=0.01) for d in SURFACE_DEPTHS[:2]]
    return tuple(dict.fromkeys((plain, *SURFACE_DEPTHS, *centimetres)))


def list_near_depths(given: Cameras) -> list[DepthConvention]:
    """Ray distances from the near plane: a camera beside would explain them nearly."""
    projection = torch.from_numpy(next(iter(given.values())).projection)
    return [d for d in list_depth_hypotheses((), list_near_planes(projection)) if d.from_near]


def thin(geometry: StoredGeometry, most: int = MOST_PIXELS) -> tuple[StoredGeometry, int]:
    """Thin a frame, and say by how much."""
    thinning = ThinnedFrame.of(geometry.depth, most)
    return thinning.geometry(geometry), thinning.k
