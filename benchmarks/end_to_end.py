"""A command with EXR in and out against its network alone, on this processor.

    python benchmarks/end_to_end.py [--system fusesr] [--frames 8] [--rounds 5] [--weights FILE]
    python benchmarks/end_to_end.py --system extranet [--size 1280x720]

A synth pair of 480 x 270 -> 1920 x 1080 (LR radiance and G-buffer, HR G-buffer) is upscaled by
`rtsr upscale`; of a system that extrapolates, synth frames of 1280 x 720 are what `rtsr
extrapolate` reads, every second of which it predicts. It runs once over all and once over the first
frames, after which history is there; their difference is what an output costs, start and
imports left out. Where nothing else is given, weights are those that come with rtsr;
where there are none, random ones, which do not change the work.

The whole command, from the interpreter's start to its end, is held against what cannot be left
out: the network's time (all cores, from the window that the run itself assembled for its last
frame, half precision as the run has it; of a system that extrapolates the layers alone) for as
many outputs, and OpenEXR's for reading the same input files and writing the same output files with
the same compression, one after the other in one thread. Start-up, which `--dry-run` takes, is
shown, and the ratio without it. The ways alternate; ratios are of one round, their medians are
printed. The last lines are of processor time, all threads together: on a machine with other work
wall time is chance.
"""

from __future__ import annotations

import os
import resource

os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import OpenEXR
import torch
from results import rtsr

from rtsr_cli.core.choices import Precision, SystemTask
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.core.network.precision import resolve_precision
from rtsr_cli.core.network.weights import save_weights
from rtsr_cli.core.run import prediction
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.system import System
from rtsr_cli.models import load_system

SCALE = 4
EVERY = 2
"""Rendered frames of an extrapolation, as the command's default has it."""

FIRST = 2
"""Frames of an upscaling after which history is there."""

SIZES = {SystemTask.UPSCALE: "1920x1080", SystemTask.EXTRAPOLATE: "1280x720"}
"""Of the outputs."""


def random_weights(name: str, folder: Path) -> Path:
    """Write weights of a fresh network."""
    system = load_system(name)
    torch.manual_seed(0)
    scale = scale_of(system)
    network = system.build(system.config(), scale)
    path = folder / f"{name}.safetensors"
    save_weights(
        path,
        network.state_dict(),
        system=name,
        scale=scale,
        config=to_plain(system.config()),
        about={},
    )
    return path


def scale_of(system: System) -> int:
    """Factor that a system is run with."""
    return SCALE if system.task is SystemTask.UPSCALE else 1


@dataclass(frozen=True, kw_only=True)
class Work:
    """What is run.

    Attributes:
        system: the system.
        pair: folder of the frames.
        out: folder of the outputs.
        options: further options of the command.
        frames: of a whole run.
    """

    system: System
    pair: Path
    out: Path
    options: tuple[str, ...]
    frames: int

    @property
    def command(self) -> str:
        """Name of the command."""
        return str(self.system.task)

    @property
    def every(self) -> int:
        """Frames of the input an output."""
        return EVERY if self.system.task is SystemTask.EXTRAPOLATE else 1

    @property
    def first(self) -> int:
        """Frames of the shorter run: history is there after them."""
        return max(EVERY, self.system.history_frames + 1) if self.every > 1 else FIRST

    def list_inputs(self) -> list[Path]:
        """Files of a whole run."""
        names = [f"frame.{number:04d}.exr" for number in range(1, self.frames + 1)]
        folders = [self.pair] if self.every > 1 else [self.pair / side for side in ("lr", "hr")]
        return [folder / name for folder in folders for name in names]


@dataclass(frozen=True, kw_only=True)
class Spent:
    """Seconds that something took.

    Attributes:
        wall: by the clock.
        processor: of all threads together.
    """

    wall: float
    processor: float


def measure(run: Callable[[], Any]) -> Spent:
    """Seconds of a call, and of the processes that it starts and waits for."""
    wall, processor = time.perf_counter(), count_processor_seconds()
    run()
    return Spent(wall=time.perf_counter() - wall, processor=count_processor_seconds() - processor)


def count_processor_seconds() -> float:
    """Seconds of this process and of those that it waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


@dataclass(frozen=True, kw_only=True)
class Round:
    """What one round took.

    Attributes:
        whole: of the command over all frames.
        start: of `--dry-run`.
        frame: of one output more.
        network: of the network, an output.
        files: of OpenEXR alone, all frames.
    """

    whole: Spent
    start: Spent
    frame: float
    network: Spent
    files: Spent


def arguments(work: Work, frames: int, *more: str) -> list[str]:
    """Return the arguments of a run over the first frames."""
    places = (str(work.pair), str(work.out), "--system", work.system.name)
    return [work.command, *places, "--frames", f"1-{frames}", "-q", *work.options, *more]


def run_command(work: Work, frames: int, *more: str) -> Spent:
    """Seconds of one run of the command, as a process of its own."""
    shutil.rmtree(work.out, ignore_errors=True)
    command = [sys.executable, "-m", "rtsr_cli", *arguments(work, frames, *more)]
    return measure(partial(subprocess.run, command, check=True))


def network_run(work: Work, precision: Precision) -> Callable[[], Any]:
    """Return the network's run on the last frame of a run in this process, to be made again.

    Of a system that extrapolates the layers alone: what is prepared for them is not small.
    """
    calls: list[tuple[Any, ...]] = []
    predict = prediction.predict_in_tiles

    def record(*given: Any) -> Any:
        calls.append(given)
        return predict(*given)

    shutil.rmtree(work.out, ignore_errors=True)
    prediction.predict_in_tiles = record
    try:
        rtsr(*arguments(work, work.first + work.every))
    finally:
        prediction.predict_in_tiles = predict
    system, network, window, state, _ = calls[-1]
    half = precision is Precision.BF16 and any(True for _ in network.parameters())
    again = partial(predict, *calls[-1])
    if work.every > 1 and system.learning is not None:
        with torch.inference_mode():
            again = partial(network, system.learning.prepare(network.config, window), state)

    def run() -> Any:
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=half):
            return again()

    return run


def copy_files(inputs: list[Path], outputs: list[Path], target: Path) -> Spent:
    """Seconds that OpenEXR takes, in this thread, to read files and to write others again."""
    loaded = [OpenEXR.File(str(path), separate_channels=True) for path in outputs]
    target.mkdir(exist_ok=True)
    written = [
        (
            {"compression": part.header["compression"], "type": OpenEXR.scanlineimage},
            {name: channel.pixels for name, channel in part.channels.items()},
        )
        for part in (file.parts[0] for file in loaded)
    ]

    def copy() -> None:
        for path in inputs:
            assert OpenEXR.File(str(path), separate_channels=True, num_threads=0).channels()
        for path, (header, planes) in zip(outputs, written, strict=True):
            OpenEXR.File(header, planes, num_threads=0).write(str(target / path.name))

    return measure(copy)


def measure_round(work: Work, run: Callable[[], Any], target: Path) -> Round:
    """Measure everything once."""
    start = run_command(work, work.frames, "--dry-run")
    shorter = run_command(work, work.first)
    whole = run_command(work, work.frames)
    outputs = sorted(work.out.glob("*.exr"))
    return Round(
        whole=whole,
        start=start,
        frame=(whole.wall - shorter.wall) / ((work.frames - work.first) // work.every),
        network=sorted((measure(run) for _ in range(3)), key=lambda spent: spent.wall)[1],
        files=copy_files(work.list_inputs(), outputs, target),
    )


def show(title: str, values: list[float]) -> None:
    """Print a median and the range."""
    middle = statistics.median(values)
    click.echo(f"    {title}: {middle:.3f} ({min(values):.3f} to {max(values):.3f})")


def report(rounds: list[Round], work: Work) -> None:
    """Print seconds and ratios."""
    frames = work.frames // work.every
    show(f"rtsr {work.command}, an output", [r.frame for r in rounds])
    show("ratio, an output", [r.frame / r.network.wall for r in rounds])
    for kind in fields(Spent):
        click.echo(f"  {kind.name} time")

        def list_seconds(part: str, kind: str = kind.name) -> list[float]:
            return [getattr(getattr(r, part), kind) for r in rounds]

        whole, start = list_seconds("whole"), list_seconds("start")
        network, files = list_seconds("network"), list_seconds("files")
        least = [f + n * frames for f, n in zip(files, network, strict=True)]
        show("network alone, an output", network)
        show(f"whole command, {frames} outputs", whole)
        show("start-up (--dry-run)", start)
        show("OpenEXR alone, the same files", files)
        show("network + OpenEXR", least)
        show("RATIO whole / (network + OpenEXR)",
             [w / a for w, a in zip(whole, least, strict=True)])  # fmt: skip
        show("RATIO less start-up",
             [(w - s) / a for w, s, a in zip(whole, start, least, strict=True)])  # fmt: skip


def weight_options(system: System, weights: Path | None, folder: Path) -> tuple[str, ...]:
    """Return the option that says which weights, where it is needed."""
    if weights is None and has_weights(system, scale_of(system)):
        return ()
    return ("--weights", str(weights or random_weights(system.name, folder)))


@click.command()
@click.option("--system", "name", default="fusesr", show_default=True)
@click.option("--frames", default=8, show_default=True, help="After the first.")
@click.option("--rounds", default=5, show_default=True)
@click.option("--weights", type=click.Path(path_type=Path))
@click.option("--size", help="Of the outputs; by default 1920x1080, of extrapolation 1280x720.")
def main(*, name: str, frames: int, rounds: int, weights: Path | None, size: str | None) -> None:
    """Print seconds an output, of the whole, of network and files, and ratios."""
    precision = resolve_precision(Precision.AUTO, torch.device("cpu"))
    torch.set_num_threads(os.cpu_count() or 1)
    system = load_system(name)
    size = size or SIZES[system.task]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        work = Work(
            system=system,
            pair=place / "pair",
            out=place / "out",
            options=weight_options(system, weights, place),
            frames=0,
        )
        work = replace(work, frames=frames + work.first)
        scaled = ("--scale", SCALE) if system.task is SystemTask.UPSCALE else ()
        rtsr("synth", work.pair, "--size", size, *scaled, "--frames", f"1-{work.frames}",
             "--seed", 7, "-q")  # fmt: skip
        run = network_run(work, precision)
        measured = [measure_round(work, run, place / "plain") for _ in range(rounds)]
    click.echo(f"{name}, {precision}, {size}: seconds, medians of {rounds} rounds")
    click.echo(f"  load average of the machine: {os.getloadavg()[0]:.1f}")
    report(measured, work)


if __name__ == "__main__":
    main()
