"""Time of planning 10,000 frames of a few pixels: what commands do before the first is computed.

    python benchmarks/planning.py [--frames 10000] [--only TEXT] [--profile]

Twelve files lie on disk, all other frames are hard links to them. `pairs` are 8 x 8 frames with
buffers of 32 x 32 beside them and cameras in the headers; `captures` are 32 x 32 frames whose
cameras a side-car tells. Each command is a process of its own, on one core where `taskset` is
there; its times are those of the whole process, Python's start included, with the bytecode cached
as an installed package has it (of two runs the second counts). How much of it is torch's import
alone stands in the first line, and what processor time a command takes beside it in its own. On a
busy machine only the processor's time says something.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import numpy as np

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data"
FILES = 6
SIZES = {"lr": 8, "hr": 32}
CAMERA = ("worldToCamera", "worldToNDC")

PAIRS = ["upscale", "PAIRS", "OUT", "--dry-run", "--system"]
CAPTURES = ["upscale", "CAPTURES", "OUT", "--dry-run", "--simulate-lr", "4", "--system"]
COMMANDS = {
    "upscale bicubic": [*PAIRS, "bicubic"],
    "upscale taau": [*PAIRS, "taau"],
    "upscale fusesr-fast": [*PAIRS, "fusesr-fast"],
    "upscale nsrd": [*PAIRS, "nsrd"],
    "upscale bicubic --frames 1-3": [*PAIRS, "bicubic", "--frames", "1-3"],
    "upscale nsrd --frames 1-3": [*PAIRS, "nsrd", "--frames", "1-3"],
    "upscale --simulate-lr taau": [*CAPTURES, "taau"],
    "upscale --simulate-lr nsrd": [*CAPTURES, "nsrd"],
    "demodulate": ["demodulate", "CAPTURES", "OUT", "--dry-run"],
    "demodulate --frames 1-3": ["demodulate", "CAPTURES", "OUT", "--frames", "1-3", "--dry-run"],
    "label --frames 1-3": [
        "label", "CAPTURES", "OUT", "--kind", "vrs", "--frames", "1-3", "--dry-run",
    ],
    "label": ["label", "CAPTURES", "OUT", "--kind", "vrs", "--dry-run"],
    "predict-vrs": ["predict-vrs", "CAPTURES", "OUT", "--dry-run"],
    "evaluate --frames 1-3": [
        "evaluate", "CAPTURES", "CAPTURES", "--metric", "psnr", "--frames", "1-3",
    ],
    "evaluate --dry-run": ["evaluate", "CAPTURES", "CAPTURES", "--metric", "psnr", "--dry-run"],
    "inspect pairs": ["inspect", "PAIRS"],
    "inspect captures": ["inspect", "CAPTURES"],
    "train": ["train", "nsrd", "CAPTURES", "--out", "OUT", "--dry-run"],
}  # fmt: skip
"""Commands; PAIRS, CAPTURES and OUT stand for the folders."""


def _cropped(path: Path, side: int) -> dict[str, np.ndarray]:
    """First pixels of every channel of a file."""
    planes = read_channels(path, read_header(path).channels)
    return {name: np.ascontiguousarray(plane[:side, :side]) for name, plane in planes.items()}


def _link(folder: Path, count: int) -> None:
    """Make the other frames of a folder: links to the first ones."""
    for number in range(FILES + 1, count + 1):
        source = folder / f"frame.{1 + (number - 1) % FILES:04d}.exr"
        os.link(source, folder / f"frame.{number:04d}.exr")


def make_pairs(folder: Path, count: int) -> None:
    """Write LR frames and HR buffers."""
    for resolution, side in SIZES.items():
        (folder / resolution).mkdir(parents=True)
        for number in range(1, FILES + 1):
            path = Path(resolution) / f"frame.{number:04d}.exr"
            attributes = read_header(SAMPLE / path).attributes
            write_exr(folder / path, _cropped(SAMPLE / path, side), attributes=attributes)
        _link(folder / resolution, count)
    shutil.copy(SAMPLE / "capture.toml", folder)


def make_captures(folder: Path, count: int) -> None:
    """Write frames with radiance and all buffers, and a side-car of their cameras."""
    folder.mkdir()
    rows = ["frame,worldToCamera,worldToNDC"]
    for number in range(1, FILES + 1):
        name = f"frame.{number:04d}.exr"
        planes = _cropped(SAMPLE / "hr" / name, SIZES["hr"])
        planes |= _cropped(SAMPLE / "reference" / name, SIZES["hr"])
        attributes = dict(read_header(SAMPLE / "hr" / name).attributes)
        matrices = [attributes.pop(camera) for camera in CAMERA]
        rows.append(",".join(" ".join(map(str, np.ravel(m))) for m in matrices))
        write_exr(folder / name, planes, attributes=attributes)
    _link(folder, count)
    cameras = [rows[1 + (n - 1) % FILES] for n in range(1, count + 1)]
    numbered = [f"{n},{camera}" for n, camera in enumerate(cameras, 1)]
    (folder / "camera.csv").write_text("\n".join([rows[0], *numbered]), encoding="utf-8")
    (folder / "capture.toml").write_text('layout = "rtsr"\ncamera = "camera.csv"\n')


def seconds_of(python: list[str], scratch: Path) -> tuple[float, float]:
    """Run Python to its end on one core; return its wall time and its processor time."""
    pinned = [] if shutil.which("taskset") is None else ["taskset", "-c", "0"]
    arguments = [*pinned, sys.executable, *python]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    environment["PYTHONPYCACHEPREFIX"] = str(scratch / "bytecode")
    before, start = os.times(), time.perf_counter()
    result = subprocess.run(
        arguments,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    wall, after = time.perf_counter() - start, os.times()
    if result.returncode:
        raise click.ClickException(f"{' '.join(arguments)}: {result.stderr}{result.stdout}")
    children = (after.children_user, after.children_system)
    return wall, sum(children) - before.children_user - before.children_system


def show_seconds(name: str, python: list[str], scratch: Path, least: float = 0.0) -> float:
    """Run twice, print the times of the second run; return its processor time.

    Args:
        name: of the command.
        python: its arguments.
        scratch: folder.
        least: processor time of torch's import.
    """
    seconds_of(python, scratch)
    wall, processor = seconds_of(python, scratch)
    beside = f" (beside torch's import {processor - least:5.2f} s)" if least else ""
    click.echo(f"{name:29s} {wall:7.2f} s, processor {processor:5.2f} s{beside}")
    return processor


@click.command()
@click.option("--frames", "count", default=10_000, show_default=True, type=click.IntRange(FILES))
@click.option("--only", default="", help="Commands whose names contain this.")
@click.option("--profile", is_flag=True, help="Write what cProfile counted, a file a command.")
def main(count: int, only: str, *, profile: bool) -> None:
    """Print the seconds of each command."""
    with tempfile.TemporaryDirectory() as scratch:
        folders = {name: Path(scratch) / name.lower() for name in ("PAIRS", "CAPTURES", "OUT")}
        make_pairs(folders["PAIRS"], count)
        make_captures(folders["CAPTURES"], count)
        torch = ("python -c 'import torch'", ["-c", "import torch"])
        least = show_seconds(*torch, Path(scratch))
        for name, command in COMMANDS.items():
            if only not in name:
                continue
            named = [str(folders.get(argument, argument)) for argument in command]
            file = f"{name.replace(' ', '_')}.prof"
            profiled = ["-m", "cProfile", "-o", file] if profile else []
            show_seconds(name, [*profiled, "-m", "rtsr_cli", *named], Path(scratch), least)


if __name__ == "__main__":
    main()
