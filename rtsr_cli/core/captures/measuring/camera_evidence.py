"""What camera matrices are held against: positions, motion along depth, normals along depth.

Each kind of evidence gives an error for a frame and the matrices of all frames; medians, so that
movers, sky and edges do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_refinement import NearbyView, Residuals, keep_rows
from rtsr_cli.core.captures.measuring.camera_rounding import measure_rounding
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import (
    DEPTH_UNITS_M,
    LEAST_POINTS,
    StoredGeometry,
    ThinnedFrame,
    compare_motion,
    find_surface,
    list_depth_hypotheses,
    measure_depth_effect,
    measure_motion_error,
    measure_offset_error,
    project_points,
    read_metres,
    sample_positions,
    take_offset,
)
from rtsr_cli.core.frames.camera import (
    CameraMetadata,
    is_orthographic,
    list_near_planes,
    place_in_camera_space,
)
from rtsr_cli.core.frames.camera_convention import AXES
from rtsr_cli.core.frames.conventions import DepthConvention, DepthKind
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.vector_length import normalize_vectors, vector_length
from rtsr_cli.core.shapes import MotionPx, Vector3

MOST_PIXELS = 1 << 12
"""Pixels of a frame that positions and motion are compared at."""

MOST_SURFACE_PIXELS = 1 << 14
"""Pixels of a frame whose depths are compared with those beside them."""

LEAST_TOLD = 1e-3
"""Share of what the best told axis of a rotation is told by, up to which another is not told."""

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


@dataclass(frozen=True, eq=False)
class PositionEvidence:
    """World positions lie on the pixels that show them.

    Attributes:
        frames: thinned, with `position` as stored.
        units: metres in a unit, to try; the first are the likely ones.
        thinning: how much the frames are thinned.
        least: error of the frame that the matrices as given fit best.
        rounding_px: how far the digits of the positions move them.
    """

    frames: Mapping[int, StoredGeometry]
    units: tuple[float, ...]
    thinning: int
    least: float = math.inf
    rounding_px: float = 0.0

    name = "world positions"
    unit = "px from their pixels"
    tells_world = True
    tells_step = True
    tells_lens = True
    slack = 0.02
    factor = 4.0

    sure = 0.75

    @property
    def limit(self) -> float:
        """Rounding, and where in its pixel a sample lies, which is alike in all frames."""
        return self.rounding_px + min(MOST_OFF_PX, max(LEAST_OFF_PX, self.factor * self.least))

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

    def view_nearby(self, given: Cameras) -> NearbyView:
        """Where positions land beside their pixels."""
        frame = next(iter(self.frames.values()))
        return NearbyView(
            measure=self._list_residuals,
            given=given,
            unit=self.unit,
            distance=self._measure_distance(given),
            width=round(frame.view.display[1] * self.thinning),
            floor=self.rounding_px + LAST_DIGITS_PX,
        )

    def _list_residuals(self, cameras: Cameras) -> Residuals:
        found = {}
        for number, frame in self.frames.items():
            if number not in cameras or frame.position is None:
                continue
            camera = bind_camera(frame.camera, cameras[number])
            position = frame.position.double() * self.units[0]
            compared = compare_landing(position, replace(frame, camera=camera))
            if compared is not None:
                found[number] = _list_rows(*compared, self.thinning)
        return found

    def _measure_distance(self, cameras: Cameras) -> float:
        """Median depth of the positions, in units of the camera."""
        depths = [
            -(frame.position[0].double().flatten(1).T * self.units[0])
            @ torch.from_numpy(cameras[n].view[:3, 2].copy())
            - cameras[n].view[3, 2]
            for n, frame in self.frames.items()
            if n in cameras and frame.position is not None
        ]
        known = torch.cat(depths)
        known = known[torch.isfinite(known) & (known > 0.0)]
        return float(known.median()) if known.numel() else 1.0

    def choose_unit(self, cameras: Cameras) -> float:
        """The unit under which matrices fit best."""
        return self.units[pick_best([self._measure(cameras, u) for u in self.units], most=FAR_PX)]

    def hold(self, cameras: Cameras) -> PositionEvidence:
        """Put the unit first under which matrices fit best, and note how well they may fit."""
        unit = self.choose_unit(cameras)
        errors = self._measure(cameras, unit)
        moved = [
            self.thinning * far
            for n, frame in self.frames.items()
            if n in cameras and (far := _measure_rounding_px(frame, cameras[n], unit)) is not None
        ]
        return replace(
            self,
            units=list_units(unit),
            least=min(errors.values(), default=math.inf),
            rounding_px=min(min(moved, default=0.0), MOST_ROUNDING_PX),
        )


LEAST_OFF_PX, MOST_OFF_PX = 0.1, 0.75
"""Positions of samples anywhere in their pixels are this far from the middles at most. Where those
of one frame are closer, so are those of the others."""

MOST_ROUNDING_PX = 2.0
"""Positions that are rounded more coarsely tell nothing."""


def _measure_rounding_px(
    frame: StoredGeometry, matrices: CameraMatrices, unit: float
) -> float | None:
    """Median pixels of a thinned frame that the rounding of its positions moves them by."""
    if frame.position is None:
        return None
    camera = bind_camera(frame.camera, matrices)
    off = measure_rounding(frame.position)
    there = project_points(frame.position * unit, camera, frame.view)
    moved = project_points((frame.position + off) * unit, camera, frame.view)
    if there is None or moved is None:
        return None
    lengths = vector_length(moved - there)
    known = lengths[torch.isfinite(lengths)]
    return float(known.median()) if known.numel() >= LEAST_POINTS else None


def measure_landing_error(position: Vector3, frame: StoredGeometry) -> float | None:
    """Median pixels between where positions are projected to and where they were seen.

    A constant difference of less than a pixel is taken out: jitter that is in the matrices.
    """
    found = compare_landing(position, frame)
    return None if found is None else measure_offset_error(*found, frame.thinned)


def compare_landing(position: Vector3, frame: StoredGeometry) -> tuple[MotionPx, Tensor] | None:
    """Pixels from where positions were seen to where they land; and where there are any."""
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
    return apart, there


def _list_rows(difference: MotionPx, valid: Tensor, thinning: int) -> Tensor:
    """Differences less a constant one, n x 2, pixels of the frame; NaN where they are not known."""
    known = valid & torch.isfinite(difference).all(1, keepdim=True)
    if int(known.sum()) >= LEAST_POINTS:
        difference = take_offset(difference, known, thinning)
    return difference[valid.expand_as(difference)].view(2, -1).T * thinning


LAST_DIGITS_PX = 1e-3
"""What the digits of single matrices move pixels by."""


MotionSource = tuple[MotionConvention, DepthConvention]

LEAST_MOVED_PX = 0.02
"""Vectors up to this rest: the last digits of matrices and depths."""

MOST_SHARE = 0.25
"""Of what moves; where more is unexplained, matrices say no more of it than none do."""

RESTING_SHARE = 0.2
"""Share of the surfaces that rest at least where a camera does, however large what moves is."""

ABOUT = 1.25
"""Of readings that do not fit, none is better by a smaller factor."""

PAN_ALIKE = 0.25
"""Shifts of a picture are one pan where they differ by less than this share; jitter's do not."""


@dataclass(frozen=True, eq=False)
class VectorEvidence:
    """Depth, carried along the camera, moves as the vectors say.

        limit = max(min(0.1 + 0.02 m, 0.25 m), 0.02) + r + d,   px

    with m what moves, r the rounding of the vectors, of each reading of them, and d what rounding
    of depth does to motion along it. Errors are scaled to the limit of the first reading: by one
    under which all vectors are short, cameras that hardly move would agree.

    Attributes:
        frames: thinned; by reading of the vectors and frame number.
        step: numbers from a frame to the next.
        depths: readings of depth, to try.
        thinning: how much the frames are thinned.
        roundings_px: how far digits are from what was meant, by reading of the vectors.
        best: the readings under which the matrices as given fit best.
        depth_px: what rounding of depth does by these.
    """

    frames: Mapping[MotionConvention, Mapping[int, StoredGeometry]]
    step: int
    depths: tuple[DepthConvention, ...]
    thinning: int
    roundings_px: Mapping[MotionConvention, float] = field(default_factory=dict)
    best: MotionSource | None = None
    depth_px: float = 0.0

    name = "motion with depth"
    unit = "px of motion"
    tells_world = False
    tells_step = True
    tells_lens = False
    slack = 0.02
    factor = 4.0

    @property
    def limit(self) -> float:
        """That of the first reading."""
        return next(iter(self._limits.values()), LEAST_MOVED_PX)

    @cached_property
    def _moved(self) -> Mapping[MotionConvention, float]:
        """Pixels of the frame that surfaces move by, the fastest of the frames."""
        return {
            motion: self.thinning * max((_measure_length(f) for f in frames.values()), default=0.0)
            for motion, frames in self.frames.items()
        }

    @cached_property
    def _limits(self) -> Mapping[MotionConvention, float]:
        """A share of what moves, and rounding."""
        return {
            motion: max(min(0.1 + 0.02 * moved, MOST_SHARE * moved), LEAST_MOVED_PX)
            + self.roundings_px.get(motion, 0.0)
            + self.depth_px
            for motion, moved in self._moved.items()
        }

    @property
    def sure(self) -> float:
        """Right readings differ by the rounding of the vectors alone."""
        return 0.25 * self.limit

    def measure(self, cameras: Cameras, *, closely: bool) -> Errors:
        """Median difference of the vectors, pixels of the frame."""
        trials = [self._measure(cameras, source) for source in self._list_sources(closely=closely)]
        return trials[self._choose(trials)] if trials else {}

    def _choose(self, trials: Sequence[Errors]) -> int:
        """Index of the reading that fits best; where none does, of the first about as good."""
        best = pick_best(trials, most=FAR_PX)
        least = mean_error(trials[best].values())
        if least <= self.limit:
            return best
        return next(i for i, t in enumerate(trials) if mean_error(t.values()) <= ABOUT * least)

    def _list_sources(self, *, closely: bool) -> list[MotionSource]:
        telling = [motion for motion in self.frames if not self._is_coarse(motion)]
        if closely and self.best is not None:
            return [self.best]
        if self.best is not None:
            # other matrices are tried under the depth that is presumed, and the likeliest one
            depths = dict.fromkeys((self.depths[0], self.best[1]))
            return [(motion, depth) for motion in telling for depth in depths]
        return [(motion, depth) for motion in telling for depth in self.depths]

    def _is_coarse(self, motion: MotionConvention) -> bool:
        """Tell whether rounding leaves little of what moves."""
        moved = self._moved[motion]
        return LEAST_MOVED_PX < moved < self.roundings_px.get(motion, 0.0) / MOST_SHARE

    def hold(self, cameras: Cameras) -> VectorEvidence:
        """Note the readings under which matrices fit best."""
        sources = self._list_sources(closely=False)
        if not sources:
            return self
        trials = [self._measure(cameras, source) for source in sources]
        best = sources[self._choose(trials)]
        return replace(self, best=best, depth_px=self._measure_depth_px(cameras, best))

    def view_nearby(self, given: Cameras) -> NearbyView:
        """What of the vectors depth and cameras do not explain."""
        motion, depth = self.best or (next(iter(self.frames)), self.depths[0])
        frame = next(iter(self.frames[motion].values()))
        metres = read_metres(frame, depth)
        known = None if metres is None else metres[find_surface(frame, metres)]
        return NearbyView(
            measure=partial(self._list_residuals, source=(motion, depth)),
            others=[
                partial(self._list_residuals, source=(motion, other))
                for other in list_near_depths(given)
            ],
            given=given,
            unit=self.unit,
            distance=1.0 if known is None or not known.numel() else float(known.median()),
            width=round(frame.view.display[1] * self.thinning),
            floor=self.roundings_px.get(motion, 0.0) + self.depth_px + LAST_DIGITS_PX,
        )

    def _list_residuals(self, cameras: Cameras, source: MotionSource) -> Residuals:
        motion, depth = source
        found = {}
        for number, _, frame in self._bind(cameras, motion):
            exact = replace(frame, depth=frame.depth.double())
            compared = compare_motion(exact, depth)
            if compared is not None:
                found[number] = _list_rows(*compared, self.thinning)
        return found

    def _measure_depth_px(self, cameras: Cameras, source: MotionSource) -> float:
        """How far rounding of depth moves what is carried along it; a share of what moves, at most.

        Wrong matrices would carry it far.
        """
        motion, depth = source
        found = (
            measure_depth_effect(frame, depth, measure_rounding(frame.depth))
            for _, _, frame in self._bind(cameras, motion)
        )
        far = max((off for off in found if off is not None), default=0.0)
        return min(far * self.thinning, MOST_SHARE * self._moved[motion])

    def _bind(
        self, cameras: Cameras, motion: MotionConvention
    ) -> Iterator[tuple[int, int, StoredGeometry]]:
        """Frames, and those that their vectors are about, with a reading of the matrices."""
        for number, frame in self.frames[motion].items():
            other = number + (self.step if motion.direction.to_next else -self.step)
            if {number, other} <= cameras.keys():
                camera = bind_camera(frame.camera, cameras[number])
                previous = bind_camera(frame.previous, cameras[other])
                yield number, other, replace(frame, camera=camera, previous=previous)

    def _measure(self, cameras: Cameras, source: MotionSource) -> Errors:
        motion, depth = source
        found: dict[int, float] = {}
        shifts: dict[int, tuple[float, Tensor]] = {}
        for number, other, frame in self._bind(cameras, motion):
            error = measure_motion_error(frame, depth)
            if error is not None:
                found[number] = error * self.thinning
                if cameras[number].equals(cameras[other]):
                    shifts[number] = _measure_shift(frame)
        found = self._hold_resting(found, shifts, motion)
        scale = self.limit / self._limits[motion]
        return {number: error * scale for number, error in found.items()}

    def _hold_resting(
        self,
        found: Mapping[int, float],
        shifts: Mapping[int, tuple[float, Tensor]],
        motion: MotionConvention,
    ) -> dict[int, float]:
        """Errors of frames by the same matrices as the next ones': there surfaces have to rest.

        What is large may move. Where all moves alike, and not by declared jitter, the camera pans;
        or, where it moves otherwise in each frame, jitter is in the vectors, and nothing is told.
        """
        rested = LEAST_MOVED_PX + self.roundings_px.get(motion, 0.0)
        errors = dict(found)
        moving = {n: s for n, s in shifts.items() if s[0] * self.thinning > rested}
        for number in shifts.keys() - moving.keys():
            errors[number] = min(found[number], shifts[number][0] * self.thinning)
        mean = torch.stack([s for _, s in moving.values()]).mean(0) if moving else torch.zeros(2)
        apart = [float((s - mean).norm()) for _, s in moving.values()]
        pans = len(moving) > 1 and max(apart) < PAN_ALIKE * float(mean.norm())
        for number, (_, shift) in moving.items():
            if found[number] > rested or pans:
                errors[number] = max(found[number], float(shift.norm()) * self.thinning)
            else:
                del errors[number]
        return errors


def _measure_length(frame: StoredGeometry) -> float:
    """Median length of a thinned frame's vectors on surfaces."""
    if frame.motion_px is None:
        return 0.0
    lengths = vector_length(frame.motion_px)[find_surface(frame, frame.depth.abs() + 1.0)]
    known = lengths[torch.isfinite(lengths)]
    return float(known.median()) if known.numel() else 0.0


def _measure_shift(frame: StoredGeometry) -> tuple[float, Tensor]:
    """How far the slowest surfaces of a thinned frame move, and the median vector (x, y).

    Vectors may contain the difference of declared jitter, either way.
    """
    if frame.motion_px is None:
        return 0.0, torch.zeros(2)
    known = find_surface(frame, frame.depth.abs() + 1.0)
    known &= torch.isfinite(frame.motion_px).all(1, keepdim=True)
    vectors = frame.motion_px[known.expand_as(frame.motion_px)].view(2, -1).T
    if not len(vectors):
        return 0.0, torch.zeros(2)
    jitter = torch.tensor(frame.camera.jitter_px) - torch.tensor(frame.previous.jitter_px)
    left = [vectors - sign * jitter.to(vectors) for sign in (0.0, 1.0, -1.0)]
    slow = [float(part.norm(dim=1).quantile(RESTING_SHARE)) for part in left]
    least = slow.index(min(slow))
    return slow[least], left[least].median(0).values


LEAST_LEAN = 0.5
"""Degrees by which normals of 8 bits, and those of surfaces, may lean."""

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

    def view_nearby(self, given: Cameras) -> NearbyView:
        """How far normals lean from their surfaces, degrees."""
        frame = next(iter(self.frames.values()))
        width = round(frame.view.display[1] * frame.thinned)
        return NearbyView(
            measure=partial(self._list_residuals, given=given, depth=self.depths[0]),
            others=[
                partial(self._list_residuals, given=given, depth=other)
                for other in list_near_depths(given)
            ],
            given=given,
            unit="degrees from their surfaces",
            width=width,
            floor=LEAST_LEAN,
        )

    def _list_residuals(
        self, cameras: Cameras, given: Cameras, depth: DepthConvention
    ) -> Residuals:
        """Normals less those of surfaces, degrees; of other lenses these are scaled, not found."""
        found = {}
        for number in self.frames.keys() & cameras.keys():
            surfaces = self._find_surfaces(number, given[number], depth)
            if surfaces is None:
                continue
            normal, own = (keep_rows(part).double() for part in surfaces)
            scale = np.diag(cameras[number].projection)[:2] / np.diag(given[number].projection)[:2]
            # points are x / P00, so that what stands on them is n P00
            own = normalize_vectors(own * torch.tensor([*scale, 1.0], dtype=own.dtype))
            turn = torch.tensor(cameras[number].view[:3, :3])
            found[number] = (normalize_vectors(normal @ turn) - own) * (180.0 / math.pi)
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

    def measure_axes(self, cameras: Cameras, axes: Tensor) -> Tensor | None:
        """The same for normals whose axes are named otherwise, w of them, by the best depth each.

        Args:
            cameras: the matrices.
            axes: A, w x 3 x 3: n_world = n . A; the last leads to the camera's own.
        """
        trials = []
        for depth in self.depths:
            found = []
            for number in self.frames.keys() & cameras.keys():
                surfaces = self._find_surfaces(number, cameras[number], depth)
                if surfaces is not None:
                    normal, own = (keep_rows(part).double() for part in surfaces)
                    turn = normalize_vectors(torch.tensor(cameras[number].view[:3, :3]))
                    turns = torch.cat([axes[:-1] @ turn, axes[-1:]])
                    cosines = torch.einsum("ni,wij,nj->nw", normalize_vectors(normal), turns, own)
                    found.append(100.0 * (cosines < ALIKE).double().mean(0))
            trials += [torch.stack(found).mean(0)] if found else []
        return torch.stack(trials).min(0).values if trials else None

    def measure_lean(self, cameras: Cameras, axes: Tensor) -> Tensor | None:
        """How far normals lean from their surfaces as a whole, degrees, w of them.

        The rotation w that is left between normals n and those of surfaces g, by least squares:
        w x n = g - n, so sum(1 - n n') w = sum(n x g). Bumps and noise lean to all sides, so that
        readings a few degrees apart are told from each other, as shares of pixels do not.

        Args:
            cameras, axes: as for `measure_axes`.
        """
        found: dict[float, Tensor] = {}
        for depth in self.depths:
            leans, apart = [], []
            for number in self.frames.keys() & cameras.keys():
                surfaces = self._find_surfaces(number, cameras[number], depth)
                if surfaces is None:
                    continue
                normal, own = (keep_rows(part).double() for part in surfaces)
                turn = normalize_vectors(torch.tensor(cameras[number].view[:3, :3]))
                turns = torch.cat([axes[:-1] @ turn, axes[-1:]])
                turned = torch.einsum("ni,wij->wnj", normalize_vectors(normal), turns)
                # of any reading: none chooses the pixels that it is judged by
                alike = ((turned * own).sum(-1) >= ALIKE).any(0)
                apart.append(1.0 - float(alike.double().mean()))
                leans.append(_find_rotation(turned[:, alike], own[alike]))
            if leans:
                found.setdefault(mean_error(apart), torch.stack(leans).mean(0))
        return found[min(found)] if found else None

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


def _find_rotation(normals: Tensor, surfaces: Tensor) -> Tensor:
    """The angle of the rotation from normals, w x n x 3, to those of surfaces, n x 3, degrees."""
    square = torch.einsum("wni,wnj->wij", normals, normals)
    count = torch.eye(3, dtype=normals.dtype) * normals.shape[1]
    moment = torch.linalg.cross(normals, surfaces.expand_as(normals)).sum(1)
    # what turns about all normals at once no normal tells: the shortest rotation
    inverse = torch.linalg.pinv(count - square, rtol=LEAST_TOLD, hermitian=True)
    rotation = torch.einsum("wij,wj->wi", inverse, moment)
    return vector_length(rotation)[:, 0] * (180.0 / math.pi)


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


def list_near_depths(given: Cameras) -> list[DepthConvention]:
    """Ray distances from the near plane: a camera beside would explain them nearly."""
    projection = torch.from_numpy(next(iter(given.values())).projection)
    return [d for d in list_depth_hypotheses((), list_near_planes(projection)) if d.from_near]


def thin(geometry: StoredGeometry, most: int = MOST_PIXELS) -> tuple[StoredGeometry, int]:
    """Thin a frame, and say by how much."""
    thinning = ThinnedFrame.of(geometry.depth, most)
    return thinning.geometry(geometry), thinning.k
