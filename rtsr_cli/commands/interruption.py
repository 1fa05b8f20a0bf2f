"""What Ctrl-C and a request to end do: unwind where files are written, else end at once.

An exception out of a signal would be lost in callbacks of the interpreter, and leave modules half
imported; where nothing is to be finished, none is raised.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn

STOPPING = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a run in good order."""

SIGNALLED = 128
"""Plus the signal's number: the exit code that shells use."""

INTERRUPTED = "Interrupted: what is finished is kept; run again for the rest"

NOTHING_KEPT = "Interrupted: nothing was written; an evaluation starts anew when it is run again"


def leave(number: int, _: FrameType | None) -> NoReturn:
    """End at once, in one line."""
    with suppress(OSError, RuntimeError, ValueError, AttributeError):
        sys.stdout.flush()
    _end(number, INTERRUPTED)


def _leave_nothing(number: int, _: FrameType | None) -> NoReturn:
    """End at once, in one line that is true while nothing is written."""
    _end(number, NOTHING_KEPT)


def _end(number: int, message: str) -> NoReturn:
    with suppress(OSError, ValueError, AttributeError):
        # not descriptor 2: it leads elsewhere while the library is silenced
        os.write(sys.stderr.fileno(), f"{message}\n".encode())
    os._exit(SIGNALLED + number)


def _interrupt(number: int, _: FrameType | None) -> None:
    """Unwind, so that files being written are finished; a second signal changes nothing."""
    for other in STOPPING:
        signal.signal(other, signal.SIG_IGN)
    raise KeyboardInterrupt(number)


@contextmanager
def unwinding() -> Iterator[None]:
    """While files are written, let the signals that otherwise end the process unwind it."""
    if signal.getsignal(signal.SIGINT) is not leave:
        yield
        return
    for number in STOPPING:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number in STOPPING:
            # after a signal both are ignored, until the process has ended
            if signal.getsignal(number) is _interrupt:
                signal.signal(number, leave)


@contextmanager
def keeping_nothing() -> Iterator[None]:
    """While an evaluation is worked out, let Ctrl-C say that nothing of it is kept."""
    if signal.getsignal(signal.SIGINT) is not leave:
        yield
        return
    for number in STOPPING:
        signal.signal(number, _leave_nothing)
    try:
        yield
    finally:
        for number in STOPPING:
            signal.signal(number, leave)
