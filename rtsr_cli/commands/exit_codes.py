"""The exit codes of every command: the one table of them."""

from __future__ import annotations

import signal
from collections.abc import Mapping

FAILED = 1
"""Some frames failed and the rest are done, or a demand is missed."""

USAGE = 2
"""The command line is wrong; click's own."""

REFUSED = 3
"""The input is refused, or nothing more can be written."""

SIGNALLED = 128
"""Plus the signal's number: ended by a signal, as shells say it."""

EXIT_CODES: Mapping[int, str] = {
    0: "all is done",
    FAILED: "some frames failed and the rest is done; or --fail-under is missed",
    USAGE: "the command line is wrong",
    REFUSED: "the input is refused, or nothing more can be written; what is finished is kept",
    SIGNALLED + signal.SIGINT: "interrupted (Ctrl-C); what is finished is kept",
    SIGNALLED + signal.SIGTERM: "asked to end (SIGTERM); what is finished is kept",
}
"""Every exit code, and what it means."""
