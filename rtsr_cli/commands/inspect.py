"""`rtsr inspect`: what a folder holds, how it is stored, what can run on it, what is wrong."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.core.inspect.request import InspectRequest


@opt.take_defaults_of(InspectRequest)
@click.command("inspect")
@opt.input_folder
@click.option(
    "--write", is_flag=True, help="Put what was found down as capture.toml in each shot's folder."
)
@click.option(
    "--overwrite",
    is_flag=True,
    help="Let --write replace a capture.toml; the former one is kept as capture.toml.bak.",
)
@click.option(
    "--all", "every", is_flag=True, help="Look at the pixels of every frame, not of 64 at most."
)
@opt.quiet
@opt.verbose
@opt.as_json
@opt.capture
@opt.layer
@opt.view
@opt.layout
@click.pass_context
def command(ctx: click.Context, /, *, as_json: bool, **chosen: Any) -> None:
    """Say what rtsr understands of the frames in IN, and what it needs to be told.

    Finds out which way the motion vectors run by warping neighbouring frames under every reading
    of them, which kind of depth and normals there are, what is missing for which system, and what
    is wrong with which frame. Channels that it does not know can be declared in capture.toml:
    --write makes one to start from.

    Exit code: 0 if commands take the frames as they are; 1 if some would fail for their pixels
    (damage, NaN) and the rest be done; 3 if commands would refuse them (files that cannot be read,
    frames missing, a wrong declaration) or no system can run on them.
    """
    request = opt.request_from(InspectRequest, chosen)
    from rtsr_cli.api import inspect
    from rtsr_cli.commands.inspection_text import show_facts, show_report

    show = show_facts if as_json else show_report
    # while nothing is to be written, a signal ends the process at once
    with unwind_on_signals() if request.write else nullcontext():
        ctx.exit(show(inspect(request)))
