"""`rtsr label`: rendered frames -> what networks are trained to tell of them."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import LabelKind, Pool, VrsMetric
from rtsr_cli.core.label.request import SAMPLES, LabelRequest


@opt.take_defaults_of(LabelRequest)
@click.command("label")
@opt.input_folder
@opt.output_folder
@click.option(
    "--kind",
    type=opt.Member(LabelKind),
    show_default=True,
    help="vrs: true errors of shading rates; holes: what past frames do not show; cgts: ghosting "
    "and aliasing pixels.",
)
@click.option("--tile", type=opt.RATE_TILE, show_default=True, help="vrs: side, pixels.")
@click.option(
    "--metric", type=opt.Member(VrsMetric), show_default=True, help="vrs: what errors are."
)
@click.option(
    "--pool",
    type=opt.Member(Pool),
    show_default=True,
    help="vrs: of a tile's pixels; PSNR takes the mean of its squared errors.",
)
@click.option(
    "--env-luminance",
    type=opt.FiniteRange(0.0),
    show_default=True,
    help="vrs: of the surroundings, in Weber's law: JN = E / (L + l).",
)
@click.option(
    "--ppd",
    type=opt.PPD,
    help="vrs: pixels per degree, for FLIP; width: the published code's width pi / 180.  "
    "[default: 67]",
)
@click.option("--keep-edges", is_flag=True, help="vrs: emulated rates stop at others.")
@click.option(
    "--every",
    type=int,
    metavar="N",
    help="holes: the first frame is rendered, and every Nth after it; the others are labelled.  "
    "[default: every frame is, against those 1, 3 and 5 before it]",
)
@click.option(
    "--rendered",
    cls=opt.ListOption,
    type=opt.Frames(),
    metavar="RANGE",
    help="holes: numbers of the rendered frames, in place of --every.",
)
@click.option(
    "--paper",
    is_flag=True,
    help="holes: the plain union of all tests; cgts: depth as printed, slanted floors are marked.",
)
@click.option(
    "--compat",
    is_flag=True,
    help="holes: compose motion in the order of ExtraNet's published code.",
)
@click.option(
    "--samples-per-pixel",
    type=click.IntRange(*SAMPLES),
    metavar="K",
    help="cgts: frames hold K x K samples of each pixel; of channels with a sample each: they lie "
    "on a grid, row by row.",
)
@click.option(
    "--depth-only", is_flag=True, help="cgts: what hides a surface need not move otherwise."
)
@click.option(
    "--least-change",
    type=opt.FiniteRange(0.0, 1.0),
    show_default=True,
    help="cgts: of colour, c / (1 + c), that is a change of light.",
)
@click.option(
    "--most-overlap",
    type=opt.FiniteRange(0.0, 1.0),
    show_default=True,
    help="cgts: of a pixel's colours with those it had, where light changed.",
)
@click.option("--preview", "previews", is_flag=True, help="A PNG of the labels beside each EXR.")
@opt.overwrite
@opt.frame_options
@click.pass_context
def command(ctx: click.Context, /, as_json: bool, **chosen: Any) -> None:
    """Make training labels of IN's frames.

    vrs: error.<AxB> of every reduced rate, one pixel a tile. Radiance at a rate is channels
    output_<AxB>.R, .G, .B where frames hold them; else one sample a block of the frame's own
    radiance, repeated, and shown as the frame is.

    holes: 1 where a past frame shows nothing of a surface, told by object ids (stencil), normals,
    positions, or lying outside: past1.holes, past1.stencil, ... of the last past frame, and past2,
    past3. Radiance is never read.

    cgts: ghosting (0 none, 1 visibility, 2 shading) and aliasing (0 none, 1 geometry, 2 texture) of
    each pixel, told by its K x K samples and those of the frame before. Frames are captures of K
    times the size, as rtsr synth --samples K writes them, or have channels with a sample each:
    color.0.R, color.1.R, ..., depth.0.Z, ...
    """
    request = opt.request_from(LabelRequest, chosen)
    from rtsr_cli.api import label
    from rtsr_cli.commands.label_text import describe_plan, show_figures
    from rtsr_cli.commands.progress import Progress

    progress = Progress(request, as_json=as_json)
    ctx.exit(progress.follow(label(request), describe_plan(request), show_figures(request)))
