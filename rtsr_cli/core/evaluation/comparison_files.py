"""What a comparison reads of the files of its folders: several of these may be one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from rtsr_cli.core.captures.header_files import HeaderFiles
from rtsr_cli.core.captures.shots import Shot, collect_frame_set
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.pairs.opening import (
    OpenedShot,
    ReadOptions,
    find_shots_of,
    open_declarations,
    open_shot,
)


class ComparisonFiles:
    """Shots of the folders of one comparison; each file and folder is read once."""

    def __init__(self, options: ReadOptions) -> None:
        """Remember how frames are read; nothing is read yet."""
        self._options = options
        self._declarations = cache(open_declarations)
        self._frame_set = cache(collect_frame_set)
        self.headers = HeaderFiles()

    def find_shot(self, root: Path, name: str, below: Sequence[str]) -> Shot:
        """Find the frames of one shot below a folder; "" is the folder's own, or its only shot's.

        Raises:
            FrameFolderError: there are none; names where they were looked for.
        """
        for sub in below:
            folder = root / name / sub
            frames = self._frame_set(folder) if is_folder(folder) else None
            if frames is not None:
                return Shot(name=name or ".", root=folder, frames=frames)
        held = self._find_targets(root, name)
        if held is not None:
            return held
        others = [] if name else find_shots_of(root, ReadOptions())
        if len(others) == 1:
            return others[0]
        more = f"; it holds {', '.join(shot.name for shot in others)}: name one" if others else ""
        places = ", ".join(repr(sub) for sub in below if sub)
        raise FrameFolderError(
            f"{root / name}: no numbered EXR frames here or in {places} below, to judge "
            f"{f'shot {name!r}' if name else 'the frames'} by{more}"
        )

    def _find_targets(self, root: Path, name: str) -> Shot | None:
        """Frames of the target size of a shot, where folders are those of a layout's data set."""
        try:
            shots = find_shots_of(root, self._options)
        except FrameFolderError:
            # whoever asked says what is missing, and where
            return None
        for shot in shots:
            if shot.name == (name or ".") and shot.layout and shot.hr is not None:
                return replace(shot, frames=shot.hr, hr=None)
        return None

    def open_shot(self, shot: Shot, root: Path) -> OpenedShot:
        """Resolve what is declared about a shot below a folder.

        Raises:
            RtsrError: a declaration is not valid.
        """
        declared = self._declarations(root, self._options)
        return open_shot(shot, root, self._options, files=declared, headers=self.headers)
