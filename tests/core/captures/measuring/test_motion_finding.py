"""Which readings of motion are told apart, and which are not."""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.captures.measuring.camera_check import CameraFinding
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.measuring.normal_finder import NormalFinding
from rtsr_cli.core.frames.conventions import NormalSpace
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection

BACK = MotionConvention()
FORTH = replace(BACK, direction=MotionDirection.CURRENT_MINUS_NEXT)
HALF = replace(BACK, scale=0.5)


def candidate(
    convention: MotionConvention, error: float, significance: float, *, same: bool = False
) -> MotionCandidate:
    return MotionCandidate(
        convention=convention,
        error=error,
        margin=significance and 0.1,
        significance=significance,
        offsets_px=(),
        same_vectors=same,
    )


def find(*candidates: MotionCandidate, unmoved: float = 1.0) -> MotionFinding:
    return MotionFinding(candidates=candidates, unmoved_error=unmoved, moving=1.0, triples=(1,))


def test_ties_are_ties_where_no_reading_fits_well() -> None:
    readings = (candidate(BACK, 0.5, 0.0), candidate(FORTH, 0.51, 0.8), candidate(HALF, 0.9, 9.0))
    for unmoved in (1.0, 0.52):
        found = find(*readings, unmoved=unmoved)
        assert found.alike == readings[:2]
    assert find(*readings, unmoved=0.52).ties == ()


def test_one_that_stands_alone_is_alike_to_none() -> None:
    assert find(candidate(BACK, 0.2, 0.0), candidate(FORTH, 0.5, 8.0)).alike == ()
    file = candidate(replace(BACK, file_offset=1), 0.2, 1.0, same=True)
    assert find(candidate(BACK, 0.2, 0.0), file).alike == ()


def test_normals_that_stand_on_the_surfaces_of_depth_are_measured() -> None:
    untold = NormalFinding(packed=False, facing={})
    assert not StorageMeasurement(normal=untold).proves_normals
    facing = replace(untold, space=NormalSpace.WORLD)
    assert StorageMeasurement(normal=facing).proves_normals
    for proofs, proven in ((("world positions",), False), (("normals with depth",), True)):
        camera = CameraFinding(proofs=proofs)
        assert StorageMeasurement(normal=untold, camera=camera).proves_normals is proven
