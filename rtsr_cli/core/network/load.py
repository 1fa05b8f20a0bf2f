"""A system's network with its weights, ready to run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.weights import SavedWeights, fill_network, find_shipped, read_weights
from rtsr_cli.core.settings import SettingsSource, resolve_settings
from rtsr_cli.core.system import System


@dataclass(frozen=True, kw_only=True)
class LoadedNetwork:
    """A network and what decides its outputs.

    Attributes:
        network: on the device, in eval mode.
        config: of the system.
        digest: of the weights' file, empty where there are none.
        weights: path of the file, None where there is none.
    """

    network: nn.Module
    config: Any
    digest: str = ""
    weights: Path | None = None


def find_shipped_weights(system: System, scale: int, config: Any = None) -> Path | None:
    """Return a system's weights that come with the package; of its default config if None."""
    return find_shipped(system.weights, scale, system.config() if config is None else config)


def has_weights(system: System, scale: int) -> bool:
    """Tell whether a system runs at a scale as it is shipped: baselines need no weights."""
    return system.learning is None or find_shipped_weights(system, scale) is not None


def load_network(
    system: System, scale: int, device: str, path: Path | None = None
) -> LoadedNetwork:
    """Build a system's network and fill it.

    Args:
        system: to build.
        scale: S.
        device: torch device.
        path: of weights; the shipped ones if None.

    Raises:
        CheckpointError: there are no weights, or they are of another system or scale.
    """
    if system.learning is None:
        if path is not None:
            raise CheckpointError(f"{path}: system '{system.name}' takes no weights")
        config = system.config()
        return LoadedNetwork(network=system.build(config, scale).eval().to(device), config=config)
    chosen = path or find_shipped_weights(system, scale)
    if chosen is None and system.scales and scale not in system.scales:
        made = ", ".join(f"{s}x" for s in system.scales)
        raise CheckpointError(f"system '{system.name}' is made for {made}, not {scale}x")
    if chosen is None:
        raise CheckpointError(
            f"system '{system.name}' comes without weights for {scale}x: train them (rtsr train "
            f"{system.name} DATA --scale {scale} --out RUN) and give --weights RUN/best.safetensors"
        )
    weights = read_weights(chosen)
    _check_weights(weights, system, scale)
    config = resolve_settings(system.config, SettingsSource(str(chosen), weights.config))
    network = system.build(config, scale)
    fill_network(network, weights)
    return LoadedNetwork(
        network=accelerate_network(network).to(device),
        config=config,
        digest=weights.digest(),
        weights=chosen,
    )


def _check_weights(weights: SavedWeights, system: System, scale: int) -> None:
    if weights.system != system.name:
        raise CheckpointError(
            f"{weights.path}: weights of '{weights.system}', not of '{system.name}'; give others, "
            f"or choose --system {weights.system} where the command has that option"
        )
    if weights.scale != scale:
        raise CheckpointError(
            f"{weights.path}: weights for {weights.scale}x, the frames ask for {scale}x"
        )
