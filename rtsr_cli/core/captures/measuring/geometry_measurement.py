"""What camera and depth of a few frames say of motion, depth and jitter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_check import (
    NOTHING_MEASURED,
    OF_NEIGHBOUR,
    UNVERIFIED,
    CameraFinding,
)
from rtsr_cli.core.captures.measuring.geometry_finder import (
    DepthFinding,
    StoredGeometry,
    find_depth,
)
from rtsr_cli.core.captures.measuring.jitter_finder import JitterFinding, JitterVerdict, find_jitter
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.measuring.motion_choices import write_motion
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention
from rtsr_cli.core.frames.motion import Jitter, MotionConvention

GEOMETRY_RATIO = 0.5
"""Of close readings of motion, the one that geometry explains this much better than all others."""

LEAST_APART_PX = 0.005
"""Readings whose vectors hardly differ are not told apart by the last digits of a matrix."""

CLOSE_MARGIN = 0.15
MOST_CLOSE = 8
"""Readings whose error is this share above the best one's are held against camera and depth."""


def add_geometry(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    measured: StorageMeasurement,
) -> StorageMeasurement:
    """Add what camera and depth say of depth, and of motion where pictures leave it tied."""
    camera = measured.camera
    if Buffer.DEPTH not in reader.stored or camera is None or not camera.fits:
        return _add_jitter(reader, measured, presumed.motion)
    placed = _find_depth(reader, stored, presumed.depth, unit=measured.position_unit_m)
    finding = measured.motion
    ties = finding.ties if finding is not None else ()
    close = list_close(finding) if ties else []
    # the errors of close readings are far apart, or no number of frames tells them apart
    few = dict(list(stored.items())[-3:])
    moved = {
        candidate: _find_depth(reader, few, presumed.depth, motion=candidate.convention)
        for candidate in dict.fromkeys([*ties, *close])
    }
    ranked = sorted(moved, key=lambda c: _format_error(moved[c]))
    errors = [_format_error(moved[c]) for c in ranked]
    clear = len(errors) > 1 and errors[0] < min(
        GEOMETRY_RATIO * errors[1], errors[1] - LEAST_APART_PX
    )
    chosen = measured.by_geometry or (ranked[0] if clear else None)
    open_ = measured.by_geometry is None and OF_NEIGHBOUR in camera.undecided
    if open_ and chosen is not None and chosen.convention != _plain(presumed.motion):
        other = _find_other(reader, few, presumed.depth, moved, chosen)
        if other is not None:
            # depth that is measured along the same matrices is no better founded
            doubted = replace(measured, camera=_doubt(camera, chosen, other))
            return _add_jitter(reader, doubted, presumed.motion)
    lead = chosen or _choose_lead(ranked, errors, presumed.motion)
    along = moved.get(lead, DepthFinding()) if ties and lead is not None else DepthFinding()
    depth = placed if placed.best is not None else along
    return _add_jitter(reader, replace(measured, by_geometry=chosen, depth=depth), presumed.motion)


def _plain(motion: MotionConvention) -> MotionConvention:
    return replace(motion, jittered=False, jitter_inverted=False)


def _choose_lead(
    ranked: Sequence[MotionCandidate], errors: Sequence[float], presumed: MotionConvention
) -> MotionCandidate | None:
    """The reading that depth is measured along where none stands alone: the presumed one, if left.

    Vectors by which everything moves far less than it does would make all depths far.
    """
    left = [
        c
        for c, error in zip(ranked, errors, strict=True)
        if error <= max(errors[0] / GEOMETRY_RATIO, errors[0] + LEAST_APART_PX)
    ]
    own = (c for c in left if c.convention == _plain(presumed))
    return next(own, left[0] if left else None)


def _find_other(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: DepthConvention,
    moved: Mapping[MotionCandidate, DepthFinding],
    chosen: MotionCandidate,
) -> MotionConvention | None:
    """A reading that would fit as well if the matrices were those of the frames beside; or None.

    Matrices of the frame before favour vectors of the other sense, and where a camera speeds up
    those of a neighbour favour another unit.
    """
    if chosen.convention.file_offset:
        return replace(chosen.convention, file_offset=0)
    most = (_format_error(moved[chosen]) + LEAST_APART_PX) / GEOMETRY_RATIO
    around = {n + offset for n in stored for offset in (-reader.step, 0, reader.step)}
    cameras = {n: reader.cameras[n] for n in around & {*reader.cameras}}
    for offset in (reader.step, -reader.step):
        turned = {n: cameras[n + offset] for n in cameras if n + offset in cameras}
        beside = replace(reader, cameras=turned)
        frames = {n: buffers for n, buffers in stored.items() if n in turned}
        for other in moved:
            if other is not chosen and not other.convention.file_offset:
                found = _find_depth(beside, frames, presumed, motion=other.convention)
                if _format_error(found) < most:
                    return other.convention
    return None


def _doubt(
    camera: CameraFinding, chosen: MotionCandidate, other: MotionConvention
) -> CameraFinding:
    """Take matrices for unverified that agree with another reading if they are a neighbour's."""
    names = " and ".join(camera.proofs)
    text = (
        f"{UNVERIFIED}: by {names} they fit motion that is {chosen.convention}, and matrices of a "
        f"neighbouring frame would fit motion that is {other} as well. Motion stays as it is "
        "without them: write each frame's own matrices, or, if they are, declare "
        f"{write_motion(chosen.convention, shifted=bool(chosen.convention.file_offset))} at the "
        f"head of capture.toml. {NOTHING_MEASURED}"
    )
    return replace(camera, proofs=(), undecided=(), certain=False, doubt=text)


def list_close(finding: MotionFinding | None) -> list[MotionCandidate]:
    """Readings of motion that pictures rank so close to the best that geometry is asked, too."""
    near = finding.candidates[:MOST_CLOSE] if finding is not None else ()
    return [c for c in near if c.margin < CLOSE_MARGIN]


def _format_error(finding: DepthFinding) -> float:
    return finding.best.error if finding.best is not None else float("inf")


def _add_jitter(
    reader: FrameReader, measured: StorageMeasurement, presumed: MotionConvention
) -> StorageMeasurement:
    """Judge the offsets of the reading that stands alone, or of the presumed one if it may hold."""
    if measured.motion is None:
        return measured
    likely = measured.motion.of(presumed)
    best = measured.best or (likely if likely in measured.motion.ties else None)
    if best is None:
        return measured
    step = 1 if best.convention.direction.to_next else -1

    def jitter(index: int) -> Jitter:
        number = index * reader.step
        return reader.cameras[number].jitter_px if number in reader.cameras else (0.0, 0.0)

    pairs = [(jitter(t), jitter(t + step)) for t in measured.motion.triples]
    between = [(now[0] - then[0], now[1] - then[1]) for now, then in pairs]
    if measured.samples_rest and not any(map(any, between)):
        return replace(measured, jitter=JitterFinding(verdict=JitterVerdict.CONSISTENT))
    return replace(measured, jitter=find_jitter(best.offsets_px, between))


def _find_depth(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: DepthConvention,
    *,
    unit: float | None = None,
    motion: MotionConvention | None = None,
) -> DepthFinding:
    """Rank readings of depth against positions in `unit`, or against vectors read as `motion`."""
    step = reader.step if motion is not None and motion.direction.to_next else -reader.step
    frames = []
    for number, buffers in stored.items():
        source = number + (motion.file_offset * reader.step if motion is not None else 0)
        if motion is not None and not {number + step, source} <= set(stored):
            continue
        position = buffers.get(Buffer.POSITION) if unit is not None else None
        vectors = None if motion is None else stored[source][Buffer.MOTION]
        frames.append(
            StoredGeometry(
                depth=buffers[Buffer.DEPTH],
                motion_px=None
                if vectors is None or motion is None
                else motion.pixels(vectors, reader.view.display, dim=1),
                position=None if position is None or unit is None else position * unit,
                camera=reader.cameras[number],
                previous=reader.cameras.get(number + step, reader.cameras[number]),
                view=reader.view,
            )
        )
    return find_depth(frames, (presumed,))
