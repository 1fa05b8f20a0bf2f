"""Time and memory of `rtsr synth`.

    python benchmarks/synth.py

1920 x 1080: seconds a frame (median of five, each kind of place once) to render, and to render and
write while the next one is rendered. 3840 x 2160: seconds, and the largest memory of a process
of its own that writes two frames.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
from click.testing import CliRunner

from rtsr_cli.cli import group
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.render import render_frame

FULL_HD = (1080, 1920)
SEEDS = range(5)
MEMORY_RUN = """
import resource, sys
from click.testing import CliRunner
from rtsr_cli.cli import group
result = CliRunner().invoke(group, ["synth", sys.argv[1], "--size", "3840x2160", "--frames", "1-2"])
assert result.exit_code == 0, result.output
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def rendered(seed: int) -> float:
    """Seconds to render one frame."""
    scene = draw_scene(seed)
    started = time.perf_counter()
    render_frame(scene, 1, FULL_HD)
    return time.perf_counter() - started


def written(seed: int, frames: int) -> float:
    """Seconds a frame of a whole run of `rtsr synth`."""
    with tempfile.TemporaryDirectory() as scratch:
        arguments = ["synth", scratch, "--size", "1920x1080", "--seed", str(seed)]
        started = time.perf_counter()
        result = CliRunner().invoke(group, [*arguments, "--frames", f"1-{frames}"])
        if result.exit_code:
            raise click.ClickException(result.output)
        return (time.perf_counter() - started) / frames


def at_4k() -> tuple[float, float]:
    """Seconds a frame and largest memory (GiB) of a process that writes two 4K frames."""
    with tempfile.TemporaryDirectory() as scratch:
        started = time.perf_counter()
        result = subprocess.run(
            [sys.executable, "-c", MEMORY_RUN, str(Path(scratch) / "out")],
            capture_output=True,
            text=True,
            check=True,
        )
        seconds = (time.perf_counter() - started) / 2
    return seconds, int(result.stdout.split()[-1]) / 2**20


@click.command()
@click.option("--frames", default=5, show_default=True, help="Frames of a run that is written.")
def main(frames: int) -> None:
    """Print a line a seed, the medians, and the line of 4K."""
    load = os.getloadavg()[0]
    before = resource.getrusage(resource.RUSAGE_SELF)
    times = {}
    for seed in SEEDS:
        times[seed] = rendered(seed), written(seed, frames)
        place = draw_scene(seed).arrangement
        render, write = times[seed]
        print(f"seed {seed} ({place}): {render:.2f} s rendered, {write:.2f} s with writing",
              flush=True)  # fmt: skip
    render, write = (statistics.median(column) for column in zip(*times.values(), strict=True))
    after = resource.getrusage(resource.RUSAGE_SELF)
    busy = (after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime) / (
        len(SEEDS) * (frames + 1)
    )
    print(f"1920 x 1080, median of {len(SEEDS)}: {render:.2f} s rendered, {write:.2f} s with "
          f"writing; {busy:.2f} s of processor time a frame, scenes made included; "
          f"{os.cpu_count()} cores, load before {load:.1f}")  # fmt: skip
    seconds, memory = at_4k()
    print(f"3840 x 2160: {seconds:.2f} s a frame with writing, {memory:.2f} GiB at most")


if __name__ == "__main__":
    main()
