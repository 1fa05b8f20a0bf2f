"""Measuring what a dump's names do not say: motion, jitter, depth, position unit, normals.

A few frames of the sequence are read as stored. Which ones depends on the files alone, so that
every command, shard and machine measures the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_check import CameraFinding
from rtsr_cli.core.captures.measuring.camera_measurement import (
    check_reader_cameras,
    drop_matrices,
    measure_normal_axes,
)
from rtsr_cli.core.captures.measuring.depth_median import find_median_depth
from rtsr_cli.core.captures.measuring.empty_buffers import (
    COLOURS,
    NEVER_ZERO,
    SHARES,
    BufferFault,
    find_faults,
)
from rtsr_cli.core.captures.measuring.geometry_measurement import add_geometry, list_close
from rtsr_cli.core.captures.measuring.jitter_finder import do_samples_rest
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.measuring.motion_by_position import prove_motion
from rtsr_cli.core.captures.measuring.motion_finder import STILL_PX, find_motion
from rtsr_cli.core.captures.measuring.motion_finding import MotionFinding
from rtsr_cli.core.captures.measuring.motion_trials import MotionEvidence, normalise_picture
from rtsr_cli.core.captures.measuring.normal_finder import find_normals
from rtsr_cli.core.captures.measuring.position_evidence import PositionEvidence
from rtsr_cli.core.captures.measuring.sky_finder import (
    SKY_BUFFERS,
    SkyFinding,
    find_sky,
    leave_out_sky,
)
from rtsr_cli.core.captures.measuring.vector_evidence import VectorEvidence
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.sequence import FrameSequence
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.threads import map_in_threads, run_single_threaded

GROUP = 4
"""Consecutive frames that are compared: two of them have both neighbours."""

LEAST_MOVING = 1e-3
"""A group in which less than this share of the pixels moves gives way to another one."""

WINDOW: Size = (896, 1152)
"""Middle part of larger frames that is looked at."""

PICTURES = (Buffer.COLOR, Buffer.ALBEDO, Buffer.NORMAL, Buffer.POSITION)
"""What sticks to surfaces."""


def measure_storage(
    reader: FrameReader,
    presumed: Conventions,
    *,
    motion: bool = True,
    motions: Sequence[MotionConvention] = (),
) -> StorageMeasurement:
    """Read a few frames and measure.

    Args:
        reader: surveyed frames.
        presumed: conventions of the preset and the declarations, which take part as hypotheses.
        motion: whether vectors are of interest.
        motions: by which vectors are read at another size of the shot: where cameras agree with
            those, they are proven.

    Pixels that cannot be read are not reported here: the run that needs them will. Where not all
    files have pixels, nothing is measured.
    """
    measured = StorageMeasurement()
    for numbers in _choose_groups(reader):
        narrowed, stored = _read_group(reader, numbers)
        if not stored:
            continue
        candidate = run_single_threaded(
            partial(_measure_group, narrowed, stored, presumed, motion=motion, motions=motions)
        )
        if measured.motion is None or _measure_movement(candidate) > _measure_movement(measured):
            measured = candidate
        if not motion or _measure_movement(candidate) > LEAST_MOVING:
            break
    if measured.sky is not None and measured.sky.is_nothing:
        measured = replace(measured, sky=_look_elsewhere(reader, presumed) or measured.sky)
    if not motion and Buffer.MOTION in reader.stored and _could_motion_tell(measured.camera):
        # nobody reads these vectors; what they say of cameras is not left unsaid for that
        with_motion = measure_storage(reader, presumed, motions=motions)
        measured = replace(measured, camera=with_motion.camera)
    return measured


def _could_motion_tell(camera: CameraFinding | None) -> bool:
    """Tell whether there are cameras that nothing has proven which tells as much as motion."""
    told = {PositionEvidence.name, VectorEvidence.name}
    return camera is not None and told.isdisjoint(camera.proofs)


def _look_elsewhere(reader: FrameReader, presumed: Conventions) -> SkyFinding | None:
    """What is sky in the first and the last frame, if they can be read."""
    own = [n for n in reader.numbers if n not in reader.held]
    ends = tuple(dict.fromkeys((own[0], own[-1])))
    buffers = reader.stored_in(ends).intersection(SKY_BUFFERS)
    try:
        narrowed = reader.narrowed(ends)
        frames = map_in_threads(partial(narrowed.read_raw, buffers=buffers), ends)
    except RtsrError:
        return None
    return run_single_threaded(partial(find_sky, frames, presumed))


def _measure_movement(measured: StorageMeasurement) -> float:
    return measured.motion.moving if measured.motion is not None else -1.0


def _choose_groups(reader: FrameReader) -> Iterator[tuple[int, ...]]:
    """Groups of adjacent frames to look at: of the middle, the start and the end."""
    sequence = FrameSequence(
        numbers=[n for n in reader.numbers if n not in reader.held],
        step=reader.step,
        cuts=reader.resets,
    )
    runs = sorted(sequence.runs(), key=len, reverse=True)
    places = [(runs[0], 0.5), (runs[0], 0.0), (runs[-1] if len(runs) > 1 else runs[0], 1.0)]
    seen = set()
    for run, share in places:
        start = round((len(run) - GROUP) * share) if len(run) > GROUP else 0
        group = tuple(run[start : start + GROUP])
        if group not in seen:
            seen.add(group)
            yield group


def _read_group(
    reader: FrameReader, numbers: Sequence[int]
) -> tuple[FrameReader, dict[int, Mapping[Buffer, Tensor]]]:
    """Read the stored buffers of a group where all files have them; none if one is unreadable."""
    wanted = {
        Buffer.MOTION,
        Buffer.FORWARD,
        Buffer.GEONORMAL,
        *SKY_BUFFERS,
        *PICTURES,
        *NEVER_ZERO,
        *SHARES,
        *COLOURS,
    }
    buffers = wanted & reader.stored_in(numbers)
    try:
        narrowed = reader.narrowed(numbers)
        frames = map_in_threads(partial(narrowed.read_raw, buffers=buffers), numbers)
        return narrowed, dict(zip(numbers, frames, strict=True))
    except RtsrError:
        return reader, {}


def _measure_group(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    *,
    motion: bool,
    motions: Sequence[MotionConvention],
) -> StorageMeasurement:
    measured = StorageMeasurement(frames=tuple(stored))
    if reader.stored & {Buffer.DEPTH, Buffer.NORMAL}:
        measured = replace(measured, sky=find_sky(list(stored.values()), presumed))
    known = _with_sky(presumed, measured)
    bare = map_in_threads(partial(leave_out_sky, conventions=known), stored.values())
    surfaces = dict(zip(stored, bare, strict=True))
    if Buffer.POSITION in reader.stored:
        measured = _place_by_positions(reader, surfaces, presumed, measured)
    proven = _prove_motion(reader, stored, presumed, measured) if motion else None
    if motion and len(stored) > 1 and _has_pictures(next(iter(stored.values()))):
        finding = _find_motion(reader, stored, [m for m in (presumed.motion, proven) if m])
        repeats = dict(_find_repeats(stored, reader.step, presumed.motion.zero))
        measured = replace(
            measured,
            motion=finding,
            by_geometry=None if proven is None else finding.of(proven),
            geometry="world positions" if proven is not None else measured.geometry,
            repeated=tuple(n for n, moves in repeats.items() if moves),
            resting=tuple(n for n, moves in repeats.items() if not moves),
            samples_rest=do_samples_rest(stored, reader.step, presumed.motion.zero),
        )
    placed = _check_by_motion(reader, surfaces, presumed, measured, motions)
    measured = replace(measured, camera=placed)
    last = max(stored)
    if Buffer.DEPTH in reader.stored:
        measured = replace(measured, median_depth=find_median_depth(stored[last][Buffer.DEPTH]))
    if Buffer.NORMAL in reader.stored:
        # by a camera that nothing proves, world space would be told from view space at random; and
        # normals of another world face the camera in neither
        certain = placed is not None and placed.certain and placed.normal_world is None
        camera = reader.cameras[last] if certain else drop_matrices(reader.cameras[last])
        normal = find_normals(surfaces[last][Buffer.NORMAL], camera, reader.view)
        axes = measure_normal_axes(reader, surfaces, presumed, placed)
        measured = replace(measured, normal=normal, normal_axes=axes)
    measured = replace(measured, faults=_find_faults(reader, stored, presumed, measured))
    return add_geometry(reader, stored, presumed, measured)


def _with_sky(presumed: Conventions, measured: StorageMeasurement) -> Conventions:
    """Conventions with the rule of the sky that was measured, if one was."""
    if measured.sky is None or measured.sky.sky is None:
        return presumed
    return replace(presumed, depth=replace(presumed.depth, sky=measured.sky.sky))


def _find_faults(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    measured: StorageMeasurement,
) -> tuple[BufferFault, ...]:
    """Look for passes that are not there; what is declared as a constant is meant."""
    normal, presumed = measured.normal, _with_sky(presumed, measured)
    if normal is not None and normal.packed is not None:
        presumed = replace(presumed, normal=replace(presumed.normal, packed=normal.packed))
    frames = {
        number: {b: t for b, t in buffers.items() if len(reader.binding[b])}
        for number, buffers in stored.items()
    }
    return find_faults(frames, presumed, reader.cameras, reader.step, reader.binding)


def _place_by_positions(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    measured: StorageMeasurement,
) -> StorageMeasurement:
    """Check the cameras by positions, which need no motion, and tell their unit."""
    placed = check_reader_cameras(reader, stored, presumed, ())
    unit = None if placed is None else placed.position_unit_m
    return replace(measured, camera=placed, position_unit_m=unit)


def _check_by_motion(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    measured: StorageMeasurement,
    motions: Sequence[MotionConvention],
) -> CameraFinding | None:
    """Check the cameras by motion where positions say nothing of them, or of single ones only ill.

    Single frames' positions may be what is wrong, which motion tells.
    """
    placed = measured.camera
    if placed is not None and placed.single:
        own = tuple(motions) or _list_motions(measured, presumed)
        again = check_reader_cameras(reader, stored, presumed, own)
        return again if again is not None and again.foreign_positions else placed
    if placed is not None and (placed.fits or placed.unfit):
        return placed
    placed = check_reader_cameras(reader, stored, presumed, motions) if motions else None
    if placed is None or VectorEvidence.name not in placed.proofs:
        own = _list_motions(measured, presumed)
        placed = check_reader_cameras(reader, stored, presumed, own)
    return placed


def _prove_motion(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    measured: StorageMeasurement,
) -> MotionConvention | None:
    if measured.position_unit_m is None or Buffer.MOTION not in reader.stored:
        return None
    plain = replace(presumed.motion, jittered=False, jitter_inverted=False)
    return prove_motion(reader, stored, measured.position_unit_m, plain)


def _list_motions(
    measured: StorageMeasurement, presumed: Conventions
) -> tuple[MotionConvention, ...]:
    """Readings of the vectors that may hold, by what pictures say."""
    finding = measured.motion
    if finding is None:
        return ()
    if finding.best is None:
        return (presumed.motion,)
    likely = dict.fromkeys(c.convention for c in (*finding.ties, *list_close(finding)))
    return tuple(likely)


def _has_pictures(buffers: Collection[Buffer]) -> bool:
    return Buffer.MOTION in buffers and any(b in buffers for b in PICTURES)


def _find_repeats(
    stored: Mapping[int, Mapping[Buffer, Tensor]], step: int, zero: float
) -> Iterator[tuple[int, bool]]:
    """Frames that show what the frame before them does, and whether their vectors move."""
    for number, buffers in stored.items():
        before = stored.get(number - step)
        # pictures without any detail look alike wherever things move
        pictures = [b for b in PICTURES if b in buffers and not _is_flat(buffers[b])]
        if not pictures or before is None or not all(buffers[b].equal(before[b]) for b in pictures):
            continue
        moving = ((buffers[Buffer.MOTION].nan_to_num() - zero).abs().amax(1) > STILL_PX).float()
        yield number, float(moving.mean()) > LEAST_MOVING


def _is_flat(picture: Tensor) -> bool:
    low, high = picture.flatten(2).aminmax(dim=2)
    return bool((low == high).all())


def _cut_window(size: Size) -> tuple[slice, slice]:
    (height, width), (most_h, most_w) = size, WINDOW
    top, left = max(0, (height - most_h) // 2), max(0, (width - most_w) // 2)
    return slice(top, top + min(height, most_h)), slice(left, left + min(width, most_w))


def _find_motion(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    include: Sequence[MotionConvention],
) -> MotionFinding:
    rows, columns = _cut_window(reader.size)

    def evidence(number: int) -> MotionEvidence:
        part = {b: t[..., rows, columns] for b, t in stored[number].items()}
        pictures = [normalise_picture(_make_picture(b, part[b])) for b in PICTURES if b in part]
        return MotionEvidence(
            features=torch.cat(pictures, dim=1),
            nearest=part.get(Buffer.OBJECT_ID),
            stored=part[Buffer.MOTION].nan_to_num(),
            jitter_px=reader.cameras[number].jitter_px,
        )

    pictures = zip(stored, map_in_threads(evidence, stored), strict=True)
    frames = {number // reader.step: part for number, part in pictures}
    return find_motion(frames, screen=reader.view.display, include=include, each=map_in_threads)


def _make_picture(buffer: Buffer, stored: Tensor) -> Tensor:
    """Radiance compressed, so that no highlight decides; whatever is not finite as 0.

    Radiance in units of its own, the middle of it far above 1, would be alike everywhere.
    """
    finite = torch.where(torch.isfinite(stored), stored, torch.zeros_like(stored))
    if buffer is not Buffer.COLOR:
        return finite
    return encode_reinhard(finite / finite.median().clamp(min=1.0))
