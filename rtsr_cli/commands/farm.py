"""`rtsr farm`: a command -> a job that engines of farms run, and what its tasks need declared."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.evaluate import ResultFile
from rtsr_cli.commands.log import LOG, show
from rtsr_cli.core.captures.layout_names import LAYOUT_SUFFIX
from rtsr_cli.core.choices import FarmEngine
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.farms.commands import Argument, FarmCommand, FarmJob
from rtsr_cli.core.farms.steps import MOST_TASKS, plan_job
from rtsr_cli.core.wording import join_names, say_count

BETWEEN = "--"
"""Parts commands; each begins when the one before it is done."""

WRITTEN = frozenset({"out_folder", "outputs"})
"""Fields that name what a command writes."""

READ_FRAMES = frozenset({"in_folder", "reference", "gbuffer"})
"""Fields that name frames whose conventions parts have to agree upon."""

FILE = "FILE"
"""Shown for paths of files; others are of folders."""


@click.group("farm")
def command() -> None:
    """Run commands on a farm: by Open Job Description, Slurm, or what takes their jobs.

    A command that takes --shard or --frames is divided into tasks; a task that failed, or a job
    that was killed, is run again, and does what is not done yet.
    """


@command.command("emit")
@click.option(
    "--engine",
    type=opt.NamedMember("engine", FarmEngine),
    required=True,
    help=f"What runs the job: {', '.join(FarmEngine)}.",
)
@click.option(
    "--tasks",
    type=click.IntRange(1, MOST_TASKS),
    default=8,
    show_default=True,
    help="Tasks that a command is divided into.",
)
@click.option("--output", type=opt.FOLDER, metavar=FILE, help="In place of standard output.")
@click.option("--overwrite", is_flag=True, help="Replace a FILE that is not rtsr's.")
@click.argument("words", metavar="-- COMMAND...", nargs=-1, required=True, type=click.UNPROCESSED)
@click.pass_context
def emit(
    ctx: click.Context,
    *,
    engine: FarmEngine,
    tasks: int,
    output: Path | None,
    overwrite: bool,
    words: tuple[str, ...],
) -> None:
    """Write a job that runs COMMAND, divided into tasks.

    COMMAND is a command line of rtsr without --shard: upscale IN OUT, say. Several are parted by
    `--`, and each begins when the one before it is done. Conventions that IN leaves to measurement
    are declared first (rtsr farm pin); the parts of a report are merged last.
    """
    from rtsr_cli.core.farms.job_files import encode_job, write_job

    lines = [list(group) for between, group in groupby(words, BETWEEN.__eq__) if not between]
    commands = [read_command(ctx, line) for line in lines]
    try:
        job = plan_job(commands, tasks)
    except RequestError as error:
        raise click.UsageError(str(error), ctx) from error
    given = shlex.join(["--engine", engine, "--tasks", str(tasks), BETWEEN, *words])
    text = encode_job(job, engine, f"rtsr farm emit {given}")
    if output is None:
        click.echo(text, nl=False)
    else:
        write_job(output, text, overwrite=overwrite)
    for line in describe_job(job, engine, "JOB" if output is None else str(output)):
        show(line, err=output is None)


def describe_job(job: FarmJob, engine: FarmEngine, name: str) -> Iterator[str]:
    """Say what a job does, and how it is run."""
    from rtsr_cli.core.farms.openjd import list_parameters

    steps = (
        s.name + (f" ({say_count(job.tasks, 'task')})" if s.divided else "") for s in job.steps
    )
    yield f"{name}: {say_count(len(job.steps), 'step')}: {', '.join(steps)}"
    if engine is FarmEngine.SLURM:
        yield f"submit it: {shlex.join(['bash', name])}"
    else:
        yield f"run it here: {shlex.join(['openjd', 'run', name, *list_parameters(job)])}"


def read_command(ctx: click.Context, words: Sequence[str]) -> FarmCommand:
    """Read a command line; what is wrong with it is said as the command itself would.

    Raises:
        UsageError: there is no such command, it is used wrongly, or it cannot be divided.
    """
    group = ctx.find_root().command
    assert isinstance(group, click.Group)
    name, *rest = words
    try:
        inner = group.resolve_command(ctx.find_root(), [name])[1]
    except click.UsageError as error:
        # it is the emitting command that is used wrongly
        error.ctx = ctx
        raise
    assert inner is not None
    fields = {param.name for param in inner.params}
    if not fields & {"shard", "frames"}:
        raise click.UsageError(
            f"{name} takes neither --shard nor --frames, so that it cannot be divided; "
            f"{join_names(list_divisible(group, ctx))} can"
        )
    with inner.make_context(name, list(rest), parent=ctx.find_root()) as context:
        frames = () if "shard" in fields else tuple(sorted(context.params["frames"]))
        arguments = tuple(list_arguments(inner, context, rest))
    return FarmCommand(name=name, arguments=_name_reference(arguments), frames=frames)


def list_divisible(group: click.Group, ctx: click.Context) -> list[str]:
    """Names of the commands that can be divided."""
    commands = {name: group.get_command(ctx, name) for name in group.list_commands(ctx)}
    return [
        name
        for name, inner in commands.items()
        if inner is not None and {param.name for param in inner.params} & {"shard", "frames"}
    ]


def list_arguments(
    inner: click.Command, context: click.Context, words: Iterable[str]
) -> Iterator[Argument]:
    """Return a command line's arguments, then its options, in the order of the declaration."""
    given, _, _ = inner.make_parser(context).parse_args(args=list(words))
    params = [param for param in inner.params if given.get(param.name or "") is not None]
    for param in sorted(params, key=lambda param: isinstance(param, click.Option)):
        value = given[param.name or ""]
        if isinstance(param, click.Option) and (param.is_flag or param.count):
            yield from [_make_flag(param, value)] * (value if param.count else 1)
            continue
        values = value if isinstance(value, list | tuple) else [value]
        for one in values:
            yield _make_argument(param, str(one))


def _make_flag(param: click.Option, value: Any) -> Argument:
    names = param.opts if value else param.secondary_opts
    return Argument(option=max(names, key=len), value=None, field=param.name or "")


def _make_argument(param: click.Parameter, value: str) -> Argument:
    option = max(param.opts, key=len) if isinstance(param, click.Option) else None
    field = param.name or ""
    names_path = isinstance(param.type, click.Path | ResultFile)
    layout_file = isinstance(param.type, opt.LayoutChoice) and value.endswith(LAYOUT_SUFFIX)
    if not names_path and not layout_file:
        return Argument(option=option, value=value, field=field)
    shown = option or param.metavar or field
    if not value:
        raise click.UsageError(f"{shown} is empty; name a file or folder")
    of_file = param.metavar == FILE or isinstance(param.type, ResultFile) or layout_file
    return Argument(
        option=option,
        value=value,
        field=field,
        path="".join(part.capitalize() for part in shown.strip("-.").split("-")),
        folder=not of_file,
        written=field in WRITTEN,
        frames=field in READ_FRAMES,
    )


def _name_reference(arguments: tuple[Argument, ...]) -> tuple[Argument, ...]:
    """Without --ref the last TEST is the reference."""
    tests = [argument for argument in arguments if argument.field == "tests"]
    if not tests or any(argument.field == "reference" for argument in arguments):
        return arguments
    return tuple(replace(a, frames=True) if a is tests[-1] else a for a in arguments)


@command.command("pin")
@opt.input_folder
@opt.layout
@opt.layer
@opt.view
@opt.verbose
@opt.quiet
def pin(in_folder: Path, layout: str | None, layer: str | None, view: str | None) -> None:
    """Declare what measurement settles of IN's shots, so that all parts of them agree.

    What a shot leaves open, and frames decide, goes into its capture.toml; one that is there is
    kept as capture.toml.bak. A shot that declares it all is left alone.
    """
    from rtsr_cli.core.farms.pin import pin_conventions

    count = written = 0
    for pinned in pin_conventions(in_folder, layout=layout, layer=layer, view=view):
        count += 1
        if pinned.written is not None:
            written += 1
            former = pinned.kept
            kept = f"; {former.name} is the former one, with its comments" if former else ""
            LOG.info(
                "%s: %s measured, written; all else is spelled out as it was declared or is "
                "presumed%s",
                pinned.written,
                join_names(pinned.measured),
                kept,
            )
    LOG.info("%s: %s, %s written", in_folder, say_count(count, "shot"), say_count(written, "file"))
