"""`rtsr export`: weights -> ONNX files for engines, and what is computed around them."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import LOG
from rtsr_cli.core.choices import Precision
from rtsr_cli.core.export.request import MOST_SIDE, OPSETS, PRECISIONS, SCALES, ExportRequest
from rtsr_cli.core.wording import say_count

if TYPE_CHECKING:
    from rtsr_cli.core.export.frame_proof import FrameProof


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
@click.option(
    "--frames-of",
    type=opt.FOLDER,
    metavar="IN",
    help="Also prove the files on whole frames, as the system's command takes them: report.json "
    "then has their PSNR, and the largest value inside.",
)
@click.option(
    "--proof-frames",
    cls=opt.ListOption,
    type=opt.Frames(),
    help="Of --frames-of: these alone.",
)
@opt.overwrite
@opt.as_json
@opt.verbose
@opt.quiet
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
                if event.frames is not None:
                    LOG.info("%s", describe_frames(event.frames))
                LOG.info("%s: %s %dx; %s", event.manifest, event.system, event.scale, event.report)
            else:
                worst = max(event.proof.difference.values())
                LOG.info("%s: %.2g from torch; %s", event.path, worst, ", ".join(event.operators))
                LOG.debug("%s: values up to %.3g inside", event.path, event.proof.inside)


def describe_frames(frames: FrameProof) -> str:
    """What whole frames proved, in a line."""
    return (
        f"{say_count(frames.frames, 'frame')}: {frames.least_db:.1f} dB from torch's at least, "
        f"graphs {frames.difference:.2g} from its own, values up to {frames.largest:.3g} inside"
    )
