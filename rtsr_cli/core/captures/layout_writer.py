"""Writing a frame as the files of a layout: the inverse of reading it."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rtsr_cli.core.captures.layouts import SCOPE, Component, Layout, Term
from rtsr_cli.core.captures.nss_cameras import write_clip_json
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.files.atomic_write import write_text_atomically
from rtsr_cli.core.files.exr import Plane, write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import StoredFrame
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.frames.storage import FLOAT_BUFFERS, from_memory, to_half
from rtsr_cli.core.marks import MARKED


class FrameRole(StrEnum):
    """Which resolution of a data set a frame belongs to."""

    LR = "lr"
    HR = "hr"


def write_frame(
    folder: Path,
    frame: Frame,
    layout: Layout,
    *,
    number: int,
    base: str,
    attributes: Mapping[str, Any] | None = None,
    role: FrameRole = FrameRole.LR,
    scale: int = 2,
    jitter_px_prev: Jitter = (0.0, 0.0),
    compression: str = "zip",
) -> tuple[Path, ...]:
    """Write the buffers of a frame that a layout has, in the layout's conventions.

    Args:
        folder: of the frames; the root of the data set where the layout has folders of its own.
        frame: in memory's convention.
        layout: how to write it.
        number: frame number of the files.
        base: base name of the files (a scene, for layouts that prefix it); the shot of a data
            set with folders of its own.
        attributes: header attributes.
        role, scale: resolution, and LR's ratio, for data sets with folders of their own.
        jitter_px_prev: jitter of the previous frame, for layouts with jittered motion.
        compression: see `write_exr`.

    Returns:
        The files, sorted.

    Raises:
        MissingBufferError: a convention needs camera matrices that the frame does not have.
        OutputError: a file cannot be written.
    """
    written = []
    for file, channels in _store_planes(frame, layout, role, jitter_px_prev).items():
        path = folder / _place_path(layout, file, number=number, base=base, role=role, scale=scale)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_exr(path, channels, attributes=attributes, compression=compression)
        written.append(path)
    return tuple(sorted(written))


def _store_planes(
    frame: Frame, layout: Layout, role: FrameRole, jitter_px_prev: Jitter
) -> dict[str, dict[str, Plane]]:
    """Channels as they are stored, by name, for each file of a layout."""
    stored = StoredFrame(
        conventions=layout.conventions,
        camera=frame.camera,
        view=frame.view,
        jitter_px_prev=jitter_px_prev,
        where=frame.gbuffer.where,
    )
    files: dict[str, dict[str, Plane]] = defaultdict(dict)
    for buffer, terms in _list_held(layout, frame.gbuffer, role):
        image = from_memory(buffer, frame.gbuffer[buffer], stored)
        for i, term in enumerate(terms):
            channel = term.place.channel.replace(SCOPE, layout.scope)
            files[term.place.file][channel] = _store_plane(buffer, image[0, i], term)
    return files


def list_frame_files(
    folder: Path,
    buffers: Collection[Buffer],
    layout: Layout,
    *,
    number: int,
    base: str,
    role: FrameRole = FrameRole.LR,
    scale: int = 2,
) -> tuple[Path, ...]:
    """Return the files that `write_frame` would write for a frame of these buffers."""
    files = {term.place.file for _, terms in _list_held(layout, buffers, role) for term in terms}
    paths = (
        folder / _place_path(layout, file, number=number, base=base, role=role, scale=scale)
        for file in files
    )
    return tuple(sorted(paths))


def _list_held(
    layout: Layout, buffers: Collection[Buffer], role: FrameRole
) -> Iterator[tuple[Buffer, list[Term]]]:
    """Buffers that a layout has files for, with the channel of each component."""
    for buffer, components in layout.buffers.items():
        terms = _choose_channels(layout, components, role)
        if buffer in buffers and terms is not None:
            yield buffer, terms


def _choose_channels(
    layout: Layout, components: tuple[Component, ...], role: FrameRole
) -> list[Term] | None:
    """First channel of each component that is not computed, among the files of a role, if any."""
    tree = layout.tree
    held: tuple[str, ...] | None = None
    if tree is not None:
        held = tree.lr_buffers if role is FrameRole.LR else tree.hr_buffers
    chosen = [
        [term for term in component.channels if held is None or term.place.file in held]
        for component in components
    ]
    return [terms[0] for terms in chosen] if all(chosen) else None


def _place_path(
    layout: Layout, file: str, *, number: int, base: str, role: FrameRole, scale: int
) -> Path:
    """Relative path of the file that holds a place."""
    digits = f"{number:0{layout.digits}d}"
    if layout.tree is not None:
        template = layout.tree.lr if role is FrameRole.LR else layout.tree.hr
        return Path(template.format(buffer=file, shot=base, scale=scale), f"{digits}.exr")
    # a pattern that stands for any name is written as the base name
    name = file.replace(SCOPE, base).replace("?*", base).replace("*", base)
    return Path(f"{name}.{digits}.exr" if name else f"{digits}.exr")


def _store_plane(buffer: Buffer, image: torch.Tensor, term: Term) -> Plane:
    """One channel as it is stored: stored = value / factor + offset."""
    plain = term.factor == 1.0 and term.offset == 0.0
    if buffer is Buffer.OBJECT_ID and plain:
        return image.numpy().astype(np.uint32)
    stored = image if plain else image.double() / term.factor + term.offset
    return stored.float().numpy() if buffer in FLOAT_BUFFERS else to_half(stored)


def write_side_car(
    folder: Path,
    frames: Iterable[Frame],
    layout: Layout,
    *,
    shot: str,
    scale: int = 2,
    fps: int = 60,
) -> Path | None:
    """Write the cameras of a shot's LR frames, for data sets that keep them beside the frames.

    Args:
        folder: root of the data set.
        frames: LR frames of the shot; their jitter is of their own resolution.
        layout: of the data set.
        shot: name of the shot.
        scale: LR's ratio.
        fps: frames a second.

    Returns:
        The file, or None where the layout has none.

    Raises:
        ConfigError: a frame has no camera matrices, or no perspective ones.
        OutputError: the file cannot be written.
    """
    path = name_side_car(folder, layout, shot)
    if path is None:
        return None
    try:
        content = write_clip_json(
            tuple(frames), scale=scale, fps=fps, reversed_depth=layout.conventions.depth.reversed
        )
    except ValueError as error:
        raise ConfigError(f"{path}: cannot be written: {error}") from error
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(path, json.dumps(content | MARKED, indent=1))
    return path


def name_side_car(folder: Path, layout: Layout, shot: str) -> Path | None:
    """Return the file of a shot's cameras, None where the layout has none."""
    if layout.tree is None or layout.tree.side_car is None:
        return None
    return folder / layout.tree.side_car.format(shot=shot)
