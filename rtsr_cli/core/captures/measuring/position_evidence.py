"""World positions against camera matrices: where they land beside the pixels that show them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_evidence import (
    FAR_PX,
    LAST_DIGITS_PX,
    Errors,
    bind_camera,
    list_rows,
    list_units,
    pick_best,
)
from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_refinement import NearbyView, Residuals
from rtsr_cli.core.captures.measuring.camera_rounding import measure_rounding
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import (
    LEAST_POINTS,
    StoredGeometry,
    measure_offset_error,
    project_points,
    sample_positions,
)
from rtsr_cli.core.frames.vector_length import vector_length
from rtsr_cli.core.shapes import MotionPx, Vector3

LEAST_OFF_PX, MOST_OFF_PX = 0.1, 0.75
"""Positions of samples anywhere in their pixels are this far from the middles at most. Where those
of one frame are closer, so are those of the others."""

MOST_ROUNDING_PX = 2.0
"""Positions that are rounded more coarsely tell nothing."""


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
                found[number] = list_rows(*compared, self.thinning)
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

    def without(self, numbers: Collection[int]) -> PositionEvidence:
        """Leave frames out."""
        kept = {n: frame for n, frame in self.frames.items() if n not in numbers}
        return replace(self, frames=kept)

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
