"""What users declare about the shots below IN: every file that says so is parsed once."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import takewhile
from pathlib import Path

from rtsr_cli.core.captures.camera_rows import CameraRow
from rtsr_cli.core.captures.cameras import add_depth_sense, read_side_car
from rtsr_cli.core.captures.capture_file import CAPTURE_FILE, CaptureDeclaration, read_capture
from rtsr_cli.core.captures.channel_tables import build_components
from rtsr_cli.core.captures.layout_files import list_declared_buffers, load_layout
from rtsr_cli.core.captures.layouts import SCOPE, Component, Layout
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.captures.shots import SHOT_PARTS, TARGET_FOLDERS, Shot
from rtsr_cli.core.documents import shorten_value
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.files.folders import is_file
from rtsr_cli.core.frames.buffers import Buffer


@dataclass(frozen=True, kw_only=True)
class Declarations:
    """What a user declares about a shot.

    Attributes:
        capture: content of the capture.toml that applies; of an empty one where there is none.
        side_car: row of the camera side-car by frame number; empty without one.
        layout: that the option, capture.toml or the data set's folders name; None to detect one.
        spelled_out: components of each buffer of a layout file or of `[buffers]`.
        sources: the file that each of those stands in.
        remarks: what is named like a capture.toml and was not read, for the user.
    """

    capture: CaptureDeclaration
    side_car: Mapping[int, CameraRow]
    layout: Layout | None
    spelled_out: Mapping[Buffer, tuple[Component, ...]]
    remarks: tuple[str, ...] = ()
    sources: Mapping[Buffer, str] = field(default_factory=dict)


class DeclarationFiles:
    """capture.toml, layout files and camera side-cars below one IN, each of them parsed once."""

    def __init__(self, root: Path, *, layout: str | None, capture: Path | None) -> None:
        """Prepare; nothing is read yet.

        Args:
            root: IN.
            layout: preset or layout file in place of what is declared, or None.
            capture: file in place of each shot's capture.toml, or None.
        """
        self._root = root
        self._name = root.absolute().name
        self._beside = _find_shot_folder(root, self._name)
        self._layout_name = layout
        self._capture_file = capture
        self._capture = cache(read_capture)
        self._layout = cache(load_layout)
        self._side_car = cache(read_side_car)

    def resolve_for(self, shot: Shot) -> Declarations:
        """Resolve what is declared about a shot.

        The nearest capture.toml from the shot's folder up to IN, and beside IN where that is a
        folder of a shot (`shot/hr`); `--capture` in place of all.

        Raises:
            ConfigError: a file is not valid.
            FrameFolderError: there is no layout of a name.
        """
        above = () if self._capture_file else self._list_capture_files(shot.root)
        path = self._capture_file or next(filter(is_file, above), None)
        capture = CaptureDeclaration() if path is None else self._capture(path)
        cameras = shot.side_car
        if path is not None and capture.camera.file:
            cameras = self._place_side_car(path, capture.camera.file)
        rows: Mapping[int, CameraRow] = {}
        if cameras is not None:
            side_car = self._side_car(cameras)
            capture, rows = add_depth_sense(capture, side_car), side_car.rows
        if path is not None and path.parent == self._beside and self._name in TARGET_FOLDERS:
            capture, rows = _leave_out_lr(capture, rows)
        named = self._layout_name or capture.layout
        name = named or shot.layout
        layout = None if name is None else self._layout(name)
        spelled_out = list_declared_buffers(named, layout, capture)
        return Declarations(
            capture=capture,
            side_car=rows,
            layout=layout,
            spelled_out=spelled_out,
            sources={b: str(path if b in capture.buffers else named) for b in spelled_out},
            remarks=tuple(_describe_no_file(p) for p in takewhile(lambda p: p != path, above)),
        )

    def _list_capture_files(self, folder: Path) -> list[Path]:
        """What is named capture.toml from a folder up to IN or its shot, the nearest first."""
        above = [folder, *(p for p in folder.parents if p.is_relative_to(self._root))]
        above += [] if self._beside is None else [self._beside]
        return [p / CAPTURE_FILE for p in above if os.path.lexists(p / CAPTURE_FILE)]

    def _read_own(self, folder: Path) -> CaptureDeclaration:
        """What a folder's own capture.toml says; of IN also the one of the shot it is part of."""
        shot = [self._beside] if folder == self._root and self._beside is not None else []
        files = (p / CAPTURE_FILE for p in (folder, *shot))
        path = next(filter(is_file, files), None)
        return CaptureDeclaration() if path is None else self._capture(path)

    def _place_side_car(self, capture: Path, name: str) -> Path:
        """Say where a side-car lies that a capture.toml names.

        Raises:
            ConfigError: it is neither beside or below that file nor below IN.
        """
        path = Path(os.path.normpath(capture.parent / name))
        around = (Path(os.path.normpath(folder)) for folder in (capture.parent, self._root))
        if not any(path.is_relative_to(folder) for folder in around):
            raise ConfigError(
                f"{capture}: camera = '{shorten_value(name)}' leads out of {self._root}; put the "
                "side-car beside capture.toml"
            )
        return path

    def list_searched_layouts(self, folder: Path) -> tuple[Layout, ...]:
        """Layouts whose folders a folder is searched for: the one that is named for it, or all.

        Raises:
            RtsrError: a layout or capture.toml is not valid.
        """
        given = self._capture_file
        capture = self._read_own(folder) if given is None else self._capture(given)
        name = self._layout_name or capture.layout
        return tuple(LAYOUTS.values()) if name is None else (self._layout(name),)

    def buffer_folders(self, folder: Path) -> tuple[str, ...]:
        """Patterns of buffer folders by a folder's own capture.toml.

        Raises:
            RtsrError: a layout or capture.toml is not valid.
        """
        capture = self._read_own(folder)
        own = Layout(
            name="", description="", buffers=build_components(capture.buffers), folders=True
        )
        named = () if capture.layout is None else (self._layout(capture.layout),)
        return list_folder_patterns((own, *named))


def _find_shot_folder(root: Path, name: str) -> Path | None:
    """Return the folder of the shot that IN, of some name, is a part of; None if it is none."""
    if name not in SHOT_PARTS:
        return None
    return root.parent if root.name == name else root / os.pardir


def _leave_out_lr(
    capture: CaptureDeclaration, rows: Mapping[int, CameraRow]
) -> tuple[CaptureDeclaration, Mapping[int, CameraRow]]:
    """Leave out what a shot declares of its LR frames, where frames of the target size are IN."""
    still = {number: row.model_copy(update={"jitter_px": None}) for number, row in rows.items()}
    return capture.model_copy(update={"jitter_px": None, "scale": None}), still


def _describe_no_file(path: Path) -> str:
    """Say why a capture.toml is not read."""
    what = "is a link to no file" if path.is_symlink() else "is no regular file"
    return f"{path}: {what}, nothing is taken from it; mend or remove it"


def list_folder_patterns(layouts: Iterable[Layout]) -> tuple[str, ...]:
    """Patterns of folders that hold one buffer each."""
    patterns = {p for layout in layouts if layout.folders for p in layout.known_files}
    return tuple(sorted(p.replace(SCOPE, "*") for p in patterns))
