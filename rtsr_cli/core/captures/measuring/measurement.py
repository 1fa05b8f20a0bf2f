"""Measuring what a dump's names do not say: motion, jitter, depth, position unit, normals.

A few frames of the sequence are read as stored. Which ones depends on the files alone, so that
every command, shard and machine measures the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.depth_median import find_median_depth
from rtsr_cli.core.captures.measuring.geometry_finder import (
    DepthFinding,
    StoredGeometry,
    find_depth,
    find_position_unit,
)
from rtsr_cli.core.captures.measuring.jitter_finder import JitterFinding, find_jitter
from rtsr_cli.core.captures.measuring.motion_finder import STILL_PX, find_motion
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.measuring.motion_trials import MotionEvidence, normalise_picture
from rtsr_cli.core.captures.measuring.normal_finder import NormalFinding, find_normals
from rtsr_cli.core.captures.measuring.sky_finder import SKY_BUFFERS, SkyFinding, find_sky
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention
from rtsr_cli.core.frames.motion import Jitter, MotionConvention
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

GEOMETRY_RATIO = 0.5
"""Of close readings of motion, the one that geometry explains this much better than all others."""

LEAST_APART_PX = 0.005
"""Readings whose vectors hardly differ are not told apart by the last digits of a matrix."""

CLOSE_MARGIN = 0.15
MOST_CLOSE = 8
"""Readings whose error is this share above the best one's are held against camera and depth."""


@dataclass(frozen=True, kw_only=True)
class StorageMeasurement:
    """What was measured; a part is empty where the files do not tell.

    Attributes:
        motion: ranked readings of the vectors, None without motion, pictures or two frames.
        repeated: frames with the picture of the frame before them, and vectors that move.
        resting: such frames whose vectors rest, as they should.
        by_geometry: the tied reading that camera and depth single out, if they do.
        jitter: whether vectors contain it.
        depth: ranked readings.
        median_depth: stored value that half of the surfaces lie below, None without depth.
        position_unit_m: metres in a unit of the position buffer.
        normal: packing and axes.
        sky: what is sky, None where neither depth nor normals tell.
        frames: numbers that were read.
    """

    motion: MotionFinding | None = None
    repeated: tuple[int, ...] = ()
    resting: tuple[int, ...] = ()
    by_geometry: MotionCandidate | None = None
    jitter: JitterFinding | None = None
    depth: DepthFinding = field(default_factory=DepthFinding)
    median_depth: float | None = None
    position_unit_m: float | None = None
    normal: NormalFinding | None = None
    sky: SkyFinding | None = None
    frames: tuple[int, ...] = ()

    @property
    def best(self) -> MotionCandidate | None:
        """The reading of motion that stands alone, None where several tie or none is good."""
        if self.motion is None or self.motion.best is None:
            return None
        if self.by_geometry is not None:
            return self.by_geometry
        return self.motion.best if len(self.motion.ties) == 1 else None


def measure_storage(
    reader: FrameReader, presumed: Conventions, *, motion: bool = True
) -> StorageMeasurement:
    """Read a few frames and measure.

    Args:
        reader: surveyed frames.
        presumed: conventions of the preset and the declarations, which take part as hypotheses.
        motion: whether vectors are of interest.

    Pixels that cannot be read are not reported here: the run that needs them will. Where not all
    files have pixels, nothing is measured.
    """
    measured = StorageMeasurement()
    for numbers in _choose_groups(reader):
        narrowed, stored = _read_group(reader, numbers)
        if not stored:
            continue
        candidate = run_single_threaded(
            partial(_measure_group, narrowed, stored, presumed, motion=motion)
        )
        if measured.motion is None or _measure_movement(candidate) > _measure_movement(measured):
            measured = candidate
        if not motion or _measure_movement(candidate) > LEAST_MOVING:
            break
    if measured.sky is not None and not (measured.sky.share or measured.sky.impossible):
        measured = replace(measured, sky=_look_elsewhere(reader, presumed) or measured.sky)
    return measured


def _look_elsewhere(reader: FrameReader, presumed: Conventions) -> SkyFinding | None:
    """What is sky in the first and the last frame, if they can be read."""
    own = [n for n in reader.numbers if n not in reader.held]
    ends = tuple(dict.fromkeys((own[0], own[-1])))
    buffers = reader.stored.intersection(SKY_BUFFERS)
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
    wanted = {Buffer.MOTION, Buffer.FORWARD, *SKY_BUFFERS, *PICTURES}
    buffers = wanted & reader.stored
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
) -> StorageMeasurement:
    measured = StorageMeasurement(frames=tuple(stored))
    if reader.stored & {Buffer.DEPTH, Buffer.NORMAL}:
        measured = replace(measured, sky=find_sky(list(stored.values()), presumed))
    if motion and len(stored) > 1 and _has_pictures(reader.stored):
        finding = _find_motion(reader, stored, presumed.motion)
        repeats = dict(_find_repeats(stored, reader.step, presumed.motion.zero))
        measured = replace(
            measured,
            motion=finding,
            repeated=tuple(n for n, moves in repeats.items() if moves),
            resting=tuple(n for n, moves in repeats.items() if not moves),
        )
    last = stored[max(stored)]
    camera = reader.cameras[max(stored)]
    if Buffer.DEPTH in last:
        measured = replace(measured, median_depth=find_median_depth(last[Buffer.DEPTH]))
    if Buffer.POSITION in last:
        unit = find_position_unit(last[Buffer.POSITION], camera, reader.view)
        measured = replace(measured, position_unit_m=None if unit is None else unit[0])
    if Buffer.NORMAL in last:
        measured = replace(measured, normal=find_normals(last[Buffer.NORMAL], camera, reader.view))
    return _add_geometry(reader, stored, presumed, measured)


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
    presumed: MotionConvention,
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
    return find_motion(frames, screen=reader.view.display, include=(presumed,), each=map_in_threads)


def _make_picture(buffer: Buffer, stored: Tensor) -> Tensor:
    """Radiance compressed, so that no highlight decides; whatever is not finite as 0."""
    finite = torch.where(torch.isfinite(stored), stored, torch.zeros_like(stored))
    return encode_reinhard(finite.clamp(min=0.0)) if buffer is Buffer.COLOR else finite


def _add_geometry(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    presumed: Conventions,
    measured: StorageMeasurement,
) -> StorageMeasurement:
    """Add what camera and depth say of depth, and of motion where pictures leave it tied."""
    if Buffer.DEPTH not in reader.stored or not reader.has_camera:
        return _add_jitter(reader, measured, presumed.motion)
    placed = _find_depth(reader, stored, presumed.depth, unit=measured.position_unit_m)
    finding = measured.motion
    ties = finding.ties if finding is not None else ()
    near = finding.candidates[:MOST_CLOSE] if finding is not None and ties else ()
    close = [c for c in near if c.margin < CLOSE_MARGIN]
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
    chosen = ranked[0] if clear else None
    along = moved[chosen or ties[0]] if ties else DepthFinding()
    depth = placed if placed.best is not None else along
    return _add_jitter(reader, replace(measured, by_geometry=chosen, depth=depth), presumed.motion)


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
