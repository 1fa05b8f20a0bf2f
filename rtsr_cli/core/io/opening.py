"""From a folder and what the user chose to checked readers and pairs, shot by shot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.capture import (
    CAPTURE_FILE,
    CameraRow,
    Capture,
    read_cameras,
    read_capture,
)
from rtsr_cli.core.io.layouts import LAYOUTS
from rtsr_cli.core.io.pairs import PairSource, real_pairs, simulated_pairs
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.shots import HR_FOLDER, LR_FOLDER, FrameSet, Shot, find_shots, frame_set
from rtsr_cli.core.io.simulation import Simulation
from rtsr_cli.core.io.survey import MissingPolicy, layout_named, open_frames


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How frames are read.

    Attributes:
        layout: name of a preset, or None to detect it.
        capture: file in place of each shot's capture.toml.
        on_missing: what holes in the numbering mean.
        output: folder that is not searched for shots, because it is written to.
    """

    layout: str | None = None
    capture: Path | None = None
    on_missing: MissingPolicy = MissingPolicy.ERROR
    output: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Declared:
    """What a user declared about a shot."""

    capture: Capture
    side_car: Mapping[int, CameraRow]


def buffer_folders() -> tuple[str, ...]:
    """Names of folders that hold one buffer each, over all layouts that have such."""
    names = {
        component.stream.split("/")[0]
        for layout in LAYOUTS.values()
        if layout.folders
        for components in layout.buffers.values()
        for component in components
    }
    return tuple(sorted(names))


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
    if path is None:
        return Declared(capture=Capture(), side_car={})
    capture = read_capture(path)
    side_car = read_cameras(path.parent / capture.camera) if capture.camera else {}
    return Declared(capture=capture, side_car=side_car)


def shots_of(folder: Path, options: ReadOptions) -> list[Shot]:
    """Find the shots of IN; a layout that does not exist is refused before any file is read."""
    if options.layout is not None:
        layout_named(options.layout)
    return find_shots(folder, buffer_folders=buffer_folders(), output=options.output)


def open_set(
    frames: FrameSet, shot: Shot, root: Path, options: ReadOptions, *, jittered: bool
) -> FrameReader:
    """Survey one resolution of a shot."""
    known = declared(shot, root, options)
    return open_frames(
        frames,
        layout=options.layout,
        capture=known.capture,
        side_car=known.side_car,
        on_missing=options.on_missing,
        jittered=jittered,
    )


def open_radiance(
    folder: Path, options: ReadOptions, *, lighting: bool = False
) -> Iterator[tuple[str, FrameReader]]:
    """Survey every frame set of IN that holds radiance (or divided lighting), by relative path.

    Raises:
        FrameFolderError: a shot has none at all.
    """
    wanted = Buffer.LIGHTING if lighting else Buffer.COLOR
    for shot in shots_of(folder, options):
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
        hr = open_set(shot.hr, shot, folder, options, jittered=False)
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
    shots = shots_of(folder, options)
    for shot in shots:
        if simulation is not None:
            capture = open_set(shot.hr or shot.frames, shot, folder, options, jittered=False)
            yield shot.name, simulated_pairs(capture, simulation)
            continue
        lr = open_set(shot.frames, shot, folder, options, jittered=True)
        hr_frames = _hr_frames(shot, hr_folder, single=len(shots) == 1)
        hr = open_set(hr_frames, shot, folder, options, jittered=False) if hr_frames else None
        known = declared(shot, folder, options).capture
        skip = options.on_missing is MissingPolicy.SKIP
        yield shot.name, real_pairs(lr, hr, scale or known.scale, skip_missing=skip)


def _hr_frames(shot: Shot, hr_folder: Path | None, *, single: bool) -> FrameSet | None:
    if hr_folder is None:
        return shot.hr
    below = hr_folder / shot.name
    chosen = hr_folder if single and not below.is_dir() else below
    if not chosen.is_dir():
        raise FrameFolderError(f"{chosen}: no such folder (--hr, for shot '{shot.name}')")
    frames = frame_set(chosen, buffer_folders())
    if frames is None:
        raise FrameFolderError(f"{chosen}: no numbered EXR frames here (--hr)")
    return frames
