"""What camera matrices are held against: positions, motion along depth, normals along depth.

Each kind of evidence gives an error for a frame and the matrices of all frames; medians, so that
movers, sky and edges do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import (
    DEPTH_UNITS_M,
    LEAST_POINTS,
    StoredGeometry,
    ThinnedFrame,
    find_surface,
    measure_motion_error,
    measure_offset_error,
    project_points,
    read_metres,
    sample_positions,
)
from rtsr_cli.core.frames.camera import CameraMetadata, is_orthographic, place_in_camera_space
from rtsr_cli.core.frames.camera_convention import AXES
from rtsr_cli.core.frames.conventions import DepthConvention, DepthKind
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.vector_length import normalize_vectors, vector_length
from rtsr_cli.core.shapes import Vector3

MOST_PIXELS = 1 << 12
"""Pixels of a frame that positions and motion are compared at."""

MOST_SURFACE_PIXELS = 1 << 14
"""Pixels of a frame whose depths are compared with those beside them."""

ALIKE = math.cos(math.radians(12.0))
"""Cosine of a normal and the surface that it stands on; bumps lean it."""

FAR_PX = 8.0
"""Of errors in pixels, those beyond are alike: whatever a frame was read as, it is wrong."""

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


@dataclass(frozen=True, eq=False)
class PositionEvidence:
    """World positions lie on the pixels that show them.

    Attributes:
        frames: thinned, with `position` as stored.
        units: metres in a unit, to try; the first are the likely ones.
        thinning: how much the frames are thinned.
    """

    frames: Mapping[int, StoredGeometry]
    units: tuple[float, ...]
    thinning: int

    name = "world positions"
    unit = "px from their pixels"
    tells_world = True
    tells_step = True
    tells_lens = True
    slack = 0.02
    factor = 4.0

    limit = 0.75
    """Positions may be half floats."""
    sure = 0.75

    def measure(self, cameras: Cameras, *, closely: bool) -> Errors:
        """Median distance from the pixels, pixels of the frame."""
        units = self.units[:1] if closely else self.units
        trials = [self._measure(cameras, unit) for unit in units]
        return trials[pick_best(trials, most=FAR_PX)]

    def _measure(self, cameras: Cameras, unit: float) -> Errors:
        found = {}
        for number, frame in self.frames.items():
            if number not in cameras or frame.position is None:
                continue
            camera = bind_camera(frame.camera, cameras[number])
            error = measure_landing_error(frame.position * unit, replace(frame, camera=camera))
            if error is not None:
                found[number] = error * self.thinning
        return found

    def choose_unit(self, cameras: Cameras) -> float:
        """The unit under which matrices fit best."""
        return self.units[pick_best([self._measure(cameras, u) for u in self.units], most=FAR_PX)]


def measure_landing_error(position: Vector3, frame: StoredGeometry) -> float | None:
    """Median pixels between where positions are projected to and where they were seen.

    A constant difference of less than a pixel is taken out: jitter that is in the matrices.
    """
    landed = project_points(position, frame.camera, frame.view)
    if landed is None:
        return None
    size = (position.shape[-2], position.shape[-1])
    apart = landed - sample_positions(size, frame.camera.jitter_px)
    view = frame.camera.world_to_camera
    if view is not None:
        # an orthographic camera projects what is behind it like what is before it
        z = sum((position[:, i : i + 1] * float(view[i, 2]) for i in range(3)), start=view[3, 2])
        apart = torch.where(z < 0.0, apart, torch.nan)
    there = torch.isfinite(position).all(1, keepdim=True) & (vector_length(position) > 0)
    return measure_offset_error(apart, there, frame.thinned)


MotionSource = tuple[MotionConvention, DepthConvention]


@dataclass(frozen=True, eq=False)
class VectorEvidence:
    """Depth, carried along the camera, moves as the vectors say.

    Attributes:
        frames: thinned; by reading of the vectors and frame number.
        step: numbers from a frame to the next.
        depths: readings of depth, to try.
        thinning: how much the frames are thinned.
        best: the readings under which the matrices as given fit best.
    """

    frames: Mapping[MotionConvention, Mapping[int, StoredGeometry]]
    step: int
    depths: tuple[DepthConvention, ...]
    thinning: int
    best: MotionSource | None = None

    name = "motion with depth"
    unit = "px of motion"
    tells_world = False
    tells_step = True
    tells_lens = False
    slack = 0.02
    factor = 4.0

    @property
    def limit(self) -> float:
        """A share of what moves, as vectors may be half floats or of rounded pixels."""
        moved = [
            float(vector_length(frame.motion_px).nanmedian()) * self.thinning
            for frames in self.frames.values()
            for frame in frames.values()
            if frame.motion_px is not None
        ]
        return 0.1 + 0.02 * max(moved, default=0.0)

    @property
    def sure(self) -> float:
        """Right readings differ by the rounding of the vectors alone."""
        return 0.25 * self.limit

    def measure(self, cameras: Cameras, *, closely: bool) -> Errors:
        """Median difference of the vectors, pixels of the frame."""
        trials = [self._measure(cameras, source) for source in self._list_sources(closely=closely)]
        return trials[pick_best(trials, most=FAR_PX)] if trials else {}

    def _list_sources(self, *, closely: bool) -> list[MotionSource]:
        if closely and self.best is not None:
            return [self.best]
        if self.best is not None:
            # other matrices are tried under the depth that is presumed, and the likeliest one
            depths = dict.fromkeys((self.depths[0], self.best[1]))
            return [(motion, depth) for motion in self.frames for depth in depths]
        return [(motion, depth) for motion in self.frames for depth in self.depths]

    def hold(self, cameras: Cameras) -> VectorEvidence:
        """Note the readings under which matrices fit best."""
        sources = self._list_sources(closely=False)
        if not sources:
            return self
        trials = [self._measure(cameras, source) for source in sources]
        return replace(self, best=sources[pick_best(trials, most=FAR_PX)])

    def _measure(self, cameras: Cameras, source: MotionSource) -> Errors:
        motion, depth = source
        found = {}
        for number, frame in self.frames[motion].items():
            other = number + (self.step if motion.direction.to_next else -self.step)
            if not {number, other} <= cameras.keys():
                continue
            moved = replace(
                frame,
                camera=bind_camera(frame.camera, cameras[number]),
                previous=bind_camera(frame.previous, cameras[other]),
            )
            error = measure_motion_error(moved, depth)
            if error is not None:
                found[number] = error * self.thinning
        return found


SURFACE_DEPTHS = (
    DepthConvention(kind=DepthKind.PLANAR),
    DepthConvention(kind=DepthKind.RAY),
    DepthConvention(kind=DepthKind.DEVICE),
    DepthConvention(kind=DepthKind.DEVICE, reversed=True),
)
"""Readings of depth under which surfaces have other directions; units have no part in that."""


@dataclass(frozen=True, eq=False)
class NormalEvidence:
    """Normals stand on the surfaces that depth shows.

    Attributes:
        frames: thinned.
        normals: unit or zero, as stored; by frame.
        depths: readings of depth, to try; the likeliest first.
        known: surfaces that were found already.
    """

    frames: Mapping[int, StoredGeometry]
    normals: Mapping[int, Vector3]
    depths: tuple[DepthConvention, ...] = SURFACE_DEPTHS
    known: dict[object, tuple[Tensor, Tensor] | None] = field(default_factory=dict)

    name = "normals with depth"
    unit = "% of the surfaces elsewhere"
    tells_world = True
    tells_step = False
    tells_lens = False
    slack = 8.0
    factor = 1.1
    limit = 70.0
    sure = 25.0

    def measure(self, cameras: Cameras, *, closely: bool) -> Errors:
        """Share of the normals that do not stand on their surfaces, in per cent.

        Bumps and edges have their share in it whatever the camera is.
        """
        depths = self.depths[:1] if closely else self.depths
        trials = [self._measure(cameras, depth) for depth in depths]
        return trials[pick_best(trials)]

    def hold(self, cameras: Cameras) -> NormalEvidence:
        """Put the reading of depth first under which matrices fit best."""
        best = self.depths[pick_best([self._measure(cameras, d) for d in self.depths])]
        return replace(self, depths=tuple(dict.fromkeys((best, *self.depths))))

    def _measure(self, cameras: Cameras, depth: DepthConvention) -> Errors:
        found = {}
        for number in self.frames.keys() & cameras.keys():
            rotation = torch.tensor(cameras[number].view[:3, :3])
            share = self._measure_share(number, cameras[number], depth, (rotation,))
            if share is not None:
                found[number] = share
        return found

    def measure_in_camera(self, cameras: Cameras) -> float:
        """The same for normals in the camera's own axes, however those are named."""
        turns = tuple(torch.tensor(a, dtype=torch.float64) for a in AXES.values())
        errors = []
        for number in self.frames.keys() & cameras.keys():
            camera = cameras[number]
            shares = [self._measure_share(number, camera, d, turns) for d in self.depths]
            errors += [min((s for s in shares if s is not None), default=math.inf)]
        return mean_error(errors)

    def _measure_share(
        self,
        number: int,
        camera: CameraMatrices,
        depth: DepthConvention,
        turns: Sequence[Tensor],
    ) -> float | None:
        """Per cent of the normals that are apart for the best of turns, n_camera = n . turn."""
        surfaces = self._find_surfaces(number, camera, depth)
        if surfaces is None:
            return None
        normal, own = surfaces
        cosines = [(normalize_vectors(normal @ turn.to(normal)) * own).sum(1) for turn in turns]
        return min(100.0 * float((c < ALIKE).float().mean()) for c in cosines)

    def _find_surfaces(
        self, number: int, camera: CameraMatrices, depth: DepthConvention
    ) -> tuple[Tensor, Tensor] | None:
        """Normals as stored, and those of the surfaces in camera space, n x 3; made once."""
        key = (number, depth, np.round(camera.projection, 5).tobytes())
        if key not in self.known:
            frame = self.frames[number]
            frame = replace(frame, camera=bind_camera(frame.camera, camera))
            self.known[key] = _pair_normals(frame, self.normals[number], depth)
        return self.known[key]


def _pair_normals(
    frame: StoredGeometry, normal: Vector3, depth: DepthConvention
) -> tuple[Tensor, Tensor] | None:
    surfaces = _find_surface_normals(frame, depth)
    if surfaces is None:
        return None
    own, known = surfaces
    inner = normal[..., 1:-1, 1:-1]
    known = known & (vector_length(inner) > 0.0)
    if int(known.sum()) < LEAST_POINTS:
        return None
    places = known[0, 0]
    return inner[0, :, places].T, own[0, :, places].T


def _find_surface_normals(
    frame: StoredGeometry, depth: DepthConvention
) -> tuple[Vector3, Tensor] | None:
    """Normals of the surfaces that depths show, in camera space, and where they are known."""
    metres = read_metres(frame, depth)
    points = None if metres is None else place_in_camera_space(metres, frame.camera, frame.view)
    if metres is None or points is None or min(metres.shape[-2:]) < 3:
        return None
    there = find_surface(frame, metres)
    across = points[..., 1:-1, 2:] - points[..., 1:-1, :-2]
    down = points[..., 2:, 1:-1] - points[..., :-2, 1:-1]
    normal = normalize_vectors(torch.linalg.cross(across, down, dim=1))
    middle = points[..., 1:-1, 1:-1]
    projection = frame.camera.projection
    if projection is not None and is_orthographic(projection):
        middle = torch.zeros_like(middle)
        middle[:, 2] = -1.0
    away = (normal * middle).sum(1, keepdim=True) > 0.0
    known = there[..., 1:-1, 1:-1] & there[..., 1:-1, 2:] & there[..., 1:-1, :-2]
    known &= there[..., 2:, 1:-1] & there[..., :-2, 1:-1]
    return torch.where(away, -normal, normal), known & torch.isfinite(normal).all(1, keepdim=True)


def list_units(likely: float) -> tuple[float, ...]:
    """Units of length, a likely one first."""
    return tuple(dict.fromkeys((likely, *DEPTH_UNITS_M)))


def list_likely_depths(presumed: DepthConvention) -> tuple[DepthConvention, ...]:
    """A few readings of depth, the presumed one first."""
    plain = replace(presumed, sky=None)
    centimetres = [replace(d, unit_m=0.01) for d in SURFACE_DEPTHS[:2]]
    return tuple(dict.fromkeys((plain, *SURFACE_DEPTHS, *centimetres)))


def thin(geometry: StoredGeometry, most: int = MOST_PIXELS) -> tuple[StoredGeometry, int]:
    """Thin a frame, and say by how much."""
    thinning = ThinnedFrame.of(geometry.depth, most)
    return thinning.geometry(geometry), thinning.k
