"""What lies beside frames and is named like one, but is none: folders, dead links."""

from __future__ import annotations

import os
import re
from pathlib import Path

from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.files.folders import is_file, is_folder, is_loop

FRAME_NAME = re.compile(r"\d(\.RGBA)?\.exr$", re.IGNORECASE)
"""Ends the name of a numbered frame."""


def list_misnamed(frames: FrameSet) -> dict[Path, str]:
    """Say what is wrong with folders and dead links that are named like the frames beside them."""
    folders = {stream.folder for stream in frames.streams.values()}
    return {p: _describe(p) for folder in sorted(folders) for p in _find_no_files(folder)}


def _find_no_files(folder: Path) -> list[Path]:
    """What is named like a frame and is no file, nor a link to one."""
    with os.scandir(folder) as entries:
        # that an entry is a file itself is known without asking for it
        others = [folder / e.name for e in entries if not e.is_file(follow_symlinks=False)]
    return sorted(
        path
        for path in others
        if FRAME_NAME.search(path.name) and not (path.name.startswith(".") or is_file(path))
    )


def _describe(path: Path) -> str:
    if is_folder(path):
        return f"{path}: is a folder that is named like a frame; rename it, or put the frame there"
    if not path.is_symlink():
        return f"{path}: is no file, though it is named like a frame; rename or remove it"
    if is_loop(path):
        return (
            f"{path}: is a link to {path.readlink()}, which leads back to itself; make it anew, or "
            "remove it"
        )
    return (
        f"{path}: is a link to {path.readlink()}, which is not there; mount or copy what it leads "
        "to, or remove the link"
    )
