"""From a folder and what the user chose to checked readers and pairs, shot by shot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.capture import CAPTURE_FILE, Capture, read_capture
from rtsr_cli.core.io.channel_tables import components_of
from rtsr_cli.core.io.exr import read_header
from rtsr_cli.core.io.layout_files import check_declared, declared_buffers, layout_named
from rtsr_cli.core.io.layouts import SCOPE, Layout
from rtsr_cli.core.io.pairs import PairSource, real_pairs, simulated_pairs
from rtsr_cli.core.io.presets import LAYOUTS
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.settling import Settled, decided, settle
from rtsr_cli.core.io.shots import (
    HR_FOLDER,
    LR_FOLDER,
    FrameSet,
    Shot,
    find_shots,
    frame_set,
    refuse_among,
)
from rtsr_cli.core.io.side_cars import CameraRow, read_cameras, with_reversed
from rtsr_cli.core.io.simulation import Simulation
from rtsr_cli.core.io.survey import Headers, open_frames


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How frames are read.

    Attributes:
        layout: preset or layout file, or None to detect it.
        capture: file in place of each shot's capture.toml.
        on_missing: what holes in the numbering mean.
        output: where frames will be written; it must not lie where they would be taken for inputs.
        sharded: whether other runs write other parts of the same shots.
    """

    layout: str | None = None
    capture: Path | None = None
    on_missing: MissingPolicy = MissingPolicy.ERROR
    output: Path | None = None
    sharded: bool = False


@dataclass(frozen=True, kw_only=True)
class Declared:
    """What a user declared about a shot."""

    capture: Capture
    side_car: Mapping[int, CameraRow]


def declared(shot: Shot, root: Path, options: ReadOptions) -> Declared:
    """Read the capture.toml that applies to a shot, and its camera side-car.

    The nearest one from the shot's folder up to IN; `--capture` in place of all.

    Raises:
        ConfigError: a file is not valid.
    """
    path = options.capture
    if path is None:
        above = [shot.root, *(p for p in shot.root.parents if p.is_relative_to(root))]
        path = next((p / CAPTURE_FILE for p in above if (p / CAPTURE_FILE).is_file()), None)
    capture = Capture() if path is None else read_capture(path)
    cameras = shot.side_car
    if path is not None and capture.camera:
        cameras = path.parent / capture.camera
    if cameras is None:
        return Declared(capture=capture, side_car={})
    return Declared(capture=with_reversed(capture, cameras), side_car=read_cameras(cameras))


def searched_layouts(folder: Path, options: ReadOptions) -> tuple[Layout, ...]:
    """Layouts whose folders IN is searched for: the one that is named for all of IN, or all.

    Raises:
        RtsrError: a layout or capture.toml is not valid.
    """
    path = options.capture or folder / CAPTURE_FILE
    capture = read_capture(path) if options.capture or path.is_file() else Capture()
    name = options.layout or capture.layout
    return tuple(LAYOUTS.values()) if name is None else (layout_named(name),)


def folders_of(layouts: Iterable[Layout]) -> tuple[str, ...]:
    """Patterns of folders that hold one buffer each."""
    patterns = {p for layout in layouts if layout.folders for p in layout.files}
    return tuple(sorted(p.replace(SCOPE, "*") for p in patterns))


def _folders_declared_in(folder: Path) -> tuple[str, ...]:
    """Patterns of buffer folders by a folder's own capture.toml."""
    path = folder / CAPTURE_FILE
    if not path.is_file():
        return ()
    capture = read_capture(path)
    own = Layout(name="", description="", buffers=components_of(capture.buffers), folders=True)
    named = () if capture.layout is None else (layout_named(capture.layout),)
    return folders_of((own, *named))


def shots_of(folder: Path, options: ReadOptions, scale: int | None = None) -> list[Shot]:
    """Find the shots of IN; a layout that does not exist is refused before any file is read."""
    layouts = searched_layouts(folder, options)
    return find_shots(
        folder,
        buffer_folders=folders_of(layouts),
        trees=[layout for layout in layouts if layout.tree],
        scale=scale,
        declared=_folders_declared_in,
        output=options.output,
    )


def check_shot(shot: Shot, root: Path, options: ReadOptions, hr: FrameSet | None = None) -> None:
    """Hold every channel that the user spelled out to be in one of a shot's resolutions.

    Raises:
        FrameFolderError: one is in none of them.
    """
    sets = [s for s in (shot.frames, hr or shot.hr) if s is not None]
    check_channels(declared(shot, root, options).capture, options, sets, shot.root)


def check_channels(
    capture: Capture, options: ReadOptions, sets: Sequence[FrameSet], where: Path
) -> None:
    """Hold every channel that the user spelled out to be in one of some sets.

    Raises:
        FrameFolderError: one is in none of them.
    """
    buffers = declared_buffers(options.layout or capture.layout, capture)
    if buffers:
        check_declared(buffers, [_first_channels(s) for s in sets], str(where))


def _first_channels(frames: FrameSet) -> dict[str, frozenset[str]]:
    return {
        key: read_header(next(iter(stream.files.values()))).channels
        for key, stream in frames.streams.items()
    }


def open_set(
    frames: FrameSet,
    shot: Shot,
    root: Path,
    options: ReadOptions,
    *,
    jittered: bool,
    vectors: bool = True,
) -> FrameReader:
    """Survey one resolution of a shot, and settle how it is read; see `settled_set`.

    Raises:
        RtsrError: a file or declaration is wrong, or nothing decides how motion is stored.
    """
    return decided(
        settled_set(frames, shot, root, options, jittered=jittered, vectors=vectors),
        sharded=options.sharded,
    )


def settled_set(
    frames: FrameSet,
    shot: Shot,
    root: Path,
    options: ReadOptions,
    *,
    jittered: bool,
    vectors: bool = True,
    headers: Headers | None = None,
) -> Settled:
    """Survey one resolution of a shot, and measure how it is stored; nothing need be decided.

    Args:
        frames: of that resolution.
        shot: what they belong to.
        root: IN.
        options: how frames are read.
        jittered: whether declared jitter applies.
        vectors: whether motion will be read; of HR frames beside LR ones nobody does.
        headers: of all files, if they are read already.

    Raises:
        RtsrError: a file or declaration is wrong.
    """
    known = declared(shot, root, options)
    name = options.layout or known.capture.layout or shot.layout
    reader = open_frames(
        frames,
        headers=headers,
        layout=name,
        capture=known.capture,
        side_car=known.side_car,
        on_missing=options.on_missing,
        jittered=jittered,
    )
    return settle(reader, known.capture, named=name is not None, motion=vectors)


def open_radiance(
    folder: Path, options: ReadOptions, *, lighting: bool = False
) -> Iterator[tuple[str, FrameReader]]:
    """Survey every frame set of IN that holds radiance (or divided lighting), by relative path.

    Raises:
        FrameFolderError: a shot has none at all.
    """
    wanted = Buffer.LIGHTING if lighting else Buffer.COLOR
    for shot in shots_of(folder, options):
        check_shot(shot, folder, options)
        main = open_set(shot.frames, shot, folder, options, jittered=True)
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
        hr = open_set(shot.hr, shot, folder, options, jittered=False, vectors=False)
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
    shots = shots_of(folder, options, scale)
    for shot in shots:
        hr_frames = _hr_frames(shot, hr_folder, options, single=len(shots) == 1)
        yield (
            shot.name,
            open_pair(shot, folder, options, hr=hr_frames, scale=scale, simulation=simulation),
        )


def open_single(folder: Path, options: ReadOptions) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot's frames by themselves; what is beside them at another size is not read.

    Raises:
        RtsrError: a folder, file or declaration is wrong.
    """
    for shot in shots_of(folder, options):
        yield shot.name, open_pair(shot, folder, options, hr=None, scale=1)


def open_pair(
    shot: Shot,
    folder: Path,
    options: ReadOptions,
    *,
    hr: FrameSet | None,
    scale: int | None = None,
    simulation: Simulation | None = None,
) -> PairSource:
    """Survey one shot of IN; see `open_pairs`.

    Raises:
        RtsrError: a folder, file or declaration is wrong.
    """
    check_shot(shot, folder, options, hr)
    if simulation is not None:
        capture = open_set(shot.hr or shot.frames, shot, folder, options, jittered=False)
        return simulated_pairs(capture, simulation)
    lr = open_set(shot.frames, shot, folder, options, jittered=True)
    target = None
    if hr is not None:
        target = open_set(hr, shot, folder, options, jittered=False, vectors=False)
    known = declared(shot, folder, options).capture
    skip = options.on_missing is MissingPolicy.SKIP
    return real_pairs(lr, target, scale or known.scale, skip_missing=skip)


def _hr_frames(
    shot: Shot, hr_folder: Path | None, options: ReadOptions, *, single: bool
) -> FrameSet | None:
    if hr_folder is None:
        return shot.hr
    below = hr_folder / shot.name
    chosen = hr_folder if single and not below.is_dir() else below
    if not chosen.is_dir():
        raise FrameFolderError(f"{chosen}: no such folder (--hr, for shot '{shot.name}')")
    frames = frame_set(chosen, folders_of(searched_layouts(shot.root, options)))
    if frames is None:
        raise FrameFolderError(f"{chosen}: no numbered EXR frames here (--hr)")
    if options.output is not None:
        refuse_among(options.output / shot.name, frames)
    return frames
