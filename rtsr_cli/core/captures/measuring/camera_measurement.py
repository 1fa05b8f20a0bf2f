"""Gathering what a few frames hold that camera matrices can be checked against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from torch import Tensor

from rtsr_cli.core.captures.bound_channels import BoundBuffer
from rtsr_cli.core.captures.measuring.camera_check import (
    CameraFinding,
    check_cameras,
    check_normals,
)
from rtsr_cli.core.captures.measuring.camera_evidence import (
    MOST_SURFACE_PIXELS,
    CameraEvidence,
    list_likely_depths,
    list_units,
    mean_error,
    thin,
)
from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras, list_worlds
from rtsr_cli.core.captures.measuring.camera_rounding import measure_rounding
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices, Matrix4
from rtsr_cli.core.captures.measuring.geometry_finder import StoredGeometry, ThinnedFrame
from rtsr_cli.core.captures.measuring.normal_axes import NormalAxes, measure_axes
from rtsr_cli.core.captures.measuring.normal_evidence import NormalEvidence
from rtsr_cli.core.captures.measuring.normal_finder import find_packing, unpack_normals
from rtsr_cli.core.captures.measuring.position_evidence import PositionEvidence
from rtsr_cli.core.captures.measuring.vector_evidence import VectorEvidence
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.conventions import Conventions
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.vector_length import vector_length
from rtsr_cli.core.shapes import Vector3

Stored = Mapping[int, Mapping[Buffer, Tensor]]

MOST_NORMAL_FRAMES = 2
"""Frames whose normals are held against depth: one tells nearly all."""

MOST_READINGS = 4
"""Readings of motion under which matrices are tried."""


def list_matrices(reader: FrameReader, numbers: Sequence[int]) -> Cameras:
    """Matrices of some frames, and of those before and after them; empty without cameras."""
    wanted = {n + offset for n in numbers for offset in (-reader.step, 0, reader.step)}
    found = {}
    # of neighbours those that were surveyed: no file is opened for them
    for number in sorted(wanted & ({*reader.cameras} | {*numbers})):
        camera = reader.cameras[number]
        if camera.world_to_camera is not None and camera.world_to_ndc is not None:
            found[number] = CameraMatrices(
                camera.world_to_camera.double().numpy(), camera.world_to_ndc.double().numpy()
            )
    return found if set(numbers) <= found.keys() else {}


def check_reader_cameras(
    reader: FrameReader,
    stored: Stored,
    presumed: Conventions,
    motions: Sequence[MotionConvention],
) -> CameraFinding | None:
    """Check the cameras of some frames; None where there are none.

    Args:
        reader: of the frames.
        stored: their buffers, as stored.
        presumed: conventions before anything is measured.
        motions: readings of the vectors that may hold; none where that is not known.
    """
    # of frames without matrices nothing is asked, and the others' are checked all the same
    stored = {n: buffers for n, buffers in stored.items() if reader.cameras[n].has_matrices}
    given = list_matrices(reader, tuple(stored))
    if not given:
        return None
    buffers = [b for b in (Buffer.GEONORMAL, Buffer.NORMAL) if b in reader.stored]
    normals, silent = _gather_normals(reader, stored, presumed, given, buffers[:1])
    evidence = (
        *_gather_positions(reader, stored, presumed, given),
        *_gather_motion(reader, stored, presumed, motions, given),
        *normals,
    )
    found = check_cameras(
        given,
        evidence,
        step=reader.step,
        convention=reader.matrices,
        silent=silent,
        of_lens=all(reader.cameras[n].of_lens for n in given),
    )
    found = _declare_normals(found, reader, stored, buffers)
    shading, _ = _gather_normals(reader, stored, presumed, given, buffers[1:])
    if shading and found.normal_world is None:
        found = _declare_normals(
            check_normals(found, given, shading[0]), reader, stored, buffers[1:]
        )
    units = [e.units[0] for e in evidence if isinstance(e, PositionEvidence)]
    proven = found.fits and PositionEvidence.name in found.proofs
    return replace(found, position_unit_m=units[0]) if proven else found


def _declare_normals(
    found: CameraFinding, reader: FrameReader, stored: Stored, normals: Sequence[Buffer]
) -> CameraFinding:
    """Add the lines that make normals fit the matrices as given, where axes do."""
    if found.normal_world is None:
        return found
    held = next(iter(stored.values()))
    lines = (
        f"{buffer} = [{', '.join(turned)}]"
        for buffer in normals
        if (turned := write_turned(reader.binding[buffer], found.normal_world, held[buffer]))
    )
    said = "; ".join(lines)
    if not said:
        return found
    text = f"; or, if the matrices are right, [buffers] of capture.toml: {said}"
    if found.unfit:
        return replace(found, unfit=found.unfit + text)
    return replace(found, contradiction=found.contradiction + text)


def write_turned(bound: BoundBuffer, axes: Matrix4, stored: Vector3) -> list[str]:
    """Write the components of n . A as `[buffers]` takes them; none where they are no channels.

    Args:
        bound: what n is made of.
        axes: A, each row of which has one entry of 1 or -1.
        stored: n, as stored; where (n + 1) / 2 is, an axis is negated by 1 - x.
    """
    if not bound.is_as_stored or len(bound) != 3:
        return []
    packed = find_packing(stored)
    written = []
    for column in axes[:3, :3].T:
        row = int(np.abs(column).argmax())
        turned = BoundBuffer((bound.components[row],))
        if column[row] < 0.0:
            turned = turned.multiplied(-1.0, 1.0 if packed else 0.0)
        written.append(f'"{turned.describe(streams=True)}"')
    return written


def _make_geometry(
    reader: FrameReader, number: int, buffers: Mapping[Buffer, Tensor], leading: Buffer
) -> StoredGeometry:
    """Geometry of one frame; where there is no depth, another buffer stands for its size."""
    return StoredGeometry(
        depth=buffers.get(Buffer.DEPTH, buffers[leading][:, :1]),
        motion_px=None,
        position=buffers.get(Buffer.POSITION),
        camera=reader.cameras[number],
        previous=reader.cameras[number],
        view=reader.view,
    )


def _gather_positions(
    reader: FrameReader, stored: Stored, presumed: Conventions, given: Cameras
) -> list[CameraEvidence]:
    if Buffer.POSITION not in reader.stored:
        return []
    thinned = {n: thin(_make_geometry(reader, n, b, Buffer.POSITION)) for n, b in stored.items()}
    frames = {n: frame for n, (frame, _) in thinned.items()}
    thinning = next(iter(thinned.values()))[1]
    units = list_units(presumed.metres_per_position)
    evidence = PositionEvidence(frames=frames, units=units, thinning=thinning)
    return [evidence.hold(given)]


def _gather_motion(
    reader: FrameReader,
    stored: Stored,
    presumed: Conventions,
    motions: Sequence[MotionConvention],
    given: Cameras,
) -> list[CameraEvidence]:
    if not {Buffer.MOTION, Buffer.DEPTH} <= reader.stored or not motions:
        return []
    frames: dict[MotionConvention, dict[int, StoredGeometry]] = {}
    roundings: dict[MotionConvention, float] = {}
    thinning = 1
    # what may hold as it is read is not left out for what fits pictures a little better
    plain = replace(presumed.motion, jittered=False, jitter_inverted=False)
    own = [motion for motion in motions if motion in {plain, presumed.motion}]
    for motion in dict.fromkeys((*own, *motions[:MOST_READINGS])):
        frames[motion] = {}
        for number, buffers in stored.items():
            source = number + motion.file_offset * reader.step
            if source not in stored:
                continue
            geometry = _make_geometry(reader, number, buffers, Buffer.DEPTH)
            other = number + (reader.step if motion.direction.to_next else -reader.step)
            previous = reader.cameras[other] if other in given else geometry.camera
            kept, thinning = thin(replace(geometry, position=None, previous=previous))
            file = ThinnedFrame(thinning).image(stored[source][Buffer.MOTION])
            vectors = motion.pixels(file, reader.view.display, dim=1)
            off = motion.pixels(file + measure_rounding(file), reader.view.display, dim=1) - vectors
            far = float(vector_length(off).nanmedian())
            roundings[motion] = max(roundings.get(motion, 0.0), far)
            frames[motion][number] = replace(kept, motion_px=vectors / thinning)
    evidence = VectorEvidence(
        frames=frames,
        step=reader.step,
        depths=list_likely_depths(presumed.depth),
        thinning=thinning,
        roundings_px=roundings,
    )
    return [evidence.hold(given)]


def _gather_normals(
    reader: FrameReader,
    stored: Stored,
    presumed: Conventions,
    given: Cameras,
    buffers: Sequence[Buffer],
) -> tuple[list[CameraEvidence], tuple[str, ...]]:
    """Normals and depths; where the normals are of the camera's own axes, why they tell nothing.

    Args:
        reader, stored, presumed, given: as for `check_reader_cameras`.
        buffers: the normals, one buffer; or none.
    """
    if not buffers or Buffer.DEPTH not in reader.stored:
        return [], ()
    evidence = _pair_with_depth(reader, stored, presumed, buffers[0])
    if evidence is None:
        return [], (NO_DIRECTIONS,)
    return ([], (OF_CAMERA,)) if are_of_camera(evidence, given) else ([evidence.hold(given)], ())


def _pair_with_depth(
    reader: FrameReader, stored: Stored, presumed: Conventions, buffer: Buffer
) -> NormalEvidence | None:
    """Normals of a few frames with their depths; None where they are no vectors of length 1."""
    frames, normals = {}, {}
    for number, held in list(stored.items())[-MOST_NORMAL_FRAMES:]:
        geometry = _make_geometry(reader, number, held, Buffer.DEPTH)
        kept, thinning = thin(geometry, MOST_SURFACE_PIXELS)
        unit = unpack_normals(ThinnedFrame(thinning).image(held[buffer]))
        if unit is not None:
            frames[number], normals[number] = kept, unit
    depths = list_likely_depths(presumed.depth)[:5]
    return NormalEvidence(frames=frames, normals=normals, depths=depths) if frames else None


def measure_normal_axes(
    reader: FrameReader, stored: Stored, presumed: Conventions, found: CameraFinding | None
) -> tuple[NormalAxes, ...]:
    """In which axes normals stand on their surfaces, where cameras are proven.

    Args:
        reader, stored, presumed: as for `check_reader_cameras`.
        found: of the cameras.
    """
    if found is None or not found.fits or Buffer.DEPTH not in reader.stored:
        return ()
    stored = {n: buffers for n, buffers in stored.items() if reader.cameras[n].has_matrices}
    given = list_matrices(reader, tuple(stored))
    measured = []
    for buffer in (Buffer.NORMAL, Buffer.GEONORMAL):
        if buffer not in reader.stored or not given:
            continue
        evidence = _pair_with_depth(reader, stored, presumed, buffer)
        axes = None if evidence is None else measure_axes(evidence, given, buffer)
        if axes is not None:
            held = next(iter(stored.values()))[buffer]
            lines = write_turned(reader.binding[buffer], axes.axes, held)
            measured.append(replace(axes, lines=tuple(lines)))
    return tuple(measured)


NO_DIRECTIONS = "normals are neither of length 1 nor packed into 0..1"

OF_CAMERA = (
    "normals fit the surfaces that depth shows in the camera's own axes, and not in those of these "
    "matrices' world: normals of the view, or of the world with matrices that are wrong"
)
"""Why normals with depth are no evidence."""


def are_of_camera(evidence: NormalEvidence, given: Cameras) -> bool:
    """Tell whether normals are in the camera's own axes.

    Args:
        evidence: the normals with their depths.
        given: cameras, by frame.

    Where surfaces face few ways they fit the camera's axes by chance, though they are of the world:
    there another world than the matrices' fits them better.
    """
    in_world = mean_error(evidence.measure(given, closely=False).values())
    in_camera = evidence.measure_in_camera(given)
    if in_camera > evidence.limit or in_camera >= in_world - evidence.slack:
        return False
    worlds = (evidence.measure(world.cameras, closely=False) for world in list_worlds(given))
    return min(mean_error(errors.values()) for errors in worlds) >= in_camera - evidence.slack


def drop_matrices(camera: CameraMetadata) -> CameraMetadata:
    """Return a camera without its matrices."""
    return replace(camera, world_to_camera=None, world_to_ndc=None)
