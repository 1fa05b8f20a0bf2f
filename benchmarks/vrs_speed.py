"""Time of the visual-error network at 1080p: as built, as `predict-vrs` runs it, against FLIP.

    python benchmarks/vrs_speed.py [--size 1920x1080] [--pairs 7] [--threads 2]

One run is `network(inputs)`: padding and all rates included, reading and preparation not. What it
replaces is the metric on every reduced rate, here flip-evaluator on four pairs. Every round runs
all of them back to back; ratios are of one round, their median is printed.
"""

from __future__ import annotations

import os

os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

import statistics
from pathlib import Path

import click
import flip_evaluator
import torch
from network_speed import Run, runner, seconds

from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.load import find_shipped_weights
from rtsr_cli.core.network.weights import fill_network, read_weights
from rtsr_cli.core.settings import SettingsSource, resolve_settings
from rtsr_cli.models import load_system

SYSTEM = "rt-percept"
PLAIN, FAST, HALF, METRIC = "as built, fp32", "predict-vrs, fp32", "predict-vrs, bf16", "FLIP"
RATES = 4


def built() -> torch.nn.Module:
    """The network with its weights, random ones where none come with the package."""
    system = load_system(SYSTEM)
    path = find_shipped_weights(system, 1)
    if path is None:
        torch.manual_seed(0)
        return system.build(system.config(), 1).eval().requires_grad_(False)
    weights = read_weights(Path(path))
    network = system.build(
        resolve_settings(system.config, SettingsSource(str(path), weights.config)), 1
    )
    fill_network(network, weights)
    return network.eval().requires_grad_(False)


def ways(height: int, width: int) -> dict[str, Run]:
    """Runs by what they are called."""
    torch.manual_seed(1)
    network = built()
    inputs = {"seen": torch.rand(1, 4, height, width)}
    pictures = torch.rand(2, height, width, 3).numpy()
    fast = accelerate_network(network)

    def metric() -> None:
        for _ in range(RATES):
            flip_evaluator.evaluate(pictures[0], pictures[1], "LDR", applyMagma=False)

    return {
        PLAIN: runner(network, inputs, half=False),
        FAST: runner(fast, inputs, half=False),
        HALF: runner(fast, inputs, half=True),
        METRIC: metric,
    }


@click.command()
@click.option("--size", default="1920x1080", show_default=True)
@click.option("--pairs", default=7, show_default=True, type=click.IntRange(1))
@click.option("--threads", default=os.cpu_count(), show_default=True)
def main(*, size: str, pairs: int, threads: int) -> None:
    """Print medians and ratios."""
    torch.set_num_threads(threads)
    width, height = (int(side) for side in size.split("x"))
    runs = ways(height, width)
    times: dict[str, list[float]] = {kind: [] for kind in runs}
    for _ in range(pairs):
        for kind, run in runs.items():
            times[kind].append(seconds(run))
    print(f"{SYSTEM} {size}, {threads} threads; FLIP: flip-evaluator on {RATES} pairs")
    for kind, measured in times.items():
        to_plain = statistics.median(a / b for a, b in zip(measured, times[PLAIN], strict=True))
        below = statistics.median(a / b for a, b in zip(times[METRIC], measured, strict=True))
        print(
            f"  {kind}: {statistics.median(measured):.3f} s, least {min(measured):.3f}; "
            f"{to_plain:.2f} of {PLAIN}; FLIP takes {below:.1f} times as long"
        )


if __name__ == "__main__":
    main()
