"""Put a run's best weights into the package, in half precision.

    python benchmarks/ship_weights.py RUN/best.safetensors

Writes `rtsr_cli/weights/<system>-<scale>x.safetensors` and prints its size.
"""

from __future__ import annotations

from pathlib import Path

import click

from rtsr_cli.core.weights import SHIPPED, read_weights, save_weights
from rtsr_cli.models import load_system


@click.command()
@click.argument("path", type=click.Path(path_type=Path, exists=True, dir_okay=False))
def main(path: Path) -> None:
    """Copy the weights."""
    weights = read_weights(path)
    pattern = load_system(weights.system).weights
    if pattern is None:
        raise click.ClickException(f"system '{weights.system}' ships no weights")
    target = SHIPPED / pattern.format(scale=weights.scale)
    save_weights(
        target,
        weights.tensors,
        system=weights.system,
        scale=weights.scale,
        config=weights.config,
        about=weights.about,
        half=True,
    )
    click.echo(f"{target.name}: {target.stat().st_size} bytes, step {weights.about.get('step')}")


if __name__ == "__main__":
    main()
