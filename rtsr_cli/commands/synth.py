"""`rtsr synth`: options -> plan of every shot -> one run -> a summary."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.io.layout_names import LAYOUT_NAMES, PAIR_LAYOUTS

MAX_SIDE = 16384


class PixelSize(click.ParamType[tuple[int, int]]):
    """Width and height: 1920x1080; given on as (height, width)."""

    name = "WxH"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Parse WxH with sides of 1 to `MAX_SIDE`."""
        if isinstance(value, tuple):
            return value
        width, _, height = str(value).lower().partition("x")
        whole = all(side.isascii() and side.isdigit() for side in (width, height))
        if not (whole and all(1 <= int(side) <= MAX_SIDE for side in (width, height))):
            self.fail(f"'{value}' is no size; write 1920x1080", param, ctx)
        return int(height), int(width)


@click.command("synth")
@opt.output_folder
@click.option(
    "--size", type=PixelSize(), default="960x540", show_default=True, help="Of the output."
)
@click.option(
    "--frames", type=opt.Frames(), default="1-8", show_default=True, help="Frames to write."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Which scene."
)
@click.option(
    "--shots",
    type=click.IntRange(1, 10000),
    help="Write that many seeds, from --seed on, into OUT/0000, OUT/0001, ...",
)
@click.option(
    "--layout",
    type=opt.Named("layout", LAYOUT_NAMES),
    default="rtsr",
    show_default=True,
    help="Channel layout.",
)
@click.option(
    "--scale",
    type=click.IntRange(2, 16),
    metavar="S",
    help="Write a pair: OUT/lr of size / S, OUT/hr without radiance, OUT/reference.",
)
@click.option(
    "--jitter",
    type=click.Choice(["none", "halton"]),
    default="none",
    show_default=True,
    help="Of the samples (LR's with --scale).",
)
@click.option(
    "--samples",
    type=click.IntRange(1, 16),
    default=1,
    show_default=True,
    metavar="K",
    help="K x K samples a pixel: all of them stored, or with --scale their mean as reference.",
)
@click.option("--static-camera", is_flag=True, help="The camera stays; objects and lights move.")
@opt.jobs
@opt.overwrite
@opt.as_json
@opt.verbose
@opt.quiet
@click.pass_context
def command(ctx: click.Context, /, **chosen: Any) -> None:
    """Render frames of a random analytic scene, with exact buffers, into OUT.

    The same seed, size and frame number always give the same frame. Files that are there already
    are kept if they are the same; capture.toml beside them declares what they hold.
    """
    if chosen["samples"] > 1 and chosen["scale"] is None and chosen["jitter"] != "none":
        raise click.UsageError("--samples stores every sample of a pixel; leave --jitter out")
    if chosen["scale"] is None and chosen["layout"] in PAIR_LAYOUTS:
        raise click.UsageError(
            f"layout '{chosen['layout']}' keeps two resolutions apart; give --scale, e.g. --scale 2"
        )
    from rtsr_cli.commands.run_synth import run_synth

    ctx.exit(run_synth(chosen))
