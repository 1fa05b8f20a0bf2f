"""What commands say to a person: the one place where text goes to the terminal."""

from __future__ import annotations

import logging
import sys

import click

from rtsr_cli.core.visible_text import make_visible

LOG = logging.getLogger("rtsr")
"""`-q` and `-v` set its level, `--json` takes its place."""


def show(text: str, *, err: bool = False) -> None:
    """Print a text whose names may come from anywhere; control characters in it are escaped."""
    # not where click would choose: it takes a narrow encoding for a mistake
    click.echo(make_visible(text, lines=True), file=sys.stderr if err else sys.stdout)


class EchoHandler(logging.Handler):
    """Writes messages where click writes: warnings to stderr, the rest to stdout."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        show(self.format(record), err=record.levelno >= logging.WARNING)
