"""Which frame is judged against which: test folders, their reference and its G-buffer.

Shots go by their paths below each folder, frames by number. Everything that headers tell is
checked before a pixel is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from rtsr_cli.core.captures.capture_file import CAPTURE_FILE
from rtsr_cli.core.captures.header_files import HeaderFiles
from rtsr_cli.core.captures.lent_motion import lend_motion
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import check_origins
from rtsr_cli.core.captures.shots import (
    HR_FOLDER,
    LR_FOLDER,
    REFERENCE_FOLDER,
    Shot,
    collect_frame_set,
)
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError, RtsrError
from rtsr_cli.core.evaluation.comparison_files import ComparisonFiles
from rtsr_cli.core.evaluation.predicted_frames import (
    holds_only_predicted,
    keep_stamped,
    list_between,
    list_stamped,
)
from rtsr_cli.core.evaluation.regions import REGION_BUFFERS
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.files.provenance import COLOR_TAG
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.frames.selection import Selection, format_ranges
from rtsr_cli.core.pairs.lacking_frames import RADIANCE
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of, open_set, open_shot, survey_set
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.wording import say_verb

REFERENCE_FOLDERS = (REFERENCE_FOLDER, HR_FOLDER, "")
"""Where below a shot of REF the pictures may lie, in the order they are looked for."""

GBUFFER_FOLDERS = (HR_FOLDER, "")
"""Where below a shot the buffers of the output resolution may lie."""

DEBUG_FOLDER = "debug"
"""Subfolder of outputs that holds no result."""


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """What is compared.

    Attributes:
        gbuffer: folder of the buffers, None for the reference's own.
        samples: K, the reference (and G-buffer) hold K x K samples of each judged pixel.
        selection: frames.
        predicted_only: refuse tests none of whose frames is stamped `rtsr:predicted`; where some
            are, they alone are judged in any case.
        changes: whether frames are compared with those before them.
        read: how frames are read.
    """

    gbuffer: Path | None = None
    samples: int = 1
    selection: Selection = field(default_factory=Selection)
    predicted_only: bool = False
    changes: bool = True
    read: ReadOptions = field(default_factory=ReadOptions)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One shot: several methods' frames, the reference's, and its buffers where there are any.

    Attributes:
        shot: path below the test folders, "" for the folder itself.
        tests: method -> its frames.
        reference: true frames, `samples` times as large along each axis.
        gbuffer: buffers of the reference's size, or None.
        numbers: frames that are judged.
        available: frames that could be judged: those that every folder has.
        there: the same whether stamped or not; history is read of those too.
        samples: K.
        remarks: what the search for frames left out, for the user.
        stamped: whether those that are judged are the ones that are stamped as predicted.
        between: frames between these, whose change alone is measured.
    """

    shot: str
    tests: Mapping[str, FrameReader]
    reference: FrameReader
    gbuffer: FrameReader | None
    numbers: tuple[int, ...]
    available: tuple[int, ...]
    there: tuple[int, ...]
    samples: int = 1
    remarks: tuple[str, ...] = ()
    stamped: bool = False
    between: tuple[int, ...] = ()

    @cached_property
    def shown(self) -> tuple[int, ...]:
        """Frames that are read in turn: those that are judged, and those between."""
        moving = (n for n in self.between if self.previous(n) is not None)
        return tuple(sorted({*self.numbers, *moving}))

    @property
    def size(self) -> Size:
        """(height, width) of a judged frame."""
        return next(iter(self.tests.values())).size

    @property
    def step(self) -> int:
        """Numbers that one motion vector spans."""
        return self.reference.step if self.gbuffer is None else self.gbuffer.step

    @cached_property
    def _there(self) -> frozenset[int]:
        return frozenset(self.there)

    def previous(self, number: int) -> int | None:
        """Return the frame that this one's motion leads to, None after a cut or hole."""
        before = number - self.step
        resets = self.reference.resets if self.gbuffer is None else self.gbuffer.resets
        return before if before in self._there and number not in resets else None

    def surfaces_before(self, number: int) -> int | None:
        """Return the frame that this one's motion leads to, if there are buffers of it."""
        before, gbuffer = number - self.step, self.gbuffer
        if gbuffer is None or before not in gbuffer.numbers or number in gbuffer.resets:
            return None
        return before


def name_methods(folders: Sequence[Path]) -> dict[str, Path]:
    """Name test folders by their paths below what they have in common.

    Raises:
        FrameFolderError: a folder is given twice.
    """
    resolved = [folder.resolve() for folder in folders]
    if len(set(resolved)) < len(resolved):
        raise FrameFolderError(f"{folders[0]}: the same folder is given twice; name each once")
    parents = [path.parent for path in resolved]
    common = parents[0]
    while not all(parent.is_relative_to(common) for parent in parents):
        common = common.parent
    pairs = zip(resolved, folders, strict=True)
    return {path.relative_to(common).as_posix(): folder for path, folder in pairs}


def open_comparisons(
    tests: Mapping[str, Path], reference: Path, options: CompareOptions
) -> list[Comparison]:
    """Survey and check everything that is compared.

    Raises:
        RtsrError: a folder, shot or frame is missing, or sizes differ.
    """
    shots = {method: _test_shots(folder) for method, folder in tests.items()}
    names = sorted({name for by_name in shots.values() for name in by_name})
    for method, by_name in shots.items():
        lacking = [name for name in names if name not in by_name]
        if lacking:
            raise FrameFolderError(
                f"{tests[method]}: shot '{lacking[0]}' is missing, another test folder has it; "
                "judge them one by one, or make it"
            )
    return [
        _open_comparison(
            {m: by_name[name] for m, by_name in shots.items()}, name, reference, options
        )
        for name in names
    ]


def _test_shots(folder: Path) -> dict[str, Shot]:
    shots = find_shots_of(folder, ReadOptions())
    return {
        "" if shot.name == "." else shot.name: shot
        for shot in shots
        if DEBUG_FOLDER not in Path(shot.name).parts
    }


def _open_comparison(
    shots: Mapping[str, Shot], name: str, reference: Path, options: CompareOptions
) -> Comparison:
    files = ComparisonFiles(options.read)
    tests = {m: _open_test(shot, files, options.read.on_missing) for m, shot in shots.items()}
    truth_shot = files.find_shot(reference, name, REFERENCE_FOLDERS)
    truth = _open_radiance(truth_shot, reference, files)
    gbuffer = _open_gbuffer(name, reference, truth, options, files)
    for method, reader in tests.items():
        _check_size(reader, truth, options.samples, method)
        _check_color_space(reader, truth, method)
    there = _list_frames(tests, truth)
    stamped = list_stamped(tests.values())
    numbers, available = _choose_numbers(tests, truth, there, options)
    turns = list_between(there, numbers, available, options.selection) if options.changes else ()
    return Comparison(
        shot=name,
        tests=tests,
        reference=truth,
        gbuffer=gbuffer,
        numbers=numbers,
        available=available,
        there=tuple(sorted(set.intersection(*there.values()))),
        samples=options.samples,
        remarks=tuple(f"{s.root}: {t}" for s in (*shots.values(), truth_shot) for t in s.remarks),
        stamped=bool(stamped),
        between=turns if stamped else (),
    )


def _open_test(shot: Shot, files: ComparisonFiles, policy: MissingPolicy) -> FrameReader:
    """Open the frames of a test; what lies between predicted frames is no hole."""
    reader = _open_radiance(shot, shot.root, files, on_missing=MissingPolicy.SKIP)
    if policy is MissingPolicy.SKIP or holds_only_predicted(reader):
        return reader
    return _open_radiance(shot, shot.root, files)


def _open_radiance(
    shot: Shot, root: Path, files: ComparisonFiles, *, on_missing: MissingPolicy | None = None
) -> FrameReader:
    """Open frames for their radiance alone: nothing about motion need be known."""
    _refuse_single_channel(shot, files.headers)
    opened = files.open_shot(shot, root)
    if on_missing is not None:
        opened = replace(opened, options=replace(opened.options, on_missing=on_missing))
    if opened.options.on_missing is MissingPolicy.SKIP:
        opened = replace(opened, options=replace(opened.options, needed=RADIANCE))
    reader = survey_set(shot.frames, opened, jittered=False)
    if Buffer.COLOR not in reader.stored:
        raise FrameFolderError(
            f"{shot.frames.root}: no radiance (channels R, G, B) in these frames; layout "
            f"'{reader.layout.name}' found: {', '.join(sorted(reader.stored))}"
        )
    # which of the other buffers some frames lack is said of those that are read
    said = tuple(text for text in reader.warnings if text not in reader.partial_said)
    return replace(reader, warnings=said)


def _refuse_single_channel(shot: Shot, headers: HeaderFiles) -> None:
    for stream in shot.frames.streams.values():
        path = next(iter(stream.files.values()))
        channels = headers.of(path).channels
        if len(channels) == 1 and len(shot.frames.streams) == 1:
            raise FrameFolderError(
                f"{path}: has the single channel '{next(iter(channels))}'; R, G and B are judged: "
                "write it three times, or name the folder of colour pictures"
            )


def _open_gbuffer(
    name: str, reference: Path, truth: FrameReader, options: CompareOptions, files: ComparisonFiles
) -> FrameReader | None:
    """Open the buffers of the judged resolution; the reference's own are there or not."""
    root = options.gbuffer or reference
    try:
        shot = files.find_shot(root, name, GBUFFER_FOLDERS)
    except FrameFolderError:
        if options.gbuffer is not None:
            raise
        return None
    if options.gbuffer is None and not _has_surface(shot, files.headers):
        return None
    opened = files.open_shot(shot, root)
    reader = open_set(shot.frames, opened, jittered=False)
    needed = reader.partial.keys() & REGION_BUFFERS
    if needed and options.read.on_missing is MissingPolicy.SKIP:
        # frames without them are judged as pictures, the others by region as well
        opened = replace(opened, options=replace(opened.options, needed=frozenset(needed)))
        reader = open_set(shot.frames, opened, jittered=False)
    if reader.size != truth.size:
        if options.gbuffer is None:
            return None
        raise FrameFolderError(
            f"{reader.frames.root}: buffers are {_describe_pixels(reader)}, the reference is "
            f"{_describe_pixels(truth)}; give buffers of the reference's size"
        )
    return reader if Buffer.MOTION in reader.stored else _lend_motion(reader, root / name, options)


def _lend_motion(reader: FrameReader, root: Path, options: CompareOptions) -> FrameReader:
    """Let buffers without motion take that of the LR frames beside them, where it can be had."""
    folder = root / LR_FOLDER
    frames = collect_frame_set(folder) if is_folder(folder) else None
    if frames is None:
        return reader
    try:
        opened = open_shot(Shot(name=".", root=root, frames=frames), root, options.read)
        return lend_motion(reader, open_set(frames, opened, jittered=True))
    except RtsrError:
        # nothing that is judged depends on it
        return reader


def _has_surface(shot: Shot, headers: HeaderFiles) -> bool:
    paths = [next(iter(stream.files.values())) for stream in shot.frames.streams.values()]
    return len(paths) > 1 or any(len(headers.of(path).channels) > 4 for path in paths)


def _show_size(size: Size) -> str:
    return f"{size[1]} x {size[0]}"


def _describe_pixels(reader: FrameReader) -> str:
    """A reader's size, and its windows if more or less than the image plane is read."""
    plane = (reader.display.height, reader.display.width)
    if reader.size == plane:
        return _show_size(reader.size)
    return f"{_show_size(reader.size)} ({reader.places[0].describe()})"


def _check_size(reader: FrameReader, truth: FrameReader, samples: int, method: str) -> None:
    """Raise where frames of two folders do not show one picture.

    Raises:
        FrameFolderError: names both folders, their sizes and windows.
    """
    height, width = (side // samples for side in truth.size)
    if reader.size == (height, width):
        if reader.view.at_scale(samples) != truth.view:
            raise FrameFolderError(
                f"{reader.frames.root}: frames of '{method}' show another part of the image plane "
                f"than the reference {truth.frames.root}: {reader.places[0].describe()}, "
                f"{truth.places[0].describe()}; compare frames of one crop"
            )
        places = (place.at_scale(samples) for place in reader.places)
        check_origins((*places, *truth.places), str(reader.frames.root))
        return
    ratio = truth.size[0] // reader.size[0]
    whole = ratio > 1 and (reader.size[0] * ratio, reader.size[1] * ratio) == truth.size
    hint = f", or give --samples-per-pixel {ratio} if it holds so many samples" if whole else ""
    raise FrameFolderError(
        f"{reader.frames.root}: frames of '{method}' are {_describe_pixels(reader)}, the reference "
        f"{truth.frames.root} is {_describe_pixels(truth)} and asks for "
        f"{_show_size((height, width))}; compare frames of one size{hint}"
    )


def _check_color_space(reader: FrameReader, truth: FrameReader, method: str) -> None:
    """Raise where one of two pictures names its primaries, and what the other's are is open.

    Raises:
        FrameFolderError: names both folders, and what to declare.
    """
    for side in (reader, truth):
        if side.foreign_tag:
            raise FrameFolderError(
                f"{side.frames.root}: {COLOR_TAG} is '{side.foreign_tag}', no linear space that "
                "pictures are compared in; declare what these frames hold in "
                f'{side.frames.root / CAPTURE_FILE}: colorspace = "lin_rec709"'
            )
    named, bare = (reader, truth) if truth.conventions.colorspace is None else (truth, reader)
    space = named.conventions.colorspace
    if bare.conventions.colorspace is None and space not in {None, ColorSpace.REC709}:
        raise FrameFolderError(
            f"{bare.frames.root}: nothing says what primaries these frames have, those of "
            f"{named.frames.root} are '{space}' (comparing '{method}'); declare them in "
            f'{bare.frames.root / CAPTURE_FILE}: colorspace = "{space}", or "lin_rec709"'
        )


def _list_frames(tests: Mapping[str, FrameReader], truth: FrameReader) -> dict[str, set[int]]:
    """Frames that each folder has."""
    return {str(r.frames.root): set(r.numbers) - set(r.held) for r in (truth, *tests.values())}


def _choose_numbers(
    tests: Mapping[str, FrameReader],
    truth: FrameReader,
    there: Mapping[str, set[int]],
    options: CompareOptions,
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Frames to judge, and all that could be: what every folder has, or all have under `skip`.

    Raises:
        FrameFolderError: a folder lacks a frame that another has; names both.
    """
    stamped = list_stamped(tests.values())
    if stamped or options.predicted_only:
        there = keep_stamped(there, tests.values(), stamped)
    every = sorted(set().union(*there.values()))
    chosen = set(options.selection.of(every))
    if options.read.on_missing is MissingPolicy.ERROR:
        for root, numbers in there.items():
            lacking = chosen - numbers
            if lacking:
                raise FrameFolderError(
                    f"{root}: {say_frames(lacking)} {say_verb(len(lacking))} missing, which others "
                    f"have; make {'it' if len(lacking) == 1 else 'them'}, choose frames with "
                    "--frames, or judge what all have with --on-missing skip"
                )
    available = tuple(n for n in every if all(n in s for s in there.values()))
    common = tuple(n for n in available if n in chosen)
    # a part may hold no frame of a short shot, which others then hold
    whole = set(replace(options.selection, shard=None).of(every))
    if not whole.intersection(available):
        what = "stamped rtsr:predicted " if options.predicted_only else ""
        raise FrameFolderError(
            f"{truth.frames.root}: no frame {what}to judge is in all folders"
            + (f" (--frames leaves none of {format_ranges(every)})" if every else "")
        )
    return common, available
