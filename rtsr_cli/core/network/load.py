"""A system's network with its weights, ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.manifest import Manifest
from rtsr_cli.core.network.precision import resolve_precision
from rtsr_cli.core.network.weights import SavedWeights, fill_network, find_shipped, read_weights
from rtsr_cli.core.settings import SettingsSource, resolve_settings
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import System


@dataclass(frozen=True, kw_only=True)
class LoadedNetwork:
    """A network and what decides its outputs.

    Attributes:
        network: on the device, in eval mode.
        config: of the system.
        digest: of the weights' file, empty where there are none.
        weights: path of the file, None where there is none.
        about: what the weights say of their training.
        manifest: of exported files that stand for the network's graphs; None where it has weights.
    """

    network: nn.Module
    config: Any
    digest: str = ""
    weights: Path | None = None
    about: Mapping[str, Any] = field(default_factory=dict)
    manifest: Manifest | None = None

    @property
    def takes_tiles(self) -> bool:
        """Tell whether frames may be cut: files of one size take whole frames alone."""
        return self.manifest is None or self.manifest.size is None

    def choose_precision(self, wanted: Precision, device: torch.device) -> Precision:
        """Number format of layers; exported files have one of their own, all else is single."""
        if self.manifest is None:
            return resolve_precision(wanted, device)
        return Precision.FP32

    def check_size(self, size: Size) -> None:
        """Hold LR frames to be of a size that the network takes.

        Raises:
            CheckpointError: they are not; only exported files take some alone.
        """
        if self.manifest is not None:
            self.manifest.check_size(size)


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
        about=weights.about,
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
