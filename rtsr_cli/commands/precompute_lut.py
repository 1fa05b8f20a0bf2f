"""`rtsr precompute-lut`: the split-sum table as an EXR file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import show
from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.lut.request import (
    MAX_SIZE,
    MIN_SAMPLES,
    MIN_SIZE,
    SUFFIX,
    PrecomputeLutRequest,
)


def _require_exr_suffix(_ctx: click.Context, _param: click.Parameter, value: Path) -> Path:
    """Demand the suffix that says what is written."""
    if value.suffix.lower() != SUFFIX:
        raise click.BadParameter(f"{value} must end in {SUFFIX}")
    return value


@opt.take_defaults_of(PrecomputeLutRequest)
@click.command("precompute-lut")
@click.argument(
    "out",
    type=click.Path(dir_okay=False, path_type=Path),
    callback=_require_exr_suffix,
    metavar="OUT.exr",
)
@click.option(
    "--size",
    type=click.IntRange(MIN_SIZE, MAX_SIZE),
    show_default=True,
    help="Texels a side; texel centres at (i + 0.5) / size.",
)
@click.option(
    "--samples",
    type=click.IntRange(min=MIN_SAMPLES),
    show_default=True,
    help="Samples of the integral of a texel.",
)
@click.option(
    "--convention",
    type=opt.Member(LutConvention),
    show_default=True,
    help="karis: alpha = roughness^2, k = alpha/2. seed: alpha = roughness, k = (alpha+1)^2/8.",
)
@click.option("--preview", is_flag=True, help="Also write OUT.png (red A, green B).")
@opt.overwrite
def command(**chosen: Any) -> None:
    """Write the table of the split sum, F = (1 - m) c + F0 A + B.

    OUT.exr gets two float channels, A and B. Columns are the view cosine, rows the roughness, both
    growing.
    """
    request = opt.request_from(PrecomputeLutRequest, chosen)
    from rtsr_cli.api import precompute_lut

    how = f"{request.size} x {request.size}, {request.convention}, {request.samples} samples"
    with unwind_on_signals():
        for written in precompute_lut(request):
            show(f"{' '.join(map(str, written.paths))}: {how}")
