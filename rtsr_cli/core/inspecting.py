"""What a folder of frames holds, and what can be done with it: the survey behind `rtsr inspect`.

Nothing is raised for what is wrong with the frames: it becomes a problem with its remedy.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.capture import Capture
from rtsr_cli.core.io.declarations import DeclarationFiles
from rtsr_cli.core.io.guessing import guesses
from rtsr_cli.core.io.misnamed_frames import find_misnamed
from rtsr_cli.core.io.opening import (
    OpenedShot,
    ReadOptions,
    check_channels,
    open_shot,
    settled_set,
)
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import ranges
from rtsr_cli.core.io.settling import Settled
from rtsr_cli.core.io.shots import FrameSet, Shot
from rtsr_cli.core.io.survey import HeaderFiles, Headers, missing_frames, read_readable
from rtsr_cli.core.pixel_survey import Statistics, doubts, nonfinite, statistics_of
from rtsr_cli.core.readiness import (
    Gravity,
    Problem,
    Readiness,
    Sources,
    alone,
    pairing,
    readiness,
)
from rtsr_cli.core.system import System

MOST_FRAMES = 64
"""Frames whose pixels are looked at, evenly spaced, unless all are asked for."""


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
    problems: tuple[Problem, ...]

    @property
    def reader(self) -> FrameReader | None:
        """The reader, None if the frames cannot be read."""
        return None if self.settled is None else self.settled.reader


@dataclass(frozen=True, kw_only=True)
class ShotInspection:
    """A shot: its frames, the HR frames beside them, and which systems can run.

    Attributes:
        name: path relative to IN.
        root: its folder.
        main: its frames.
        hr: the HR frames beside them, if there are any.
        systems: whether each can run.
        capture: what is declared about it; nothing where that cannot be read.
    """

    name: str
    root: Path
    main: SetInspection
    hr: SetInspection | None
    systems: Mapping[str, Readiness]
    capture: Capture = field(default_factory=Capture)

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Those of both resolutions."""
        return (*self.main.problems, *(self.hr.problems if self.hr is not None else ()))

    @property
    def gravity(self) -> Gravity:
        """The worst that a command with default options does about them; nothing may run at all."""
        if not any(system.ready for system in self.systems.values()):
            return Gravity.REFUSED
        return max((p.gravity for p in self.problems), default=Gravity.REMARK)


def inspect_shot(
    shot: Shot,
    root: Path,
    options: ReadOptions,
    *,
    systems: Iterable[System],
    every: bool,
    files: DeclarationFiles | None = None,
) -> ShotInspection:
    """Survey, measure and judge one shot.

    Args:
        shot: what was found.
        root: IN.
        options: how frames are read; holes in the numbering are always reported, never refused.
        systems: to judge.
        every: look at the pixels of every frame, however many there are.
        files: declarations below IN, as far as they are read already.
    """
    headers = HeaderFiles()
    try:
        opened: OpenedShot | RtsrError = open_shot(
            shot, root, options, files=files, headers=headers
        )
    except RtsrError as error:
        opened = error
    surveyed = [_surveyed(s, headers) for s in (shot.frames, shot.hr) if s is not None]
    capture, wrong = _declarations(opened, surveyed)
    main, *others = [
        _inspect_set(one, opened, lr=i == 0, every=every) for i, one in enumerate(surveyed)
    ]
    main = replace(main, problems=_once((*wrong, *main.problems)))
    hr = others[0] if others else None
    sources: Sources = []
    if main.reader is not None and hr is None:
        sources = alone(main.reader, capture.scale)
    elif main.reader is not None and hr is not None and hr.reader is not None:
        sources, apart = pairing(main.reader, hr.reader, capture.scale)
        hr = replace(hr, problems=_once((*hr.problems, *apart)))
    found = ShotInspection(
        name=shot.name, root=shot.root, main=main, hr=hr, systems={}, capture=capture
    )
    ready = {
        s.name: readiness(s, sources, found.problems)
        for s in systems
        if s.task is SystemTask.UPSCALE
    }
    return replace(found, systems=ready)


def refused(root: Path, message: str, systems: Iterable[System]) -> ShotInspection:
    """Inspect a folder in which not even shots can be found."""
    problem = Problem(text=message, gravity=Gravity.REFUSED)
    main = _nothing_known(FrameSet(root=root, streams={}), {}, [problem])
    ready = {s.name: readiness(s, [], [problem]) for s in systems if s.task is SystemTask.UPSCALE}
    return ShotInspection(name=".", root=root, main=main, hr=None, systems=ready)


@dataclass(frozen=True, kw_only=True)
class _Surveyed:
    """One resolution before it is known how it is read.

    Attributes:
        frames: every file.
        readable: those whose headers can be read.
        headers: of those.
        problems: what is wrong with the others.
    """

    frames: FrameSet
    readable: FrameSet
    headers: Headers
    problems: tuple[Problem, ...]


def _declarations(
    opened: OpenedShot | RtsrError, surveyed: Iterable[_Surveyed]
) -> tuple[Capture, tuple[Problem, ...]]:
    """What the user declares, and what of it is not so."""
    if isinstance(opened, RtsrError):
        return Capture(), (_refusal(opened, "a valid capture.toml"),)
    try:
        check_channels(opened, [one.readable for one in surveyed])
    except RtsrError as error:
        return opened.declarations.capture, (_refusal(error, "the declared channels"),)
    return opened.declarations.capture, ()


def _refusal(error: RtsrError, lacks: str = "readable frames") -> Problem:
    return Problem(text=str(error), gravity=Gravity.REFUSED, lacks=lacks)


def _once(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    return tuple({p.text: p for p in reversed(list(problems))}.values())[::-1]


def _nothing_known(
    frames: FrameSet, headers: Headers, problems: Iterable[Problem]
) -> SetInspection:
    """All that is known of frames before it is known how they are read."""
    channels = {
        key: tuple(sorted({c for h in by_number.values() for c in h.channels}))
        for key, by_number in headers.items()
    }
    return SetInspection(
        root=frames.root,
        numbers=frames.numbers,
        channels=channels,
        unknown=channels,
        guessed=guesses(channels),
        missing={},
        settled=None,
        statistics={},
        looked_at=(),
        problems=tuple(problems),
    )


def _inspect_set(
    surveyed: _Surveyed, opened: OpenedShot | RtsrError, *, lr: bool, every: bool
) -> SetInspection:
    headers, problems = surveyed.headers, surveyed.problems
    found = _nothing_known(surveyed.frames, headers, problems)
    if not headers:
        return found
    try:
        if isinstance(opened, RtsrError):
            raise opened
        settled = settled_set(surveyed.readable, opened, jittered=lr, headers=headers)
    except RtsrError as error:
        return replace(found, problems=(*problems, _refusal(error, "a known layout")))
    if not lr and settled.undecided == settled.motion_undecided:
        # of HR frames beside LR ones commands read no vectors
        settled = replace(settled, undecided="")
    return _with_pixels(replace(found, settled=settled), surveyed.frames, settled, every=every)


def _surveyed(frames: FrameSet, files: HeaderFiles) -> _Surveyed:
    """Headers of the readable files, the frame set of them, and what is wrong with the others."""
    wrong = find_misnamed(frames)
    right = {
        key: {n: path for n, path in stream.files.items() if path not in wrong}
        for key, stream in frames.streams.items()
    }
    every, errors = read_readable(_of_files(frames, right), files)
    headers = {key: by_number for key, by_number in every.items() if by_number}
    good = {key: {n: right[key][n] for n in by_number} for key, by_number in headers.items()}
    readable = _of_files(frames, good)
    problems = [Problem(text=text, gravity=Gravity.REFUSED) for text in wrong.values()]
    problems += [_refusal(error) for error in errors]
    return _Surveyed(frames=frames, readable=readable, headers=headers, problems=tuple(problems))


def _of_files(frames: FrameSet, files: Mapping[str, Mapping[int, Path]]) -> FrameSet:
    """Return a frame set of some of its files."""
    streams = {key: replace(frames.streams[key], files=held) for key, held in files.items()}
    return replace(frames, streams=streams)


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
    statistics, damaged = statistics_of(reader, looked_at)
    holes = (
        f"'{key}' lacks frames {ranges(lacking)}: render them, or use --on-missing skip|hold"
        for key, lacking in missing.items()
    )
    unsettled = Problem(text=settled.undecided, gravity=Gravity.REFUSED, lacks="a named layout")
    remarks = [*doubts(reader, statistics), *settled.warnings]
    remarks += [settled.motion_undecided] if settled.motion_undecided else []
    problems = [
        *found.problems,
        *(Problem(text=text, gravity=Gravity.PIXELS) for text in damaged),
        *(Problem(text=text, gravity=Gravity.HOLES) for text in holes),
        *(Problem(text=text, gravity=Gravity.PIXELS) for text in nonfinite(statistics)),
        *([unsettled] if settled.undecided else []),
        *(Problem(text=text) for text in remarks),
    ]
    return replace(
        found,
        unknown=unknown,
        guessed={b: p for b, p in guesses(unknown).items() if b not in reader.binding},
        missing=missing,
        statistics=statistics,
        looked_at=looked_at,
        problems=_once(problems),
    )


def _chosen(numbers: Sequence[int], *, every: bool) -> tuple[int, ...]:
    if every or len(numbers) <= MOST_FRAMES:
        return tuple(numbers)
    places = (round(i * (len(numbers) - 1) / (MOST_FRAMES - 1)) for i in range(MOST_FRAMES))
    return tuple(numbers[i] for i in places)
