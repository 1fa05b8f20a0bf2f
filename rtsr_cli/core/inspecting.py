"""What a folder of frames holds, and what can be done with it: the survey behind `rtsr inspect`.

Nothing is raised for what is wrong with the frames: it becomes a problem with its remedy.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.exr import read_header
from rtsr_cli.core.io.guessing import guesses
from rtsr_cli.core.io.opening import ReadOptions, settled_set
from rtsr_cli.core.io.pairs import Inputs, PairSource, RealPairs, SimulatedPairs
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import ranges
from rtsr_cli.core.io.settling import Settled
from rtsr_cli.core.io.shots import FrameSet, Shot, Stream
from rtsr_cli.core.io.simulation import Simulation
from rtsr_cli.core.io.survey import Headers, missing_frames
from rtsr_cli.core.planning import system_inputs
from rtsr_cli.core.system import System, Task

MOST_FRAMES = 64
"""Frames whose pixels are looked at, evenly spaced, unless all are asked for."""

COARSE_STEP_PX = 0.25
"""Vectors stored in coarser steps than this have lost the sub-pixel part."""

HALF_STEP = 2.0**-11
"""Relative step of half precision: values of 0.5 to 1 are this far apart."""

ANY_SCALE = 2
"""Stands for the scale where readiness does not depend on it."""


@dataclass(frozen=True, kw_only=True)
class Statistics:
    """What the pixels of a buffer are, over the frames that were looked at, as stored.

    Attributes:
        low, high, median: of the finite values.
        nonfinite: frame -> number of NaN and Inf.
        zero: frames in which every value is 0.
    """

    low: float
    high: float
    median: float
    nonfinite: Mapping[int, int] = field(default_factory=dict)
    zero: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Readiness:
    """Whether a system can run.

    Attributes:
        ready: it can, in the way that `how` says.
        missing: what it lacks for that.
        how: options that it needs ("--simulate-lr S", "--scale S"), or nothing.
    """

    ready: bool
    missing: tuple[str, ...]
    how: str = ""


@dataclass(frozen=True, kw_only=True)
class SetInspection:
    """One resolution of a shot.

    Attributes:
        root: its folder.
        numbers: every frame number of any file sequence.
        channels: per file sequence, the names of all channels.
        unknown: those that no buffer takes.
        guessed: what unknown channels may be, by their names.
        missing: per file sequence, the frames that it lacks.
        settled: how it is read, None if it cannot be.
        statistics: of each buffer.
        looked_at: frames whose pixels were read.
        problems: what is wrong, each with its remedy.
    """

    root: Path
    numbers: tuple[int, ...]
    channels: Mapping[str, tuple[str, ...]]
    unknown: Mapping[str, tuple[str, ...]]
    guessed: Mapping[Buffer, tuple[str, ...]]
    missing: Mapping[str, list[int]]
    settled: Settled | None
    statistics: Mapping[Buffer, Statistics]
    looked_at: tuple[int, ...]
    problems: tuple[str, ...]

    @property
    def reader(self) -> FrameReader | None:
        """The reader, None if the frames cannot be read."""
        return None if self.settled is None else self.settled.reader


@dataclass(frozen=True, kw_only=True)
class ShotInspection:
    """A shot: its frames, the HR frames beside them, and which systems can run."""

    name: str
    root: Path
    main: SetInspection
    hr: SetInspection | None
    systems: Mapping[str, Readiness]


def inspect_shot(
    shot: Shot, root: Path, options: ReadOptions, *, systems: Iterable[System], every: bool
) -> ShotInspection:
    """Survey, measure and judge one shot.

    Args:
        shot: what was found.
        root: IN.
        options: how frames are read; holes in the numbering are always reported, never refused.
        systems: to judge.
        every: look at the pixels of every frame, however many there are.
    """
    main = _inspect_set(shot.frames, shot, root, options, every=every)
    hr = None
    if shot.hr is not None:
        hr = _inspect_set(shot.hr, shot, root, options, every=every)
    readiness = {s.name: _readiness(s, main, hr) for s in systems if s.task is Task.UPSCALE}
    return ShotInspection(name=shot.name, root=shot.root, main=main, hr=hr, systems=readiness)


def _inspect_set(
    frames: FrameSet, shot: Shot, root: Path, options: ReadOptions, *, every: bool
) -> SetInspection:
    headers, readable, problems = _headers(frames)
    channels = {
        key: tuple(sorted({c for h in by_number.values() for c in h.channels}))
        for key, by_number in headers.items()
    }
    settled, refusal = None, ""
    try:
        settled = settled_set(
            readable, shot, root, options, jittered=frames is not shot.hr, headers=headers
        )
    except RtsrError as error:
        refusal = str(error)
    problems += (refusal,) if refusal else ()
    found = SetInspection(
        root=frames.root,
        numbers=frames.numbers,
        channels=channels,
        unknown=channels,
        guessed=guesses(channels),
        missing={},
        settled=settled,
        statistics={},
        looked_at=(),
        problems=problems,
    )
    return found if settled is None else _with_pixels(found, frames, settled, every=every)


def _headers(frames: FrameSet) -> tuple[Headers, FrameSet, tuple[str, ...]]:
    """Headers of the readable files, the frame set of them, and what is wrong with the others."""
    headers: dict[str, dict[int, object]] = {}
    problems: list[str] = []
    streams: dict[str, Stream] = {}
    for key, stream in frames.streams.items():
        good = {}
        for number, path in stream.files.items():
            try:
                good[number] = read_header(path)
            except RtsrError as error:
                problems.append(str(error))
        if good:
            headers[key] = good  # type: ignore[assignment]
            kept = {n: p for n, p in stream.files.items() if n in good}
            streams[key] = replace(stream, files=kept)
    return headers, replace(frames, streams=streams), tuple(problems)  # type: ignore[return-value]


def _with_pixels(
    found: SetInspection, frames: FrameSet, settled: Settled, *, every: bool
) -> SetInspection:
    """Add gaps, unknown channels and the statistics of pixels; damaged files are no gaps."""
    reader = settled.reader
    bound: dict[str, set[str]] = {}
    for components in reader.binding.values():
        for c in components:
            bound.setdefault(c.stream, set()).add(c.channel)
    unknown = {
        key: tuple(n for n in names if n not in bound.get(key, ()))
        for key, names in found.channels.items()
    }
    unknown = {key: names for key, names in unknown.items() if names}
    missing = missing_frames(frames, sorted(bound), reader.step)
    looked_at = _chosen(reader.numbers, every=every)
    statistics, damaged = _statistics(reader, looked_at)
    problems = [*found.problems, *damaged]
    problems += [
        f"'{key}' lacks frames {ranges(lacking)}: render them, or use --on-missing skip|hold"
        for key, lacking in missing.items()
    ]
    problems += [*_pixel_problems(reader, statistics), *settled.warnings]
    problems += dict.fromkeys(t for t in (settled.undecided, settled.motion_undecided) if t)
    return replace(
        found,
        unknown=unknown,
        guessed={b: p for b, p in guesses(unknown).items() if b not in reader.binding},
        missing=missing,
        statistics=statistics,
        looked_at=looked_at,
        problems=tuple(problems),
    )


def _chosen(numbers: Sequence[int], *, every: bool) -> tuple[int, ...]:
    if every or len(numbers) <= MOST_FRAMES:
        return tuple(numbers)
    places = (round(i * (len(numbers) - 1) / (MOST_FRAMES - 1)) for i in range(MOST_FRAMES))
    return tuple(numbers[i] for i in places)


@dataclass
class _Running:
    """Statistics of a buffer while frames come in."""

    low: float = float("inf")
    high: float = float("-inf")
    medians: list[float] = field(default_factory=list)
    nonfinite: dict[int, int] = field(default_factory=dict)
    zero: list[int] = field(default_factory=list)

    def add(self, number: int, stored: Tensor) -> None:
        values = stored.flatten().float()
        finite = values[torch.isfinite(values)]
        if finite.numel() < values.numel():
            self.nonfinite[number] = values.numel() - finite.numel()
        if finite.numel():
            self.low = min(self.low, float(finite.amin()))
            self.high = max(self.high, float(finite.amax()))
            self.medians.append(float(finite.median()))
        if not bool(values.any()):
            self.zero.append(number)

    def result(self) -> Statistics:
        nothing = not self.medians
        return Statistics(
            low=0.0 if nothing else self.low,
            high=0.0 if nothing else self.high,
            median=0.0 if nothing else sorted(self.medians)[len(self.medians) // 2],
            nonfinite=self.nonfinite,
            zero=tuple(self.zero),
        )


def _statistics(
    reader: FrameReader, numbers: Sequence[int]
) -> tuple[dict[Buffer, Statistics], list[str]]:
    """Look at the pixels; frames that cannot be read are problems."""
    running = {buffer: _Running() for buffer in sorted(reader.stored)}
    damaged = []
    for number in numbers:
        try:
            stored = reader.read_raw(number, reader.stored)
        except RtsrError as error:
            damaged.append(str(error))
            continue
        for buffer, tensor in stored.items():
            running[buffer].add(number, tensor)
    return {buffer: r.result() for buffer, r in running.items()}, damaged


def _pixel_problems(reader: FrameReader, statistics: Mapping[Buffer, Statistics]) -> list[str]:
    problems = [
        f"{sum(s.nonfinite.values())} values of '{buffer}' are NaN or Inf in frames "
        f"{ranges(s.nonfinite)}: render them again, or use --on-nonfinite zero|inpaint"
        for buffer, s in statistics.items()
        if s.nonfinite and buffer is not Buffer.DEPTH
    ]
    motion = statistics.get(Buffer.MOTION)
    if motion is None:
        return problems
    if motion.low == motion.high == 0.0:
        problems.append(
            "motion is zero in every pixel of every frame: unless nothing moves, the motion pass "
            "was not rendered"
        )
    elif motion.zero and len(motion.zero) < len(reader.numbers):
        problems.append(
            f"motion is zero in every pixel of frames {ranges(motion.zero)}: still frames, or a "
            "pass that was not rendered there"
        )
    step = _motion_step_px(reader)
    if step > COARSE_STEP_PX:
        problems.append(
            f"motion is stored as half centred at {reader.conventions.motion.zero:g}: its steps "
            f"are {step:.2f} px, sub-pixel motion is lost; write it as float, or uncentred"
        )
    return problems


def _motion_step_px(reader: FrameReader) -> float:
    """Pixels between neighbouring stored values near the centre; 0 for float files."""
    convention = reader.conventions.motion
    if not convention.zero or Buffer.MOTION not in reader.binding:
        return 0.0
    component = reader.binding[Buffer.MOTION][0]
    place = (component.stream, component.channel)
    if reader.read_stored(reader.numbers[0], [place])[place].dtype != np.float16:
        return 0.0
    return (
        HALF_STEP * convention.zero * 2.0 * max(map(abs, convention.factors(reader.view.display)))
    )


def _readiness(system: System, main: SetInspection, hr: SetInspection | None) -> Readiness:
    if main.reader is None:
        return Readiness(ready=False, missing=("readable frames",))
    inputs = system_inputs(system, Inputs(lr=()))
    sources: list[tuple[str, PairSource]] = []
    if hr is not None and hr.reader is not None:
        sources.append(("", RealPairs(lr=main.reader, hr=hr.reader, scale=ANY_SCALE)))
    else:
        sources.append(("--scale S", RealPairs(lr=main.reader, hr=None, scale=ANY_SCALE)))
        simulation = Simulation(scale=ANY_SCALE)
        sources.append(
            ("--simulate-lr S", SimulatedPairs(capture=main.reader, simulation=simulation))
        )
    ways = [
        Readiness(ready=not m, missing=m, how=how)
        for how, s in sources
        for m in [s.missing(inputs)]
    ]
    return min(ways, key=lambda way: len(way.missing))
