"""A network whose graphs are exported files: all that surrounds them stays this project's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import nn

from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.graphs import NetworkGraphs
from rtsr_cli.core.network.graphs import replace_graph
from rtsr_cli.core.network.load import LoadedNetwork, load_network
from rtsr_cli.core.network.manifest import Manifest, read_manifest
from rtsr_cli.core.network.onnx_graph import OnnxGraph
from rtsr_cli.core.settings import SettingsSource, resolve_settings
from rtsr_cli.core.system import System

ObserveNetwork = Callable[[LoadedNetwork], None]
"""Sees a network before it runs."""

_OBSERVERS: list[ObserveNetwork] = []


@contextmanager
def observe_networks(observe: ObserveNetwork) -> Iterator[None]:
    """Show every network that a run loads to a function, which may follow its graphs."""
    _OBSERVERS.append(observe)
    try:
        yield
    finally:
        _OBSERVERS.remove(observe)


def load_chosen_network(
    system: System, scale: int, device: str, weights: Path | None, model: Path | None
) -> LoadedNetwork:
    """Return a system's network with weights, or with exported files in place of its graphs.

    Raises:
        CheckpointError: there are none, or they are of another system or scale.
        ConfigError: onnxruntime is not installed.
    """
    if model is None:
        loaded = load_network(system, scale, device, weights)
    else:
        loaded = load_exported_network(system, scale, read_manifest(model))
    for observe in _OBSERVERS:
        observe(loaded)
    return loaded


def load_exported_network(system: System, scale: int, manifest: Manifest) -> LoadedNetwork:
    """Build a system's network and put exported files in place of its graphs.

    Raises:
        CheckpointError: they are of another system or scale, or not all there.
        ConfigError: onnxruntime is not installed.
    """
    if manifest.system != system.name:
        raise CheckpointError(
            f"{manifest.path}: a network of '{manifest.system}', not of '{system.name}'; give "
            f"another, or choose --system {manifest.system} where the command has that option"
        )
    if manifest.scale != scale:
        raise CheckpointError(
            f"{manifest.path}: a network for {manifest.scale}x, the frames ask for {scale}x"
        )
    config = resolve_settings(system.config, SettingsSource(str(manifest.path), manifest.config))
    network = system.build(config, scale).eval().requires_grad_(False)
    graphs = describe_graphs(system, config)
    _fill_values(network, graphs, manifest)
    files = {file.method: file for file in manifest.files}
    for graph in graphs.graphs:
        if graph.method not in files:
            raise CheckpointError(f"{manifest.path}: names no graph '{graph.method}'; export again")
        replace_graph(network, graph.method, OnnxGraph(files[graph.method].path))
    return LoadedNetwork(
        network=network,
        config=config,
        digest=manifest.digest(),
        weights=manifest.path,
        about=manifest.about,
        manifest=manifest,
    )


def describe_graphs(system: System, config: Any) -> NetworkGraphs:
    """What is exported of a system's network.

    Raises:
        CheckpointError: nothing can be.
        ConfigError: it cannot be of this config.
    """
    if system.learning is None:
        raise CheckpointError(f"system '{system.name}' has no network: there is nothing to export")
    if system.graphs is None:
        raise CheckpointError(f"system '{system.name}' declares no graphs: it cannot be exported")
    graphs: NetworkGraphs = system.graphs(config)
    return graphs


def _fill_values(network: nn.Module, graphs: NetworkGraphs, manifest: Manifest) -> None:
    """Fill the buffers that steps outside read."""
    for name in graphs.values:
        buffer = network.get_buffer(name)
        try:
            values = torch.tensor(manifest.values[name], dtype=buffer.dtype).view_as(buffer)
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise CheckpointError(
                f"{manifest.path}: what it says of itself is damaged (values.{name})"
            ) from error
        buffer.copy_(values)
