"""`python -m rtsr_cli`, and the `rtsr` script: a signal ends both in one line from the start on."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from types import FrameType
from typing import NoReturn


def _leave(number: int, _: FrameType | None) -> NoReturn:
    """End at once, as nothing has begun; `cli.leave` takes over once it is imported."""
    with suppress(OSError):
        os.write(2, b"Interrupted: nothing was done\n")
    os._exit(128 + number)


def main() -> NoReturn:
    """Entry point of `rtsr`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)
    from rtsr_cli.cli import main as run

    run()


if __name__ == "__main__":
    main()
