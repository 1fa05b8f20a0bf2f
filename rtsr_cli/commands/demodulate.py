"""`rtsr demodulate`: radiance folder -> lighting, material and emission, and back."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import DemodulationMode, LutConvention
from rtsr_cli.core.demodulate.request import DemodulateRequest


@opt.take_defaults_of(DemodulateRequest)
@click.command("demodulate")
@opt.input_folder
@opt.output_folder
@click.option(
    "--mode",
    type=opt.Member(DemodulationMode, without=[DemodulationMode.NONE]),
    show_default=True,
    help="What radiance is divided by.",
)
@click.option(
    "--convention",
    type=opt.Member(LutConvention),
    show_default=True,
    help="Split-sum table.",
)
@click.option(
    "--epsilon",
    type=opt.FiniteRange(0.0, 1.0, min_open=True),
    show_default=True,
    help="Smallest divisor; below it a pixel is left undivided.",
)
@click.option("--inverse", is_flag=True, help="Multiply lighting by material, add emission.")
@click.option("--float", "full", is_flag=True, help="Write 32-bit float instead of half.")
@opt.overwrite
@opt.frame_options
@click.pass_context
def command(ctx: click.Context, /, as_json: bool, **chosen: Any) -> None:
    """Divide the radiance of IN by its material term into OUT.

    Writes lighting.RGB, material.RGB, mask (1 = divided) and emission.RGB, such that
    radiance = lighting * material + emission in every pixel.
    """
    request = opt.request_from(DemodulateRequest, chosen)
    from rtsr_cli.api import demodulate
    from rtsr_cli.commands.log import LOG
    from rtsr_cli.commands.progress import Progress
    from rtsr_cli.core.demodulate.call import DivisionDone
    from rtsr_cli.core.run.events import Status

    def conclude(event: object) -> None:
        if isinstance(event, DivisionDone) and event.counts[Status.WRITTEN] and not request.inverse:
            LOG.info(
                "not divided (mask 0): %.2f %% of the pixels, which are sky, and %.2f %%, which "
                "are surfaces whose material carries no radiance; lighting * material + emission "
                "is the radiance to within %.2e of it (of 1e-3 where it is darker)",
                100 * event.sky,
                100 * (event.undivided - event.sky),
                event.error,
            )

    progress = Progress(request, as_json=as_json)
    ctx.exit(progress.follow(demodulate(request), conclude=conclude))
