"""Keeping OpenEXR's own lines off the terminal: what is wrong is said once, with the file's name.

The C library writes `<file>: (EXR_ERR_...) ...` to file descriptor 2 and its Python module prints
a warning to `sys.stdout`; neither can be told not to. Both would spoil `--json` and say twice
what the exception says.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any, TextIO, cast

from rtsr_cli.core.files.standard_streams import open_tolerant

STDERR = 2
LIBRARY_LINE = re.compile(rb"^.*\(EXR_ERR_\w+\).*\n?", re.MULTILINE)
"""What the C library says about a damaged file."""


class _ThreadFilter:
    """A text stream that drops what the silenced threads write; for the others it is `stream`."""

    def __init__(self, stream: TextIO, silenced: set[int]) -> None:
        self._stream = stream
        self._silenced = silenced

    def write(self, text: str) -> int:
        """Write, or swallow."""
        if threading.get_ident() in self._silenced:
            return len(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class _Silencer:
    """Diverts descriptor 2 and `sys.stdout` while any thread is inside; the last one restores.

    What Python writes to `sys.stderr` meanwhile goes straight to where it belongs. Lines that other
    C code writes are passed on as each thread leaves.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._silenced: set[int] = set()
        self._stdout: TextIO | None = None
        self._proxy: _ThreadFilter | None = None
        self._stderr = -1
        self._diverted: IO[bytes] | None = None
        self._passed = 0
        self._python: TextIO | None = None
        self._direct: TextIO | None = None

    def is_silenced(self) -> bool:
        """Tell whether the present thread is inside."""
        return threading.get_ident() in self._silenced

    def enter(self) -> None:
        """Silence the present thread."""
        with self._lock:
            if not self._silenced:
                self._divert()
            self._silenced.add(threading.get_ident())

    def leave(self) -> None:
        """Let the present thread speak again."""
        with self._lock:
            self._silenced.discard(threading.get_ident())
            if not self._silenced:
                self._restore()
            self._pass_on()
            if not self._silenced:
                self._close()

    def _divert(self) -> None:
        self._stdout = sys.stdout
        self._proxy = _ThreadFilter(self._stdout, self._silenced)
        sys.stdout = cast(TextIO, self._proxy)
        if not hasattr(os, "pread"):
            return
        # without descriptor 2, or without a place for the diverted lines, nothing is diverted
        with suppress(OSError):
            self._diverted = tempfile.TemporaryFile(mode="a+b", buffering=0)  # noqa: SIM115
            self._stderr = os.dup(STDERR)
            self._divert_python()
            os.dup2(self._diverted.fileno(), STDERR)

    def _divert_python(self) -> None:
        """Give Python a stream of its own to where descriptor 2 leads."""
        try:
            if sys.stderr.fileno() != STDERR:
                return
        except (OSError, ValueError, AttributeError):
            # no file: a test's buffer, or none at all
            return
        if self._direct is None or not os.path.sameopenfile(self._direct.fileno(), STDERR):
            # it is kept: a thread may be writing to it at any time
            self._direct = open_tolerant(os.dup(STDERR), sys.stderr.encoding)
        self._python, sys.stderr = sys.stderr, self._direct

    def _restore(self) -> None:
        if sys.stdout is cast(TextIO, self._proxy) and self._stdout is not None:
            sys.stdout = self._stdout
        if self._stderr >= 0:
            os.dup2(self._stderr, STDERR)
        if self._python is not None and sys.stderr is self._direct:
            sys.stderr = self._python
        self._python = None

    def _pass_on(self) -> None:
        if self._diverted is None or self._stderr < 0:
            return
        # the two descriptors share one position, so that it is kept apart
        size = os.fstat(self._diverted.fileno()).st_size
        text = os.pread(self._diverted.fileno(), size - self._passed, self._passed)
        self._passed = size
        if ours := LIBRARY_LINE.sub(b"", text):
            os.write(self._stderr, ours)

    def _close(self) -> None:
        if self._stderr >= 0:
            os.close(self._stderr)
            self._stderr = -1
        if self._diverted is not None:
            self._diverted.close()
            self._diverted = None
        self._passed = 0


_SILENCER = _Silencer()


@contextmanager
def silence_library() -> Iterator[None]:
    """Swallow what OpenEXR writes to the terminal inside; any number of threads may be inside.

    A thread that is inside already may come in again, which costs nothing.
    """
    if _SILENCER.is_silenced():
        yield
        return
    _SILENCER.enter()
    try:
        yield
    finally:
        _SILENCER.leave()
