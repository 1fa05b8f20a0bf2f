"""What camera and depth may decide of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring import geometry_measurement
from rtsr_cli.core.captures.measuring.camera_check import OF_NEIGHBOUR, CameraFinding
from rtsr_cli.core.captures.measuring.camera_measurement import check_reader_cameras
from rtsr_cli.core.captures.measuring.geometry_finder import DepthCandidate, DepthFinding
from rtsr_cli.core.captures.measuring.geometry_measurement import add_geometry
from rtsr_cli.core.captures.measuring.jitter_finder import JitterVerdict
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection

Array = NDArray[np.float64]
OWN, LATE = MotionConvention(), MotionConvention(file_offset=1)


@pytest.mark.parametrize(
    ("undecided", "favoured", "settled"),
    [
        ((OF_NEIGHBOUR,), LATE, None),
        ((OF_NEIGHBOUR,), OWN, OWN),
        ((), LATE, LATE),
    ],
)
def test_matrices_that_may_be_a_neighbours_settle_no_vectors_of_another_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    undecided: tuple[str, ...],
    favoured: MotionConvention,
    settled: MotionConvention | None,
) -> None:
    for number in (1, 2, 3):
        planes = {n: np.ones((4, 6), np.float32) for n in ("R", "G", "B", "depth.Z")}
        write_exr(tmp_path / f"f.{number:04d}.exr", planes)
    frames = collect_frame_set(tmp_path)
    assert frames is not None
    reader = open_frames(frames, layout=None, capture=CaptureDeclaration(), side_car={})

    def find_depth(*_: Any, motion: MotionConvention | None = None, **__: Any) -> DepthFinding:
        error = 0.001 if motion == favoured else 2.0
        return DepthFinding(
            candidates=(DepthCandidate(convention=DepthConvention(), error=error),),
            measure="px of motion",
        )

    monkeypatch.setattr(geometry_measurement, "_find_depth", find_depth)
    ranked = tuple(
        MotionCandidate(
            convention=c, error=0.1, margin=0.0, significance=0.0, offsets_px=((0.0, 0.0),)
        )
        for c in (OWN, LATE)
    )
    motion = MotionFinding(candidates=ranked, unmoved_error=0.4, moving=1.0, triples=(1,))
    camera = CameraFinding(proofs=("motion with depth",), undecided=undecided)
    measured = StorageMeasurement(motion=motion, camera=camera, frames=(1, 2, 3))
    found = add_geometry(reader, {1: {}, 2: {}, 3: {}}, Conventions(), measured)
    assert (None if found.by_geometry is None else found.by_geometry.convention) == settled
    assert found.camera is not None
    assert found.camera.fits == (settled is not None)
    assert ("file_offset" in found.camera.doubt) == (settled is None)


SIZE = (40, 64)
BACK, FORTH = MotionConvention(), MotionConvention(direction=MotionDirection.CURRENT_MINUS_NEXT)


def make_view(number: int) -> Array:
    """A camera that turns to a wall and goes along it, faster and faster."""
    t = 0.05 * number + 0.02 * number * number
    yaw = 0.3 + 0.2 * t
    view = np.eye(4)
    view[:3, 0], view[:3, 2] = (math.cos(yaw), 0.0, -math.sin(yaw)), (math.sin(yaw), 0.0, 0.0)
    view[2, 2] = math.cos(yaw)
    view[3, :3] = -np.array([t, 0.3 * t, 6.0]) @ view[:3, :3]
    return view


LENS = np.array([[1.1, 0, 0, 0], [0, 1.76, 0, 0], [0, 0, -1.0, -1.0], [0, 0, -0.1, 0]])


def project(world: Array, number: int) -> Array:
    clip = world @ (make_view(number) @ LENS)
    x = (clip[..., 0] / clip[..., 3] * 0.5 + 0.5) * SIZE[1]
    y = (0.5 - 0.5 * clip[..., 1] / clip[..., 3]) * SIZE[0]
    return np.stack([x, y])


def write_frames(folder: Path, numbers: Sequence[int], *, of: int) -> FrameReader:
    """Frames of boxes before a wall, with the matrices of the frames `of` after their own."""
    rows, columns = np.mgrid[0 : SIZE[0], 0 : SIZE[1]] + 0.5
    for number in numbers:
        depth = 4.0 + ((rows // 8 + columns // 8) % 3)
        x = (2.0 * columns / SIZE[1] - 1.0) / LENS[0, 0] * depth
        y = (1.0 - 2.0 * rows / SIZE[0]) / LENS[1, 1] * depth
        seen = np.stack([x, y, -depth, np.ones(SIZE)], -1)
        world = seen @ np.linalg.inv(make_view(number))
        moved = project(world, number - 1) - project(world, number)
        planes = {name: depth.astype(np.float32) for name in ("R", "G", "B", "depth.Z")}
        planes |= {f"motion.{a}": m.astype(np.float32) for a, m in zip("XY", moved, strict=True)}
        given = make_view(number + of)
        matrices = {"worldToCamera": given, "worldToNDC": given @ LENS}
        write_exr(
            folder / f"f.{number:04d}.exr",
            planes,
            attributes={name: m.astype(np.float32) for name, m in matrices.items()},
        )
    frames = collect_frame_set(folder)
    assert frames is not None
    return open_frames(frames, layout=None, capture=CaptureDeclaration(), side_car={})


@pytest.mark.parametrize(("of", "presumed", "settled"), [(0, BACK, BACK), (-1, BACK, None)])
def test_matrices_of_the_frame_before_turn_no_sense_around(
    tmp_path: Path, of: int, presumed: MotionConvention, settled: MotionConvention | None
) -> None:
    """By those, vectors to the frame before look like such to the next one, turned around."""
    numbers = (1, 2, 3, 4)
    reader = write_frames(tmp_path, numbers, of=of)
    buffers = (Buffer.DEPTH, Buffer.MOTION)
    stored = {n: reader.read_raw(n, buffers=buffers) for n in numbers}
    conventions = Conventions(motion=presumed)
    camera = check_reader_cameras(reader, stored, conventions, (BACK, FORTH))
    assert camera is not None
    assert OF_NEIGHBOUR in camera.undecided
    ranked = tuple(
        MotionCandidate(
            convention=c, error=0.1, margin=0.0, significance=0.0, offsets_px=((0.0, 0.0),)
        )
        for c in (BACK, FORTH)
    )
    motion = MotionFinding(candidates=ranked, unmoved_error=0.4, moving=1.0, triples=(2, 3))
    measured = StorageMeasurement(motion=motion, camera=camera, frames=numbers)
    found = add_geometry(reader, stored, conventions, measured)
    assert (None if found.by_geometry is None else found.by_geometry.convention) == settled


def test_the_reading_that_is_presumed_is_tried_whatever_fits_pictures_better(
    tmp_path: Path,
) -> None:
    """Coarse pictures rank others before it; right matrices agree with it alone."""
    numbers = (1, 2, 3, 4)
    reader = write_frames(tmp_path, numbers, of=0)
    stored = {n: reader.read_raw(n, buffers=(Buffer.DEPTH, Buffer.MOTION)) for n in numbers}
    others = [MotionConvention(scale=s) for s in (0.1, 0.2, 0.3, 0.4, 0.5)]
    for presumed in (BACK, replace(BACK, jittered=True)):
        found = check_reader_cameras(reader, stored, Conventions(motion=presumed), (*others, BACK))
        assert found is not None
        assert found.fits
        assert found.errors["motion with depth"] < 1e-3


def test_depth_is_measured_along_a_reading_that_geometry_leaves(tmp_path: Path) -> None:
    """Where two are left, along the presumed one; never along short vectors that rank first."""
    numbers = (1, 2, 3, 4)
    reader = write_frames(tmp_path, numbers, of=0)
    stored = {n: reader.read_raw(n, buffers=(Buffer.DEPTH, Buffer.MOTION)) for n in numbers}
    alike = MotionConvention(scale=1.0005)
    ranked = tuple(
        MotionCandidate(
            convention=c, error=0.1, margin=0.0, significance=0.0, offsets_px=((0.0, 0.0),)
        )
        for c in (MotionConvention(scale=0.05), alike, BACK)
    )
    motion = MotionFinding(candidates=ranked, unmoved_error=0.4, moving=1.0, triples=(2, 3))
    camera = CameraFinding(proofs=("motion with depth",), certain=True)
    measured = StorageMeasurement(motion=motion, camera=camera, frames=numbers)
    found = add_geometry(reader, stored, Conventions(motion=BACK), measured)
    assert found.by_geometry is None
    assert found.depth.best is not None
    assert found.depth.best.convention == DepthConvention()
    assert found.depth.best.error < 1e-3


@pytest.mark.parametrize(
    ("rest", "verdict"),
    [(True, JitterVerdict.CONSISTENT), (False, JitterVerdict.UNDECLARED)],
)
def test_offsets_of_the_search_are_no_jitter_where_samples_rest(
    tmp_path: Path, rest: bool, verdict: JitterVerdict
) -> None:
    numbers = (1, 2, 3, 4)
    reader = write_frames(tmp_path, numbers, of=0)
    stored = {n: reader.read_raw(n, buffers=(Buffer.DEPTH, Buffer.MOTION)) for n in numbers}
    best = MotionCandidate(
        convention=BACK,
        error=0.1,
        margin=1.0,
        significance=9.0,
        offsets_px=((0.2, 0.0), (0.0, 0.0)),
    )
    motion = MotionFinding(candidates=(best,), unmoved_error=0.4, moving=1.0, triples=(2, 3))
    measured = StorageMeasurement(motion=motion, frames=numbers, samples_rest=rest)
    found = add_geometry(reader, stored, Conventions(motion=BACK), measured)
    assert found.jitter is not None
    assert found.jitter.verdict is verdict
