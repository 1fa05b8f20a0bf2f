"""`rtsr predict-vrs`: frames -> the shading rate of every tile, before it is shaded."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt

METRICS = ("jnflip", "flip", "jnyang", "psnr", "lpips")


@click.command("predict-vrs")
@opt.input_folder
@opt.output_folder
@click.option("--tile", type=opt.RATE_TILE, help="Side of a tile, pixels.  [default: 16]")
@click.option(
    "--metric", type=click.Choice(METRICS), help="What errors are measured by.  [default: jnflip]"
)
@click.option(
    "--threshold",
    type=opt.FiniteRange(0.0, min_open=True),
    help="Error that a rate must stay below, in the metric's unit.  [default: that of the weights]",
)
@click.option(
    "--analytic-threshold",
    type=opt.FiniteRange(0.0, min_open=True),
    help="The same for the analytic estimate, in its own unit.  [default: 0.07]",
)
@click.option(
    "--estimator",
    type=click.Choice(["network", "analytic", "hybrid"]),
    default="network",
    show_default=True,
    help="Analytic: from the frame before alone (Yang et al. 2019); hybrid: the network only "
    "where that shows nothing.",
)
@click.option(
    "--weights",
    "weights_file",
    type=opt.FOLDER,
    metavar="FILE",
    help="Of rtsr train rt-percept; those that come with rtsr by default.",
)
@click.option(
    "--margin",
    type=opt.FiniteRange(0.0, 1.0),
    help="Added to predictions, 0..1; the underestimation on validation by default.",
)
@click.option(
    "--reuse",
    is_flag=True,
    help="Instead of rates: which tiles may keep the frame before, moved to this one.",
)
@click.option("--overlay", "overlays", is_flag=True, help="A PNG of the frame under its rates.")
@click.option("--no-compare", is_flag=True, help="Do not measure the true errors.")
@click.option("--device", default="auto", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@opt.overwrite
@opt.reads_frames
@click.pass_context
def command(ctx: click.Context, /, **chosen: Any) -> None:
    """Predict the error of each shading rate in each tile of IN's frames, and choose rates.

    Writes error.<AxB> (A wide, B tall) and rate (D3D12's and Vulkan's code) as EXR, one pixel a
    tile, the codes as an 8-bit PNG, and summary.json. The radiance of a frame is never looked at
    before its rates are chosen; then, true errors are measured, on frames of captured rates
    (channels output_2x2.R/G/B or folders output_2x2/ beside the frames) where there are any.
    """
    from rtsr_cli.commands.run_predict_vrs import run_predict_vrs

    ctx.exit(run_predict_vrs(chosen))
