"""Asking the file system about paths that users name: what cannot be asked is simply not there."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.errors import FrameFolderError


def is_folder(path: Path) -> bool:
    """Tell whether a path leads to a folder; `Path.is_dir` raises where it may not look."""
    try:
        return path.is_dir()
    except OSError:
        return False


def is_file(path: Path) -> bool:
    """Tell whether a path leads to a regular file: no pipe, no device."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_loop(path: Path) -> bool:
    """Tell whether a path is a link that leads back to itself."""
    try:
        path.stat()
    except OSError as error:
        return error.errno == errno.ELOOP
    return False


def describe_obstacle(folder: Path) -> str:
    """Say what stands where a folder or one above it would be; empty where nothing does."""
    there = next((path for path in (folder, *folder.parents) if os.path.lexists(path)), None)
    if there is None or is_folder(there):
        return ""
    if is_loop(there):
        return f"{there} is a link that leads back to itself"
    if there.is_symlink() and not there.exists():
        return f"{there} is a link to what is not there"
    return f"{there} is a file, no folder"


def find_real_path(path: Path) -> Path:
    """Return the path without links; of a link that leads to itself, the path as it is."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return path.absolute()


@dataclass(frozen=True, kw_only=True)
class FolderContent:
    """What is not hidden in a folder, sorted by name.

    Attributes:
        folder: the folder.
        folders: names of the folders in it, and of links to such.
        others: names of all else, dead links among it.
    """

    folder: Path
    folders: tuple[str, ...]
    others: tuple[str, ...]

    @property
    def subfolders(self) -> list[Path]:
        """The folders in it."""
        return [self.folder / name for name in self.folders]


def list_content(folder: Path) -> FolderContent:
    """List a folder; of files, the system is asked nothing more.

    Raises:
        FrameFolderError: the folder cannot be read or entered; names it.
    """
    folders: list[str] = []
    others: list[str] = []
    for entry in _list_entries(folder):
        if not entry.name.startswith("."):
            (folders if _leads_to_folder(entry) else others).append(entry.name)
    return FolderContent(
        folder=folder, folders=tuple(sorted(folders)), others=tuple(sorted(others))
    )


def list_names(folder: Path) -> list[str]:
    """Names of what lies in a folder, sorted.

    Raises:
        FrameFolderError: the folder cannot be read or entered; names it.
    """
    return sorted(entry.name for entry in _list_entries(folder))


def _list_entries(folder: Path) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            listed = list(entries)
    except OSError as error:
        raise FrameFolderError(f"{folder}: cannot be read ({error.strerror})") from error
    if not os.access(folder, os.X_OK):
        raise FrameFolderError(f"{folder}: cannot be entered; what is in it cannot be read")
    return listed


def _leads_to_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False
