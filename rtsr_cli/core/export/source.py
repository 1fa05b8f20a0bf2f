"""What is exported: a system by name with the weights that come along, or a file of weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.export.request import ExportRequest
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.graphs import NetworkGraphs
from rtsr_cli.core.network.acceleration import fold_norms
from rtsr_cli.core.network.exported import describe_graphs
from rtsr_cli.core.network.load import find_shipped_weights
from rtsr_cli.core.network.weights import (
    SHIPPED,
    SavedWeights,
    fill_network,
    list_shipped,
    name_shipped,
    read_weights,
)
from rtsr_cli.core.settings import SettingsSource, resolve_settings
from rtsr_cli.core.system import System

SUFFIX = ".safetensors"


@dataclass(frozen=True, kw_only=True)
class ExportSource:
    """A network that is exported.

    Attributes:
        system: whose it is.
        weights: that it has.
        config: of the system.
        graphs: what of it is exported.
        network: in eval mode, of single precision, batch norms folded into convolutions.
    """

    system: System
    weights: SavedWeights
    config: Any
    graphs: NetworkGraphs
    network: nn.Module

    @property
    def scale(self) -> int:
        """S."""
        return self.weights.scale

    def name_file(self, method: str) -> str:
        """File name of a graph; its own name is left out where there is no other.

        Weights that a config tells apart are called by it, as the shipped ones are.
        """
        stem, pattern = f"{self.system.name}-{self.scale}x", self.system.weights or ""
        if "{config" in pattern:
            stem = Path(name_shipped(pattern, self.scale, self.config)).stem
        return f"{stem}.onnx" if len(self.graphs.graphs) == 1 else f"{stem}-{method}.onnx"


def load_source(request: ExportRequest, load: Callable[[str], System]) -> ExportSource:
    """Read weights and build their network.

    Raises:
        ConfigError: there is no such system, or it comes with several weights.
        CheckpointError: it has no network, no weights, or they are damaged.
    """
    path = _find_file(request.source)
    if path is None:
        path = _find_weights(_load_named(request.source, load), request.scale)
    weights = read_weights(path)
    system = load(weights.system)
    if request.scale not in {None, weights.scale}:
        raise CheckpointError(f"{path}: weights for {weights.scale}x, not {request.scale}x")
    config = resolve_settings(system.config, SettingsSource(str(path), weights.config))
    graphs = describe_graphs(system, config)
    network = system.build(config, weights.scale)
    fill_network(network, weights)
    return ExportSource(
        system=system, weights=weights, config=config, graphs=graphs, network=fold_norms(network)
    )


def _load_named(source: str, load: Callable[[str], System]) -> System:
    """Load the system of a name.

    Raises:
        ConfigError: there is none.
        CheckpointError: it is a folder's.
    """
    try:
        return load(source)
    except ConfigError as error:
        if not is_folder(Path(source)):
            raise
        raise CheckpointError(
            f"{source}: a folder; export a system or a file of weights, such as "
            f"{Path(source) / f'best{SUFFIX}'}"
        ) from error


def _find_file(source: str) -> Path | None:
    """Return the weights that a name or a path stands for, None where it is a system's name."""
    if source.endswith(SUFFIX) or Path(source).is_file():
        return Path(source)
    shipped = SHIPPED / f"{source}{SUFFIX}"
    return shipped if Path(source).name == source and shipped.is_file() else None


def _find_weights(system: System, scale: int | None) -> Path:
    """Return the weights that a system comes with.

    Raises:
        ConfigError: there are several, and none is chosen; says how one is.
        CheckpointError: there are none; says how they are made.
    """
    describe_graphs(system, system.config())
    variants = list_shipped(system.name)
    if "{config" in (system.weights or "") and len(variants) > 1:
        listed = ", ".join(path.stem for path in variants)
        raise ConfigError(
            f"system '{system.name}' comes with several weights: give one's name in place of the "
            f"system's ({listed})"
        )
    there = [s for s in system.scales if find_shipped_weights(system, s) is not None]
    if scale is None and len(there) > 1:
        listed = ", ".join(f"{s}x" for s in there)
        raise ConfigError(f"system '{system.name}' comes with weights for {listed}: add --scale")
    chosen = find_shipped_weights(system, there[0] if scale is None and there else scale or 0)
    if chosen is None:
        wanted = "" if scale is None else f" for {scale}x"
        raise CheckpointError(
            f"system '{system.name}' comes without weights{wanted}: train them (rtsr train "
            f"{system.name} DATA --out RUN) and export RUN/best.safetensors"
        )
    return chosen
