"""Time of the networks on this processor: as built, and as `upscale` runs them.

    python benchmarks/network_speed.py [--size 480x270] [--scale 4] [--pairs 7] [--threads 2]
        [--system fusesr --system gather ...]

One run is `network(inputs, state)` with the state of the frame before: past features are known,
warps are included, reading and preparation are not. Every round runs all ways back to back;
ratios are of one round, their median is printed. Weights are random, which does not change the
work.
"""

from __future__ import annotations

import os

# as the command sets them
os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

import statistics
import time
from collections.abc import Callable
from typing import Any

import click
import torch
from torch import nn
from torch.profiler import ProfilerActivity, profile

from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.cost import make_uniform_window
from rtsr_cli.core.system import Tensors
from rtsr_cli.models import load_system

Run = Callable[[], Any]

DIRECTIONS = ("normal", "small_normal", "plane")
"""Inputs that hold unit vectors."""

FACTS = ("kind", "facing")
"""Inputs that hold what is so, not how bright it is."""

PLAIN, FAST = "as built, fp32", "accelerated, fp32"


def noisy(inputs: Tensors) -> dict[str, torch.Tensor]:
    """Random pictures of the same shapes; motion of a few pixels; facts of a frame as they are.

    Normals are of unit length: beyond that, weights of surfaces leave what numbers can hold.
    """
    torch.manual_seed(1)

    def draw(name: str, tensor: torch.Tensor) -> torch.Tensor:
        if tensor.shape[2:] == (1, 1):
            return tensor
        if name in DIRECTIONS:
            return torch.nn.functional.normalize(torch.randn_like(tensor), dim=1)
        if name in FACTS:
            return torch.ones_like(tensor)
        return 4.0 * torch.randn_like(tensor) if name.startswith("motion") else tensor.uniform_()

    return {name: draw(name, tensor) for name, tensor in inputs.items()}


def runner(network: nn.Module, inputs: Tensors, *, half: bool) -> Run:
    """Return a run with the state of the frame before."""

    def run(state: Any = None) -> Any:
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=half):
            return network(inputs, state)[1]

    # two frames, so that both past frames are known
    state = run(run())
    return lambda: run(state)


def ways(name: str, scale: int, size: tuple[int, int]) -> dict[str, Run]:
    """Runs by what they are called."""
    system = load_system(name)
    assert system.learning is not None
    torch.manual_seed(0)
    config = system.config()
    built = system.build(config, scale).eval().requires_grad_(False)
    for parameter in built.parameters():
        parameter.copy_(0.05 * torch.randn_like(parameter))
    inputs = noisy(system.learning.prepare(config, make_uniform_window(system, scale, size)))
    fast = accelerate_network(built)
    return {
        PLAIN: runner(built, inputs, half=False),
        FAST: runner(fast, inputs, half=False),
        "accelerated, bf16": runner(fast, inputs, half=True),
    }


def seconds(run: Run) -> float:
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def report(runs: dict[str, Run], pairs: int) -> None:
    """Print medians and ratios."""
    times: dict[str, list[float]] = {kind: [] for kind in runs}
    for _ in range(pairs):
        for kind, run in runs.items():
            times[kind].append(seconds(run))
    for kind, measured in times.items():
        ratios = [a / b for a, b in zip(measured, times[PLAIN], strict=True)]
        print(
            f"  {kind}: {statistics.median(measured):.3f} s, least {min(measured):.3f}; "
            f"{statistics.median(ratios):.2f} of {PLAIN} ({min(ratios):.2f} to {max(ratios):.2f})"
        )


def compare(runs: dict[str, Run], pairs: int) -> None:
    """Print how systems compare with the first, each round back to back."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(pairs):
        for name, run in runs.items():
            times[name].append(seconds(run))
    first, *others = times
    for name in others:
        ratios = [a / b for a, b in zip(times[name], times[first], strict=True)]
        print(
            f"{name}: {statistics.median(ratios):.2f} of {first} ({FAST}, "
            f"{min(ratios):.2f} to {max(ratios):.2f})"
        )


def show_profile(run: Run) -> None:
    """Print where the time goes."""
    with profile(activities=[ProfilerActivity.CPU]) as recorded:
        run()
    print(recorded.key_averages().table(sort_by="self_cpu_time_total", row_limit=14))


@click.command()
@click.option("--system", "names", multiple=True, default=("fusesr", "fusesr-fast", "nsrd"))
@click.option("--size", default="480x270", show_default=True, help="LR width and height.")
@click.option("--scale", default=4, show_default=True)
@click.option("--pairs", default=7, show_default=True, type=click.IntRange(1))
@click.option("--threads", default=os.cpu_count(), show_default=True)
@click.option("--profile", "profiled", is_flag=True, help="Also the operations that take longest.")
def main(
    *, names: tuple[str, ...], size: str, scale: int, pairs: int, threads: int, profiled: bool
) -> None:
    """Print medians and ratios."""
    torch.set_num_threads(threads)
    width, height = (int(side) for side in size.split("x"))
    fast: dict[str, Run] = {}
    for name in names:
        print(f"{name} {width}x{height} -> {width * scale}x{height * scale}, {threads} threads")
        runs = ways(name, scale, (height, width))
        report(runs, pairs)
        fast[name] = runs[FAST]
        for kind, run in runs.items() if profiled else ():
            print(kind)
            show_profile(run)
    compare(fast, pairs)


if __name__ == "__main__":
    main()
