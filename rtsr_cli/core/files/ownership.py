"""Which files rtsr wrote, by their marks, and the refusal to replace others; needs no EXR library.

One rule for files of every kind. What bears the mark is rtsr's, also where it was cut behind it:
marks stand in the first bytes of a file. An empty file holds nothing that could be lost, and may be
replaced. Everything else is another's: what was cut before its mark, and a link, wherever it leads.
"""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.exr_chunks import FIXED_BYTES, FileBytes, list_attributes
from rtsr_cli.core.files.png import read_png_texts
from rtsr_cli.core.files.tensor_file import read_metadata
from rtsr_cli.core.marks import MARK, MARKDOWN_MARK, TOML_MARK

TENSORS_KEY, TENSORS_FORMAT = "rtsr", "rtsr-"
"""Of metadata of tensors: a key, and how the names of formats begin."""

HEAD_BYTES = 1 << 16
"""Pages have the mark near their beginning."""

JSON_MARK = re.compile(rb'\s*\{\s*"rtsr:version":\s*"')
"""How documents of rtsr's begin; it tells those that were cut."""

TENSORS_MARK = re.compile(
    rb'.{8}\{"__metadata__":\{"(?:rtsr"|format":"rtsr-|format":"pt","rtsr")', re.DOTALL
)
"""How files of tensors of rtsr's begin; it tells those that were cut in their header."""

PAGE_MARK = re.compile(rb'<meta name="rtsr:version" content="[^"<>]*">')


def is_own(path: Path) -> bool:
    """Tell whether rtsr wrote a file, by what its suffix promises."""
    recognise = RECOGNISERS.get(path.suffix.lower())
    try:
        # what is no file, a pipe say, might never answer
        return recognise is not None and path.is_file() and recognise(path)
    except OSError:
        return False


def _is_own_exr(path: Path) -> bool:
    with path.open("rb", buffering=0) as file:
        attributes, _ = list_attributes(FileBytes(file), FIXED_BYTES)
    return any(attribute.name == MARK.encode() for attribute in attributes)


def _is_own_png(path: Path) -> bool:
    return MARK in read_png_texts(path)


def _is_own_json(path: Path) -> bool:
    text = path.read_bytes()
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return JSON_MARK.match(text) is not None
    return isinstance(content, dict) and MARK in content


def _is_own_page(path: Path) -> bool:
    return PAGE_MARK.search(_read_head(path)) is not None


def _is_own_markdown(path: Path) -> bool:
    return _read_head(path).startswith(MARKDOWN_MARK.encode())


def _is_own_toml(path: Path) -> bool:
    return _read_head(path).startswith(TOML_MARK.encode())


def is_own_tensors(path: Path) -> bool:
    """Tell whether rtsr wrote a file of tensors, whatever its suffix."""
    if not path.is_file():
        return False
    known = read_metadata(path)
    if known is None:
        return TENSORS_MARK.match(_read_head(path)) is not None
    return TENSORS_KEY in known or str(known.get("format", "")).startswith(TENSORS_FORMAT)


def _read_head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


RECOGNISERS: Mapping[str, Callable[[Path], bool]] = {
    ".exr": _is_own_exr,
    ".png": _is_own_png,
    ".json": _is_own_json,
    ".html": _is_own_page,
    ".toml": _is_own_toml,
    ".md": _is_own_markdown,
    ".safetensors": is_own_tensors,
    ".rtsr-clips": is_own_tensors,
}
"""What tells by a suffix whether a file is rtsr's."""


def is_empty_file(path: Path) -> bool:
    """Tell whether a path is a file, no link, of no bytes."""
    try:
        status = path.lstat()
    except OSError:
        return False
    return stat.S_ISREG(status.st_mode) and status.st_size == 0


def may_be_replaced(path: Path, recognise: Callable[[Path], bool] = is_own) -> bool:
    """Tell whether what a path is taken by, if anything, may be replaced without being asked."""
    if not os.path.lexists(path) or is_empty_file(path):
        return True
    return not path.is_symlink() and recognise(path)


def list_foreign(paths: Iterable[Path], recognise: Callable[[Path], bool] = is_own) -> list[Path]:
    """Return those paths that are taken by what rtsr did not write, or cannot tell for its own."""
    return [path for path in paths if not may_be_replaced(path, recognise)]


def refuse_foreign(paths: Sequence[Path], command: str) -> None:
    """Raise if files stand in the way that this run would not have written.

    Raises:
        OutputError: names the first and counts them.
    """
    if not paths:
        return
    more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    raise OutputError(
        f"{paths[0]}{more}: {explain_foreign(paths[0], command)}; choose another folder, or "
        "replace with --overwrite"
    )


def explain_foreign(path: Path, command: str) -> str:
    """Say why a file is not replaced."""
    if path.is_symlink():
        return "is a link, which is neither followed nor replaced"
    return f"{command} did not write this from these inputs and settings, or its mark is cut off"
