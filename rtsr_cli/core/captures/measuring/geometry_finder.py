"""Finding how a dump stores depth, by geometry that only the right reading satisfies.

Surface points of the right depth, carried into the previous camera, move as the motion vectors
say, or lie where the position buffer says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.frames.camera import (
    CameraMetadata,
    View,
    list_near_planes,
    place_in_camera_space,
)
from rtsr_cli.core.frames.conventions import (
    DepthConvention,
    DepthKind,
    depth_to_metres,
)
from rtsr_cli.core.frames.vector_length import vector_length
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.shapes import MotionPx, Plane, Size, Vector3

DEPTH_UNITS_M = (1.0, 0.01, 0.001, 100.0, 1000.0, 0.3048, 0.0254)
"""Metres, centimetres, millimetres, 100 m (centimetres times 1e-4), kilometres, feet, inches."""

NEAR_UNITS_M = (1.0, 0.01)
"""Units of distances that begin on the near plane."""

MOST_PIXELS = 1 << 14
"""Larger frames are looked at in every k-th pixel."""

LEAST_POINTS = 64

MOTION, POSITION = "px of motion", "of the distance"
"""What errors are measured in."""

TRUSTED = {MOTION: 0.5, POSITION: 0.05}
"""Where the best reading is worse than this, the cameras do not belong to the frames."""

LEAST_PARALLAX_PX = 0.05
"""Depth is not measured where all readings move points alike, to this many pixels."""

FAR_OFF_PX = 1e9
"""Error of a camera that sees hardly any point at all."""

LARGEST_OFFSET_PX = 1.25
"""Jitter differs by less than a pixel between frames."""


@dataclass(frozen=True, kw_only=True)
class StoredGeometry:
    """Stored geometry of one frame, and the camera of this frame and the previous one.

    Attributes:
        depth: as stored, 1 x 1 x h x w.
        motion_px: in memory's convention, or None.
        position: world positions in metres, or None.
        camera, previous: of both frames.
        view: where the frame lies in the image plane.
        thinned: of how many pixels across one is kept.
    """

    depth: Plane
    motion_px: MotionPx | None
    position: Vector3 | None
    camera: CameraMetadata
    previous: CameraMetadata
    view: View
    thinned: int = 1


@dataclass(frozen=True, kw_only=True)
class DepthCandidate:
    """A reading of depth and its error: pixels of motion, or share of the distance."""

    convention: DepthConvention
    error: float


@dataclass(frozen=True, kw_only=True)
class DepthFinding:
    """Ranked readings of depth; none where the files do not tell.

    Attributes:
        candidates: best first.
        measure: what the errors are ("px of motion", "of the distance").
    """

    candidates: tuple[DepthCandidate, ...] = ()
    measure: str = ""

    @property
    def best(self) -> DepthCandidate | None:
        """The winner."""
        return self.candidates[0] if self.candidates else None

    @property
    def margin(self) -> float:
        """1 - error of the winner / error of the runner-up."""
        if len(self.candidates) < 2 or self.candidates[1].error == 0.0:
            return 0.0
        return 1.0 - self.candidates[0].error / self.candidates[1].error

    def of(self, convention: DepthConvention) -> DepthCandidate | None:
        """Return what was measured about a reading; where sky begins is not part of it."""
        plain = replace(convention, sky=None)
        return next((c for c in self.candidates if c.convention == plain), None)


def list_depth_hypotheses(
    declared: Sequence[DepthConvention] = (), near_m: Sequence[float] = ()
) -> list[DepthConvention]:
    """Every reading of depth, and the declared ones; distances may begin on a near plane."""
    readings = [
        DepthConvention(kind=kind, unit_m=unit)
        for kind in (DepthKind.PLANAR, DepthKind.RAY)
        for unit in DEPTH_UNITS_M
    ]
    readings += [
        DepthConvention(kind=DepthKind.RAY, unit_m=unit, from_near=True, near_m=near)
        for near in near_m
        for unit in NEAR_UNITS_M
    ]
    readings += [DepthConvention(kind=DepthKind.DEVICE, reversed=r) for r in (False, True)]
    return list(dict.fromkeys([*(replace(c, sky=None) for c in declared), *readings]))


def unproject_depth(depth_m: Plane, camera: CameraMetadata, view: View) -> Tensor | None:
    """World positions (1 x 3 x h x w) of planar depths; None without matrices."""
    points = place_in_camera_space(depth_m, camera, view)
    if points is None or camera.world_to_camera is None:
        return None
    inverse = torch.linalg.inv(camera.world_to_camera).to(depth_m)
    parts = [points[:, j : j + 1] for j in range(3)]
    rows = [
        sum((p * inverse[j, i] for j, p in enumerate(parts)), start=inverse[3, i] + 0 * depth_m)
        for i in range(3)
    ]
    return torch.cat(rows, dim=1)


def project_points(world: Vector3, camera: CameraMetadata, view: View) -> Tensor | None:
    """Pixel positions (1 x 2 x h x w) of world points in the image that `view` describes.

    q = [x y z 1] . world_to_ndc;  x = (q.x/q.w / 2 + 1/2) W,  y = (1/2 - q.y/q.w / 2) H
    """
    if camera.world_to_ndc is None:
        return None
    m = camera.world_to_ndc.to(world)
    columns = [
        sum((world[:, j : j + 1] * m[j, i] for j in range(3)), start=m[3, i]) for i in (0, 1, 3)
    ]
    height, width = view.display
    w = torch.where(columns[2] > 1e-6, columns[2], torch.nan)
    x = (columns[0] / w * 0.5 + 0.5) * width - view.left
    y = (0.5 - columns[1] / w * 0.5) * height - view.top
    return torch.cat([x, y], dim=1)


@dataclass(frozen=True)
class ThinnedFrame:
    """Every k-th pixel of a large frame, as a frame of that size whose samples are shifted."""

    k: int

    @classmethod
    def of(cls, image: Tensor, most: int = MOST_PIXELS) -> ThinnedFrame:
        """Keep so few pixels of an image of this size."""
        height, width = image.shape[-2:]
        return cls(math.ceil(math.sqrt(max(1.0, height * width / most))))

    def image(self, image: Tensor) -> Tensor:
        """Thin an image."""
        rows, columns = (side // self.k * self.k for side in image.shape[-2:])
        return decimate(image[..., :rows, :columns], self.k, (self.k // 2, self.k // 2))

    def camera(self, camera: CameraMetadata) -> CameraMetadata:
        """Move the jitter to where the kept pixels are."""
        x, y = ((j + self.k // 2 + 0.5) / self.k - 0.5 for j in camera.jitter_px)
        return replace(camera, jitter_px=(x, y))

    def view(self, view: View) -> View:
        """Return where the kept pixels lie."""
        # a display of a whole number of thinned pixels would move the rays
        height, width = view.display
        display = (height / self.k, width / self.k)
        return View(display=display, top=view.top / self.k, left=view.left / self.k)  # type: ignore[arg-type]

    def geometry(self, geometry: StoredGeometry) -> StoredGeometry:
        """Thin the geometry of a frame."""
        motion, position = geometry.motion_px, geometry.position
        return StoredGeometry(
            depth=self.image(geometry.depth),
            motion_px=None if motion is None else self.image(motion) / self.k,
            position=None if position is None else self.image(position),
            camera=self.camera(geometry.camera),
            previous=self.camera(geometry.previous),
            view=self.view(geometry.view),
            thinned=self.k,
        )


def sample_positions(size: Size, jitter_px: tuple[float, float] = (0.0, 0.0)) -> Tensor:
    """Positions (x, y) of every pixel's sample, 1 x 2 x h x w; centres at 0.5."""
    rows = torch.arange(size[0], dtype=torch.float32) + 0.5 + jitter_px[1]
    columns = torch.arange(size[1], dtype=torch.float32) + 0.5 + jitter_px[0]
    y, x = torch.meshgrid(rows, columns, indexing="ij")
    return torch.stack([x, y])[None]


def find_depth(
    frames: Sequence[StoredGeometry], declared: Sequence[DepthConvention] = ()
) -> DepthFinding:
    """Rank every reading of depth.

    Args:
        frames: with camera matrices; several, as one may stand still.
        declared: readings that take part beside the usual ones.
    """
    thinned = [ThinnedFrame.of(f.depth).geometry(f) for f in frames]
    by_position = [f for f in thinned if f.position is not None]
    by_motion = [f for f in thinned if f.motion_px is not None]
    projection = frames[0].camera.projection if frames else None
    hypotheses = list_depth_hypotheses(
        declared, () if projection is None else list_near_planes(projection)
    )
    for measure, error, usable in (
        (POSITION, measure_position_error, by_position),
        (MOTION, measure_motion_error, by_motion),
    ):
        ranked = []
        for reading in hypotheses:
            errors = [e for f in usable if (e := error(f, reading)) is not None]
            if errors:
                ranked.append(DepthCandidate(convention=reading, error=sum(errors) / len(errors)))
        ranked.sort(key=lambda candidate: candidate.error)
        if ranked and ranked[0].error < TRUSTED[measure] and not _are_alike(ranked, measure):
            return DepthFinding(candidates=tuple(ranked), measure=measure)
    return DepthFinding()


def _are_alike(ranked: Sequence[DepthCandidate], measure: str) -> bool:
    """Tell whether a camera that does not travel leaves every reading equally good."""
    spread = ranked[len(ranked) // 2].error - ranked[0].error
    return measure == MOTION and spread < LEAST_PARALLAX_PX


def read_metres(frame: StoredGeometry, reading: DepthConvention) -> Tensor | None:
    """Planar depths under a reading; None where it needs a camera that is not there."""
    try:
        return depth_to_metres(frame.depth, reading, frame.camera, frame.view, where="")
    except MissingBufferError:
        return None


def measure_motion_error(frame: StoredGeometry, reading: DepthConvention) -> float | None:
    """Median distance between the motion that a reading predicts and the vectors, pixels.

    A constant difference of at most `LARGEST_OFFSET_PX` is taken out: vectors may contain jitter.
    """
    found = compare_motion(frame, reading)
    return None if found is None else measure_offset_error(*found, frame.thinned)


def compare_motion(
    frame: StoredGeometry, reading: DepthConvention
) -> tuple[MotionPx, Tensor] | None:
    """The motion that a reading predicts less the vectors, pixels; and where surfaces are."""
    metres = read_metres(frame, reading)
    then = None if metres is None else _carry(metres, frame)
    if metres is None or then is None or frame.motion_px is None:
        return None
    size = (metres.shape[-2], metres.shape[-1])
    predicted = then - sample_positions(size, frame.camera.jitter_px)
    return predicted - frame.motion_px, find_surface(frame, metres)


def _carry(metres: Plane, frame: StoredGeometry) -> Tensor | None:
    """Where what a frame shows lies in the previous one, pixels."""
    world = unproject_depth(metres, frame.camera, frame.view)
    return None if world is None else project_points(world, frame.previous, frame.view)


def measure_depth_effect(
    frame: StoredGeometry, reading: DepthConvention, off: Plane
) -> float | None:
    """Median pixels by which other depths change where points lie in the previous frame.

    Args:
        frame: with depth.
        reading: of the depth.
        off: added to depth as stored.
    """
    metres = read_metres(frame, reading)
    changed = read_metres(replace(frame, depth=frame.depth + off), reading)
    if metres is None or changed is None:
        return None
    then, there = _carry(metres, frame), _carry(changed, frame)
    if then is None or there is None:
        return None
    lengths = vector_length(there - then)[find_surface(frame, metres)]
    known = lengths[torch.isfinite(lengths)]
    return float(known.median()) if known.numel() >= LEAST_POINTS else None


def measure_offset_error(difference: MotionPx, valid: Tensor, thinned: int = 1) -> float | None:
    """Median length of differences less a constant one of at most `LARGEST_OFFSET_PX`.

    Args:
        difference: pixels of an image of which every `thinned`-th pixel was kept.
        valid: where there is something to compare.
        thinned: as said.
    """
    known = valid & torch.isfinite(difference).all(1, keepdim=True)
    if int(known.sum()) < LEAST_POINTS:
        return None if int(valid.sum()) < LEAST_POINTS else FAR_OFF_PX
    return _median(vector_length(take_offset(difference, known, thinned)), valid)


def take_offset(difference: MotionPx, known: Tensor, thinned: int = 1) -> MotionPx:
    """Differences less the constant one, as `measure_offset_error` says.

    Args:
        difference: as there.
        known: where they are known, which is somewhere.
        thinned: as there.
    """
    offset = difference[known.expand_as(difference)].view(2, -1).median(1).values
    largest = LARGEST_OFFSET_PX / thinned
    return difference - offset.clamp(-largest, largest).view(1, 2, 1, 1)


def measure_position_error(frame: StoredGeometry, reading: DepthConvention) -> float | None:
    """Median distance between a reading's points and the position buffer, per distance."""
    metres = read_metres(frame, reading)
    world = None if metres is None else unproject_depth(metres, frame.camera, frame.view)
    if metres is None or world is None or frame.position is None:
        return None
    where = frame.camera.position
    if where is None:
        return None
    distance = vector_length(frame.position - where.to(world).view(1, 3, 1, 1)).clamp(min=1e-6)
    return _median(vector_length(world - frame.position) / distance, find_surface(frame, metres))


def find_surface(frame: StoredGeometry, metres: Tensor) -> Tensor:
    """Pixels that some reading may take for surfaces: finite, and not the largest value stored."""
    stored = frame.depth
    # where NaN is there it is the sky's, as infinity is: what is largest else is a surface's
    farthest = stored.nan_to_num(nan=torch.inf, posinf=torch.inf).amax()
    return torch.isfinite(stored) & (stored < farthest.clamp(max=SKY_DEPTH_M)) & (metres > 0)


def _median(error: Tensor, valid: Tensor) -> float | None:
    values = error[valid]
    values = torch.where(torch.isfinite(values), values, torch.full_like(values, FAR_OFF_PX))
    return float(values.median()) if values.numel() >= LEAST_POINTS else None
