"""`rtsr synth`: a seed -> frames with exact buffers."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES
from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.synth.request import SAMPLES, SCALES, SHOTS, SynthRequest

MAX_SIDE = 16384


@opt.take_defaults_of(SynthRequest)
@click.command("synth")
@opt.output_folder
@click.option("--size", type=opt.PixelSize(MAX_SIDE), show_default=True, help="Of the output.")
@click.option(
    "--frames",
    cls=opt.ListOption,
    type=opt.Frames(),
    show_default=True,
    help="Frames to write.",
)
@click.option("--seed", type=click.IntRange(min=0), show_default=True, help="Which scene.")
@click.option(
    "--shots",
    type=click.IntRange(*SHOTS),
    help="Write that many seeds, from --seed on, into OUT/0000, OUT/0001, ...",
)
@click.option(
    "--layout",
    type=opt.Named("layout", LAYOUT_NAMES),
    show_default=True,
    help="Channel layout.",
)
@click.option(
    "--scale",
    type=click.IntRange(*SCALES),
    metavar="S",
    help="Write a pair: OUT/lr of size / S, OUT/hr without radiance, OUT/reference.",
)
@click.option(
    "--jitter",
    type=opt.Member(JitterMode),
    show_default=True,
    help="Of the samples (LR's with --scale).",
)
@click.option(
    "--samples",
    type=click.IntRange(*SAMPLES),
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
def command(as_json: bool, **chosen: Any) -> None:
    """Render frames of a random analytic scene, with exact buffers, into OUT.

    The same seed, size and frame number always give the same frame. Files that are there already
    are kept if they are the same; capture.toml beside them declares what they hold.
    """
    request = opt.request_from(SynthRequest, chosen)
    from rtsr_cli.api import synth
    from rtsr_cli.commands.synth_text import follow_synthesis

    follow_synthesis(synth(request), as_json=as_json)
