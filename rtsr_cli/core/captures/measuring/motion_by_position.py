"""Proving how vectors are stored by world positions: still surfaces move by exactly so much.

A surface that does not move, whose world position is known, is projected into both frames by
cameras that positions have verified; the right reading of the vectors says the same of most pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.geometry_finder import (
    ThinnedFrame,
    measure_offset_error,
    project_points,
)
from rtsr_cli.core.captures.measuring.motion_finder import find_centre
from rtsr_cli.core.captures.measuring.motion_hypotheses import list_hypotheses
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.vector_length import vector_length
from rtsr_cli.core.shapes import MotionPx

MOST_PIXELS = 1 << 11

LEAST_MOVED_PX = 0.05
"""Where the camera moves things by less, vectors are not told apart."""

LIMIT_PX, LIMIT_SHARE = 0.1, 0.02
"""The right reading differs by less than this, and this share of what moves."""

CLEAR = 4.0
"""All other readings differ this many times more."""


@dataclass(frozen=True)
class _MovedFrame:
    """Vectors as stored, and exact motion to the neighbours, on the same thinned pixels."""

    stored: Mapping[int, Tensor]
    exact: Mapping[int, MotionPx]
    valid: Tensor
    thinned: int


def prove_motion(
    reader: FrameReader,
    stored: Mapping[int, Mapping[Buffer, Tensor]],
    unit_m: float,
    presumed: MotionConvention,
) -> MotionConvention | None:
    """Return the one reading that world positions leave, None where they leave several or none.

    Args:
        reader: of the frames; its cameras are verified.
        stored: buffers of consecutive frames, as stored.
        unit_m: metres in a unit of the positions.
        presumed: takes part beside the usual readings.
    """
    frames = {n: _move_frame(reader, stored, n, unit_m) for n in stored}
    moved = [
        float(vector_length(exact)[frame.valid].median()) * frame.thinned
        for frame in frames.values()
        for exact in frame.exact.values()
        if bool(frame.valid.any())
    ]
    if not moved or max(moved) < LEAST_MOVED_PX:
        return None
    vectors = torch.cat([b[Buffer.MOTION].nan_to_num().flatten() for b in stored.values()])
    tried = list(dict.fromkeys((presumed, *list_hypotheses(find_centre(vectors)))))
    errors = [_measure_reading(reader, frames, reading) for reading in tried]
    best = min(errors)
    if best > LIMIT_PX + LIMIT_SHARE * max(moved):
        return None
    close = [r for r, e in zip(tried, errors, strict=True) if e <= max(CLEAR * best, best + 0.02)]
    return _choose(close)


def _choose(close: Sequence[MotionConvention]) -> MotionConvention | None:
    """The reading that is left; of several that differ in the file alone, that of the own file."""
    own = [r for r in close if not r.file_offset]
    left = own or close
    return left[0] if len(left) == 1 else None


def _move_frame(
    reader: FrameReader, stored: Mapping[int, Mapping[Buffer, Tensor]], number: int, unit_m: float
) -> _MovedFrame:
    position = stored[number][Buffer.POSITION]
    thinning = ThinnedFrame.of(position, MOST_PIXELS)
    world, view = thinning.image(position) * unit_m, thinning.view(reader.view)
    valid = torch.isfinite(world).all(1, keepdim=True) & (vector_length(world) > 0)
    now = project_points(world, reader.cameras[number], view)
    exact = {}
    for offset in (-reader.step, reader.step):
        other = number + offset
        if other not in reader.numbers or now is None:
            continue
        then = project_points(world, reader.cameras[other], view)
        if then is not None:
            exact[offset] = then - now
    sources = {o: number + o for o in (-reader.step, 0, reader.step) if number + o in stored}
    vectors = {o: thinning.image(stored[n][Buffer.MOTION]) for o, n in sources.items()}
    return _MovedFrame(stored=vectors, exact=exact, valid=valid, thinned=thinning.k)


def _measure_reading(
    reader: FrameReader, frames: Mapping[int, _MovedFrame], reading: MotionConvention
) -> float:
    """Mean of the frames' median differences, pixels; infinite where no frame can tell."""
    errors = []
    leads = reader.step if reading.direction.to_next else -reader.step
    source = reading.file_offset * reader.step
    for frame in frames.values():
        if source not in frame.stored or leads not in frame.exact:
            continue
        vectors = reading.pixels(frame.stored[source], reader.view.display, dim=1) / frame.thinned
        apart = vectors - frame.exact[leads]
        error = measure_offset_error(apart, frame.valid, frame.thinned)
        if error is not None:
            errors.append(error * frame.thinned)
    return sum(errors) / len(errors) if errors else float("inf")
