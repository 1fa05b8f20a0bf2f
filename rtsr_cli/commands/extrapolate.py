"""`rtsr extrapolate`: frames rendered at every second time step -> the ones between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import Precision
from rtsr_cli.core.extrapolate.request import ExtrapolateRequest
from rtsr_cli.models import list_extrapolator_names

if TYPE_CHECKING:
    from rtsr_cli.core.run.events import ShotPlanned


@opt.take_defaults_of(ExtrapolateRequest)
@click.command("extrapolate")
@opt.input_folder
@opt.output_folder
@click.option(
    "--system",
    type=opt.Named("system", list_extrapolator_names()),
    help="Default: the best that the inputs allow.",
)
@click.option(
    "--weights",
    "weights_file",
    type=opt.FOLDER,
    metavar="FILE",
    help="Of rtsr train; those that come with rtsr by default.",
)
@click.option(
    "--every",
    type=int,
    metavar="N",
    help="The first frame is rendered, and every Nth after it.  [default: 2]",
)
@click.option(
    "--rendered",
    cls=opt.ListOption,
    type=opt.Frames(),
    metavar="RANGE",
    help="Numbers of the rendered frames, in place of --every.",
)
@click.option(
    "--keep-rendered",
    is_flag=True,
    help="Also write the rendered frames, so that OUT is the whole sequence.",
)
@click.option(
    "--passthrough",
    metavar="GLOB",
    multiple=True,
    help="Copy input channels of these names to the output, never radiance, so that upscale can "
    "go on with it. Repeatable; not for R G B A.",
)
@click.option("--preview", "previews", is_flag=True, help="A PNG beside each EXR.")
@click.option("--device", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@click.option(
    "--precision",
    type=opt.Member(Precision),
    show_default=True,
    help="Number format of network layers; auto: bf16 where the device computes in it.",
)
@click.option("--debug-buffers", is_flag=True, help="Also write what the system saw and decided.")
@opt.runtime
@opt.model
@opt.overwrite
@opt.frame_options
@click.pass_context
def command(ctx: click.Context, /, as_json: bool, **chosen: Any) -> None:
    """Predict the frames of IN that were not rendered, from those before them.

    IN holds one sequence: radiance and G-buffer of rendered frames, the G-buffer alone of those
    between them. Radiance that these hold is never read. Predicted frames are stamped
    rtsr:predicted, so that evaluate --protocol extranet judges them alone.
    """
    request = opt.request_from(ExtrapolateRequest, chosen)
    from rtsr_cli.api import extrapolate
    from rtsr_cli.commands.progress import Progress

    ctx.exit(Progress(request, as_json=as_json).follow(extrapolate(request), describe_plan))


def describe_plan(plan: ShotPlanned) -> str:
    """Return what is said of a plan."""
    (width, height), known = plan.details["size"], plan.details
    return (
        f", {width} x {height}, {known['rendered']} rendered, {known['predicted']} to predict, "
        f"system {known['system']}"
    )
