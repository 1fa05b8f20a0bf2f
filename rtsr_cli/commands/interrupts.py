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

from rtsr_cli.commands.exit_codes import SIGNALLED

STOPPING = (signal.SIGINT, signal.SIGTERM)
"""Signals that end a run in good order."""

INTERRUPTED = "Interrupted: what is finished is kept; run again for the rest"

NOTHING_KEPT = "Interrupted: nothing was written; an evaluation starts anew when it is run again"


def end_at_once(number: int, _: FrameType | None) -> NoReturn:
    """End at once, in one line."""
    with suppress(OSError, RuntimeError, ValueError, AttributeError):
        sys.stdout.flush()
    _end(number, INTERRUPTED)


def _leave_without_result(number: int, _: FrameType | None) -> NoReturn:
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
def unwind_on_signals() -> Iterator[None]:
    """While files are written, let the signals that otherwise end the process unwind it."""
    if signal.getsignal(signal.SIGINT) is not end_at_once:
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
                signal.signal(number, end_at_once)


@contextmanager
def discard_on_interrupt() -> Iterator[None]:
    """While an evaluation is worked out, let Ctrl-C say that nothing of it is kept."""
    if signal.getsignal(signal.SIGINT) is not end_at_once:
        yield
        return
    for number in STOPPING:
        signal.signal(number, _leave_without_result)
    try:
        yield
    finally:
        for number in STOPPING:
            signal.signal(number, end_at_once)
