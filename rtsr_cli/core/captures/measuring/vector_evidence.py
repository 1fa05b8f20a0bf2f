"""Motion vectors against camera matrices: depth, carried from a frame to the next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_evidence import (
    FAR_PX,
    LAST_DIGITS_PX,
    Errors,
    bind_camera,
    list_near_depths,
    list_rows,
    mean_error,
    pick_best,
)
from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_refinement import NearbyView, Residuals
from rtsr_cli.core.captures.measuring.camera_rounding import measure_rounding
from rtsr_cli.core.captures.measuring.geometry_finder import (
    StoredGeometry,
    compare_motion,
    find_surface,
    measure_depth_effect,
    measure_motion_error,
    read_metres,
)
from rtsr_cli.core.frames.conventions import DepthConvention
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.vector_length import vector_length

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
                found[number] = list_rows(*compared, self.thinning)
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
