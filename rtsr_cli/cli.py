"""The `rtsr` command: names and help in one table, a command imported only when it runs."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
from importlib import import_module
from typing import NoReturn

import click

from rtsr_cli import __version__
from rtsr_cli.commands.examples import GROUP, format_examples
from rtsr_cli.commands.exit_codes import EXIT_CODES, REFUSED, SIGNALLED
from rtsr_cli.commands.interrupts import INTERRUPTED, STOPPING, end_at_once
from rtsr_cli.commands.log import LOG, EchoHandler, show
from rtsr_cli.core.errors import RequestError, RtsrError, did_you_mean
from rtsr_cli.core.files.standard_streams import find_loss, make_streams_tolerant
from rtsr_cli.core.limits import lift_file_limits
from rtsr_cli.core.memory import return_large_arrays
from rtsr_cli.core.visible_text import make_visible

COMMANDS = {
    "inspect": "Say what a folder of frames holds, and find out how its motion is stored.",
    "precompute-lut": "Write the split-sum BRDF table (A and B over NoV and roughness).",
    "demodulate": "Divide radiance into lighting and material, or multiply back.",
    "label": "Make training labels of rendered frames.",
    "train": "Train a system's network on captures, or go on with a run.",
    "upscale": "Reconstruct high-resolution frames from low-resolution ones.",
    "extrapolate": "Predict the frames between rendered ones from their G-buffers.",
    "predict-vrs": "Predict the error of each shading rate, tile by tile, and choose rates.",
    "evaluate": "Judge result folders against a reference: metrics, regions, a report.",
    "farm": "Write a job for a render farm: a command divided into tasks.",
    "synth": "Render random analytic scenes with exact buffers.",
    "export": "Write a network as ONNX files for engines, with all that surrounds it.",
    "systems": "List the systems, their inputs, scales and weights.",
}
"""Command -> one-line help; `predict-vrs` lives in `commands/predict_vrs.py`."""


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
        command.epilog = format_examples(cmd_name)
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

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of exit codes, and the examples."""
        del ctx
        with formatter.section("Exit codes"):
            formatter.write_dl([(str(code), meaning) for code, meaning in EXIT_CODES.items()])
        formatter.write_paragraph()
        formatter.write_text(format_examples(GROUP))

    def invoke(self, ctx: click.Context) -> object:
        """Run a command; what a user can cause ends in one message and an exit code."""
        try:
            return super().invoke(ctx)
        except RequestError as error:
            raise click.UsageError(make_visible(str(error), lines=True), ctx) from error
        except (RtsrError, OSError) as error:
            _refuse(ctx, _describe_error(error))
        except KeyboardInterrupt as interrupt:
            number = interrupt.args[0] if interrupt.args else signal.SIGINT
            show(INTERRUPTED, err=True)
            ctx.exit(SIGNALLED + number)


def _describe_error(error: RtsrError | OSError) -> str:
    """What is said of an error; where no layer knew more of a file, the system's own words."""
    if isinstance(error, RtsrError):
        return str(error)
    name = error.filename
    place = f"{os.fsdecode(name)}: " if isinstance(name, str | bytes) else ""
    return f"{place}{error.strerror or error}; check that it is there, and its permissions"


def _refuse(ctx: click.Context, message: str) -> NoReturn:
    """Say why nothing is done, as an event, too, where events are what a script reads."""
    from rtsr_cli.commands.options import JSON_CHOSEN, emit

    show(f"Error: {message}", err=True)
    if ctx.meta.get(JSON_CHOSEN):
        emit({"event": "error", "message": message, "exit": REFUSED})
    ctx.exit(REFUSED)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rtsr")
@click.option(
    "--unlimited", is_flag=True, help="Read EXR files of any number of channels and any size."
)
@click.pass_context
def group(ctx: click.Context, *, unlimited: bool) -> None:
    """Neural reconstruction for real-time rendering, over folders of EXR frames.

    Point it at any engine's EXR folder: every command says what it understood and refuses what
    is wrong. inspect exits with the code that its frames would lead to.
    """
    if unlimited:
        ctx.with_resource(lift_file_limits())
    LOG.handlers = [EchoHandler()]
    LOG.propagate = False
    LOG.setLevel(logging.INFO)


def main() -> NoReturn:
    """Entry point of `rtsr`."""
    # torch then asks for huge pages: a frame's arrays cost far fewer page faults
    os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")
    # threads that spin while they wait take the cores from those they wait for: 5x when busy
    os.environ.setdefault("GOMP_SPINCOUNT", "0")
    # from the first array on: what is freed before a frame loop begins would keep holes else
    return_large_arrays()
    # what a plan holds of thousands of frames stays: walking it again and again is a fifth of it
    gc.set_threshold(10_000, 20, 20)
    make_streams_tolerant()
    for number in STOPPING:
        signal.signal(number, end_at_once)
    try:
        group(prog_name="rtsr")
    except SystemExit as leaving:
        sys.exit(_report_loss() or leaving.code)
    raise AssertionError("click ends the process")


def _report_loss() -> int:
    """Say if standard output took no more, to a full disk say; return the exit code, else 0."""
    loss = find_loss(sys.stdout)
    if loss is None:
        return 0
    show(f"Error: standard output: cannot be written ({loss.strerror})", err=True)
    return REFUSED
