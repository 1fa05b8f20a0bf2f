"""Rates of a frame before it is shaded: by a network's errors, analytically, or by both."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from rtsr_cli.core.choices import Estimator, VrsMetric
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.shapes import Mask, TileMap
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.core.vrs.adaptive_estimate import (
    AdaptiveConfig,
    adaptive_codes,
    axis_errors,
    scale_errors,
)
from rtsr_cli.core.vrs.rates import REDUCED, Errors, ShadingRate, choose_codes, extrapolate_errors
from rtsr_cli.core.vrs.reprojection import reproject
from rtsr_cli.core.vrs.shading_error import ErrorConfig, from_amplitude, rec601_luma, to_amplitude
from rtsr_cli.core.vrs.tile_pooling import tile_mean

MOSTLY = 0.5
"""Share of a tile's pixels that the frame before shows, from which the tile counts as seen."""

WORST = 10.0
"""Larger errors count as that: by Weber's law those of dark tiles know no bound."""


@dataclass(frozen=True, kw_only=True)
class VrsOptions:
    """How rates are decided.

    Attributes:
        estimator: what decides.
        error: metric and tiles of the network.
        threshold: error that a rate must stay below, in the metric's unit.
        analytic: settings of the analytic estimate; its threshold is of its own unit.
        compare: measure the true errors, too, where the frame holds radiance.
        keep_edges: emulated true rates keep pixels of other objects than the sample's.
    """

    estimator: Estimator = Estimator.NETWORK
    error: ErrorConfig = field(default_factory=ErrorConfig)
    threshold: float = 0.25
    analytic: AdaptiveConfig = field(default_factory=AdaptiveConfig)
    compare: bool = True
    keep_edges: bool = False


@dataclass(frozen=True, kw_only=True)
class RateEstimate:
    """What was decided for a frame.

    Attributes:
        errors: of every reduced rate, in the metric's unit, of `hybrid` those of the network; of
            `analytic` in its own, `WORST` where nothing is known.
        codes: of the chosen rates.
        seen: 1 = the frame before shows the tile.
    """

    errors: Errors
    codes: TileMap
    seen: Mask


def estimate_rates(
    window: FrameWindow,
    predicted: TileMap | None,
    rates: tuple[ShadingRate, ...],
    options: VrsOptions,
) -> RateEstimate:
    """Decide the rates of a frame.

    Args:
        window: the frame's G-buffer, and the frame before.
        predicted: errors of `rates` by the network, a channel a rate; None without one.
        rates: those that it predicts.
        options: how.
    """
    mask = reproject(window).seen
    seen = (tile_mean(mask, options.error.tile) >= MOSTLY).to(mask.dtype)
    analytic = None
    if options.estimator is not Estimator.NETWORK:
        analytic = estimate_analytically(window, seen, options.analytic)
        if options.estimator is Estimator.ANALYTIC:
            return analytic
    assert predicted is not None
    metric = options.error.metric
    values = to_amplitude(predicted, metric)
    each = {rate: values[:, i : i + 1] for i, rate in enumerate(rates)}
    amplitudes = extrapolate_errors(each)
    codes = choose_codes(amplitudes, _to_amplitude(options.threshold, metric))
    if analytic is not None:
        codes = torch.where(seen > 0, analytic.codes, codes)
    errors = {rate: from_amplitude(value, metric) for rate, value in amplitudes.items()}
    return RateEstimate(errors=errors, codes=codes, seen=seen)


def _to_amplitude(value: float, metric: VrsMetric) -> float:
    return float(to_amplitude(torch.tensor(value), metric))


def estimate_analytically(window: FrameWindow, seen: Mask, config: AdaptiveConfig) -> RateEstimate:
    """Rates by the frame before alone; a tile that it does not show is shaded at full rate.

    The frame before is moved pixel by pixel, and a tile's speed is the mean of its pixels'; the
    publication fetches both once a tile, at its centre.
    """
    motion = window.current.gbuffer[Buffer.MOTION].abs()
    speeds = tuple(tile_mean(motion[:, axis : axis + 1], config.tile) for axis in (0, 1))
    ends = axis_errors(rec601_luma(reproject(window).moved), config)
    codes = adaptive_codes(ends, (speeds[0], speeds[1]), config)
    (half_x, quarter_x), (half_y, quarter_y) = (
        scale_errors(error, speed, config) for error, speed in zip(ends, speeds, strict=True)
    )
    errors = {
        ShadingRate.HALF_Y: half_y,
        ShadingRate.HALF_X: half_x,
        ShadingRate.HALF: torch.maximum(half_x, half_y),
        ShadingRate.QUARTER_Y: torch.maximum(half_x, quarter_y),
        ShadingRate.QUARTER_X: torch.maximum(quarter_x, half_y),
        ShadingRate.QUARTER: torch.maximum(quarter_x, quarter_y),
    }
    codes = torch.where(seen > 0, codes, ShadingRate.FULL.code)
    known = {rate: torch.where(seen > 0, errors[rate], WORST) for rate in REDUCED}
    return RateEstimate(errors=known, codes=codes, seen=seen)


def errors_of_codes(errors: Errors, codes: TileMap, metric: VrsMetric) -> TileMap:
    """Amplitude of the error of the rate that each tile got, up to `WORST`; 0 at full rate."""
    chosen = torch.zeros_like(codes)
    for rate, values in errors.items():
        chosen = torch.where(codes == rate.code, to_amplitude(values, metric), chosen)
    return chosen.clamp(max=WORST)
