"""What a system that predicts the errors of tiles declares, and choosing and checking one.

A `System` holds a `TilePredictor` as its `tiles`; its configs are opaque to core, and are asked
through it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from rtsr_cli.core.choices import Estimator, SystemTask, VrsMetric
from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.network.exported import load_chosen_network
from rtsr_cli.core.network.load import LoadedNetwork, find_shipped_weights
from rtsr_cli.core.network.weights import SHIPPED, find_margin
from rtsr_cli.core.run.given_network import name_given_system
from rtsr_cli.core.run.system_inputs import SystemTable
from rtsr_cli.core.shapes import TileMap
from rtsr_cli.core.system import NoNetwork, System
from rtsr_cli.core.vrs.adaptive_estimate import AdaptiveConfig
from rtsr_cli.core.vrs.estimate import VrsOptions
from rtsr_cli.core.vrs.rates import ShadingRate
from rtsr_cli.core.vrs.request import PredictVrsRequest
from rtsr_cli.core.vrs.shading_error import ErrorConfig, to_amplitude

ANALYTIC_INPUTS = (Buffer.COLOR, Buffer.MOTION, Buffer.DEPTH, Buffer.NORMAL)
"""What the analytic estimate reads."""

DEFAULT_TILE = 16
"""Side of a tile, pixels, where users say nothing."""


@dataclass(frozen=True, kw_only=True)
class TilePredictor:
    """How the errors that a system predicts are to be read.

    Attributes:
        configure: (error, reuse) -> a config that predicts these errors, of rates or of reuse.
        error: config -> what errors are measured by, on which tiles.
        rates: config -> rates of the predicted channels, in their order.
        threshold: config -> error that a rate must stay below where users say nothing.
        keeps_edges: config -> whether reduced rates keep pixels of other objects.
        reuses: config -> whether keeping the frame before is predicted, in place of rates.
        with_margin: (config, margin) -> the same config with that margin on its predictions.
        encode: (errors, network) -> values 0..1, in which predicted and true errors compare.
        decode: the way back.
    """

    configure: Callable[[ErrorConfig, bool], Any]
    error: Callable[[Any], ErrorConfig]
    rates: Callable[[Any], tuple[ShadingRate, ...]]
    threshold: Callable[[Any], float]
    keeps_edges: Callable[[Any], bool]
    reuses: Callable[[Any], bool]
    with_margin: Callable[[Any, float], Any]
    encode: Callable[[TileMap, nn.Module], TileMap]
    decode: Callable[[TileMap, nn.Module], TileMap]


@dataclass(frozen=True, kw_only=True)
class ChosenPredictor:
    """What predicts the errors of a run; the analytic estimate has no network.

    Attributes:
        name: of what predicts, as outputs and messages have it.
        system: that declares it.
        loaded: network and config.
        analytic: True if no network is asked.
    """

    name: str
    system: System
    loaded: LoadedNetwork
    analytic: bool = False

    @property
    def tiles(self) -> TilePredictor:
        """What the system declares of its predictions."""
        predictor = self.system.tiles
        assert isinstance(predictor, TilePredictor)
        return predictor

    @property
    def error(self) -> ErrorConfig:
        """What errors are measured by."""
        return self.tiles.error(self.loaded.config)

    @property
    def reuses(self) -> bool:
        """Tell whether keeping the frame before is predicted."""
        return self.tiles.reuses(self.loaded.config)


def choose_predictor(
    request: PredictVrsRequest, systems: SystemTable, device: str
) -> ChosenPredictor:
    """Return what predicts the errors of a request.

    Raises:
        ConfigError: choices do not go with the weights, or with the estimator.
        CheckpointError: there are no weights, or they are of another system.
    """
    system = systems.load(request.system or systems.preferred[0])
    if request.reuse and request.estimator is not Estimator.NETWORK:
        raise ConfigError(
            f"--reuse: only networks predict it; leave out --estimator {request.estimator}"
        )
    if request.estimator is Estimator.ANALYTIC:
        return _choose_analytic(request, system)
    name_given_system(
        systems, SystemTask.PREDICT_VRS, weights=request.weights_file, model=request.model
    )
    path = request.model or request.weights_file or _find_shipped(request, system)
    loaded = load_chosen_network(system, 1, device, path, request.model)
    chosen = ChosenPredictor(name=system.name, system=system, loaded=loaded)
    _check_weights(request, chosen, path)
    margin = request.margin
    if margin is None:
        margin = find_margin(loaded.about)
    config = chosen.tiles.with_margin(loaded.config, margin)
    loaded.network.config = config
    return replace(chosen, loaded=replace(loaded, config=config))


def resolve_error_config(request: PredictVrsRequest) -> ErrorConfig:
    """Return metric and tiles of a request where no weights say otherwise."""
    return ErrorConfig(metric=request.metric or VrsMetric.JNFLIP, tile=request.tile or DEFAULT_TILE)


def _choose_analytic(request: PredictVrsRequest, system: System) -> ChosenPredictor:
    for option, value in (
        ("weights", request.weights_file),
        ("model", request.model),
        ("margin", request.margin),
    ):
        if value is not None:
            raise ConfigError(f"--{option}: the analytic estimate has none; leave it out")
    chosen = ChosenPredictor(
        name=Estimator.ANALYTIC.value,
        system=system,
        loaded=LoadedNetwork(network=NoNetwork(None), config=None),
        analytic=True,
    )
    config = chosen.tiles.configure(resolve_error_config(request), False)
    return replace(chosen, loaded=LoadedNetwork(network=NoNetwork(config), config=config))


def _check_weights(request: PredictVrsRequest, chosen: ChosenPredictor, path: Path) -> None:
    """Refuse weights that predict something else than what is asked for.

    Raises:
        ConfigError: names the option that contradicts them.
    """
    error, name = chosen.error, chosen.system.name
    asked = (("metric", request.metric, error.metric), ("tile", request.tile, error.tile))
    for option, wanted, value in asked:
        if wanted is not None and wanted != value:
            raise ConfigError(
                f"{path}: weights for --{option} {value}, not {wanted}; leave --{option} out, or "
                f"train others (rtsr train {name})"
            )
    if chosen.reuses != request.reuse:
        raise ConfigError(
            f"{path}: weights for rates; leave --reuse out, or train others (rtsr train {name} "
            "--set network.reuse=true)"
            if request.reuse
            else f"{path}: weights for reuse; add --reuse"
        )


def _find_shipped(request: PredictVrsRequest, system: System) -> Path:
    """Return the weights that come with rtsr.

    Raises:
        CheckpointError: there are none; says which there are, and how to train others.
    """
    error, name = resolve_error_config(request), system.name
    assert isinstance(system.tiles, TilePredictor)
    path = find_shipped_weights(system, 1, system.tiles.configure(error, request.reuse))
    if path is not None:
        return path
    there = sorted(p.stem.removeprefix(f"{name}-") for p in SHIPPED.glob(f"{name}-*"))
    raise CheckpointError(
        f"there are no weights for --metric {error.metric} --tile {error.tile}"
        f"{' --reuse' if request.reuse else ''} (there: "
        f"{', '.join(there) or 'none'}); train them (rtsr train {name} DATA --out RUN --set "
        f"network.error.metric={error.metric} --set network.error.tile={error.tile}"
        f"{' --set network.reuse=true' if request.reuse else ''}) and give --weights "
        "RUN/best.safetensors, or use --estimator analytic"
    )


def make_rate_options(request: PredictVrsRequest, chosen: ChosenPredictor) -> VrsOptions:
    """Return how rates are decided.

    Raises:
        ConfigError: a threshold is given that decides nothing, or that no prediction reaches.
    """
    config, tiles = chosen.loaded.config, chosen.tiles
    options = VrsOptions(
        estimator=request.estimator,
        error=chosen.error,
        threshold=request.threshold or tiles.threshold(config),
        analytic=_make_analytic_config(request, chosen.error.tile),
        compare=not request.no_compare,
        keep_edges=tiles.keeps_edges(config),
    )
    if not chosen.analytic:
        _check_threshold(options, chosen)
    return options


def _make_analytic_config(request: PredictVrsRequest, tile: int) -> AdaptiveConfig:
    """Settings of the analytic estimate.

    Raises:
        ConfigError: its threshold is given, but the network alone decides.
    """
    if request.analytic_threshold is None:
        return AdaptiveConfig(tile=tile)
    if request.estimator is Estimator.NETWORK:
        raise ConfigError("--analytic-threshold: the network decides; add --estimator hybrid")
    return AdaptiveConfig(tile=tile, threshold=request.analytic_threshold)


def _check_threshold(options: VrsOptions, chosen: ChosenPredictor) -> None:
    """Refuse a threshold that no prediction can reach: every tile would get the cheapest rate.

    Raises:
        ConfigError: says what the weights can tell.
    """
    worst = chosen.tiles.decode(torch.ones(1, 1, 1, 1), chosen.loaded.network)
    metric = options.error.metric
    reach, asked = (
        to_amplitude(worst, metric),
        to_amplitude(torch.tensor(options.threshold), metric),
    )
    if float(asked) >= float(reach):
        raise ConfigError(
            f"--threshold {options.threshold:g}: these weights tell errors up to "
            f"{float(worst):.3g} ({metric}) apart; choose one below"
        )
