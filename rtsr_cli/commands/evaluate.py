"""`rtsr evaluate`: options -> comparison of every shot -> scores -> table, files, thresholds."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.interruption import SIGNALLED, STOPPING, leave
from rtsr_cli.core.errors import ConfigError

METRIC_NAMES = (
    "psnr", "ssim", "ms-ssim", "flip", "hdr-flip", "lpips", "vmaf", "tpsnr", "temporal", "warped",
)  # fmt: skip
DEFAULT_METRICS = ("psnr", "ssim", "flip")
PROTOCOL_NAMES = ("rtsr", "nsrd", "fusesr", "extranet")
SSIM_CONVENTIONS = ("wang", "skimage7", "skimage11", "zero-pad", "torchmetrics")
OUTPUT_SUFFIXES = (".json", ".csv", ".html")
EVERY = "all"

NOTHING_KEPT = "Interrupted: nothing was written; an evaluation starts anew when it is run again"


class MetricList(click.ParamType[tuple[str, ...]]):
    """Names with commas between them, or all of them."""

    name = "LIST"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Check every name."""
        if isinstance(value, tuple):
            return value
        names = [name.strip().lower() for name in str(value).split(",") if name.strip()]
        if not names:
            self.fail("name at least one metric", param, ctx)
        if names == [EVERY]:
            return METRIC_NAMES
        known = opt.Named("metric", METRIC_NAMES)
        return tuple(dict.fromkeys(known.convert(name, param, ctx) for name in names))


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


def _leave(number: int, _: FrameType | None) -> NoReturn:
    """End at once, in one line that is true while nothing is written."""
    with suppress(OSError, ValueError, AttributeError):
        os.write(sys.stderr.fileno(), f"{NOTHING_KEPT}\n".encode())
    os._exit(SIGNALLED + number)


@contextmanager
def keeping_nothing() -> Iterator[None]:
    """While an evaluation is worked out, let Ctrl-C say that nothing of it is kept."""
    if signal.getsignal(signal.SIGINT) is not leave:
        yield
        return
    for number in STOPPING:
        signal.signal(number, _leave)
    try:
        yield
    finally:
        for number in STOPPING:
            signal.signal(number, leave)


def _demanded(chosen: dict[str, Any]) -> tuple[Any, ...]:
    """Conditions of --fail-under; what merged parts hold is found out when they are read.

    Raises:
        click.UsageError: it is no list of conditions, or names what is not computed.
    """
    if chosen["fail_under"] is None:
        return ()
    from rtsr_cli.core.evaluation.results import conditions

    try:
        return conditions(
            chosen["fail_under"], METRIC_NAMES if chosen["merge"] else chosen["metrics"]
        )
    except ConfigError as error:
        raise click.UsageError(f"--fail-under: {error}") from error


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
    type=MetricList(),
    default=",".join(DEFAULT_METRICS),
    show_default=True,
    help=f"Any of {', '.join(METRIC_NAMES)}; or {EVERY}.",
)
@click.option(
    "--protocol",
    type=opt.Named("protocol", PROTOCOL_NAMES),
    default=PROTOCOL_NAMES[0],
    show_default=True,
    help=f"How frames are shown to the metrics: {', '.join(PROTOCOL_NAMES)}.",
)
@click.option(
    "--ssim-convention",
    type=opt.Named("SSIM convention", SSIM_CONVENTIONS),
    help="In place of the protocol's: " + ", ".join(SSIM_CONVENTIONS) + ".",
)
@click.option("--ppd", type=opt.FiniteRange(1.0, 1000.0), help="Pixels per degree, for FLIP.")
@click.option(
    "--border",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="PX",
    help="Leave this rim out.",
)
@click.option(
    "--skip-first",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="N",
    help="First frames of each shot that take no part in means.",
)
@click.option(
    "--samples-per-pixel",
    type=click.IntRange(1, 16),
    default=1,
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
    metavar="LIST",
    help="Demands on means, like 'psnr>30,flip<0.1'; exit 1 where a test misses one.",
)
@click.option(
    "--merge",
    is_flag=True,
    help="TEST... are JSON files of parts (--shard) of the same frames; join them.",
)
@click.option(
    "--lpips-weights", type=opt.FOLDER, metavar="FILE", help="AlexNet and heads, for LPIPS."
)
@click.option("--device", default="auto", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@opt.layout
@opt.capture
@click.option(
    "--frames",
    type=opt.Frames(),
    help="Judge these frames only; temporal metrics still read the others.",
)
@click.option(
    "--shard", type=opt.ShardOf(), help="Judge part I of N of each shot; --merge joins the parts."
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 64),
    default=2,
    show_default=True,
    help="Frames judged at a time, each with one thread.",
)
@click.option(
    "--on-missing",
    type=click.Choice(["error", "skip"]),
    default="error",
    show_default=True,
    help="Frames that not every folder has.",
)
@opt.dry_run
@opt.as_json
@opt.verbose
@opt.quiet
@click.pass_context
def command(ctx: click.Context, /, **chosen: Any) -> None:
    """Judge result folders TEST... against the reference REF, frame by frame and as sequences.

    Shots go by their paths below each folder, frames by number. With one TEST folder and no --ref
    the last folder is the reference. Exit 1 where --fail-under is missed.
    """
    if chosen["merge"]:
        if chosen["reference"] is not None:
            raise click.UsageError("--merge joins JSON files; it takes no --ref")
    elif chosen["reference"] is None:
        folders = chosen["tests"]
        if len(folders) != 2:
            raise click.UsageError(
                "without --ref exactly two folders are taken, TEST REF; name the reference with "
                "--ref"
            )
        chosen["tests"], chosen["reference"] = folders[:1], folders[1]
    chosen["demanded"] = _demanded(chosen)
    with keeping_nothing():
        from rtsr_cli.commands.run_evaluate import deliver, evaluated

        found = evaluated(chosen)
    ctx.exit(0 if found is None else deliver(chosen, found))
