"""Put a run's best weights into the package, by default in half precision.

    python benchmarks/ship_weights.py RUN/best.safetensors [--full] [--scale 3]

Another scale than the run's is for networks whose layers are the same at every scale. Writes
`rtsr_cli/weights/<name>.safetensors`, named as the system declares, and prints its size.
"""

from __future__ import annotations

from pathlib import Path

import click

from rtsr_cli.core.network.weights import SHIPPED, name_shipped, read_weights, save_weights
from rtsr_cli.core.settings import SettingsSource, resolve_settings, to_plain
from rtsr_cli.models import load_system


@click.command()
@click.argument("path", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--half/--full", default=True, show_default=True, help="Precision.")
@click.option("--scale", type=click.IntRange(1), help="In place of the run's.")
def main(path: Path, *, half: bool, scale: int | None) -> None:
    """Copy the weights."""
    weights = read_weights(path)
    scale = weights.scale if scale is None else scale
    system = load_system(weights.system)
    if system.weights is None:
        raise click.ClickException(f"system '{weights.system}' ships no weights")
    config = resolve_settings(system.config, SettingsSource(str(path), weights.config))
    target = SHIPPED / name_shipped(system.weights, scale, config)
    save_weights(
        target,
        weights.tensors,
        system=weights.system,
        scale=scale,
        # every setting, so that a default that changes later changes nothing of these
        config=to_plain(config),
        about=weights.about,
        half=half,
    )
    click.echo(f"{target.name}: {target.stat().st_size} bytes, step {weights.about.get('step')}")


if __name__ == "__main__":
    main()
