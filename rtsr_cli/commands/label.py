"""`rtsr label`: rendered frames -> what networks are trained to tell of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import LabelKind, Pool, VrsMetric
from rtsr_cli.core.label.request import LabelRequest

if TYPE_CHECKING:
    from rtsr_cli.core.run.events import ShotPlanned


@opt.take_defaults_of(LabelRequest)
@click.command("label")
@opt.input_folder
@opt.output_folder
@click.option("--kind", type=opt.Member(LabelKind), required=True, help="Errors of shading rates.")
@click.option("--tile", type=opt.RATE_TILE, show_default=True)
@click.option("--metric", type=opt.Member(VrsMetric), show_default=True)
@click.option(
    "--pool",
    type=opt.Member(Pool),
    show_default=True,
    help="Of a tile's pixels; PSNR takes the mean of its squared errors.",
)
@click.option(
    "--env-luminance",
    type=opt.FiniteRange(0.0),
    show_default=True,
    help="Of the surroundings, in Weber's law: JN = E / (L + l).",
)
@click.option(
    "--ppd",
    type=opt.PPD,
    help="Pixels per degree, for FLIP; width: the published code's width pi / 180.  [default: 67]",
)
@click.option("--keep-edges", is_flag=True, help="Emulated rates stop at other objects.")
@click.option("--preview", "previews", is_flag=True, help="A PNG of the errors beside each EXR.")
@opt.overwrite
@opt.frame_options
@click.pass_context
def command(ctx: click.Context, /, as_json: bool, **chosen: Any) -> None:
    """Make training labels of IN's frames: error.<AxB> of every reduced rate, one pixel a tile.

    Radiance at a rate is channels output_<AxB>.R, .G, .B where frames hold them; else one sample a
    block of the frame's own radiance, repeated, and shown as the frame is.
    """
    request = opt.request_from(LabelRequest, chosen)
    from rtsr_cli.api import label
    from rtsr_cli.commands.progress import Progress

    ctx.exit(Progress(request, as_json=as_json).follow(label(request), describe_plan(request)))


def describe_plan(request: LabelRequest) -> Callable[[ShotPlanned], str]:
    """Return what is said of a plan of a request."""

    def describe(plan: ShotPlanned) -> str:
        rates = opt.describe_rates(plan.details["captured_rates"])
        return f", {request.metric}, tiles of {request.tile}, {rates}"

    return describe
