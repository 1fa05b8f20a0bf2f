"""`rtsr precompute-lut`: the split-sum table as an EXR file."""

from __future__ import annotations

import os
from pathlib import Path

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.core.errors import OutputError

_MIN_SIZE, _MIN_SAMPLES = 2, 16
_MAX_SIZE = 8192
"""Texels a side; the table then takes 512 MiB."""


def _exr_path(_ctx: click.Context, _param: click.Parameter, value: Path) -> Path:
    """Demand the suffix that says what is written."""
    if value.suffix.lower() != ".exr":
        raise click.BadParameter(f"{value} must end in .exr")
    return value


def _check_writable(path: Path, *, overwrite: bool) -> None:
    """Refuse before anything is computed.

    Raises:
        OutputError: no such folder, a folder without write permission, or a file in the way.
    """
    folder = path.parent
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist; create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists; give --overwrite to replace it")


@click.command("precompute-lut")
@click.argument(
    "out", type=click.Path(dir_okay=False, path_type=Path), callback=_exr_path, metavar="OUT.exr"
)
@click.option(
    "--size",
    type=click.IntRange(_MIN_SIZE, _MAX_SIZE),
    default=512,
    show_default=True,
    help="Texels a side; texel centres at (i + 0.5) / size.",
)
@click.option(
    "--samples",
    type=click.IntRange(min=_MIN_SAMPLES),
    default=1024,
    show_default=True,
    help="Samples of the integral of a texel.",
)
@click.option(
    "--convention",
    type=click.Choice(["karis", "seed"]),
    default="karis",
    show_default=True,
    help="karis: alpha = roughness^2, k = alpha/2. seed: alpha = roughness, k = (alpha+1)^2/8.",
)
@click.option("--preview", is_flag=True, help="Also write OUT.png (red A, green B).")
@opt.overwrite
def command(
    out: Path, size: int, samples: int, convention: str, preview: bool, overwrite: bool
) -> None:
    """Write the table of the split sum, F = (1 - m) c + F0 A + B.

    OUT.exr gets two float channels, A and B. Columns are the view cosine, rows the roughness, both
    growing.
    """
    from rtsr_cli.commands.run_precompute_lut import write_table

    outputs = (out, out.with_suffix(".png")) if preview else (out,)
    for path in outputs:
        _check_writable(path, overwrite=overwrite)
    write_table(outputs, size=size, samples=samples, convention=convention)
    click.echo(f"{' '.join(map(str, outputs))}: {size} x {size}, {convention}, {samples} samples")
