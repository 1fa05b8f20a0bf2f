"""Time of `demod-guided` against another checkout's, and how far their lighting is apart.

    python benchmarks/guided_speed.py --against TREE [--size 480x270] [--scale 4] [--holes]

One run is `predict` of an assembled window: neither reading nor writing. Both checkouts compute in
processes of their own, in turn, so that another load on the machine falls on both; ratios are of
one pair, their median is printed, by wall time and by processor time. Lighting is compared as
log(1 + lighting / k).
"""

from __future__ import annotations

import os

# as the command sets them
os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
import torch
from torch import Tensor

from rtsr_cli.core import system as declarations
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.models import load_system

SYSTEM = "demod-guided"
HERE = Path(__file__).resolve()


def scene(size: tuple[int, int], holes: bool) -> dict[Buffer, Tensor]:
    """Waves of three depths and their normals, bumps on them, and a sky above.

    Of holes, the radiance is enlarged in place of lighting that they do not have.
    """
    height, width = size
    # points of the picture, so that both resolutions see one scene
    y = ((torch.arange(height) + 0.5) / height).view(1, 1, -1, 1).expand(1, 1, height, width)
    x = ((torch.arange(width) + 0.5) / width).view(1, 1, 1, -1).expand(1, 1, height, width)
    nearer = (torch.sin(17.0 * x + 5.0 * y) > 0.3).float() + (torch.cos(23.0 * y - 9.0 * x) > 0.6)
    sky = (y < 0.12 + 0.06 * torch.sin(11.0 * x)).float()
    depth = 9.0 - 2.5 * nearer + torch.sin(5.0 * x) + torch.cos(7.0 * y)
    bumps = 0.2 * torch.cat([torch.sin(211.0 * x), torch.cos(173.0 * y), 0.0 * x], dim=1)
    facing = torch.cat([torch.sin(9.0 * x + 3.0 * nearer), torch.cos(8.0 * y), 1.0 + 0.0 * x], 1)
    normal = torch.nn.functional.normalize(facing + bumps, dim=1) * (1.0 - sky)
    lit = 1.5 + torch.cat([torch.sin((20.0 + k) * x) * torch.cos(14.0 * y) for k in range(3)], 1)
    hole = ((torch.sin(91.0 * x) * torch.sin(83.0 * y)) > 0.95).float() * holes
    known = {
        Buffer.DEPTH: torch.where(sky > 0, SKY_DEPTH_M, depth),
        Buffer.NORMAL: normal,
        Buffer.SKY: sky,
        Buffer.LIGHTING: lit * (1.0 + 2.0 * nearer),
        Buffer.LIGHTING_MASK: (1.0 - sky) * (1.0 - hole),
    }
    other = {b: lit[:, : spec.channels] / 4.0 for b, spec in BUFFER_SPECS.items()}
    return {**other, **known}


def window(size: tuple[int, int], scale: int, jitter_px: float, holes: bool) -> Any:
    """What the system sees of the scene."""
    system = load_system(SYSTEM)
    large = (size[0] * scale, size[1] * scale)

    def frame(buffers: Iterable[Buffer], size: tuple[int, int]) -> Frame:
        planes = scene(size, holes)
        return Frame(
            number=1,
            gbuffer=GBuffer({b: planes[b].contiguous() for b in buffers}, "scene"),
            camera=CameraMetadata(jitter_px=(jitter_px, jitter_px)),
            view=View(display=size),
        )

    hr = frame((*system.hr_inputs, *system.hr_optional), large)
    # earlier revisions call it Window
    kind = getattr(declarations, "FrameWindow", None) or declarations.Window
    return kind(lr=(frame(system.lr_inputs, size),), hr=hr, scale=scale)


def work(size: tuple[int, int], scale: int, jitter_px: float, holes: bool, out: Path) -> None:
    """Write log lighting once; then time a run for every line that comes in."""
    system, seen = load_system(SYSTEM), window(size, scale, jitter_px, holes)
    network = system.build(system.config(), scale)
    with torch.inference_mode():
        lighting = system.predict(network, seen, None).debug["lighting"]
        torch.save(torch.log1p(lighting / seen.current.lighting_scale), out)
        print("ready", flush=True)
        for _ in sys.stdin:
            wall, cpu = time.perf_counter(), time.process_time()
            system.predict(network, seen, None)
            answer = (time.perf_counter() - wall, time.process_time() - cpu)
            print(json.dumps(answer), flush=True)


class Worker:
    """A process that computes with the code of one checkout."""

    def __init__(self, tree: Path, arguments: Iterable[str], out: Path) -> None:
        """Start it, and wait until it has computed once."""
        self.process = subprocess.Popen(
            [sys.executable, str(HERE), *arguments, "--worker", str(out)],
            env={**os.environ, "PYTHONPATH": str(tree)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.out = out
        self.answer()

    def answer(self) -> str:
        """Read the next line."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("a worker ended: see its message above")
        return str(line)

    def seconds(self) -> tuple[float, float]:
        """Wall time and processor time of one run."""
        assert self.process.stdin is not None
        self.process.stdin.write("run\n")
        self.process.stdin.flush()
        wall, cpu = json.loads(self.answer())
        return wall, cpu

    def end(self) -> None:
        """Let it end."""
        self.process.communicate()


def compare(trees: tuple[Path, Path], arguments: tuple[str, ...], pairs: int) -> None:
    """Print medians, ratios and the largest difference."""
    with tempfile.TemporaryDirectory() as folder:
        names = ("before", "now")
        workers = [
            Worker(tree, arguments, Path(folder) / name)
            for name, tree in zip(names, trees, strict=True)
        ]
        times = [[worker.seconds() for worker in workers] for _ in range(pairs)]
        before, now = (torch.load(worker.out, weights_only=True) for worker in workers)
        for worker in workers:
            worker.end()
    for clock, kind in enumerate(("wall time", "processor time")):
        medians = [statistics.median(pair[side][clock] for pair in times) for side in (0, 1)]
        ratios = sorted(pair[1][clock] / pair[0][clock] for pair in times)
        print(
            f"{kind}: before {medians[0]:.3f} s, now {medians[1]:.3f} s; ratio "
            f"{statistics.median(ratios):.3f} ({ratios[0]:.3f} to {ratios[-1]:.3f})"
        )
    print(f"largest difference in log lighting: {float((now - before).abs().max()):.1e}")


@click.command()
@click.option("--against", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--size", default="480x270", show_default=True, help="LR width and height.")
@click.option("--scale", default=4, show_default=True)
@click.option(
    "--jitter",
    "jitter_px",
    default=0.125,
    show_default=True,
    help="0.125: decimation.",
)
@click.option("--holes", is_flag=True, help="Some LR samples are not divided.")
@click.option("--pairs", default=9, show_default=True, type=click.IntRange(1))
@click.option("--worker", type=click.Path(path_type=Path), hidden=True)
def main(
    *, against: Path | None, size: str, scale: int, jitter_px: float, pairs: int, **other: Any
) -> None:
    """Print medians, ratios and the largest difference."""
    width, height = (int(side) for side in size.split("x"))
    worker: Path | None = other["worker"]
    if worker is not None:
        work((height, width), scale, jitter_px, other["holes"], worker)
        return
    if against is None:
        raise click.UsageError("name another checkout: --against TREE")
    print(f"{SYSTEM} {size}, {scale}x, {torch.get_num_threads()} threads")
    arguments = (f"--size={size}", f"--scale={scale}", f"--jitter={jitter_px}")
    arguments += ("--holes",) if other["holes"] else ()
    compare((against.resolve(), HERE.parents[1]), arguments, pairs)


if __name__ == "__main__":
    main()
