"""Decisions of `predict-vrs`: a rate for each tile, or whether the frame before is kept there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray

from rtsr_cli.core.captured_rates import CAPTURED_NAMES, true_errors
from rtsr_cli.core.choices import Estimator
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.beside import images_of
from rtsr_cli.core.io.outputs import image_channels
from rtsr_cli.core.run.frames import Moment
from rtsr_cli.core.shading_files import TALLIES, Decision, Transform
from rtsr_cli.core.shapes import TileMap
from rtsr_cli.core.vrs.accuracy import tally, to_plain
from rtsr_cli.core.vrs.errors import amplitude, from_amplitude
from rtsr_cli.core.vrs.estimating import MOSTLY, WORST, VrsOptions, chosen_errors, estimate
from rtsr_cli.core.vrs.rates import Rate, rate_shares, shaded_share
from rtsr_cli.core.vrs.reuse import reuse_errors, seen_share
from rtsr_cli.core.vrs.tiles import pixel_shares

COLORS: Mapping[Rate, tuple[int, int, int]] = {
    Rate.FULL: (220, 50, 47),
    Rate.HALF_Y: (230, 140, 30),
    Rate.HALF_X: (220, 200, 40),
    Rate.HALF: (90, 180, 60),
    Rate.QUARTER_Y: (40, 170, 170),
    Rate.QUARTER_X: (50, 110, 210),
    Rate.QUARTER: (110, 60, 180),
}
"""Of the overlay: red is full rate, violet the cheapest."""

KEPT = 255
"""Code of a tile whose pixels are those of the frame before."""


def error_channels(errors: Mapping[str, TileMap]) -> dict[str, NDArray[Any]]:
    """`error.<name>`, float."""
    return {
        f"error.{name}": image_channels("e", values, "", full=True)["e"]
        for name, values in errors.items()
    }


def tinted(codes: TileMap, colors: Mapping[int, tuple[int, int, int]]) -> TileMap:
    """Colour of each code, 0..1."""
    tint = codes.new_zeros(1, 3, *codes.shape[-2:])
    for code, rgb in colors.items():
        tint = torch.where(codes == code, codes.new_tensor(rgb).view(1, 3, 1, 1) / 255.0, tint)
    return tint


def _pixels(moment: Moment, tiles: TileMap, options: VrsOptions) -> TileMap:
    """Share of the frame's pixels in each tile."""
    return pixel_shares(moment.window.current.gbuffer.size, options.error.tile, tiles)


def _limit(options: VrsOptions) -> float:
    return float(amplitude(torch.tensor(options.threshold), options.error.metric))


def _mean_error(amplitudes: TileMap, options: VrsOptions) -> float:
    """Mean over tiles, in the metric's unit."""
    return float(from_amplitude(amplitudes.mean(), options.error.metric))


def _missed(worst: TileMap, options: VrsOptions) -> dict[str, float]:
    """Mean of the true error, and share of the tiles that miss the threshold."""
    missed = (worst >= _limit(options)).float()
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
    rates: tuple[Rate, ...]
    transform: Transform | None

    def __call__(self, moment: Moment, predicted: TileMap | None) -> Decision:
        """Estimate, and measure where the frame has radiance."""
        options, metric = self.options, self.options.error.metric
        found = estimate(moment.window, predicted, self.rates, options)
        shares = rate_shares(found.codes, _pixels(moment, found.codes, options))
        facts: dict[str, Any] = {
            "shares": shares,
            "shaded": shaded_share(shares),
            "seen": float(found.seen.mean()),
        }
        # what the analytic estimate decides, it decides in another unit
        if options.estimator is Estimator.NETWORK:
            chosen = chosen_errors(found.errors, found.codes, metric)
            facts["predicted_error"] = _mean_error(chosen, options)
        held = moment.pair.lr.gbuffer.buffers
        color = held.get(Buffer.COLOR)
        if color is not None and options.compare:
            ids = held.get(Buffer.OBJECT_ID) if options.keep_edges else None
            captured = images_of(moment.passed, CAPTURED_NAMES)
            true = true_errors(color, options.error, captured=captured, object_id=ids)
            facts |= _missed(chosen_errors(true, found.codes, metric), options)
            if self.transform is not None:
                tallies = {
                    rate.label: tally(self.transform(found.errors[rate]), self.transform(values))
                    for rate, values in true.items()
                }
                facts[TALLIES] = to_plain(tallies)
        errors = {rate.label: values for rate, values in found.errors.items()}
        return Decision(
            channels=error_channels(errors)
            | image_channels("rate", found.codes, "")
            | image_channels("seen", found.seen, ""),
            codes=found.codes,
            colors=tinted(found.codes, {rate.code: rgb for rate, rgb in COLORS.items()}),
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

    def __call__(self, moment: Moment, predicted: TileMap | None) -> Decision:
        """Decide, and measure where the frame has radiance."""
        options, metric = self.options, self.options.error.metric
        assert predicted is not None
        shown = seen_share(moment.window, options.error.tile)
        below = amplitude(predicted, metric) < _limit(options)
        keep = (below & (shown >= MOSTLY)).to(shown.dtype)
        share = float((keep * shown * _pixels(moment, keep, options)).sum())
        facts: dict[str, Any] = {
            "shares": {"kept": share, "shaded": 1.0 - share},
            "shaded": 1.0 - share,
            "seen": float(shown.mean()),
            "predicted_error": _mean_error(amplitude(predicted, metric) * keep, options),
        }
        color = moment.pair.lr.gbuffer.buffers.get(Buffer.COLOR)
        if color is not None and options.compare:
            true = reuse_errors(moment.window, color, options.error)
            facts |= _missed((amplitude(true, metric) * keep).clamp(max=WORST), options)
            facts[TALLIES] = to_plain(
                {"reuse": tally(self.transform(predicted), self.transform(true))}
            )
        codes = keep * KEPT
        return Decision(
            channels=error_channels({"reuse": predicted}) | image_channels("keep", keep, ""),
            codes=codes,
            colors=tinted(codes, {0: COLORS[Rate.FULL], KEPT: COLORS[Rate.QUARTER]}),
            facts=facts,
        )
