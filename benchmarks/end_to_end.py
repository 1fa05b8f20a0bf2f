"""`rtsr upscale` with EXR in and out against its network alone, on this processor.

    python benchmarks/end_to_end.py [--system fusesr] [--frames 8] [--rounds 5] [--weights FILE]

A synth pair of 480 x 270 -> 1920 x 1080 (LR radiance and G-buffer, HR G-buffer) is upscaled by the
command, once over `--frames` + 2 and once over 2 frames; their difference is what a frame costs,
start and imports left out. The network's own time is measured as benchmarks/network_speed.py does,
in the same rounds. Without `--weights`, weights are random, which does not change the work.
"""

from __future__ import annotations

import os

os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import torch
from network_speed import seconds, ways
from results import rtsr

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.precision import settled
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.weights import save_weights
from rtsr_cli.models import load_system

SCALE, LR_SIZE = 4, (270, 480)
FIRST = 2
"""Frames of the shorter run: history is there from the third on."""


def random_weights(name: str, folder: Path) -> Path:
    """Write weights of a fresh network."""
    system = load_system(name)
    torch.manual_seed(0)
    network = system.build(system.config(), SCALE)
    path = folder / f"{name}.safetensors"
    save_weights(
        path,
        network.state_dict(),
        system=name,
        scale=SCALE,
        config=to_plain(system.config()),
        about={},
    )
    return path


def upscaled(pair: Path, out: Path, weights: Path, frames: int) -> float:
    """Seconds of one run of the command, as a process of its own."""
    shutil.rmtree(out, ignore_errors=True)
    command = [sys.executable, "-m", "rtsr_cli", "upscale", str(pair), str(out), "-q"]
    started = time.perf_counter()
    subprocess.run([*command, "--weights", str(weights), "--frames", f"1-{frames}"], check=True)
    return time.perf_counter() - started


@click.command()
@click.option("--system", "name", default="fusesr", show_default=True)
@click.option("--frames", default=8, show_default=True)
@click.option("--rounds", default=5, show_default=True)
@click.option("--weights", type=click.Path(path_type=Path))
def main(*, name: str, frames: int, rounds: int, weights: Path | None) -> None:
    """Print seconds a frame of both, and their ratio."""
    precision = settled(Precision.AUTO, torch.device("cpu"))
    run = ways(name, SCALE, LR_SIZE)[f"accelerated, {precision}"]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        size = f"{LR_SIZE[1] * SCALE}x{LR_SIZE[0] * SCALE}"
        rtsr("synth", work / "pair", "--size", size, "--scale", SCALE, "--frames",
             f"1-{frames + FIRST}", "--seed", 7, "-q")  # fmt: skip
        chosen = weights or random_weights(name, work)
        whole, network = [], []
        for _ in range(rounds):
            longer = upscaled(work / "pair", work / "out", chosen, frames + FIRST)
            shorter = upscaled(work / "pair", work / "out", chosen, FIRST)
            whole.append((longer - shorter) / frames)
            network.append(statistics.median(seconds(run) for _ in range(3)))
        ratios = [a / b for a, b in zip(whole, network, strict=True)]
    click.echo(f"{name}, {precision}, {size}: seconds a frame, medians of {rounds} rounds")
    click.echo(f"  rtsr upscale: {statistics.median(whole):.3f}")
    click.echo(f"  network alone: {statistics.median(network):.3f}")
    click.echo(f"  ratio: {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")


if __name__ == "__main__":
    main()
