"""`rtsr label`: rendered frames -> what networks are trained to tell of them."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.predict_vrs import METRICS


@click.command("label")
@opt.input_folder
@opt.output_folder
@click.option("--kind", type=click.Choice(["vrs"]), required=True, help="Errors of shading rates.")
@click.option("--tile", type=opt.RATE_TILE, default=16, show_default=True)
@click.option("--metric", type=click.Choice(METRICS), default="jnflip", show_default=True)
@click.option(
    "--pool",
    type=click.Choice(["max", "mean"]),
    default="max",
    show_default=True,
    help="Of a tile's pixels; PSNR takes the mean of its squared errors.",
)
@click.option(
    "--env-luminance",
    type=opt.FiniteRange(0.0),
    default=1e-10,
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
@opt.reads_frames
@click.pass_context
def command(ctx: click.Context, /, **chosen: Any) -> None:
    """Make training labels of IN's frames: error.<AxB> of every reduced rate, one pixel a tile.

    Radiance at a rate is channels output_<AxB>.R, .G, .B where frames hold them; else one sample a
    block of the frame's own radiance, repeated, and shown as the frame is.
    """
    from rtsr_cli.commands.run_label import run_label

    ctx.exit(run_label(chosen))
