"""`rtsr export`: weights -> ONNX files for engines, and what is computed around them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import show
from rtsr_cli.core.choices import Precision
from rtsr_cli.core.export.request import MOST_SIDE, OPSETS, PRECISIONS, SCALES, ExportRequest


@opt.take_defaults_of(ExportRequest)
@click.command("export")
@click.argument("source", metavar="WEIGHTS|SYSTEM")
@opt.output_folder
@click.option(
    "--scale", type=click.IntRange(*SCALES), help="Of a system that comes with several weights."
)
@click.option(
    "--precision",
    type=opt.Member(Precision, without=set(Precision) - set(PRECISIONS)),
    show_default=True,
    help="Number format of weights and layers.",
)
@click.option(
    "--size",
    type=opt.PixelSize(MOST_SIDE),
    help="Of the LR frames that the files take; any by default.",
)
@click.option(
    "--opset",
    type=click.Choice(OPSETS),
    show_default=True,
    help="Version of ONNX' operators.",
)
@opt.overwrite
@opt.as_json
def command(*, as_json: bool, **chosen: Any) -> None:
    """Write the network of a system as ONNX files, with manifest.json and report.json, into OUT.

    WEIGHTS is a file of rtsr train. Of a SYSTEM the weights that come with rtsr are taken. The
    files hold the network alone; what an engine computes around it, and every input, the manifest
    says. Every file is run by onnxruntime and held against torch before it is written.
    """
    request = opt.request_from(ExportRequest, chosen)
    from rtsr_cli.api import export
    from rtsr_cli.core.export.call import ExportDone

    with unwind_on_signals():
        for event in export(request):
            if as_json:
                name = "done" if isinstance(event, ExportDone) else "graph"
                opt.emit({"event": name, **asdict(event)})
            elif isinstance(event, ExportDone):
                show(f"{event.manifest}: {event.system} {event.scale}x; {event.report}")
            else:
                worst = max(event.proof.difference.values())
                show(f"{event.path}: {worst:.2g} from torch; {', '.join(event.operators)}")
