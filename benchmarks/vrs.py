"""How well shading errors are predicted, and what rates by them save: `docs/vrs.md`.

    python benchmarks/vrs.py DATA [--weights LABEL=FILE ...] [--csv FOLDER] [--output docs/vrs.md]

Runs every set of `rt-percept` weights, those of the package by default, over the `val` and `test`
sequences of DATA/manifest.json at full resolution, from the second frame on, and holds predicted
tile errors against true ones in transformed space. The proxy needs no learning: the exact metric on
the frame before, moved to this one. A plot for each shows what rates save against their true error
as the threshold changes: network, analytic estimate, and both together. Every figure goes to CSV
files, the tables that `benchmarks/vrs_text.py` makes of them to the document.
"""

from __future__ import annotations

import json
import statistics
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import click
import torch
from curves import Curve, drawn
from tables import Row, write_csv
from torch import Tensor
from vrs_text import (
    ACCURACY,
    ACCURACY_COLUMNS,
    FIGURES,
    SAVINGS,
    SAVINGS_COLUMNS,
    write_text,
)

from rtsr_cli.core.choices import Estimator, NonfinitePolicy, VrsMetric
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import FrameSequence
from rtsr_cli.core.network.load import LoadedNetwork, load_network
from rtsr_cli.core.network.weights import SHIPPED
from rtsr_cli.core.pairs.opening import ReadOptions, open_single_sets
from rtsr_cli.core.run.sliding_window import SlidingWindow
from rtsr_cli.core.run.system_inputs import resolve_system_inputs
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.core.vrs.accuracy import AccuracyTally, average_accuracy, join_tallies, tally_errors
from rtsr_cli.core.vrs.adaptive_estimate import AdaptiveConfig
from rtsr_cli.core.vrs.captured_rates import measure_true_errors
from rtsr_cli.core.vrs.coarse_shading import shade_coarsely
from rtsr_cli.core.vrs.estimate import VrsOptions, errors_of_codes, estimate_rates
from rtsr_cli.core.vrs.rates import ShadingRate, extrapolate_errors, rate_shares, shaded_share
from rtsr_cli.core.vrs.reprojection import reproject
from rtsr_cli.core.vrs.shading_error import ErrorConfig, tile_errors, to_amplitude
from rtsr_cli.core.vrs.tile_pooling import pixel_shares
from rtsr_cli.models import load_system
from rtsr_cli.models.rt_percept.config import RtPerceptConfig
from rtsr_cli.models.rt_percept.loss import restore_errors, transform_errors

SYSTEM = "rt-percept"
DERIVED = (ShadingRate.HALF, ShadingRate.QUARTER)
STEPS = 18
"""Thresholds of a curve."""

FOLDER = Path("docs/results")


@dataclass(frozen=True)
class Known:
    """What is known of a frame: its window, true and predicted errors of every reduced rate."""

    window: FrameWindow
    true: Mapping[ShadingRate, Tensor]
    predicted: Tensor
    proxy: Mapping[ShadingRate, Tensor]
    seen: Tensor


def proxy_errors(
    window: FrameWindow, rates: tuple[ShadingRate, ...], config: ErrorConfig
) -> dict[ShadingRate, Any]:
    """Errors of rates on the frame before, moved; what it does not show is the nearest it does."""
    moved = reproject(window).moved
    # a display transform of single samples: coarse shading of what is shown is the same
    return {rate: tile_errors(shade_coarsely(moved, rate), moved, config) for rate in rates}


def frames_of(folder: Path, loaded: LoadedNetwork) -> Iterator[Known]:
    """Run a sequence; the first frame, which has none before it, is left out."""
    system, config = load_system(SYSTEM), loaded.config
    inputs = resolve_system_inputs(system, NonfinitePolicy.ERROR, config)
    for _, source in open_single_sets(folder, ReadOptions()):
        reader = source.reader
        sequence = FrameSequence(numbers=reader.numbers, step=reader.step, cuts=reader.resets)
        sliding = SlidingWindow(sequence, history_frames=system.history_frames, scale=1)
        for number in reader.numbers:
            window = sliding.slide(source.load(number, inputs))
            with torch.inference_mode():
                predicted = system.predict(loaded.network, window, None).tiles
            if len(window.lr) == 1 or predicted is None:
                continue
            color = window.current.gbuffer[Buffer.COLOR]
            options = VrsOptions(error=config.error)
            yield Known(
                window=window,
                true=measure_true_errors(color, config.error),
                predicted=predicted,
                proxy=proxy_errors(window, config.predicted, config.error),
                seen=estimate_rates(window, predicted, config.predicted, options).seen,
            )


def tallies(
    frame: Known, loaded: LoadedNetwork, space: RtPerceptConfig | None = None
) -> dict[str, dict[str, AccuracyTally]]:
    """Kind of prediction and of tile -> rate -> sums, in the weights' own space or another one."""
    config = space or loaded.config
    mean = loaded.network.get_buffer("mean")
    each: dict[str, dict[str, AccuracyTally]] = defaultdict(dict)
    unseen = 1.0 - frame.seen
    for index, rate in enumerate(config.predicted):
        wanted = transform_errors(frame.true[rate], mean, config)
        predicted = transform_errors(frame.predicted[:, index : index + 1], mean, config)
        proxy = transform_errors(frame.proxy[rate], mean, config)
        each["network"][rate.label] = tally_errors(predicted, wanted)
        each["network, seen"][rate.label] = tally_errors(predicted, wanted, frame.seen)
        each["network, unseen"][rate.label] = tally_errors(predicted, wanted, unseen)
        each["proxy"][rate.label] = tally_errors(proxy, wanted)
    metric = config.error.metric
    given = {
        rate: to_amplitude(frame.predicted[:, i : i + 1], metric)
        for i, rate in enumerate(config.predicted)
    }
    derived = extrapolate_errors(given)
    if metric == "psnr":
        return each
    for rate in DERIVED:
        wanted = transform_errors(frame.true[rate], mean, config)
        each["extrapolated"][rate.label] = tally_errors(
            transform_errors(derived[rate], mean, config), wanted
        )
    return each


def decided(
    frames: list[Known],
    loaded: LoadedNetwork,
    estimator: Estimator,
    threshold: float,
    analytic: float,
) -> tuple[float, float]:
    """(true error, saved share) over frames; errors beyond `WORST` count as that."""
    config = loaded.config
    options = VrsOptions(
        estimator=estimator,
        error=config.error,
        threshold=threshold,
        analytic=AdaptiveConfig(tile=config.error.tile, threshold=analytic),
    )
    each = []
    for frame in frames:
        found = estimate_rates(frame.window, frame.predicted, config.predicted, options)
        worst = errors_of_codes(frame.true, found.codes, config.error.metric)
        pixels = pixel_shares(frame.window.current.gbuffer.size, config.error.tile, found.codes)
        shares = rate_shares(found.codes, pixels)
        each.append((float(worst.mean()), 1.0 - shaded_share(shares)))
    error, saved = (statistics.fmean(column) for column in zip(*each, strict=True))
    return error, 100.0 * saved


def frontier(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Points that no other one saves more than at as low an error."""
    best: list[tuple[float, float]] = []
    for error, saved in sorted(points):
        if not best or saved > best[-1][1]:
            best.append((error, saved))
    return best


def curves(frames: list[Known], loaded: LoadedNetwork) -> list[Curve]:
    """What is saved against the true error, a curve an estimator."""
    reach = float(
        restore_errors(torch.ones(1, 1, 1, 1), loaded.network.get_buffer("mean"), loaded.config)
    )
    own = [reach * (step / STEPS) ** 2 for step in range(1, STEPS)]
    analytic = [0.005 * 1.35**step for step in range(STEPS)]
    ways = {
        Estimator.NETWORK: [(t, 1.0) for t in own],
        Estimator.ANALYTIC: [(1.0, a) for a in analytic],
        # two thresholds: every third of both
        Estimator.HYBRID: list(product(own[::3], analytic[::3])),
    }
    return [
        Curve(
            kind.value,
            frontier([decided(frames, loaded, kind, t, a) for t, a in pairs]),
        )
        for kind, pairs in ways.items()
    ]


def saved_at(curve: Curve, error: float) -> float | None:
    """What a curve saves at a true error, between its points; None outside of them."""
    for (x0, y0), (x1, y1) in pairwise(curve.points):
        if x0 <= error <= x1:
            return y0 + (y1 - y0) * (error - x0) / max(x1 - x0, 1e-12)
    return None


def moving(frames: list[Known]) -> bool:
    """Whether the camera moves: most pixels do."""
    motion = [f.window.current.gbuffer[Buffer.MOTION].norm(dim=1).median() for f in frames]
    return bool(statistics.fmean(map(float, motion)) > 0.1)


def accuracy_cells(found: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    """Columns of what was found of each kind of prediction and tile."""
    return {
        column: f"{found[kind][name]:.3f}" if name in found.get(kind, {}) else "-"
        for column, (kind, name) in FIGURES.items()
    }


def mean_accuracy(each: Sequence[Mapping[str, Mapping[str, float]]]) -> dict[str, dict[str, float]]:
    """Mean over sequences of what was found of each kind, over those that have it."""
    means: dict[str, dict[str, float]] = defaultdict(dict)
    for kind, name in FIGURES.values():
        values = [one[kind][name] for one in each if one.get(kind)]
        if values:
            means[kind][name] = statistics.fmean(values)
    return means


def measure_accuracy(loaded: LoadedNetwork, data: Path) -> tuple[list[Row], list[Known]]:
    """Rows of each sequence and of their mean, and the frames whose camera moves."""
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    rows: list[Row] = []
    each, moved = [], []
    for shot in (s for s in manifest["sequences"] if s["split"] in ("val", "test")):
        name = f"{shot['scene']}/{shot['sequence']}"
        frames = list(frames_of(data / name, loaded))
        sums = [tallies(frame, loaded) for frame in frames]
        kinds = {kind for one in sums for kind in one}
        each.append(
            {k: average_accuracy(join_tallies(one.get(k, {}) for one in sums)) for k in kinds}
        )
        scene = "seen in training" if shot["seen_in_training"] else "unseen"
        rows.append({"sequence": name, "scene": scene, **accuracy_cells(each[-1])})
        if moving(frames):
            moved += frames
    rows.append({"sequence": f"mean of {len(each)}", **accuracy_cells(mean_accuracy(each))})
    return rows, moved


def measure_savings(loaded: LoadedNetwork, moved: list[Known], plot: Path) -> list[Row]:
    """Rows of what estimators save at the same true error; draws their curves."""
    metric = loaded.config.error.metric
    lines = curves(moved, loaded)
    across = f"true error ({metric}, mean of tiles)"
    plot.write_text(drawn(lines, across=across, up="saved, %"), encoding="utf-8")
    analytic = next(c for c in lines if c.name == Estimator.ANALYTIC)
    rows = []
    for error, _ in analytic.points[:: max(1, len(analytic.points) // 6)]:
        saved = {c.name: saved_at(c, error) for c in lines}
        cells = {name: "" if share is None else f"{share:.1f}" for name, share in saved.items()}
        rows.append({"true_error": f"{error:.4f}", **cells})
    return rows


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--weights", multiple=True, metavar="LABEL=FILE")
@click.option("--csv", "folder", type=click.Path(path_type=Path), default=FOLDER, show_default=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/vrs.md"))
@click.option("--no-curves", is_flag=True)
def main(
    *, data: Path, weights: tuple[str, ...], folder: Path, output: Path, no_curves: bool
) -> None:
    """Write the figures, and the tables."""
    files = dict(item.split("=", 1) for item in weights) or {
        path.stem: str(path) for path in sorted(SHIPPED.glob(f"{SYSTEM}-*.safetensors"))
    }
    accurate: list[Row] = []
    saved: list[Row] = []
    for label, file in files.items():
        loaded = load_network(load_system(SYSTEM), 1, "cpu", Path(file))
        loaded.network.config = replace(loaded.config, margin=0.0)
        error = loaded.config.error
        head = {"weights": label, "metric": str(error.metric)}
        rows, moved = measure_accuracy(loaded, data)
        accurate += [head | {"tile": str(error.tile), **row} for row in rows]
        if moved and not no_curves and error.metric != VrsMetric.PSNR:
            plot = output.parent / f"vrs-{label}.svg"
            saved += [head | dict(row) for row in measure_savings(loaded, moved, plot)]
        click.echo(f"{label}: measured")
    write_csv(folder / ACCURACY, ACCURACY_COLUMNS, accurate)
    write_csv(folder / SAVINGS, SAVINGS_COLUMNS, saved)
    write_text(folder, output)
    click.echo(f"{folder / ACCURACY}, {folder / SAVINGS}, {output}: written")


if __name__ == "__main__":
    main()
