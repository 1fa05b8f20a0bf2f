"""What a folder of frames holds, and what can be done with it: the survey behind `rtsr inspect`.

Nothing is raised for what is wrong with the frames: it becomes a problem with its remedy.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rtsr_cli.core.captures.cameras import find_side_car
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.channel_guesses import (
    guess_buffers,
    guess_material,
    list_named,
)
from rtsr_cli.core.captures.declarations import DeclarationFiles
from rtsr_cli.core.captures.frame_numbers import list_missing_frames
from rtsr_cli.core.captures.guess_checks import check_guesses, choose_files
from rtsr_cli.core.captures.header_files import HeaderFiles, Headers, read_readable
from rtsr_cli.core.captures.layers import bind_layers, join_layer
from rtsr_cli.core.captures.likely_channels import (
    find_base_colour,
    guess_further,
    list_bound,
    list_unknown,
)
from rtsr_cli.core.captures.measuring.camera_decision import share_verdicts
from rtsr_cli.core.captures.measuring.decision import describe_unmet
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.captures.misnamed_frames import list_misnamed
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shared_warnings import join_warnings
from rtsr_cli.core.captures.shots import REFERENCE_FOLDER, FrameSet, Shot
from rtsr_cli.core.captures.unrendered_frames import list_partial_streams, take_first
from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.errors import LayerChoiceError, RtsrError
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.gaps import format_gaps
from rtsr_cli.core.inspect.checked_commands import CheckedCommand, ShotSources, judge_commands
from rtsr_cli.core.inspect.fixes import Fix, Hints, list_fixes
from rtsr_cli.core.inspect.lossy_buffers import LossyBuffer, describe_lossy, find_lossy_buffers
from rtsr_cli.core.inspect.pixel_statistics import (
    PixelStatistics,
    describe_negative,
    describe_nonfinite,
    list_doubts,
    measure_statistics,
)
from rtsr_cli.core.inspect.readiness import (
    Severity,
    ShotProblem,
    Sources,
    SystemReadiness,
    lacks_radiance,
    list_single_sources,
    match_resolutions,
)
from rtsr_cli.core.pairs.opening import (
    OpenedShot,
    ReadOptions,
    check_channels,
    leave_out_absent,
    measure_set,
    open_shot,
    survey_set,
)
from rtsr_cli.core.pairs.real_pairs import open_real_pairs
from rtsr_cli.core.pairs.sources import NAMED_LAYOUT

NEEDS_NO_RADIANCE = "extrapolate needs none there"
"""Said of radiance that some frames lack."""

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
        material: how unknown channels may add up to material; empty if nothing speaks for it.
        missing: per file sequence, the frames that it lacks.
        layers: names of the layers and views that the files hold; empty where they name none.
        settled: how it is read, None if it cannot be.
        known_layout: name of the layout that fits frames which are refused for another reason.
        in_time: how it is read where frames that hold no radiance count as others; None where all
            hold some.
        statistics: of each buffer.
        looked_at: frames whose pixels were read.
        lossy: buffers of numbers that are compressed with losses.
        problems: what is wrong, each with its remedy.
    """

    root: Path
    numbers: tuple[int, ...]
    channels: Mapping[str, tuple[str, ...]]
    unknown: Mapping[str, tuple[str, ...]]
    guessed: Mapping[Buffer, tuple[str, ...]]
    missing: Mapping[str, list[range]]
    settled: MeasuredReader | None
    statistics: Mapping[Buffer, PixelStatistics]
    looked_at: tuple[int, ...]
    problems: tuple[ShotProblem, ...]
    layers: tuple[str, ...] = ()
    material: str = ""
    lossy: Mapping[str, LossyBuffer] = field(default_factory=dict)
    in_time: FrameReader | None = None
    known_layout: str = ""

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
        commands: by command, whether each of its systems or parts can run.
        fixes: lines that would provide what is missing.
        capture: what is declared about it; nothing where that cannot be read.
        filter_width_px: standard deviation of the pixel filter that went over LR radiance and not
            over its G-buffer, LR pixels; 0 of point samples, None where that is not known.
        filter_measured: whether that was measured, and is not 0.
    """

    name: str
    root: Path
    main: SetInspection
    hr: SetInspection | None
    commands: Mapping[str, Mapping[str, SystemReadiness]]
    fixes: tuple[Fix, ...] = ()
    capture: CaptureDeclaration = field(default_factory=CaptureDeclaration)
    filter_width_px: float | None = None
    filter_measured: bool = False

    @property
    def systems(self) -> Mapping[str, SystemReadiness]:
        """Whether each system that upscales can run."""
        return self.commands.get(SystemTask.UPSCALE.value, {})

    @property
    def problems(self) -> tuple[ShotProblem, ...]:
        """Those of both resolutions."""
        return (*self.main.problems, *(self.hr.problems if self.hr is not None else ()))

    @property
    def gravity(self) -> Severity:
        """The worst that a command with default options does about them; nothing may run at all.

        Frames without radiance are right for what predicts them, unless HR frames lie beside: those
        are there for `upscale`, which refuses.
        """
        in_time = self.commands.get(SystemTask.EXTRAPOLATE.value, {})
        predictable = self.main.in_time is not None and self.hr is None
        problems = self.problems
        if predictable and any(system.ready for system in in_time.values()):
            problems = tuple(p for p in problems if not p.radiance)
        elif not any(system.ready for system in self.systems.values()):
            return Severity.REFUSED
        return max((p.gravity for p in problems), default=Severity.REMARK)


def inspect_shot(
    shot: Shot,
    root: Path,
    options: ReadOptions,
    *,
    commands: Sequence[CheckedCommand],
    every: bool,
    files: DeclarationFiles | None = None,
) -> ShotInspection:
    """Survey, measure and judge one shot.

    Args:
        shot: what was found.
        root: IN.
        options: how frames are read; holes in the numbering are always reported, never refused.
        commands: to judge.
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
    surveyed = [_survey_headers(s, headers) for s in (shot.frames, shot.hr) if s is not None]
    capture, wrong = _read_declarations(opened, surveyed)
    if wrong and not isinstance(opened, RtsrError):
        # said once, as what is wrong, and of the rest of the frames nothing more by it
        opened = leave_out_absent(opened, [one.readable for one in surveyed])
    main = _inspect_set(surveyed[0], opened, every=every)
    others = [_inspect_set(s, opened, every=every, beside=main) for s in surveyed[1:]]
    main = replace(main, problems=_drop_repeats((*wrong, *main.problems)))
    hr = others[0] if others else None
    if hr is not None:
        main, hr = _settle_cameras(main, hr, capture.scale)
    sources: Sources = []
    if main.reader is not None and hr is None:
        sources = list_single_sources(main.reader, capture.scale)
    elif main.reader is not None and hr is not None and hr.reader is not None:
        sources, apart = match_resolutions(main.reader, hr.reader, capture.scale, hr.numbers)
        hr = replace(hr, problems=_drop_repeats((*hr.problems, *apart)))
    inspection = ShotInspection(
        name=shot.name, root=shot.root, main=main, hr=hr, commands={}, capture=capture
    )
    if hr is not None and sources:
        (_, pairs), *_ = sources
        inspection = replace(
            inspection,
            filter_width_px=pairs.filter_width_px,
            filter_measured=pairs.filter_measured,
        )
        texts = (pairs.filter_doubt, pairs.misfit, pairs.misfit_doubt)
        doubts = [ShotProblem(text=text) for text in texts if text]
        main = replace(main, problems=_drop_repeats((*main.problems, *doubts)))
        inspection = replace(inspection, main=main)
    known = ShotSources(
        main=main.reader,
        in_time=main.in_time,
        hr=None if hr is None else hr.reader,
        enlarged=sources,
        referenced=is_folder(shot.root / REFERENCE_FOLDER),
    )
    ready = judge_commands(commands, known, inspection.problems)
    fixes = list_fixes(ready, _list_hints(shot.root, main, hr, capture))
    return _join_remarks(replace(inspection, commands=ready, fixes=fixes))


def _join_remarks(inspection: ShotInspection) -> ShotInspection:
    """Say once, of the frames that lead, what is remarked on both sizes alike."""
    main, hr = inspection.main, inspection.hr
    if hr is None:
        return inspection
    remarks = {
        one.root: [p.text for p in one.problems if p.gravity is Severity.REMARK]
        for one in (main, hr)
    }
    joined = join_warnings(remarks)
    alone = {(root, text) for roots, text in joined for root in roots if len(roots) == 1}
    shared = tuple(
        ShotProblem(text=f"{main.root.name} and {hr.root.name}: {text}")
        for roots, text in joined
        if len(roots) > 1
    )
    main_only, hr_only = (
        tuple(
            p
            for p in one.problems
            if p.gravity is not Severity.REMARK or (one.root, p.text) in alone
        )
        for one in (main, hr)
    )
    return replace(
        inspection,
        main=replace(main, problems=(*main_only, *shared)),
        hr=replace(hr, problems=hr_only),
    )


def _settle_cameras(
    main: SetInspection, hr: SetInspection, scale: int | None
) -> tuple[SetInspection, SetInspection]:
    """Read the cameras of both resolutions as commands do, and say where they differ."""
    if main.settled is None or hr.settled is None:
        return main, hr
    lr, target = main.settled.reader, hr.settled.reader
    lr_reader, hr_reader = share_verdicts(lr, target, lambda: _read_misfit(lr, target, scale))
    said = (t for t in hr_reader.warnings if t not in target.warnings)
    kept = hr.problems
    if hr_reader.camera_unfit != target.camera_unfit and target.camera_unfit:
        kept = tuple(p for p in kept if target.camera_unfit not in p.text)
    problems = _drop_repeats((*kept, *(ShotProblem(text=text) for text in said)))
    return (
        replace(main, settled=replace(main.settled, reader=lr_reader)),
        replace(hr, settled=replace(hr.settled, reader=hr_reader), problems=problems),
    )


def _read_misfit(lr: FrameReader, hr: FrameReader, scale: int | None) -> str:
    """How HR's pixels are none of LR's; empty if they are, or cannot be compared."""
    try:
        return open_real_pairs(lr, hr, scale, skip_missing=True).misfit
    except RtsrError:
        return ""


def _list_hints(
    root: Path, main: SetInspection, hr: SetInspection | None, capture: CaptureDeclaration
) -> Hints:
    """What is known that may stand for what is missing; of the frames that lead first."""
    sets = [one for one in (main, hr) if one is not None]
    guessed = {b: places for one in reversed(sets) for b, places in one.guessed.items()}
    layers = tuple(dict.fromkeys(name for one in sets for name in one.layers))
    material = next((one.material for one in sets if one.material), "")
    settled = main.settled
    settled_sets = [one.settled for one in sets]
    layout = settled.reader.layout.name if settled is not None and settled.undecided else ""
    found = (one.settled.measured.camera for one in sets if one.settled is not None)
    camera = next((one.declared for one in found if one is not None and one.declared), "")
    return Hints(
        guessed=guessed,
        layers=layers,
        layout=layout,
        named=frozenset(b for one in sets for b in list_named(one.unknown)),
        material=material,
        base_colour=_describe_base_colour(settled, main),
        divided=any(
            s is not None and Buffer.MATERIAL in s.reader.stored | s.reader.lacking.keys()
            for s in settled_sets
        ),
        camera=camera,
        side_car=capture.camera.file or "",
        undeclared="" if capture.camera.file else find_side_car(root),
    )


def _describe_base_colour(settled: MeasuredReader | None, main: SetInspection) -> str:
    """What base colour is made of, where it is all that is known of material; else empty."""
    if settled is None or settled.measured.camera is not None:
        return ""
    return find_base_colour(settled.reader, main.guessed)


def inspect_refused_folder(
    root: Path, message: str, commands: Sequence[CheckedCommand]
) -> ShotInspection:
    """Inspect a folder in which not even shots can be found."""
    problem = ShotProblem(text=message, gravity=Severity.REFUSED)
    main = _inspect_unread_set(FrameSet(root=root, streams={}), {}, [problem])
    nothing = ShotSources(main=None, hr=None, enlarged=[])
    ready = judge_commands(commands, nothing, [problem])
    return ShotInspection(name=".", root=root, main=main, hr=None, commands=ready)


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
    problems: tuple[ShotProblem, ...]


def _read_declarations(
    opened: OpenedShot | RtsrError, surveyed: Iterable[_Surveyed]
) -> tuple[CaptureDeclaration, tuple[ShotProblem, ...]]:
    """What the user declares, and what of it is not so."""
    if isinstance(opened, RtsrError):
        return CaptureDeclaration(), (_make_problem(opened, "a valid capture.toml"),)
    try:
        check_channels(opened, [one.readable for one in surveyed])
    except RtsrError as error:
        return opened.declarations.capture, (_make_problem(error, "the declared channels"),)
    return opened.declarations.capture, ()


def _make_problem(error: RtsrError, lacks: str = "readable frames") -> ShotProblem:
    return ShotProblem(text=str(error), gravity=Severity.REFUSED, lacks=lacks)


def _drop_repeats(problems: Iterable[ShotProblem]) -> tuple[ShotProblem, ...]:
    return tuple({p.text: p for p in reversed(list(problems))}.values())[::-1]


def _inspect_unread_set(
    frames: FrameSet, headers: Headers, problems: Iterable[ShotProblem]
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
        guessed={},
        missing={},
        settled=None,
        statistics={},
        looked_at=(),
        problems=tuple(problems),
    )


def _inspect_set(
    surveyed: _Surveyed,
    opened: OpenedShot | RtsrError,
    *,
    every: bool,
    beside: SetInspection | None = None,
) -> SetInspection:
    """Inspect the frames that lead, or the HR frames beside those."""
    lr = beside is None
    headers, problems = surveyed.headers, surveyed.problems
    inspection = _inspect_unread_set(surveyed.frames, headers, problems)
    if not headers:
        return inspection
    in_time = _measure_in_time(surveyed, opened) if lr else None
    inspection = replace(inspection, in_time=None if in_time is None else in_time.reader)
    try:
        if isinstance(opened, RtsrError):
            raise opened
        settled = measure_set(
            surveyed.readable,
            opened,
            jittered=lr,
            headers=headers,
            beside=None if beside is None else beside.settled,
        )
    except LayerChoiceError as error:
        problem = _make_problem(error, "a choice of layer")
        return replace(inspection, layers=error.layers, problems=(*problems, problem))
    except RtsrError as error:
        if in_time is not None:
            problem = ShotProblem(
                text=f"{error} ({NEEDS_NO_RADIANCE})",
                gravity=Severity.REFUSED,
                lacks=lacks_radiance(in_time.reader),
                radiance=True,
            )
            inspection = replace(inspection, settled=in_time, problems=(*problems, problem))
            return _with_pixels(inspection, surveyed.frames, in_time, every=every)
        known = _find_layout(surveyed, opened)
        if known:
            # the names are understood; what is wrong stands in the problem
            problems = (*problems, _make_problem(error))
            return replace(inspection, known_layout=known, problems=problems)
        problem = _make_problem(error, "a known layout")
        return _guess_unread(replace(inspection, problems=(*problems, problem)), surveyed)
    if not lr and settled.undecided == settled.motion_undecided:
        # of HR frames beside LR ones commands read no vectors
        settled = replace(settled, undecided="", reader=replace(settled.reader, undecided=""))
    return _with_pixels(replace(inspection, settled=settled), surveyed.frames, settled, every=every)


def _find_layout(surveyed: _Surveyed, opened: OpenedShot | RtsrError) -> str:
    """Name of the layout of one frame's channels; empty where none, or a declaration, fits."""
    if isinstance(opened, RtsrError):
        return ""
    known, options = opened.declarations, opened.options
    layer = join_layer(options.layer or known.capture.layer, options.view or known.capture.view)
    first = take_first(surveyed.headers)
    try:
        bound = bind_layers(known.layout, known.capture, first, str(surveyed.frames.root), layer)
    except RtsrError:
        return ""
    return bound.layout.name


def _measure_in_time(surveyed: _Surveyed, opened: OpenedShot | RtsrError) -> MeasuredReader | None:
    """Take frames without radiance as others; None where all hold some, or nothing can be read."""
    if isinstance(opened, RtsrError):
        return None
    opened = replace(opened, options=replace(opened.options, unrendered=True))
    try:
        reader = survey_set(surveyed.readable, opened, jittered=True, headers=surveyed.headers)
        if not reader.unrendered:
            return None
        return measure_set(surveyed.readable, opened, jittered=True, headers=surveyed.headers)
    except RtsrError:
        return None


def _guess_unread(inspection: SetInspection, surveyed: _Surveyed) -> SetInspection:
    """Add what the channels may be of frames that cannot be read as they are."""
    check = check_guesses(choose_files(surveyed.readable, surveyed.headers))
    return replace(
        inspection,
        guessed=guess_buffers(inspection.channels, check),
        material=guess_material(inspection.channels, check),
    )


def _survey_headers(frames: FrameSet, files: HeaderFiles) -> _Surveyed:
    """Headers of the readable files, the frame set of them, and what is wrong with the others."""
    wrong = list_misnamed(frames)
    right = {
        key: {n: path for n, path in stream.files.items() if path not in wrong}
        for key, stream in frames.streams.items()
    }
    every, errors = read_readable(_list_of_files(frames, right), files)
    headers = {key: by_number for key, by_number in every.items() if by_number}
    good = {key: {n: right[key][n] for n in by_number} for key, by_number in headers.items()}
    readable = _list_of_files(frames, good)
    problems = [ShotProblem(text=text, gravity=Severity.REFUSED) for text in wrong.values()]
    problems += [_make_problem(error) for error in errors]
    return _Surveyed(frames=frames, readable=readable, headers=headers, problems=tuple(problems))


def _list_of_files(frames: FrameSet, files: Mapping[str, Mapping[int, Path]]) -> FrameSet:
    """Return a frame set of some of its files."""
    streams = {key: replace(frames.streams[key], files=held) for key, held in files.items()}
    return replace(frames, streams=streams)


def _with_pixels(
    inspection: SetInspection, frames: FrameSet, settled: MeasuredReader, *, every: bool
) -> SetInspection:
    """Add gaps, unknown channels and the statistics of pixels; damaged files are no gaps."""
    reader = settled.reader
    unknown = list_unknown(reader)
    check = check_guesses(choose_files(reader.frames, reader.channels), reader.stored)
    missing = list_missing_frames(frames, sorted(list_bound(reader)), reader.step)
    partial = list_partial_streams(reader.binding) if inspection.in_time is not None else ()
    looked_at = _choose_numbers(reader.numbers, every=every)
    statistics, damaged = measure_statistics(reader, looked_at)
    holes = (
        ShotProblem(
            text=f"'{key}' lacks {_say_gaps(lacking)}, or use --on-missing skip|hold"
            + (f" ({NEEDS_NO_RADIANCE})" if key in partial else ""),
            gravity=Severity.HOLES,
            radiance=key in partial,
        )
        for key, lacking in missing.items()
    )
    # radiance needs no proof
    gravity = Severity.REMARK if Buffer.COLOR in reader.stored else Severity.REFUSED
    unsettled = ShotProblem(text=settled.undecided, gravity=gravity, lacks=NAMED_LAYOUT)
    lossy = find_lossy_buffers(reader, unknown, looked_at)
    remarks = [*describe_lossy(lossy), *describe_negative(statistics)]
    remarks += [*list_doubts(reader, statistics), *settled.warnings]
    remarks += [settled.motion_undecided] if settled.motion_undecided else []
    remarks += describe_unmet(reader)
    problems = [
        *inspection.problems,
        *(ShotProblem(text=text, gravity=Severity.PIXELS) for text in damaged),
        *holes,
        *(
            ShotProblem(text=text, gravity=Severity.PIXELS)
            for text in describe_nonfinite(reader, statistics)
        ),
        *([unsettled] if settled.undecided else []),
        *(ShotProblem(text=text) for text in remarks),
    ]
    return replace(
        inspection,
        layers=reader.layers,
        unknown=unknown,
        guessed=guess_further(reader, unknown, check),
        material=""
        if Buffer.MATERIAL in reader.stored | reader.lacking.keys()
        else guess_material(unknown, check),
        missing=missing,
        statistics=statistics,
        looked_at=looked_at,
        lossy=lossy,
        problems=_drop_repeats(problems),
    )


def _say_gaps(lacking: Sequence[range]) -> str:
    # of stray numbers they are more than `len` can say
    one = sum(gap.stop - gap.start for gap in lacking) == 1
    return f"frame{'' if one else 's'} {format_gaps(lacking)}: render {'it' if one else 'them'}"


def _choose_numbers(numbers: Sequence[int], *, every: bool) -> tuple[int, ...]:
    if every or len(numbers) <= MOST_FRAMES:
        return tuple(numbers)
    places = (round(i * (len(numbers) - 1) / (MOST_FRAMES - 1)) for i in range(MOST_FRAMES))
    return tuple(numbers[i] for i in places)
