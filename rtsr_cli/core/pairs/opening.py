"""From a folder and what the user chose to checked readers and pairs, shot by shot.

What is declared about a shot, its layout and its folders are resolved once (`open_shot`); the
result goes to whatever reads frames of the shot.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from rtsr_cli.core.captures.channel_matching import Streams
from rtsr_cli.core.captures.declarations import DeclarationFiles, Declarations, list_folder_patterns
from rtsr_cli.core.captures.header_files import (
    HeaderFiles,
    Headers,
    read_headers,
    read_readable,
)
from rtsr_cli.core.captures.layers import join_layer, list_plain_names
from rtsr_cli.core.captures.layout_files import check_declared, list_absent
from rtsr_cli.core.captures.lent_motion import lend_motion
from rtsr_cli.core.captures.measuring.decision import measure_and_decide, require_decision
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.captures.misnamed_frames import list_misnamed
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import (
    HR_FOLDER,
    LR_FOLDER,
    FrameSet,
    Shot,
    collect_frame_set,
    find_shots,
    refuse_among,
)
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.captures.surveyed import list_needed
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import Selection
from rtsr_cli.core.pairs.file_faults import naming_every_fault
from rtsr_cli.core.pairs.real_pairs import (
    RealPairs,
    describe_unpaired,
    open_real_pairs,
    settle_cameras,
)
from rtsr_cli.core.pairs.simulated_pairs import open_simulated_pairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.wording import say_missing


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How frames are read.

    Attributes:
        layout: preset or layout file, or None to detect it.
        layer: layer or view that is read, in place of what capture.toml says.
        view: stereo view that is read, likewise.
        capture: file in place of each shot's capture.toml.
        on_missing: what holes in the numbering mean.
        output: where frames will be written; it must not lie where they would be taken for inputs.
        sharded: whether other runs write other parts of the same shots.
        selection: frames that will be written; of those that no output of theirs depends on, no
            header need be read.
        unrendered: whether frames may hold no radiance.
        needed: buffers without which a frame is left out; of others that some frames lack, nothing
            is read.
    """

    layout: str | None = None
    layer: str | None = None
    view: str | None = None
    capture: Path | None = None
    on_missing: MissingPolicy = MissingPolicy.ERROR
    output: Path | None = None
    sharded: bool = False
    selection: Selection = field(default_factory=Selection)
    unrendered: bool = False
    needed: frozenset[Buffer] = frozenset()


@dataclass(frozen=True, kw_only=True)
class OpenedShot:
    """A shot, and what is declared about it, resolved once for all that read its frames.

    Attributes:
        shot: its files.
        options: how frames are read.
        declarations: capture.toml, cameras and layout.
        headers: of its files, as far as they are read already.
    """

    shot: Shot
    options: ReadOptions
    declarations: Declarations
    headers: HeaderFiles = field(default_factory=HeaderFiles)


def open_declarations(folder: Path, options: ReadOptions) -> DeclarationFiles:
    """Return the declarations below IN, none of which is read yet."""
    return DeclarationFiles(folder, layout=options.layout, capture=options.capture)


def find_shots_of(
    folder: Path,
    options: ReadOptions,
    scale: int | None = None,
    files: DeclarationFiles | None = None,
) -> list[Shot]:
    """Find the shots of IN; a layout that does not exist is refused before any file is read.

    Args:
        folder: IN.
        options: how frames are read.
        scale: which LR frames of a data set with several are wanted.
        files: declarations below IN that `open_shot` will be given, too.

    Raises:
        RtsrError: a declaration is not valid, or there are no frames.
    """
    files = files or open_declarations(folder, options)
    layouts = files.list_searched_layouts(folder)
    return find_shots(
        folder,
        buffer_folders=list_folder_patterns(layouts),
        trees=[layout for layout in layouts if layout.tree],
        scale=scale,
        declared=files.buffer_folders,
        output=options.output,
    )


def open_shot(
    shot: Shot,
    folder: Path,
    options: ReadOptions,
    *,
    files: DeclarationFiles | None = None,
    headers: HeaderFiles | None = None,
) -> OpenedShot:
    """Resolve what is declared about a shot; of its frames nothing is read yet.

    Args:
        shot: of IN.
        folder: IN.
        options: how frames are read.
        files: declarations below IN, as far as they are read already.
        headers: of its files, as far as they are read already.

    Raises:
        RtsrError: a declaration is not valid.
    """
    files = files or open_declarations(folder, options)
    return OpenedShot(
        shot=shot,
        options=options,
        declarations=files.resolve_for(shot),
        headers=headers or HeaderFiles(),
    )


def check_shot(opened: OpenedShot, hr: FrameSet | None = None) -> None:
    """Hold every channel that the user spelled out to be in one of a shot's resolutions.

    Raises:
        FrameFolderError: one is in none of them.
    """
    shot = opened.shot
    check_channels(opened, [s for s in (shot.frames, hr or shot.hr) if s is not None])


def check_channels(opened: OpenedShot, sets: Sequence[FrameSet]) -> None:
    """Hold every channel that the user spelled out to be in one of some sets.

    Raises:
        FrameFolderError: one is in none of them.
    """
    buffers = opened.declarations.spelled_out
    if buffers:
        names = _list_plain_streams(opened, sets)
        check_declared(buffers, names, str(opened.shot.root), opened.declarations.sources)


def _list_plain_streams(opened: OpenedShot, sets: Sequence[FrameSet]) -> list[Streams]:
    """Names of the channels of each file sequence, of each resolution."""
    first = [opened.headers.of_first(frames) for frames in sets]
    return [{key: list_plain_names(header) for key, header in held.items()} for held in first]


def leave_out_absent(opened: OpenedShot, sets: Sequence[FrameSet]) -> OpenedShot:
    """Forget what `[buffers]` declares of channels that none of some sets holds."""
    known = opened.declarations
    absent = list_absent(known.spelled_out, _list_plain_streams(opened, sets))
    buffers = {b: text for b, text in known.capture.buffers.items() if b not in absent}
    capture = known.capture.model_copy(update={"buffers": buffers})
    return replace(opened, declarations=replace(known, capture=capture))


def open_set(
    frames: FrameSet,
    opened: OpenedShot,
    *,
    jittered: bool,
    vectors: bool = True,
    beside: MeasuredReader | None = None,
) -> FrameReader:
    """Survey one resolution of a shot, and settle how it is read; see `measure_set`.

    Raises:
        RtsrError: a file or declaration is wrong, or nothing decides how motion is stored.
    """
    with naming_every_fault(lambda: _list_file_faults(opened, [frames])):
        measured = measure_set(frames, opened, jittered=jittered, vectors=vectors, beside=beside)
    return require_decision(measured, sharded=opened.options.sharded)


def measure_set(
    frames: FrameSet,
    opened: OpenedShot,
    *,
    jittered: bool,
    vectors: bool = True,
    headers: Headers | None = None,
    beside: MeasuredReader | None = None,
) -> MeasuredReader:
    """Survey one resolution of a shot, and measure how it is stored; nothing need be decided.

    Args:
        frames: of that resolution.
        opened: what they belong to.
        jittered: whether declared jitter applies.
        vectors: whether motion will be read; of HR frames beside LR ones nobody does.
        headers: of all files, if they are read already.
        beside: the LR frames beside HR ones.

    Raises:
        RtsrError: a file or declaration is wrong.
    """
    known = opened.declarations
    reader = survey_set(frames, opened, jittered=jittered, headers=headers)
    settled = measure_and_decide(
        reader, known.capture, named=known.layout is not None, motion=vectors, beside=beside
    )
    # said once, with the frames that lead
    remarks = (*opened.shot.remarks, *known.remarks) if vectors else ()
    return replace(settled, warnings=(*remarks, *settled.warnings))


def survey_set(
    frames: FrameSet, opened: OpenedShot, *, jittered: bool, headers: Headers | None = None
) -> FrameReader:
    """Survey one resolution of a shot by its headers; nothing is measured.

    Raises:
        RtsrError: a file or declaration is wrong.
    """
    known = opened.declarations
    if headers is None:
        headers = read_headers(frames, opened.headers, _list_needed(frames, opened))
    open_those = partial(
        open_frames,
        files=opened.headers,
        layout=known.layout,
        capture=known.capture,
        side_car=known.side_car,
        layer=join_layer(
            opened.options.layer or known.capture.layer, opened.options.view or known.capture.view
        ),
        on_missing=opened.options.on_missing,
        wanted=opened.options.selection.frames,
        jittered=jittered,
        unrendered=opened.options.unrendered,
    )
    reader, lacking = _survey_needed(open_those, frames, headers, opened.options)
    without = frozenset[int]().union(*lacking.values())
    if not without or without.issuperset(frames.numbers):
        return reader
    rest = frames.without(without)
    reader = open_those(rest, headers=_leave_out(headers, rest), left_out=without)
    return replace(
        reader, warnings=(*reader.warnings, *_say_left_out(lacking, reader.held, opened.options))
    )


def _list_needed(frames: FrameSet, opened: OpenedShot) -> Collection[int]:
    """Frames that a run may read."""
    step = opened.declarations.capture.frame_step
    return list_needed(frames.numbers, opened.options.selection, step)


def _list_file_faults(opened: OpenedShot, sets: Sequence[FrameSet]) -> Iterator[str]:
    """Say what is wrong with all files of a shot: misnamed, not readable, or not there.

    Args:
        opened: the shot.
        sets: those of its frames, LR before HR.
    """
    holes = False
    for frames in sets:
        yield from list_misnamed(frames).values()
        headers, errors = read_readable(frames, opened.headers, _list_needed(frames, opened))
        yield from map(str, errors)
        if not all(headers.values()):
            continue
        try:
            # files that are there and cannot be read are no holes
            survey_set(frames, opened, jittered=False, headers=headers)
        except FrameFolderError as error:
            holes = True
            yield str(error)
    if len(sets) == 1 or holes or opened.options.on_missing is not MissingPolicy.ERROR:
        return
    lr, hr = sets
    wanted = opened.options.selection.frames or lr.numbers
    lacking = {n for n in lr.numbers if min(wanted) <= n <= max(wanted)} - set(hr.numbers)
    if lacking:
        yield describe_unpaired(lacking, lr.root, hr.root)


def _survey_needed(
    open_those: Callable[..., FrameReader], frames: FrameSet, headers: Headers, options: ReadOptions
) -> tuple[FrameReader, dict[Buffer, frozenset[int]]]:
    """Survey frames, and say which of them lack what is needed; radiance may be among that.

    Raises:
        FrameFolderError: as surveying has it; not of radiance that is needed and some frames lack.
    """
    try:
        reader = open_those(frames, headers=headers)
        lacking = {}
    except FrameFolderError:
        if Buffer.COLOR not in options.needed or options.unrendered:
            raise
        reader = open_those(frames, headers=headers, unrendered=True)
        if not reader.unrendered:
            raise
        lacking = {Buffer.COLOR: reader.unrendered}
    known = {b: n for b, n in reader.partial.items() if b in options.needed}
    return reader, lacking | known


def _leave_out(headers: Headers, rest: FrameSet) -> Headers:
    """Headers of the files that are left."""
    return {
        key: {n: header for n, header in headers[key].items() if n in stream.files}
        for key, stream in rest.streams.items()
    }


def _say_left_out(
    lacking: Mapping[Buffer, frozenset[int]], held: Collection[int], options: ReadOptions
) -> Iterator[str]:
    """Say which frames are left out, or stood in for, once for all that they lack."""
    grouped: dict[frozenset[int], list[Buffer]] = {}
    for buffer, numbers in lacking.items():
        grouped.setdefault(numbers, []).append(buffer)
    for numbers, buffers in grouped.items():
        why = f"{say_missing(buffers)} there"
        stood, out = numbers.intersection(held), numbers.difference(held)
        if stood:
            verb = "counts" if len(stood) == 1 else "count"
            yield f"{say_frames(stood)} {verb} as missing (--on-missing hold): {why}"
        if out:
            bare = options.on_missing is MissingPolicy.HOLD
            alone = ", no frame before stands in" if bare else ""
            yield f"{say_frames(out)} left out (--on-missing {options.on_missing}{alone}): {why}"


def open_radiance(
    folder: Path, options: ReadOptions, *, lighting: bool = False
) -> Iterator[tuple[str, FrameReader]]:
    """Survey every frame set of IN that holds radiance (or divided lighting), by relative path.

    Raises:
        FrameFolderError: a shot has none at all.
    """
    wanted = Buffer.LIGHTING if lighting else Buffer.COLOR
    files = open_declarations(folder, options)
    for shot in find_shots_of(folder, options, files=files):
        opened = open_shot(shot, folder, options, files=files)
        check_shot(opened)
        main = open_set(shot.frames, opened, jittered=True)
        if wanted not in main.stored:
            raise FrameFolderError(
                f"{main.frames.root}: buffer '{wanted}' is missing; layout "
                f"'{main.layout.name}' found: {', '.join(sorted(main.stored))}. "
                "Name another layout with --layout"
            )
        if shot.hr is None:
            yield shot.name, main
            continue
        yield f"{shot.name}/{LR_FOLDER}", main
        hr = open_set(shot.hr, opened, jittered=False, vectors=False)
        if wanted in hr.stored:
            yield f"{shot.name}/{HR_FOLDER}", hr


def open_pairs(
    folder: Path,
    options: ReadOptions,
    *,
    hr_folder: Path | None = None,
    scale: int | None = None,
    simulation: Simulation | None = None,
) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot of IN as LR/HR pairs, by relative path.

    Args:
        folder: IN.
        options: how frames are read.
        hr_folder: HR frames of IN, or a tree like IN's.
        scale: as asked for.
        simulation: make LR frames from HR captures instead.

    Raises:
        RtsrError: a folder, file or declaration is wrong.
    """
    files = open_declarations(folder, options)
    shots = find_shots_of(folder, options, scale, files)
    for shot in shots:
        hr = shot.hr
        if hr_folder is not None:
            only = len(shots) == 1
            patterns = list_folder_patterns(files.list_searched_layouts(shot.root))
            hr = _list_frame_sets(hr_folder, shot, options, patterns, only=only)
        opened = open_shot(shot, folder, options, files=files)
        yield shot.name, open_pair(opened, hr=hr, scale=scale, simulation=simulation)


def open_single_sets(folder: Path, options: ReadOptions) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot's frames by themselves; what is beside them at another size is not read.

    Raises:
        RtsrError: a folder, file or declaration is wrong.
    """
    files = open_declarations(folder, options)
    for shot in find_shots_of(folder, options, files=files):
        source = open_pair(open_shot(shot, folder, options, files=files), hr=None, scale=1)
        yield shot.name, _note_unread_size(source, shot)


def _note_unread_size(source: PairSource, shot: Shot) -> PairSource:
    """Say of a pair that the frames of one size are taken, and which."""
    if shot.hr is None or not isinstance(source, RealPairs):
        return source
    note = (
        f"this command reads frames of one size, here those of {shot.frames.root}; to take those "
        f"of {shot.hr.root}, give that folder in place of IN"
    )
    return replace(source, lr=replace(source.lr, notes=(note, *source.lr.notes)))


def open_pair(
    opened: OpenedShot,
    *,
    hr: FrameSet | None,
    scale: int | None = None,
    simulation: Simulation | None = None,
) -> PairSource:
    """Survey one shot of IN; see `open_pairs`.

    Raises:
        RtsrError: a folder, file or declaration is wrong.
    """
    check_shot(opened, hr)
    shot = opened.shot
    if simulation is not None:
        return open_simulated_pairs(open_capture(opened), simulation)
    sets = [shot.frames] if hr is None else [shot.frames, hr]
    with naming_every_fault(lambda: _list_file_faults(opened, sets)):
        return settle_cameras(_open_sizes(opened, hr, scale))


def _open_sizes(opened: OpenedShot, hr: FrameSet | None, scale: int | None) -> RealPairs:
    """Survey the frames of a shot and the HR ones beside them."""
    measured = measure_set(opened.shot.frames, opened, jittered=True)
    lr = require_decision(measured, sharded=opened.options.sharded)
    target = None
    if hr is not None:
        target = open_set(hr, opened, jittered=False, vectors=False, beside=measured)
    return open_real_pairs(
        lr,
        target,
        scale or opened.declarations.capture.scale,
        skip_missing=opened.options.on_missing is MissingPolicy.SKIP,
        wanted=opened.options.selection.frames,
    )


def open_capture(opened: OpenedShot) -> FrameReader:
    """Survey a shot's frames of the largest size; motion is lent by LR frames where it is missing.

    Raises:
        RtsrError: a folder, file or declaration is wrong.
    """
    shot = opened.shot
    capture = open_set(shot.hr or shot.frames, opened, jittered=False)
    if shot.hr is not None and Buffer.MOTION not in capture.stored:
        return lend_motion(capture, open_set(shot.frames, opened, jittered=True))
    return capture


def _list_frame_sets(
    hr_folder: Path, shot: Shot, options: ReadOptions, patterns: Sequence[str], *, only: bool
) -> FrameSet:
    """HR frames of a shot where `--hr` names their folder, or a tree like IN's.

    Args:
        hr_folder: as named.
        shot: of IN.
        options: how frames are read.
        patterns: folders that hold one buffer each.
        only: whether IN holds no other shot.

    Raises:
        FrameFolderError: there are none.
    """
    below = hr_folder / shot.name
    chosen = hr_folder if only and not is_folder(below) else below
    if not is_folder(chosen):
        raise FrameFolderError(f"{chosen}: no such folder (--hr, for shot '{shot.name}')")
    frames = collect_frame_set(chosen, patterns)
    if frames is None:
        raise FrameFolderError(f"{chosen}: no numbered EXR frames here (--hr)")
    if options.output is not None:
        refuse_among(options.output / shot.name, frames)
    return frames
