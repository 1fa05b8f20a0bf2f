"""Where an output came from: stamps that tell a finished file from a stale or foreign one."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

from rtsr_cli import __version__
from rtsr_cli.core.errors import FrameFolderError, InputChangedError
from rtsr_cli.core.files.exr_chunks import SIZE_BYTES
from rtsr_cli.core.frames.conventions import Conventions
from rtsr_cli.core.marks import MARKED
from rtsr_cli.core.visible_text import make_visible

COLOR_TAG, SCENE_SUFFIX = "colorInteropID", "_scene"
"""Attribute that names the primaries of radiance, and how its values end [ASWF colour interop]."""

STAMP = "rtsr:stamp"
"""Header attribute: hash of config, weights and inputs; no dates, no absolute paths."""

PREDICTED = "rtsr:predicted"
"""Header attribute of frames that no renderer made: 1 where a system predicted them."""

PAST = "rtsr:past"
"""Header attribute of predicted frames: rendered ones of the unbroken sequence before them."""

DIGEST_BYTES = 16

LONGEST_COUNT = 9
"""Digits of a count that others wrote, less than so many."""

Signature = tuple[int, int]
"""Size in bytes and time of the last change in ns: tells one content from another unread."""


def digest_values(*parts: object) -> str:
    """Hash a list of plain values (JSON; keys sorted)."""
    text = json.dumps(parts, sort_keys=True, default=str, ensure_ascii=True)
    return hashlib.blake2b(text.encode(), digest_size=DIGEST_BYTES).hexdigest()


def digest_config(*parts: object) -> str:
    """Hash what, beside the inputs, decides the outputs' bytes: this version, and plain values."""
    return digest_values(__version__, *parts)


class FileDigests:
    """Content hashes of input files, each file read once a run, and checked to stay as planned.

    A stamp must only be given for what was read: files are looked at when the run is planned
    (`note`), and again after each was hashed and decoded (`check`).
    """

    def __init__(self) -> None:
        """Start with nothing known."""
        self._known: dict[Path, str] = {}
        self._noted: dict[Path, Signature | None] = {}
        self._lock = Lock()

    def note(self, paths: Iterable[Path]) -> None:
        """Remember size and time of files; one that is not there is remembered as such."""
        for path in paths:
            if path not in self._noted:
                self._noted[path] = _read_signature(path)

    def bytes_of(self, paths: Iterable[Path]) -> int:
        """Size of files as it was noted, each counted once."""
        notes = (self._noted.get(path) for path in set(paths))
        return sum(signature[0] for signature in notes if signature)

    def check(self, paths: Iterable[Path]) -> None:
        """Raise if a file is not the one that was noted any more.

        Raises:
            InputChangedError: names the file, and whether it vanished or changed.
        """
        for path in paths:
            now = _read_signature(path)
            if now is None:
                raise InputChangedError(
                    f"{path}: vanished since the run was planned; put it back and run again"
                )
            if self._noted.get(path, now) != now:
                raise InputChangedError(
                    f"{path}: changed since the run was planned; run again when it is finished"
                )

    @contextmanager
    def hold_unchanged(self, paths: Sequence[Path]) -> Iterator[None]:
        """Check files before and after what is done inside, also where that fails.

        Raises:
            InputChangedError: a file vanished or changed.
        """
        self.check(paths)
        try:
            yield
        finally:
            # a file that changed meanwhile explains whatever went wrong inside
            self.check(paths)

    def of(self, path: Path) -> str:
        """Hash a file's bytes.

        Raises:
            FrameFolderError: the file cannot be read.
        """
        with self._lock:
            known = self._known.get(path)
        if known is not None:
            return known
        self.note((path,))
        try:
            with path.open("rb") as file:
                # processors have instructions for this one: a third of BLAKE2's time
                value = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise FrameFolderError(f"{path}: cannot be read ({error.strerror})") from error
        with self._lock:
            self._known[path] = value
        return value

    def of_all(self, paths: Sequence[Path]) -> str:
        """Hash several files as one."""
        return digest_values(*(self.of(path) for path in paths))


def _read_signature(path: Path) -> Signature | None:
    """Size and time of the last change of a file; None if it is not there."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def describe_provenance(
    *, command: str, config_hash: str, source: Path, stamp: str, extra: Mapping[str, Any]
) -> dict[str, Any]:
    """Header attributes that every output carries."""
    return {
        "software": f"rtsr {__version__}",
        **MARKED,
        "rtsr:command": command,
        "rtsr:configHash": config_hash,
        "rtsr:sourceFrame": make_visible(source.name),
        STAMP: stamp,
        **extra,
    }


def read_past(attributes: Mapping[str, Any]) -> int | None:
    """Rendered frames that a predicted one had before it; None where nothing says so."""
    told = str(attributes.get(PAST, ""))
    return int(told) if told.isascii() and told.isdecimal() and len(told) < LONGEST_COUNT else None


def is_predicted(attributes: Mapping[str, Any]) -> bool:
    """Tell whether a file says of itself that it is a predicted frame."""
    return str(attributes.get(PREDICTED, 0)) not in {"0", "False", ""}


def name_color_space(conventions: Conventions) -> dict[str, str]:
    """`colorInteropID` of the radiance, where its primaries are declared or named; no guess."""
    space = conventions.colorspace
    return {} if space is None else {COLOR_TAG: f"{space.value}{SCENE_SUFFIX}"}


def holds_stamp(content: bytes, stamp: str) -> bool:
    """Tell whether the bytes of an EXR, however damaged, hold a stamp in their header."""
    name, kind, value = STAMP.encode(), b"string", stamp.encode()
    size = len(value).to_bytes(SIZE_BYTES, "little")
    return b"\0".join((name, kind, size + value)) in content
