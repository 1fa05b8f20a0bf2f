"""Numbered EXR files of one folder: what one wildcard each would name."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fileseq

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import list_names

FRAME_SUFFIX = ".exr"

MASKS = ("", ".RGBA")
"""What may stand between a number and the suffix: Falcor's word for files that have alpha. Those
without it are another sequence."""


@dataclass(frozen=True, kw_only=True)
class FileSequence:
    """One numbered file sequence: what one wildcard would name."""

    key: str
    base: str
    files: Mapping[int, Path]


def list_sequences(folder: Path, prefix: str = "") -> dict[str, FileSequence]:
    """Return the numbered EXR sequences directly in a folder, by `prefix` and name.

    Raises:
        FrameFolderError: the folder cannot be read, or a frame is there twice.
    """
    files_by_key: dict[str, dict[int, str]] = {}
    bases: dict[str, str] = {}
    for sequence in _find_sequences(folder):
        frames = sequence.frameSet()
        mask, dot, suffix = sequence.extension().rpartition(".")
        if frames is None or f"{dot}{suffix}".lower() != FRAME_SUFFIX or mask not in MASKS:
            continue
        base = sequence.basename().rstrip("._- ")
        key = f"{prefix}{base}{mask}"
        files = files_by_key.setdefault(key, {})
        for index, number in enumerate(frames):
            file = os.path.basename(str(sequence[index]))  # noqa: PTH119
            other = files.setdefault(int(number), file)
            if other != file:
                raise FrameFolderError(
                    f"{folder}: frame {number} is there twice ({other} and {file}); "
                    "remove one of them"
                )
        bases[key] = base
    return {
        key: FileSequence(key=key, base=bases[key], files=_sort_files(folder, files, bases[key]))
        for key, files in files_by_key.items()
    }


def _find_sequences(folder: Path) -> list[Any]:
    """Find numbered files of any kind."""
    list_names(folder)
    try:
        return list(fileseq.findSequencesOnDisk(str(folder)))
    except ArithmeticError as error:
        raise FrameFolderError(
            f"{folder}: a file is numbered with more digits than frame numbers have; rename it, or "
            "move it out of the folder"
        ) from error


def _sort_files(folder: Path, files: Mapping[int, str], base: str) -> dict[int, Path]:
    """Sort by number; a dash that follows the name in every file separates, it is no sign."""
    after = [name[len(base) : len(base) + 2] for name in files.values()]
    separated = base and all(text[:1] == "-" and text[1:].isdigit() for text in after)
    numbered = sorted((-n if separated else n, name) for n, name in files.items())
    return {number: folder / name for number, name in numbered}
