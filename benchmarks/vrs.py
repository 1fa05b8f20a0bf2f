"""How well shading errors are predicted, and what rates by them save: `docs/vrs.md`.

    python benchmarks/vrs.py DATA [--weights LABEL=FILE ...] [--output docs/vrs.md]

Runs every set of `rt-percept` weights, those of the package by default, over the `val` and `test`
sequences of DATA/manifest.json at full resolution, from the second frame on, and holds predicted
tile errors against true ones in transformed space. The proxy needs no learning: the exact metric on
the frame before, moved to this one. A plot for each shows what rates save against their true error
as the threshold changes: network, analytic estimate, and both together.
"""

from __future__ import annotations

import json
import statistics
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import torch
from curves import Curve, drawn
from rtsr_cli.core.planning import UpscaleOptions
from sections import replace_section
from torch import Tensor

from rtsr_cli.core import planning, upscaling
from rtsr_cli.core.captured_rates import true_errors
from rtsr_cli.core.choices import Estimator, VrsMetric
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.opening import ReadOptions, open_single
from rtsr_cli.core.io.pairs import Inputs
from rtsr_cli.core.networks import Loaded, load_network
from rtsr_cli.core.system import Window
from rtsr_cli.core.vrs.accuracy import Tally, accuracy, tally, together
from rtsr_cli.core.vrs.adaptive import AdaptiveConfig
from rtsr_cli.core.vrs.coarse import coarse_shading
from rtsr_cli.core.vrs.errors import ErrorConfig, amplitude, tile_errors
from rtsr_cli.core.vrs.estimating import VrsOptions, chosen_errors, estimate
from rtsr_cli.core.vrs.rates import Rate, extrapolated, rate_shares, shaded_share
from rtsr_cli.core.vrs.reprojection import moved_picture
from rtsr_cli.core.vrs.tiles import pixel_shares
from rtsr_cli.core.weights import SHIPPED
from rtsr_cli.models import load_system
from rtsr_cli.models.rt_percept.config import RtPerceptConfig
from rtsr_cli.models.rt_percept.loss import restore_errors, transform_errors

SYSTEM = "rt-percept"
DERIVED = (Rate.HALF, Rate.QUARTER)
STEPS = 18
"""Thresholds of a curve."""

HEAD = """# Predicted shading errors

Predicted against true errors of reduced shading rates, tile by tile, in transformed space (0..1),
on sequences that no network was trained on: R2 and mean absolute error of each predicted rate,
then their mean over rates; `under` is the mean underestimation. Tiles count as seen if the frame
before shows at least half of their pixels. The proxy is the exact metric on the frame before, moved
to this one. Predictions are the network's, without the safety margin that `predict-vrs` adds.

Written by `python benchmarks/vrs.py DATA`; do not edit."""


@dataclass(frozen=True)
class Known:
    """What is known of a frame: its window, true and predicted errors of every reduced rate."""

    window: Window
    true: Mapping[Rate, Tensor]
    predicted: Tensor
    proxy: Mapping[Rate, Tensor]
    seen: Tensor


def proxy_errors(window: Window, rates: tuple[Rate, ...], config: ErrorConfig) -> dict[Rate, Any]:
    """Errors of rates on the frame before, moved; what it does not show is the nearest it does."""
    moved = moved_picture(window)
    # a display transform of single samples: coarse shading of what is shown is the same
    return {rate: tile_errors(coarse_shading(moved, rate), moved, config) for rate in rates}


def frames_of(folder: Path, loaded: Loaded) -> Iterator[Known]:
    """Run a sequence; the first frame, which has none before it, is left out."""
    system, config = load_system(SYSTEM), loaded.config
    options = UpscaleOptions(jobs=1, command="vrs")
    found: list[Known] = []

    def make(made: upscaling.Made) -> Callable[[], None]:
        window, prediction = made.window, made.prediction
        if len(window.lr) > 1 and prediction.tiles is not None:
            color = window.current.gbuffer[Buffer.COLOR]
            options = VrsOptions(error=config.error)
            seen = estimate(window, prediction.tiles, config.predicted, options).seen
            found.append(
                Known(
                    window=window,
                    true=true_errors(color, config.error),
                    predicted=prediction.tiles,
                    proxy=proxy_errors(window, config.predicted, config.error),
                    seen=seen,
                )
            )
        return lambda: None

    with TemporaryDirectory() as scratch:
        for name, source in open_single(folder, ReadOptions()):
            inputs = planning.system_inputs(system, Inputs(lr=()), config)
            plan = planning.plan_shot(
                name,
                source,
                system,
                inputs=inputs,
                folder=Path(scratch) / name,
                options=options,
                config=None,
            )
            for event in upscaling.run_shot(plan, loaded.network, options, make):
                if event.message:
                    raise click.ClickException(event.message)
    yield from found


def tallies(
    frame: Known, loaded: Loaded, space: RtPerceptConfig | None = None
) -> dict[str, dict[str, Tally]]:
    """Kind of prediction and of tile -> rate -> sums, in the weights' own space or another one."""
    config = space or loaded.config
    mean = loaded.network.get_buffer("mean")
    each: dict[str, dict[str, Tally]] = defaultdict(dict)
    unseen = 1.0 - frame.seen
    for index, rate in enumerate(config.predicted):
        wanted = transform_errors(frame.true[rate], mean, config)
        predicted = transform_errors(frame.predicted[:, index : index + 1], mean, config)
        proxy = transform_errors(frame.proxy[rate], mean, config)
        each["network"][rate.label] = tally(predicted, wanted)
        each["network, seen"][rate.label] = tally(predicted, wanted, frame.seen)
        each["network, unseen"][rate.label] = tally(predicted, wanted, unseen)
        each["proxy"][rate.label] = tally(proxy, wanted)
    metric = config.error.metric
    given = {
        rate: amplitude(frame.predicted[:, i : i + 1], metric)
        for i, rate in enumerate(config.predicted)
    }
    derived = extrapolated(given)
    if metric == "psnr":
        return each
    for rate in DERIVED:
        wanted = transform_errors(frame.true[rate], mean, config)
        each["extrapolated"][rate.label] = tally(
            transform_errors(derived[rate], mean, config), wanted
        )
    return each


def decided(
    frames: list[Known], loaded: Loaded, estimator: Estimator, threshold: float, analytic: float
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
        found = estimate(frame.window, frame.predicted, config.predicted, options)
        worst = chosen_errors(frame.true, found.codes, config.error.metric)
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


def curves(frames: list[Known], loaded: Loaded) -> list[Curve]:
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


def line(label: str, seen: str, found: Mapping[str, Mapping[str, Tally]]) -> str:
    """One row of the table."""
    cells = []
    for kind in ("network", "network, seen", "network, unseen", "proxy"):
        facts = accuracy(found.get(kind, {}))
        names = ("r2", "mae", "under") if kind == "network" else ("r2", "mae")
        cells += [f"{facts[name]:.3f}" if name in facts else "-" for name in names]
    facts = accuracy(found.get("extrapolated", {}))
    cells += [f"{facts[name]:.3f}" if name in facts else "-" for name in ("r2", "mae")]
    return f"| {label} | {seen} | " + " | ".join(cells) + " |"


TABLE = (
    "| sequence | scene | R2 | MAE | under | seen R2 | seen MAE | unseen R2 | unseen MAE "
    "| proxy R2 | proxy MAE | 2x2, 4x4 by eq. 10 R2 | MAE |\n| --- | --- |" + " ---: |" * 11
)


def report(label: str, loaded: Loaded, data: Path, plot: Path | None) -> Iterator[str]:
    """The section of a set of weights."""
    error = loaded.config.error
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    shots = [s for s in manifest["sequences"] if s["split"] in ("val", "test")]
    yield f"\n## {label}: {error.metric}, tiles of {error.tile}\n\n{TABLE}"
    rows, moved = [], []
    for shot in shots:
        name = f"{shot['scene']}/{shot['sequence']}"
        frames = list(frames_of(data / name, loaded))
        each = [tallies(frame, loaded) for frame in frames]
        kinds = {kind for one in each for kind in one}
        found = {kind: together(one.get(kind, {}) for one in each) for kind in kinds}
        seen = "seen in training" if shot["seen_in_training"] else "unseen"
        yield line(name, seen, found)
        rows.append({kind: accuracy(value) for kind, value in found.items()})
        if moving(frames):
            moved += frames
    means = []
    for kind, name in (
        ("network", "r2"), ("network", "mae"), ("network", "under"),
        ("network, seen", "r2"), ("network, seen", "mae"),
        ("network, unseen", "r2"), ("network, unseen", "mae"),
        ("proxy", "r2"), ("proxy", "mae"), ("extrapolated", "r2"), ("extrapolated", "mae"),
    ):  # fmt: skip
        values = [row[kind][name] for row in rows if row.get(kind)]
        means.append(f"{statistics.fmean(values):.3f}" if values else "-")
    yield f"| **mean of {len(rows)}** |  | " + " | ".join(means) + " |"
    if plot is None or not moved or error.metric == VrsMetric.PSNR:
        return
    lines = curves(moved, loaded)
    plot.write_text(
        drawn(lines, across=f"true error ({error.metric}, mean of tiles)", up="saved, %"),
        encoding="utf-8",
    )
    analytic = next(c for c in lines if c.name == Estimator.ANALYTIC)
    yield f"\n![saved against true error]({plot.name})\n"
    yield "| true error | " + " | ".join(f"{c.name} saves" for c in lines) + " |"
    yield "| ---: |" + " ---: |" * len(lines)
    for error_at, _ in analytic.points[:: max(1, len(analytic.points) // 6)]:
        saved = [saved_at(c, error_at) for c in lines]
        cells = ["-" if value is None else f"{value:.1f} %" for value in saved]
        yield f"| {error_at:.4f} | " + " | ".join(cells) + " |"


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--weights", multiple=True, metavar="LABEL=FILE")
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/vrs.md"))
@click.option("--no-curves", is_flag=True)
def main(*, data: Path, weights: tuple[str, ...], output: Path, no_curves: bool) -> None:
    """Print and write."""
    files = dict(item.split("=", 1) for item in weights) or {
        path.stem: str(path) for path in sorted(SHIPPED.glob(f"{SYSTEM}-*.safetensors"))
    }
    parts = [HEAD]
    for label, file in files.items():
        loaded = load_network(load_system(SYSTEM), 1, "cpu", Path(file))
        loaded.network.config = replace(loaded.config, margin=0.0)
        plot = None if no_curves else output.parent / f"vrs-{label}.svg"
        for text in report(label, loaded, data, plot):
            click.echo(text)
            parts.append(text)
    replace_section(output, "vrs", "\n".join(parts))


if __name__ == "__main__":
    main()
