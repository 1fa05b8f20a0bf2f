"""Time of occlusion motion vectors, and of holes, of one frame.

    python benchmarks/occlusion_speed.py [--size 1920x1080] [--runs 7]

Frames are arrays in memory: neither reading nor writing is timed. Printed are the least and the
median wall time, and the median processor time, of `find_occlusion_motion`, of `fill_by_occlusion`,
and of `find_holes`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import click
import torch

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import (
    fill_by_occlusion,
    find_occlusion_motion,
    sample_motion,
)
from rtsr_cli.core.imaging.holes import find_holes


def make_frame(size: tuple[int, int]) -> Frame:
    """Disks that move before a wall that pans."""
    height, width = size
    y = torch.arange(height).view(1, 1, -1, 1).expand(1, 1, height, width) / height
    x = torch.arange(width).view(1, 1, 1, -1).expand(1, 1, height, width) / height
    disk = ((9 * x % 1 - 0.5).square() + (9 * y % 1 - 0.5).square() < 0.1).float()
    depth = 8.0 + torch.sin(6.0 * x) - 3.0 * disk
    motion = torch.cat([-2.3 - 9.1 * disk, 0.7 + 4.4 * disk * torch.cos(5.0 * y)], dim=1)
    normal = torch.nn.functional.normalize(torch.cat([torch.sin(9.0 * x), y, 1.0 + x], dim=1))
    camera = torch.eye(4, dtype=torch.float64)
    projection = torch.zeros(4, 4, dtype=torch.float64)
    projection[0, 0], projection[1, 1] = height / width, 1.0
    projection[2, 2], projection[2, 3], projection[3, 2] = -1.0, -1.0, -0.2
    return Frame(
        number=1,
        gbuffer=GBuffer(
            {
                Buffer.COLOR: normal.abs(),
                Buffer.DEPTH: depth,
                Buffer.MOTION: motion,
                Buffer.NORMAL: normal,
                Buffer.OBJECT_ID: 1 + disk.int(),
            },
            "made",
        ),
        camera=CameraMetadata(world_to_camera=camera, world_to_ndc=projection),
        view=View(display=size),
    )


def show(name: str, runs: int, work: Callable[[], object]) -> None:
    """Time some runs after one that is not."""
    work()
    walls, cpus = [], []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    print(
        f"{name}: least {min(walls):.3f} s, median {statistics.median(walls):.3f} s, "
        f"processor {statistics.median(cpus):.3f} s"
    )


@click.command()
@click.option("--size", default="1920x1080", show_default=True, help="Width and height.")
@click.option("--runs", default=7, show_default=True, type=click.IntRange(1))
def main(size: str, runs: int) -> None:
    """Print times."""
    width, height = (int(side) for side in size.split("x"))
    frame = make_frame((height, width))
    motion = sample_motion(frame, frame)
    print(f"{size}, {torch.get_num_threads()} threads")
    with torch.inference_mode():
        vectors = find_occlusion_motion([frame, frame], motion)
        color = frame.gbuffer[Buffer.COLOR]
        holes = find_holes([frame, frame]).union
        show("vectors", runs, lambda: find_occlusion_motion([frame, frame], motion))
        show("fill", runs, lambda: fill_by_occlusion(color, motion, vectors, holes))
        show("holes", runs, lambda: find_holes([frame, frame]))


if __name__ == "__main__":
    main()
