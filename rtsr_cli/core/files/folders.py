"""Asking the file system about paths that users name: what cannot be asked is simply not there."""

from __future__ import annotations

import os
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


def find_real_path(path: Path) -> Path:
    """Return the path without links; of a link that leads to itself, the path as it is."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return path.absolute()


def list_names(folder: Path) -> list[str]:
    """Names of what lies in a folder, sorted.

    Raises:
        FrameFolderError: the folder cannot be read or entered; names it.
    """
    try:
        with os.scandir(folder) as entries:
            names = sorted(entry.name for entry in entries)
    except OSError as error:
        raise FrameFolderError(f"{folder}: cannot be read ({error.strerror})") from error
    if not os.access(folder, os.X_OK):
        raise FrameFolderError(f"{folder}: cannot be entered; what is in it cannot be read")
    return names
