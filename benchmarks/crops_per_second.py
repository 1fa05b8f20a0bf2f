"""Training samples a second from a pack, and what share of a training step they cost.

    python benchmarks/crops_per_second.py DATA [--system fusesr-fast] [--threads 2] [--rounds 7]

Packs crops of DATA by `rtsr train --pack`, then makes samples as a run does: cut, turned, relit,
some with swapped materials or filtered, decimated, divided, aligned. Prints samples (64 LR pixels,
4x) a second of each round's `--count`, and their median.
"""

from __future__ import annotations

import os

os.environ.setdefault("GOMP_SPINCOUNT", "0")

import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
import torch

from rtsr_cli.core.memory import keep_freed
from rtsr_cli.core.training.clips import read_clips
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.sampler import SampleDrawer
from rtsr_cli.core.training.samples import SampleTask
from rtsr_cli.models import load_system

SCALE = 4


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True))
@click.option("--system", "name", default="fusesr-fast", show_default=True)
@click.option("--threads", default=2, show_default=True)
@click.option("--rounds", default=7, show_default=True)
@click.option("--count", default=200, show_default=True, help="Samples a round.")
@click.option("--packed", default=200, show_default=True, help="Crops in the pack.")
def main(*, data: Path, name: str, threads: int, rounds: int, count: int, packed: int) -> None:
    """Print samples a second."""
    from results import rtsr

    keep_freed()
    system = load_system(name)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "crops.rtsr-clips"
        rtsr(
            "train", name, data, "--pack", file, "--pack-crops", packed, "--scale", SCALE, "-q",
            "--cache", Path(folder) / "cache",
        )  # fmt: skip
        size = file.stat().st_size
        clips, _ = read_clips(file)
        task = SampleTask(system=system, config=system.config(), scale=SCALE)
        sampler = SampleDrawer(clips, task, TrainingConfig(scale=SCALE))
        rates = []
        torch.set_num_threads(1)
        with ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,)) as pool:
            list(pool.map(sampler.make, range(2 * threads)))
            for number in range(rounds):
                start = time.perf_counter()
                list(pool.map(sampler.make, range(number * count, (number + 1) * count)))
                rates.append(count / (time.perf_counter() - start))
    click.echo(f"{name}: {packed} crops packed in {size / 2**20:.1f} MiB")
    click.echo(f"samples a second with {threads} threads: {statistics.median(rates):.0f}")
    click.echo(f"rounds: {', '.join(f'{rate:.0f}' for rate in rates)}")


if __name__ == "__main__":
    main()
