"""`rtsr demodulate`: radiance folder -> lighting, material and emission, and back."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt

MODES = ("brdf", "softplus", "albedo", "glossy-albedo")


@click.command("demodulate")
@opt.input_folder
@opt.output_folder
@click.option(
    "--mode",
    type=click.Choice(MODES),
    default="brdf",
    show_default=True,
    help="What radiance is divided by.",
)
@click.option(
    "--convention",
    type=click.Choice(["karis", "seed"]),
    default="karis",
    show_default=True,
    help="Split-sum table.",
)
@click.option(
    "--epsilon",
    type=opt.FiniteRange(0.0, 1.0, min_open=True),
    default=4e-3,
    show_default=True,
    help="Smallest divisor; below it a pixel is left undivided.",
)
@click.option("--inverse", is_flag=True, help="Multiply lighting by material, add emission.")
@click.option("--float", "full", is_flag=True, help="Write 32-bit float instead of half.")
@opt.overwrite
@opt.reads_frames
@click.pass_context
def command(ctx: click.Context, /, **chosen: Any) -> None:
    """Divide the radiance of IN by its material term into OUT.

    Writes lighting.RGB, material.RGB, mask (1 = divided) and emission.RGB, such that
    radiance = lighting * material + emission in every pixel.
    """
    from rtsr_cli.commands.run_demodulate import run_demodulate

    ctx.exit(run_demodulate(chosen))
