"""`rtsr upscale`: LR frames -> HR frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import JitterMode, PixelFilter, Precision
from rtsr_cli.core.upscale.request import SAMPLES, SCALES, SIMULATED_SCALES, UpscaleRequest
from rtsr_cli.models import list_upscaler_names

if TYPE_CHECKING:
    from rtsr_cli.core.run.events import ShotPlanned


@opt.take_defaults_of(UpscaleRequest)
@click.command("upscale")
@opt.input_folder
@opt.output_folder
@click.option(
    "--system",
    type=opt.Named("system", list_upscaler_names()),
    help="Default: the best that the inputs allow.",
)
@click.option(
    "--weights",
    "weights_file",
    type=opt.FOLDER,
    metavar="FILE",
    help="Of rtsr train; those that come with rtsr by default.",
)
@click.option("--scale", type=click.IntRange(*SCALES), help="Needed where there are no HR frames.")
@click.option(
    "--hr",
    "hr_folder",
    type=opt.FOLDER,
    metavar="DIR",
    help="HR G-buffers of IN; IN/hr by default.",
)
@click.option(
    "--simulate-lr",
    type=click.IntRange(*SIMULATED_SCALES),
    metavar="S",
    help="IN is an HR capture; make the LR frames by decimation.",
)
@click.option(
    "--samples-per-pixel",
    type=click.IntRange(*SAMPLES),
    metavar="K",
    help="The capture holds K x K samples of each output pixel.",
)
@click.option(
    "--jitter",
    type=opt.Member(JitterMode),
    help="Which sample of a block --simulate-lr keeps.",
)
@click.option(
    "--lr-filter",
    type=opt.Member(PixelFilter),
    help="Pixel filter of the simulated LR radiance.",
)
@click.option("--preview", "previews", is_flag=True, help="A PNG beside each EXR.")
@click.option(
    "--tile",
    type=opt.TileSide(),
    metavar="PX",
    help="Side of tiles in LR pixels, 16 or more; 0 = never; by the frame's size by default.",
)
@click.option(
    "--passthrough",
    metavar="GLOB",
    multiple=True,
    help="Copy input channels of these names to the output: as HR holds them (never its "
    "radiance), else LR's with each pixel repeated. Repeatable; not for R G B A.",
)
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
    """Reconstruct the frames of IN at a higher resolution into OUT.

    IN holds shots: `shot/lr/*.exr` with `shot/hr/*.exr` beside it, or HR captures with
    --simulate-lr. HR radiance is never read, except to make LR frames from it.
    """
    request = opt.request_from(UpscaleRequest, chosen)
    from rtsr_cli.api import upscale
    from rtsr_cli.commands.progress import Progress

    ctx.exit(Progress(request, as_json=as_json).follow(upscale(request), describe_plan(request)))


def describe_plan(request: UpscaleRequest) -> Callable[[ShotPlanned], str]:
    """Return what is said of a plan of a request."""
    unnamed = not any((request.system, request.weights_file, request.model))
    default = " (the best that these inputs allow)" if unnamed else ""

    def describe(plan: ShotPlanned) -> str:
        (lr_width, lr_height), (width, height) = plan.details["lr_size"], plan.details["size"]
        return (
            f", {lr_width} x {lr_height} -> {width} x {height}, "
            f"system {plan.details['system']}{default}"
        )

    return describe
