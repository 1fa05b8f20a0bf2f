"""Processor time over wall time of the commands, on 1920 x 1080 frames.

    python benchmarks/cores.py [--before TREE] [--frames 6] [--only NAME ...] [--rounds 1]

Six frames of `rtsr synth`, a pair of 480 x 270 -> 1920 x 1080 and a capture of 1920 x 1080, are
upscaled by every system that has weights or needs none, divided, labelled, rated and judged, each
by a process of its own: wall seconds from its start to its end, and user and system time of the
process. `--before` runs another tree on the same frames, right before this one in each round.
Medians are printed. `others` is what other processes took meanwhile, in cores: over `QUIET`, a
line is marked noisy, and its wall time and ratio say little.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import click

HERE = Path(__file__).resolve().parents[1]
SIZE, SCALE = "1920x1080", 4
QUIET = 0.15
"""Cores that others may take."""

VRS_ESTIMATORS = ("network", "analytic", "hybrid")


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a process took.

    Attributes:
        wall: seconds from its start to its end.
        processor: seconds of all cores, user and system.
        others: cores that other processes took meanwhile.
    """

    wall: float
    processor: float
    others: float


def busy_seconds() -> float:
    """Return processor time of the whole machine."""
    line = Path("/proc/stat").read_text(encoding="utf-8").splitlines()[0].split()[1:]
    ticks = [int(part) for part in line]
    idle = ticks[3] + ticks[4]
    return (sum(ticks[:8]) - idle) / os.sysconf("SC_CLK_TCK")


def environment(tree: Path) -> dict[str, str]:
    """Return the environment in which `-m rtsr_cli` is a tree's."""
    return {**os.environ, "PYTHONPATH": str(tree)}


def run_rtsr(tree: Path, *arguments: object) -> str:
    """Run a command of a tree; return what it prints."""
    command = [sys.executable, "-m", "rtsr_cli", *map(str, arguments)]
    done = subprocess.run(
        command, cwd=tree, env=environment(tree), check=False, capture_output=True, text=True
    )
    if done.returncode:
        raise click.ClickException(f"{command}: {done.stderr}")
    return done.stdout


def measure(tree: Path, arguments: list[str]) -> Cost:
    """Run a command of a tree and measure it."""
    command = [sys.executable, "-m", "rtsr_cli", *arguments]
    busy, started = busy_seconds(), time.perf_counter()
    # Python looks into the working directory before it looks into PYTHONPATH
    process = subprocess.Popen(command, cwd=tree, env=environment(tree), stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - started
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise click.ClickException(f"{arguments}: exit code {process.returncode}")
    processor = usage.ru_utime + usage.ru_stime
    others = max(0.0, busy_seconds() - busy - processor) / wall
    return Cost(wall=wall, processor=processor, others=others)


def make_frames(tree: Path, work: Path, frames: int) -> None:
    """Render what is not there yet: a pair, a capture, and a result to judge."""
    common = ("--size", SIZE, "--frames", f"1-{frames}", "--seed", 7, "-q")
    if not (work / "pair").is_dir():
        run_rtsr(tree, "synth", work / "pair", "--scale", SCALE, *common)
    if not (work / "capture").is_dir():
        run_rtsr(tree, "synth", work / "capture", *common)
    if not (work / "result").is_dir():
        run_rtsr(tree, "upscale", work / "pair", work / "result", "--system", "bicubic", "-q")


def systems(tree: Path) -> list[str]:
    """Name the systems that can upscale the pair with what comes with rtsr."""
    rows = [json.loads(line) for line in run_rtsr(tree, "systems", "--json").splitlines()]
    return [
        row["name"]
        for row in rows
        if row["task"] == "upscale"
        and (not row["parameters"] or f"{SCALE}x" in str(row["weights"]).split(", "))
    ]


def command_lines(tree: Path, work: Path) -> dict[str, list[str]]:
    """Return the command lines that are measured, by name; `OUT` is a fresh folder."""
    pair, capture = str(work / "pair"), str(work / "capture")
    lines = {
        f"upscale {name}": ["upscale", pair, "OUT", "--system", name] for name in systems(tree)
    }
    for estimator in VRS_ESTIMATORS:
        lines[f"predict-vrs {estimator}"] = [
            "predict-vrs", capture, "OUT", "--estimator", estimator,
        ]  # fmt: skip
    lines["label"] = ["label", "--kind", "vrs", capture, "OUT"]
    lines["demodulate"] = ["demodulate", capture, "OUT"]
    lines["evaluate"] = ["evaluate", str(work / "result"), str(work / "pair" / "reference")]
    return {name: [*line, "-q"] for name, line in lines.items()}


def measure_in_folder(tree: Path, line: list[str]) -> Cost:
    """Measure a command that writes to a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        return measure(tree, [f"{folder}/out" if part == "OUT" else part for part in line])


def middle(costs: list[Cost]) -> Cost:
    """Return medians."""
    return Cost(
        wall=statistics.median(c.wall for c in costs),
        processor=statistics.median(c.processor for c in costs),
        others=statistics.median(c.others for c in costs),
    )


def cells(cost: Cost) -> str:
    """Return wall seconds, processor seconds, their ratio, and what others took."""
    noisy = " noisy" if cost.others > QUIET else ""
    return (
        f"{cost.wall:7.1f} s {cost.processor:7.1f} s {cost.processor / cost.wall:6.2f} "
        f"{cost.others:6.2f}{noisy:6}"
    )


@click.command()
@click.option("--tree", type=click.Path(exists=True, path_type=Path), default=HERE)
@click.option("--before", type=click.Path(exists=True, path_type=Path))
@click.option("--frames", default=6, show_default=True)
@click.option("--rounds", default=1, show_default=True)
@click.option("--only", multiple=True, help="Beginnings of names. Repeatable.")
@click.option("--work", type=click.Path(path_type=Path), help="Where rendered frames are kept.")
def main(
    *, tree: Path, before: Path | None, frames: int, rounds: int, only: tuple[str, ...],
    work: Path | None,
) -> None:  # fmt: skip
    """Print a line a command, and one for each tree."""
    trees = {"before": before.resolve()} if before else {}
    trees["now"] = tree.resolve()
    with tempfile.TemporaryDirectory() as folder:
        place = (work or Path(folder)).resolve()
        make_frames(tree.resolve(), place, frames)
        print(f"{SIZE}, {frames} frames, {os.cpu_count()} cores, medians of {rounds}")
        print(f"{'':24}{'':8}   wall      cpu   cpu/wall others")
        for name, line in command_lines(tree.resolve(), place).items():
            if only and not name.startswith(only):
                continue
            costs: dict[str, list[Cost]] = {key: [] for key in trees}
            for _ in range(rounds):
                for key, path in trees.items():
                    costs[key].append(measure_in_folder(path, line))
            for key, measured in costs.items():
                print(f"{name:24}{key:8}{cells(middle(measured))}", flush=True)


if __name__ == "__main__":
    main()
