"""Decisions of `predict-vrs`: a rate for each tile, or whether the frame before is kept there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray

from rtsr_cli.core.choices import Estimator
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.storage import split_image
from rtsr_cli.core.pairs.auxiliary_radiance import join_planes
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.shapes import TileMap
from rtsr_cli.core.vrs.accuracy import tallies_to_plain, tally_errors
from rtsr_cli.core.vrs.captured_rates import CAPTURED_NAMES, measure_true_errors
from rtsr_cli.core.vrs.decision_files import TALLIES, TileDecision, Transform
from rtsr_cli.core.vrs.estimate import MOSTLY, WORST, VrsOptions, errors_of_codes, estimate_rates
from rtsr_cli.core.vrs.rates import ShadingRate, rate_shares, shaded_share
from rtsr_cli.core.vrs.reuse import reuse_errors, seen_share
from rtsr_cli.core.vrs.shading_error import from_amplitude, to_amplitude
from rtsr_cli.core.vrs.tile_pooling import pixel_shares

COLORS: Mapping[ShadingRate, tuple[int, int, int]] = {
    ShadingRate.FULL: (220, 50, 47),
    ShadingRate.HALF_Y: (230, 140, 30),
    ShadingRate.HALF_X: (220, 200, 40),
    ShadingRate.HALF: (90, 180, 60),
    ShadingRate.QUARTER_Y: (40, 170, 170),
    ShadingRate.QUARTER_X: (50, 110, 210),
    ShadingRate.QUARTER: (110, 60, 180),
}
"""Of the overlay: red is full rate, violet the cheapest."""

KEPT = 255
"""Code of a tile whose pixels are those of the frame before."""


def name_error_channels(errors: Mapping[str, TileMap]) -> dict[str, NDArray[Any]]:
    """`error.<name>`, float."""
    return {
        f"error.{name}": split_image("e", values, "", full=True)["e"]
        for name, values in errors.items()
    }


def color_codes(codes: TileMap, colors: Mapping[int, tuple[int, int, int]]) -> TileMap:
    """Colour of each code, 0..1."""
    tint = codes.new_zeros(1, 3, *codes.shape[-2:])
    for code, rgb in colors.items():
        tint = torch.where(codes == code, codes.new_tensor(rgb).view(1, 3, 1, 1) / 255.0, tint)
    return tint


def _pixel_shares(moment: FrameInTurn, tiles: TileMap, options: VrsOptions) -> TileMap:
    """Share of the frame's pixels in each tile."""
    return pixel_shares(moment.window.current.gbuffer.size, options.error.tile, tiles)


def _error_limit(options: VrsOptions) -> float:
    return float(to_amplitude(torch.tensor(options.threshold), options.error.metric))


def _mean_error(amplitudes: TileMap, options: VrsOptions) -> float:
    """Mean over tiles, in the metric's unit."""
    return float(from_amplitude(amplitudes.mean(), options.error.metric))


def _measure_missed(worst: TileMap, options: VrsOptions) -> dict[str, float]:
    """Mean of the true error, and share of the tiles that miss the threshold."""
    missed = (worst >= _error_limit(options)).float()
    return {"true_error": _mean_error(worst, options), "missed": float(missed.mean())}


@dataclass(frozen=True, kw_only=True)
class RateDecider:
    """Chooses the cheapest rate that stays below the threshold, tile by tile.

    Attributes:
        options: how.
        rates: that the network predicts.
        transform: T; None where predicted and true errors are of different units.
    """

    options: VrsOptions
    rates: tuple[ShadingRate, ...]
    transform: Transform | None

    def __call__(self, moment: FrameInTurn, predicted: TileMap | None) -> TileDecision:
        """Estimate, and measure where the frame has radiance."""
        options, metric = self.options, self.options.error.metric
        estimated = estimate_rates(moment.window, predicted, self.rates, options)
        shares = rate_shares(estimated.codes, _pixel_shares(moment, estimated.codes, options))
        facts: dict[str, Any] = {
            "shares": shares,
            "shaded": shaded_share(shares),
            "seen": float(estimated.seen.mean()),
        }
        # what the analytic estimate decides, it decides in another unit
        if options.estimator is Estimator.NETWORK:
            chosen = errors_of_codes(estimated.errors, estimated.codes, metric)
            facts["predicted_error"] = _mean_error(chosen, options)
        held = moment.pair.lr.gbuffer.buffers
        color = held.get(Buffer.COLOR)
        if color is not None and options.compare:
            ids = held.get(Buffer.OBJECT_ID) if options.keep_edges else None
            captured = join_planes(moment.passed, CAPTURED_NAMES)
            true = measure_true_errors(color, options.error, captured=captured, object_id=ids)
            facts |= _measure_missed(errors_of_codes(true, estimated.codes, metric), options)
            if self.transform is not None:
                tallies = {
                    rate.label: tally_errors(
                        self.transform(estimated.errors[rate]), self.transform(values)
                    )
                    for rate, values in true.items()
                }
                facts[TALLIES] = tallies_to_plain(tallies)
        errors = {rate.label: values for rate, values in estimated.errors.items()}
        return TileDecision(
            channels=name_error_channels(errors)
            | split_image("rate", estimated.codes, "")
            | split_image("seen", estimated.seen, ""),
            codes=estimated.codes,
            colors=color_codes(estimated.codes, {rate.code: rgb for rate, rgb in COLORS.items()}),
            facts=facts,
        )


@dataclass(frozen=True, kw_only=True)
class ReuseDecider:
    """Keeps the frame before where it shows most of a tile and the error stays below.

    Pixels that it does not show are shaded in any case.

    Attributes:
        options: how.
        transform: T.
    """

    options: VrsOptions
    transform: Transform

    def __call__(self, moment: FrameInTurn, predicted: TileMap | None) -> TileDecision:
        """Decide, and measure where the frame has radiance."""
        options, metric = self.options, self.options.error.metric
        assert predicted is not None
        shown = seen_share(moment.window, options.error.tile)
        below = to_amplitude(predicted, metric) < _error_limit(options)
        keep = (below & (shown >= MOSTLY)).to(shown.dtype)
        share = float((keep * shown * _pixel_shares(moment, keep, options)).sum())
        facts: dict[str, Any] = {
            "shares": {"kept": share, "shaded": 1.0 - share},
            "shaded": 1.0 - share,
            "seen": float(shown.mean()),
            "predicted_error": _mean_error(to_amplitude(predicted, metric) * keep, options),
        }
        color = moment.pair.lr.gbuffer.buffers.get(Buffer.COLOR)
        if color is not None and options.compare:
            true = reuse_errors(moment.window, color, options.error)
            facts |= _measure_missed((to_amplitude(true, metric) * keep).clamp(max=WORST), options)
            facts[TALLIES] = tallies_to_plain(
                {"reuse": tally_errors(self.transform(predicted), self.transform(true))}
            )
        codes = keep * KEPT
        return TileDecision(
            channels=name_error_channels({"reuse": predicted}) | split_image("keep", keep, ""),
            codes=codes,
            colors=color_codes(
                codes, {0: COLORS[ShadingRate.FULL], KEPT: COLORS[ShadingRate.QUARTER]}
            ),
            facts=facts,
        )
