"""The `rtsr` command: names and help in one table, a command imported only when it runs."""

from __future__ import annotations

import errno
import gc
import logging
import os
import signal
import sys
from importlib import import_module
from typing import NoReturn

import click

from rtsr_cli import __version__
from rtsr_cli.commands.interrupts import INTERRUPTED, SIGNALLED, STOPPING, end_at_once
from rtsr_cli.core.errors import RequestError, RtsrError, did_you_mean
from rtsr_cli.core.limits import lift_file_limits

COMMANDS = {
    "inspect": "Say what a folder of frames holds, and find out how its motion is stored.",
    "precompute-lut": "Write the split-sum BRDF table (A and B over NoV and roughness).",
    "demodulate": "Divide radiance into lighting and material, or multiply back.",
    "label": "Make training labels of rendered frames.",
    "train": "Train a system's network on captures, or go on with a run.",
    "upscale": "Reconstruct high-resolution frames from low-resolution ones.",
    "predict-vrs": "Predict the error of each shading rate, tile by tile, and choose rates.",
    "evaluate": "Judge result folders against a reference: metrics, regions, a report.",
    "synth": "Render random analytic scenes with exact buffers.",
    "systems": "List the systems, their inputs, scales and weights.",
}
"""Command -> one-line help; `predict-vrs` lives in `commands/predict_vrs.py`."""

EXIT_REFUSED = 3
"""Exit code of an input that is refused; usage errors are click's 2, failed frames 1."""

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})
"""What a redirected output fails with."""


class LazyGroup(click.Group):
    """A group that knows its commands' names and help without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the table's order."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"rtsr_cli.commands.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve a name, or suggest the nearest one."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            ctx.fail(f"no command is called '{name}'{did_you_mean(name, COMMANDS)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table without importing a command."""
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> object:
        """Run a command; what a user can cause ends in one message and an exit code."""
        try:
            return super().invoke(ctx)
        except RequestError as error:
            raise click.UsageError(str(error), ctx) from error
        except RtsrError as error:
            click.echo(f"Error: {error}", err=True)
            _emit_error(ctx, error)
            ctx.exit(EXIT_REFUSED)
        except KeyboardInterrupt as interrupt:
            number = interrupt.args[0] if interrupt.args else signal.SIGINT
            click.echo(INTERRUPTED, err=True)
            ctx.exit(SIGNALLED + number)
        except BrokenPipeError:
            # the reader of a pipe went away; nothing is left to tell it
            _close_output()
            ctx.exit(1)
        except OSError as error:
            # files name themselves; a stream that a shell opened does not
            if error.filename is not None or error.errno not in FULL:
                raise
            _close_output()
            click.echo(f"Error: standard output: cannot be written ({error.strerror})", err=True)
            ctx.exit(EXIT_REFUSED)


def _close_output() -> None:
    """Let what is still buffered go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _emit_error(ctx: click.Context, error: RtsrError) -> None:
    """Say an error as an event, too, where events are what a script reads."""
    from rtsr_cli.commands.options import JSON_CHOSEN, emit

    if ctx.meta.get(JSON_CHOSEN):
        emit({"event": "error", "message": str(error), "exit": EXIT_REFUSED})


class EchoHandler(logging.Handler):
    """Writes messages where click writes: warnings to stderr, the rest to stdout."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        click.echo(self.format(record), err=record.levelno >= logging.WARNING)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rtsr")
@click.option(
    "--unlimited", is_flag=True, help="Read EXR files of any number of channels and any size."
)
@click.pass_context
def group(ctx: click.Context, *, unlimited: bool) -> None:
    """Neural reconstruction for real-time rendering, over folders of EXR frames.

    Point it at any engine's EXR folder: every command says what it understood and refuses what
    is wrong. Exit codes: 0 done, 1 some frames failed, 2 usage, 3 input refused, or
    nothing can be written. inspect gives the code that its frames would lead to.
    """
    if unlimited:
        ctx.with_resource(lift_file_limits())
    logger = logging.getLogger("rtsr")
    logger.handlers = [EchoHandler()]
    logger.propagate = False
    logger.setLevel(logging.INFO)


def main() -> NoReturn:
    """Entry point of `rtsr`."""
    # torch then asks for huge pages: a frame's arrays cost far fewer page faults
    os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")
    # threads that spin while they wait take the cores from those they wait for: 5x when busy
    os.environ.setdefault("GOMP_SPINCOUNT", "0")
    # what a plan holds of thousands of frames stays: walking it again and again is a fifth of it
    gc.set_threshold(10_000, 20, 20)
    for number in STOPPING:
        signal.signal(number, end_at_once)
    group(prog_name="rtsr")
    raise AssertionError("click ends the process")
