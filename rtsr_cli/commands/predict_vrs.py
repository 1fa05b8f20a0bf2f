"""`rtsr predict-vrs`: frames -> the shading rate of every tile, before it is shaded."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import Estimator, VrsMetric
from rtsr_cli.core.vrs.request import PredictVrsRequest
from rtsr_cli.models import list_rate_predictor_names


@opt.take_defaults_of(PredictVrsRequest)
@click.command("predict-vrs")
@opt.input_folder
@opt.output_folder
@click.option(
    "--system",
    type=opt.Named("system", list_rate_predictor_names()),
    help="What predicts errors.  [default: the first that does]",
)
@click.option("--tile", type=opt.RATE_TILE, help="Side of a tile, pixels.  [default: 16]")
@click.option(
    "--metric", type=opt.Member(VrsMetric), help="What errors are measured by.  [default: jnflip]"
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
    type=opt.Member(Estimator),
    show_default=True,
    help="Analytic: from the frame before alone (Yang et al. 2019); hybrid: the network only "
    "where that shows nothing.",
)
@click.option(
    "--weights",
    "weights_file",
    type=opt.FOLDER,
    metavar="FILE",
    help=f"Of rtsr train {list_rate_predictor_names()[0]}; those that come with rtsr by default.",
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
@click.option("--device", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@opt.runtime
@opt.model
@opt.overwrite
@opt.frame_options
@click.pass_context
def command(ctx: click.Context, /, as_json: bool, **chosen: Any) -> None:
    """Predict the error of each shading rate in each tile of IN's frames, and choose rates.

    Writes error.<AxB> (A wide, B tall) and rate (D3D12's and Vulkan's code) as EXR, one pixel a
    tile, the codes as an 8-bit PNG, and summary.json. The radiance of a frame is never looked at
    before its rates are chosen; then, true errors are measured, on frames of captured rates
    (channels output_2x2.R/G/B or folders output_2x2/ beside the frames) where there are any.
    """
    request = opt.request_from(PredictVrsRequest, chosen)
    from rtsr_cli.api import predict_vrs
    from rtsr_cli.commands.progress import Progress
    from rtsr_cli.commands.rates_text import describe_plan, show_summary

    progress = Progress(request, as_json=as_json)
    ctx.exit(progress.follow(predict_vrs(request), describe_plan, show_summary))
