"""`rtsr upscale`: options -> plan of every shot -> one run -> a summary."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.models import upscaler_names


@click.command("upscale")
@opt.input_folder
@opt.output_folder
@click.option(
    "--system",
    type=opt.Named("system", upscaler_names()),
    help="Default: the best that the inputs allow.",
)
@click.option(
    "--weights",
    "weights_file",
    type=opt.FOLDER,
    metavar="FILE",
    help="Of rtsr train; those that come with rtsr by default.",
)
@click.option("--scale", type=click.IntRange(1, 16), help="Needed where there are no HR frames.")
@click.option(
    "--hr",
    "hr_folder",
    type=opt.FOLDER,
    metavar="DIR",
    help="HR G-buffers of IN; IN/hr by default.",
)
@click.option(
    "--simulate-lr",
    type=click.IntRange(2, 16),
    metavar="S",
    help="IN is an HR capture; make the LR frames by decimation.",
)
@click.option(
    "--samples-per-pixel",
    type=click.IntRange(1, 16),
    default=1,
    metavar="K",
    help="The capture holds K x K samples of each output pixel.",
)
@click.option(
    "--jitter",
    type=click.Choice(["none", "halton"]),
    default="none",
    help="Which sample of a block --simulate-lr keeps.",
)
@click.option(
    "--lr-filter",
    type=click.Choice(["none", "box", "blackman-harris"]),
    default="none",
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
@click.option("--device", default="auto", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@click.option(
    "--precision",
    type=click.Choice(["auto", "fp32", "bf16", "fp16"]),
    default="auto",
    show_default=True,
    help="Number format of network layers; auto: bf16 where the device computes in it.",
)
@click.option("--debug-buffers", is_flag=True, help="Also write what the system saw and decided.")
@opt.overwrite
@opt.reads_frames
@click.pass_context
def command(ctx: click.Context, /, **chosen: Any) -> None:
    """Reconstruct the frames of IN at a higher resolution into OUT.

    IN holds shots: `shot/lr/*.exr` with `shot/hr/*.exr` beside it, or HR captures with
    --simulate-lr. HR radiance is never read, except to make LR frames from it.
    """
    if chosen["simulate_lr"] is None:
        for name in ("samples_per_pixel", "jitter", "lr_filter"):
            if ctx.get_parameter_source(name) is not click.core.ParameterSource.DEFAULT:
                raise click.UsageError(f"--{name.replace('_', '-')} needs --simulate-lr")
    from rtsr_cli.commands.run_upscale import run_upscale

    ctx.exit(run_upscale(chosen))
