"""`rtsr evaluate`: options -> comparison of every shot -> scores -> table, files, thresholds."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.interrupts import discard_on_interrupt
from rtsr_cli.core.choices import MetricName, MissingPolicy, ProtocolName, SsimConvention
from rtsr_cli.core.evaluation.request import (
    MOST_SAMPLES,
    OUTPUT_SUFFIXES,
    PPD_RANGE,
    EvaluateRequest,
)
from rtsr_cli.core.requests import MOST_JOBS

EVERY = "all"
"""Stands for every metric."""


class MetricList(click.ParamType[tuple[MetricName, ...]]):
    """Names with commas between them, or all of them."""

    name = "LIST"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[MetricName, ...]:
        """Check every name."""
        if isinstance(value, tuple):
            return value
        names = [name.strip().lower() for name in str(value).split(",") if name.strip()]
        if not names:
            self.fail("name at least one metric", param, ctx)
        known = opt.NamedMember("metric", MetricName)
        chosen = [known.convert(name, param, ctx) for name in names if name != EVERY]
        return tuple(MetricName) if EVERY in names else tuple(dict.fromkeys(chosen))

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Offer metrics for the last name of the list."""
        del ctx, param
        before, comma, begun = incomplete.rpartition(",")
        given = before.split(",")
        names = [*MetricName, EVERY] if not comma else [n for n in MetricName if n not in given]
        return [CompletionItem(f"{before}{comma}{n}") for n in names if n.startswith(begun)]


class ResultFile(click.ParamType[Path]):
    """A file whose suffix says what is written."""

    name = "FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check the suffix."""
        path = Path(value)
        if path.suffix.lower() not in OUTPUT_SUFFIXES:
            listed = ", ".join(OUTPUT_SUFFIXES)
            self.fail(f"'{value}' ends in none of {listed}", param, ctx)
        return path


@opt.take_defaults_of(EvaluateRequest)
@click.command("evaluate")
@click.argument("tests", metavar="TEST...", nargs=-1, required=True, type=opt.FOLDER)
@click.option(
    "--ref",
    "reference",
    type=opt.FOLDER,
    metavar="REF",
    help="Reference frames; without it exactly two folders, TEST REF.",
)
@click.option(
    "--gbuffer",
    type=opt.FOLDER,
    metavar="DIR",
    help="Buffers of the judged resolution, for regions and temporal metrics; REF's own by "
    "default.",
)
@click.option(
    "--metric",
    "metrics",
    cls=opt.ListOption,
    type=MetricList(),
    show_default=True,
    help=f"Any of {', '.join(MetricName)}; or {EVERY}.",
)
@click.option(
    "--protocol",
    type=opt.NamedMember("protocol", ProtocolName),
    show_default=True,
    help=f"How frames are shown to the metrics: {', '.join(ProtocolName)}.",
)
@click.option(
    "--ssim-convention",
    type=opt.NamedMember("SSIM convention", SsimConvention),
    help="In place of the protocol's: " + ", ".join(SsimConvention) + ".",
)
@click.option("--ppd", type=opt.FiniteRange(*PPD_RANGE), help="Pixels per degree, for FLIP.")
@click.option(
    "--border",
    type=click.IntRange(0),
    show_default=True,
    metavar="PX",
    help="Leave this rim out.",
)
@click.option(
    "--skip-first",
    type=click.IntRange(0),
    show_default=True,
    metavar="N",
    help="First frames of each shot that take no part in means.",
)
@click.option(
    "--samples-per-pixel",
    type=click.IntRange(1, MOST_SAMPLES),
    metavar="K",
    help="REF holds K x K samples of each judged pixel; their mean is the reference.",
)
@click.option(
    "--output",
    "outputs",
    type=ResultFile(),
    multiple=True,
    help="Write .json, .csv or a one-file .html report. Repeatable.",
)
@click.option(
    "--overwrite", is_flag=True, help="Replace outputs that 'rtsr evaluate' did not write, too."
)
@click.option(
    "--fail-under",
    cls=opt.ListOption,
    metavar="LIST",
    help="Demands on means, like 'psnr>30,flip<0.1'; exit 1 where a test misses one.",
)
@click.option(
    "--merge",
    is_flag=True,
    help="TEST... are JSON files of parts (--shard) of the same frames, or folders of such; join "
    "them.",
)
@click.option(
    "--lpips-weights", type=opt.FOLDER, metavar="FILE", help="AlexNet and heads, for LPIPS."
)
@click.option("--device", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@opt.layer
@opt.view
@opt.layout
@opt.capture
@click.option(
    "--frames",
    cls=opt.ListOption,
    type=opt.Frames(),
    help="Judge these frames only; temporal metrics still read the others.",
)
@click.option(
    "--shard", type=opt.ShardOf(), help="Judge part I of N of each shot; --merge joins the parts."
)
@click.option(
    "--jobs",
    type=click.IntRange(1, MOST_JOBS),
    show_default=True,
    help="Frames judged at a time, each with one thread.",
)
@click.option(
    "--on-missing",
    type=opt.Member(MissingPolicy, without=[MissingPolicy.HOLD]),
    show_default=True,
    help="Frames that not every folder has.",
)
@opt.dry_run
@opt.as_json
@opt.verbose
@opt.quiet
@click.pass_context
def command(ctx: click.Context, /, *, as_json: bool, **chosen: Any) -> None:
    """Judge result folders TEST... against the reference REF, frame by frame and as sequences.

    Shots go by their paths below each folder, frames by number. With one TEST folder and no --ref
    the last folder is the reference. Exit 1 where --fail-under is missed.
    """
    request = opt.request_from(EvaluateRequest, chosen)
    with ExitStack() as phase:
        phase.enter_context(discard_on_interrupt())
        from rtsr_cli.api import evaluate
        from rtsr_cli.commands.evaluation_text import show_evaluation

        ctx.exit(show_evaluation(evaluate(request), phase, as_json=as_json))
