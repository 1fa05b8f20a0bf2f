"""What camera and depth may decide of motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring import geometry_measurement
from rtsr_cli.core.captures.measuring.camera_check import OF_NEIGHBOUR, CameraFinding
from rtsr_cli.core.captures.measuring.geometry_finder import DepthCandidate, DepthFinding
from rtsr_cli.core.captures.measuring.geometry_measurement import add_geometry
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention
from rtsr_cli.core.frames.motion import MotionConvention

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
