"""`rtsr train`: data and settings -> one run -> weights."""

from __future__ import annotations

from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.training.request import SCALE_RANGE, TrainRequest
from rtsr_cli.models import list_trainable_names


@opt.take_defaults_of(TrainRequest)
@click.command("train")
@click.argument("system", type=opt.Named("system that is trained", list_trainable_names()))
@click.argument("data", metavar="DATA...", nargs=-1, required=True, type=opt.FOLDER)
@click.option("--out", "out_folder", type=opt.FOLDER, metavar="RUN", help="Folder of the run.")
@click.option(
    "--scale",
    type=click.IntRange(*SCALE_RANGE),
    help="The same as --set training.scale=S.",
)
@click.option("--config", "config_file", type=opt.FOLDER, metavar="FILE", help="Settings in TOML.")
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="A.B=C",
    help="One setting, over the file's: training.steps=5000. Repeatable.",
)
@click.option(
    "--init", "init_file", type=opt.FOLDER, metavar="FILE", help="Start from these weights."
)
@click.option(
    "--pack",
    "pack_file",
    type=opt.FOLDER,
    metavar="FILE",
    help="Write packed crops instead; a pack is DATA where no EXR library is installed.",
)
@click.option("--pack-crops", type=click.IntRange(1), show_default=True, help="Crops to pack.")
@click.option(
    "--cache",
    "cache_folder",
    type=opt.FOLDER,
    metavar="DIR",
    help="Where decoded frames are kept; RUN/cache by default.",
)
@click.option("--device", show_default=True, help="auto, cpu, cuda, cuda:1, ...")
@opt.layer
@opt.view
@click.option(
    "--overwrite", is_flag=True, help="Replace files in RUN, or FILE, that are not rtsr's, too."
)
@opt.layout
@opt.capture
@opt.on_missing
@opt.on_nonfinite
@click.option("--dry-run", is_flag=True, help="Print every setting, read no frame, write nothing.")
@opt.as_json
@opt.verbose
@opt.quiet
@click.pass_context
def command(ctx: click.Context, /, *, as_json: bool, **chosen: Any) -> None:
    """Train SYSTEM on the shots of DATA: HR captures with radiance, or LR/HR pairs.

    LR frames are made from HR captures by decimation. A folder's manifest.json, or
    data.validation, says which shots are judged on and not trained on. Run again with the same
    settings, a run goes on where it was cut off.
    """
    request = opt.request_from(TrainRequest, chosen)
    from rtsr_cli.api import train
    from rtsr_cli.commands.training_text import show_training

    ctx.exit(show_training(train(request), dry_run=request.dry_run, as_json=as_json))
