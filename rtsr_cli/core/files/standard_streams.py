"""Standard output and standard error that never end the work behind them.

A reader that went away, a closed descriptor, an encoding that lacks a letter: what cannot be shown
is dropped, or replaced by an escape, and the work goes on to its own end.
"""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from contextlib import suppress
from typing import Any, TextIO

STANDARD_NUMBERS = range(3)
"""Descriptors of input, output and errors."""

GONE = frozenset({errno.EPIPE, errno.EBADF, errno.ESHUTDOWN, errno.ECONNRESET})
"""Nobody listens: nothing is lost to anyone."""

ESCAPED = "backslashreplace"
"""How letters are written that an encoding lacks."""


class TolerantFile(io.FileIO):
    """A descriptor that is written to until it fails; from then on all is dropped.

    Attributes:
        failure: the error that it failed with, if it did.
    """

    def __init__(self, number: int) -> None:
        """Write to a descriptor, which stays open."""
        super().__init__(number, "w", closefd=False)
        self.failure: OSError | None = None

    def write(self, content: Any, /) -> int:
        """Write, or drop."""
        while self.failure is None:
            try:
                taken = super().write(content)
                if taken is not None:
                    return taken
                # a pipe that does not block, and is full
                select.select([], [self], [])
            except OSError as error:
                self.failure = error
        return memoryview(content).nbytes


def open_tolerant(number: int, encoding: str | None = None) -> TextIO:
    """Return a stream of text to a descriptor; lines are written as they end."""
    buffer = io.BufferedWriter(TolerantFile(number))
    return io.TextIOWrapper(
        buffer, encoding=encoding or "utf-8", errors=ESCAPED, line_buffering=True
    )


def make_streams_tolerant() -> None:
    """Replace `sys.stdout` and `sys.stderr`; descriptors that are closed lead nowhere from here on.

    A descriptor that stayed closed would become that of the next file that is opened, and what a
    library says to it would be written into that file.
    """
    for number in STANDARD_NUMBERS:
        try:
            os.fstat(number)
        except OSError:
            # the lowest free number is taken
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _make_tolerant(sys.stdout, 1)
    sys.stderr = _make_tolerant(sys.stderr, 2)


def _make_tolerant(stream: TextIO | None, number: int) -> TextIO:
    if stream is None:
        return open_tolerant(number)
    # a Windows console, say, is left as it is
    plain = type(_find_file(stream)) is io.FileIO
    return open_tolerant(number, stream.encoding) if plain else stream


def _find_file(stream: TextIO) -> object:
    """What is below a stream: under its buffer, unless Python was told to have none."""
    buffer = getattr(stream, "buffer", None)
    return getattr(buffer, "raw", buffer)


def find_loss(stream: TextIO) -> OSError | None:
    """Return why text that somebody waits for was not written, None if none is lost."""
    with suppress(OSError, ValueError):
        stream.flush()
    failure = getattr(_find_file(stream), "failure", None)
    return failure if isinstance(failure, OSError) and failure.errno not in GONE else None
