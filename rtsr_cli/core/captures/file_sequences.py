"""Numbered EXR files of one folder: what one wildcard each would name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import FolderContent, list_content
from rtsr_cli.core.limits import LARGEST_FRAME

NUMBERED = re.compile(r"(?P<base>.*?)(?P<number>-?\d+)(?P<mask>\.RGBA)?\.[eE][xX][rR]")
"""A frame's name. Between number and suffix may stand Falcor's word for files that have alpha:
those without it are another sequence."""

VERSION = re.compile(r"\.\w*[A-Za-z]\d")
"""Ends a word that counts no frames: `beauty.v1.exr` is a file of its own, `beauty.v01.exr` is
frame 1."""


class FrameFiles(Mapping[int, Path]):
    """Files of one folder by frame number; a path is made when it is asked for."""

    def __init__(self, folder: Path, names: Mapping[int, str]) -> None:
        """Remember where the files lie, and what they are called."""
        self._folder, self._names = folder, names
        self._paths: dict[int, Path] = {}

    def __getitem__(self, number: int) -> Path:
        """Return the file of a frame.

        Raises:
            KeyError: there is none.
        """
        path = self._paths.get(number)
        if path is None:
            path = self._paths[number] = self._folder / self._names[number]
        return path

    def __contains__(self, number: object) -> bool:
        """Tell whether there is a file of a frame."""
        return number in self._names

    def __iter__(self) -> Iterator[int]:
        """Go through the frame numbers."""
        return iter(self._names)

    def __len__(self) -> int:
        """Count the files."""
        return len(self._names)


@dataclass(frozen=True, kw_only=True)
class FileSequence:
    """One numbered file sequence: what one wildcard would name.

    Attributes:
        key: what it is called among the sequences of a shot.
        base: what the names of its files begin with.
        folder: where all of them lie.
        files: by frame number, ascending.
    """

    key: str
    base: str
    folder: Path
    files: Mapping[int, Path]


def list_sequences(folder: Path, prefix: str = "") -> dict[str, FileSequence]:
    """Return the numbered EXR sequences directly in a folder; see `group_sequences`.

    Raises:
        FrameFolderError: the folder cannot be read, or a frame is there twice.
    """
    return group_sequences(list_content(folder), prefix)


def group_sequences(content: FolderContent, prefix: str = "") -> dict[str, FileSequence]:
    """Return the numbered EXR sequences of what lies in a folder, by `prefix` and name.

    Raises:
        FrameFolderError: a frame is there twice.
    """
    folder = content.folder
    files_by_key: dict[str, dict[int, str]] = {}
    bases: dict[str, str] = {}
    for name in content.others:
        found = NUMBERED.fullmatch(name)
        if found is None:
            continue
        start, digits, mask = found.groups(default="")
        if len(digits) == 1 and VERSION.fullmatch(name, start.rfind("."), found.end("number")):
            continue
        base = start.rstrip("._- ")
        key = f"{prefix}{base}{mask}"
        files, number = files_by_key.setdefault(key, {}), _read_number(digits, folder / name)
        other = files.setdefault(number, name)
        if other != name:
            raise FrameFolderError(
                f"{folder}: frame {number} is there twice ({other} and {name}); remove one of them"
            )
        bases[key] = base
    return {
        key: FileSequence(
            key=key,
            base=bases[key],
            folder=folder,
            files=FrameFiles(folder, _sort_names(names, bases[key])),
        )
        for key, names in files_by_key.items()
    }


def _read_number(digits: str, path: Path) -> int:
    number = int(digits)
    if abs(number) > LARGEST_FRAME:
        raise FrameFolderError(
            f"{path}: is numbered with more digits than frame numbers have; rename it, or move it "
            "out of the folder"
        )
    return number


def _sort_names(names: Mapping[int, str], base: str) -> dict[int, str]:
    """Sort by number; a dash that follows the base in every name separates, it is no sign."""
    after = (name[len(base) : len(base) + 2] for name in names.values())
    separated = base and all(text[:1] == "-" and text[1:].isdigit() for text in after)
    return dict(sorted((-n if separated else n, name) for n, name in names.items()))
