"""Many shots through an OpenJD template on one machine, killed on the way and run again.

    python benchmarks/farm.py [--shots 200] [--system bicubic] [--tasks 4]

`rtsr synth` makes the shots, `rtsr farm emit` a template that upscales and judges them. A first
`openjd run` is killed with all that it started when a third of the frames are there; the second
has to end it. Outputs and the merged report are then held to one run without a farm.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import numpy as np

import rtsr_cli
from rtsr_cli.core.files.atomic_write import TEMPORARY_SUFFIX
from rtsr_cli.core.files.exr import read_channels

FACTOR = 2
"""Of the enlargement."""

POLL_S = 0.05


def rtsr(*words: object) -> None:
    subprocess.run(
        [sys.executable, "-m", "rtsr_cli", *map(str, words)],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def write_program(path: Path) -> None:
    """Write `rtsr` of this tree as one command."""
    package = Path(rtsr_cli.__file__).parents[1]
    run = f"exec {shlex.quote(sys.executable)} -m rtsr_cli"
    path.write_text(f'#!/bin/sh\nPYTHONPATH={shlex.quote(str(package))} {run} "$@"\n')
    path.chmod(0o755)


def start_job(job: Path, paths: dict[str, Path]) -> subprocess.Popen[bytes]:
    openjd = Path(sys.executable).with_name("openjd")
    given = (word for name, path in paths.items() for word in ("-p", f"{name}={path}"))
    return subprocess.Popen(
        [str(openjd), "run", str(job), *given],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def list_processes_below(parent: int) -> list[int]:
    """Processes that one started, and those that these did (Linux)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == parent:
            child = int(stat.parent.name)
            found += [child, *list_processes_below(child)]
    return found


def kill_all(process: subprocess.Popen[bytes]) -> int:
    """Kill a process and those below it, none of which can clean up; return how many."""
    below = list_processes_below(process.pid)
    process.kill()
    for number in below:
        os.kill(number, signal.SIGKILL)
    process.wait()
    return 1 + len(below)


def list_frames(folder: Path) -> dict[str, Path]:
    return {path.relative_to(folder).as_posix(): path for path in folder.rglob("*.exr")}


def run_until(job: Path, paths: dict[str, Path], count: int) -> None:
    """Run the job, and kill it when so many frames are there."""
    process = start_job(job, paths)
    while len(list_frames(paths["Out"])) < count:
        if process.poll() is not None:
            raise click.ClickException("the job ended before it could be killed")
        time.sleep(POLL_S)
    killed = kill_all(process)
    left = len(list(paths["Out"].rglob(f".*{TEMPORARY_SUFFIX}")))
    done = len(list_frames(paths["Out"]))
    print(f"killed {killed} processes with {done} frames done, {left} half written beside them")


def compare_frames(found: dict[str, Path], expected: dict[str, Path]) -> None:
    """Print what differs."""
    same = sum(
        found[name].read_bytes() == path.read_bytes()
        for name, path in expected.items()
        if name in found
    )
    print(f"frames: {len(found)} of {len(expected)}, {same} equal to one run's, byte by byte")
    worst = math.inf
    for name, path in expected.items():
        pairs = [read_channels(file, "RGB") for file in (found[name], path)]
        shown = [np.stack([p[c].astype(np.float64) for c in "RGB"]) for p in pairs]
        error = float(np.mean((shown[0] / (1 + shown[0]) - shown[1] / (1 + shown[1])) ** 2))
        worst = min(worst, math.inf if error == 0 else -10 * math.log10(error))
    print(f"least PSNR of a frame to one run's: {worst:.1f} dB")


@click.command()
@click.option("--shots", default=200, show_default=True)
@click.option("--frames", default=2, show_default=True)
@click.option("--size", default="64x48", show_default=True)
@click.option("--capture", "given", type=click.Path(path_type=Path), help="Shots that are there.")
@click.option("--system", default="bicubic", show_default=True)
@click.option("--tasks", default=2, show_default=True)
def main(
    *, shots: int, frames: int, size: str, given: Path | None, system: str, tasks: int
) -> None:
    """Print what became of the job."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        capture, out, report = folder / "in", folder / "out", folder / "report.json"
        job = folder / "job.json"
        if given is not None:
            shutil.copytree(given, capture)
        else:
            rtsr("synth", capture, "--shots", shots, "--frames", f"1-{frames}", "--size", size)
        upscale = ("--simulate-lr", FACTOR, "--system", system)
        rtsr("farm", "emit", "--engine", "openjd", "--tasks", tasks, "--output", job, "--",
             "upscale", capture, out, *upscale, "--",
             "evaluate", out, capture, "--output", report)  # fmt: skip
        write_program(folder / "rtsr")
        paths = {"In": capture, "Out": out, "Output": report, "Rtsr": folder / "rtsr"}
        run_until(job, paths, len(list_frames(capture)) // 3)
        kept = {name: path.stat().st_mtime_ns for name, path in list_frames(out).items()}
        start = time.perf_counter()
        code = start_job(job, paths).wait()
        seconds = time.perf_counter() - start
        again = sum(list_frames(out)[name].stat().st_mtime_ns == at for name, at in kept.items())
        print(f"run again: exit {code}, {seconds:.0f} s, {again} of {len(kept)} done frames kept")
        rtsr("upscale", capture, folder / "whole", *upscale)
        compare_frames(list_frames(out), list_frames(folder / "whole"))
        rtsr("evaluate", out, capture, "--output", folder / "whole.json")
        merged, whole = (json.loads(p.read_text()) for p in (report, folder / "whole.json"))
        print(
            f"merged report of {len(merged['tests'])} shots equal to one run's: {merged == whole}"
        )


if __name__ == "__main__":
    main()
