"""`rtsr systems`: what there is, what it needs, what it comes with."""

from __future__ import annotations

import click

from rtsr_cli.commands.options import as_json


@click.command("systems")
@click.option(
    "--flops",
    is_flag=True,
    help="Also the multiply-accumulates of every network's convolutions, for a 1920x1080 output.",
)
@as_json
def command(*, flops: bool, as_json: bool) -> None:
    """List the systems: inputs, scales, parameters, weights."""
    from rtsr_cli.commands.run_systems import run_systems

    run_systems(flops=flops, as_json=as_json)
