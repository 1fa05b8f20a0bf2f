"""`rtsr upscale` with EXR in and out against its network alone, on this processor.

    python benchmarks/end_to_end.py [--system fusesr] [--frames 8] [--rounds 5] [--weights FILE]

A synth pair of 480 x 270 -> 1920 x 1080 (LR radiance and G-buffer, HR G-buffer) is upscaled by the
command, once over `--frames` + 2 and once over 2 frames; their difference is what a frame costs,
start and imports left out. Where nothing else is given, weights are those that come with rtsr;
where there are none, random ones, which do not change the work.

The whole command, from the interpreter's start to its end, is held against what cannot be left
out: the network's time (all cores, from the window that the run itself assembled for its last
frame, half precision as the run has it) for as many frames, and OpenEXR's for reading the same
input files and writing the same output files with the same compression, one after the other in
one thread. Start-up, which `--dry-run` takes, is shown, and the ratio without it. The ways
alternate; ratios are of one round, their medians are printed.
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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import OpenEXR
import torch
from network_speed import seconds
from results import rtsr

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.core.network.precision import resolve_precision
from rtsr_cli.core.network.weights import save_weights
from rtsr_cli.core.run import prediction
from rtsr_cli.core.settings import to_plain
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


@dataclass(frozen=True, kw_only=True)
class Work:
    """What is run.

    Attributes:
        name: of the system.
        pair: folder of the frames.
        out: folder of the outputs.
        options: further options of the command.
        frames: of a whole run.
    """

    name: str
    pair: Path
    out: Path
    options: tuple[str, ...]
    frames: int


@dataclass(frozen=True, kw_only=True)
class Round:
    """Seconds of one round.

    Attributes:
        whole: of the command over all frames.
        start: of `--dry-run`.
        frame: of one frame more.
        network: of the network, a frame.
        files: of OpenEXR alone, all frames.
    """

    whole: float
    start: float
    frame: float
    network: float
    files: float


def arguments(work: Work, frames: int, *more: str) -> list[str]:
    """Return the arguments of a run over the first frames."""
    places = (str(work.pair), str(work.out), "--system", work.name)
    return ["upscale", *places, "--frames", f"1-{frames}", "-q", *work.options, *more]


def upscaled(work: Work, frames: int, *more: str) -> float:
    """Seconds of one run of the command, as a process of its own."""
    shutil.rmtree(work.out, ignore_errors=True)
    command = [sys.executable, "-m", "rtsr_cli", *arguments(work, frames, *more)]
    started = time.perf_counter()
    subprocess.run(command, check=True)
    return time.perf_counter() - started


def network_run(work: Work, precision: Precision) -> Callable[[], Any]:
    """Return the prediction of the last frame of a run in this process, to be made again."""
    calls: list[tuple[Any, ...]] = []
    predict = prediction.predict_in_tiles

    def record(*given: Any) -> Any:
        calls.append(given)
        return predict(*given)

    shutil.rmtree(work.out, ignore_errors=True)
    prediction.predict_in_tiles = record
    try:
        rtsr(*arguments(work, FIRST + 1))
    finally:
        prediction.predict_in_tiles = predict
    half = precision is Precision.BF16 and any(True for _ in calls[-1][1].parameters())

    def run() -> Any:
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=half):
            return predict(*calls[-1])

    return run


def copy_files(inputs: list[Path], outputs: list[Path], target: Path) -> float:
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
    started = time.perf_counter()
    for path in inputs:
        assert OpenEXR.File(str(path), separate_channels=True, num_threads=0).channels()
    for path, (header, planes) in zip(outputs, written, strict=True):
        OpenEXR.File(header, planes, num_threads=0).write(str(target / path.name))
    return time.perf_counter() - started


def measure_round(work: Work, run: Callable[[], Any], target: Path) -> Round:
    """Measure everything once."""
    start = upscaled(work, work.frames, "--dry-run")
    shorter = upscaled(work, FIRST)
    whole = upscaled(work, work.frames)
    numbers = [f"frame.{number:04d}.exr" for number in range(1, work.frames + 1)]
    inputs = [work.pair / side / name for side in ("lr", "hr") for name in numbers]
    outputs = [work.out / name for name in numbers]
    return Round(
        whole=whole,
        start=start,
        frame=(whole - shorter) / (work.frames - FIRST),
        network=statistics.median(seconds(run) for _ in range(3)),
        files=copy_files(inputs, outputs, target),
    )


def show(title: str, values: list[float]) -> None:
    """Print a median and the range."""
    middle = statistics.median(values)
    click.echo(f"  {title}: {middle:.3f} ({min(values):.3f} to {max(values):.3f})")


def report(rounds: list[Round], frames: int) -> None:
    """Print seconds and ratios."""
    least = [r.files + r.network * frames for r in rounds]
    show("rtsr upscale, a frame", [r.frame for r in rounds])
    show("network alone, a frame", [r.network for r in rounds])
    show("ratio, a frame", [r.frame / r.network for r in rounds])
    show(f"whole command, {frames} frames", [r.whole for r in rounds])
    show("start-up (--dry-run)", [r.start for r in rounds])
    show("OpenEXR alone, the same files", [r.files for r in rounds])
    show("network + OpenEXR", least)
    show("RATIO whole / (network + OpenEXR)",
         [r.whole / a for r, a in zip(rounds, least, strict=True)])  # fmt: skip
    show("RATIO less start-up",
         [(r.whole - r.start) / a for r, a in zip(rounds, least, strict=True)])  # fmt: skip


def weight_options(name: str, weights: Path | None, folder: Path) -> tuple[str, ...]:
    """Return the option that says which weights, where it is needed."""
    if weights is None and has_weights(load_system(name), SCALE):
        return ()
    return ("--weights", str(weights or random_weights(name, folder)))


@click.command()
@click.option("--system", "name", default="fusesr", show_default=True)
@click.option("--frames", default=8, show_default=True)
@click.option("--rounds", default=5, show_default=True)
@click.option("--weights", type=click.Path(path_type=Path))
def main(*, name: str, frames: int, rounds: int, weights: Path | None) -> None:
    """Print seconds a frame, of the whole, of network and files, and ratios."""
    precision = resolve_precision(Precision.AUTO, torch.device("cpu"))
    torch.set_num_threads(os.cpu_count() or 1)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        size = f"{LR_SIZE[1] * SCALE}x{LR_SIZE[0] * SCALE}"
        rtsr("synth", place / "pair", "--size", size, "--scale", SCALE, "--frames",
             f"1-{frames + FIRST}", "--seed", 7, "-q")  # fmt: skip
        work = Work(
            name=name,
            pair=place / "pair",
            out=place / "out",
            options=weight_options(name, weights, place),
            frames=frames + FIRST,
        )
        run = network_run(work, precision)
        measured = [measure_round(work, run, place / "plain") for _ in range(rounds)]
    click.echo(f"{name}, {precision}, {size}: seconds, medians of {rounds} rounds")
    click.echo(f"  load average of the machine: {os.getloadavg()[0]:.1f}")
    report(measured, frames + FIRST)


if __name__ == "__main__":
    main()
