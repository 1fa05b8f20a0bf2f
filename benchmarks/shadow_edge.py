"""Where the edges of moving shadows and highlights are in predicted frames.

    python benchmarks/shadow_edge.py [--system warp-guided ...] [--seeds 4] [--size 480x288]

Scenes of `rtsr synth` whose camera stands still, so that what changes on still surfaces is light
alone. Between the last rendered frame and a predicted one an edge of light sweeps a strip: the
pixels whose log radiance changes by more than `CHANGE`. In it a predicted pixel is on the truth's
side of the edge or still on that of the last frame, whichever radiance it is nearer to, and

    distance to the truth's edge  = area of those on the last frame's side / length of the strip
    distance to the last edge     = area of those on the truth's side     / length of the strip

pixels; the sum of both is what the edge moved. Length is that of half the strip's outline. A system
that moves nothing on its surface has its edges where the last frame had them.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import torch
import torch.nn.functional as F
from results import rtsr
from torch import Tensor

from rtsr_cli.core.files.exr import read_channels
from rtsr_cli.core.imaging.color import luminance

CHANGE = 0.3
"""Of log radiance: a third brighter or darker."""

STILL_PX = 0.02
RIM_PX = 2
"""Still surfaces, so far from anything else."""

DARK = 1e-3
"""Radiance below which nothing is seen."""

LEAST_STRIP_PX = 50
"""Smaller strips are left out."""

CROSSINGS = math.pi / 8
"""Length of half an outline in sides of pixels that it crosses, the mean over all directions."""


@dataclass(frozen=True)
class Edges:
    """Sums over the strips of some frames, pixels.

    `swept` is the area of the strips, `reached` what of it is on the truth's side.
    """

    swept: float = 0.0
    reached: float = 0.0
    length: float = 0.0

    def __add__(self, other: Edges) -> Edges:
        """Sum of both."""
        return Edges(
            self.swept + other.swept, self.reached + other.reached, self.length + other.length
        )

    @property
    def moved_px(self) -> float:
        """From the last frame's edge to the truth's."""
        return self.swept / self.length if self.length else math.nan

    @property
    def behind_px(self) -> float:
        """From the predicted edge to the truth's."""
        return (self.swept - self.reached) / self.length if self.length else math.nan

    @property
    def ahead_px(self) -> float:
        """From the last frame's edge to the predicted one."""
        return self.reached / self.length if self.length else math.nan


def measure_edges(predicted: Tensor, truth: Tensor, last: Tensor, still: Tensor) -> Edges:
    """Tell on which side of the edge the pixels of the swept strips are.

    Args:
        predicted, truth, last: radiance.
        still: where surfaces and camera stand still, 1 x 1 x h x w.
    """
    now, before, made = (torch.log(luminance(c) + DARK) for c in (truth, last, predicted))
    strip = still & ((now - before).abs() > CHANGE)
    if int(strip.sum()) < LEAST_STRIP_PX:
        return Edges()
    reached = strip & ((made - now).abs() < (made - before).abs())
    crossings = sum(int((strip.diff(dim=dim) != 0).sum()) for dim in (2, 3))
    return Edges(float(strip.sum()), float(reached.sum()), CROSSINGS * crossings)


def load(path: Path, names: str | tuple[str, ...] = "RGB") -> Tensor:
    """Planes of a file, 1 c h w."""
    planes = read_channels(path, set(names))
    return torch.stack([torch.from_numpy(planes[n].astype("float32")) for n in names])[None]


def find_still(path: Path) -> Tensor:
    """Pixels of surfaces that do not move, some way from those that do and from the sky."""
    motion, depth = load(path, ("motion.X", "motion.Y")), load(path, ("depth.Z",))
    moving = (motion.abs().amax(1, keepdim=True) > STILL_PX) | (depth >= depth.max() * 0.99)
    return F.max_pool2d(moving.float(), 2 * RIM_PX + 1, stride=1, padding=RIM_PX) == 0


def list_edges(truth: Path, made: Path) -> Iterator[Edges]:
    """Edges of every predicted frame of a shot."""
    for path in sorted(made.glob("*.exr")):
        number = int(path.stem.rpartition(".")[2])
        now, before = (
            truth / f"{path.stem.rpartition('.')[0]}.{n:04d}.exr" for n in (number, number - 1)
        )
        still = find_still(now) & find_still(before)
        yield measure_edges(load(path), load(now), load(before), still)


@click.command()
@click.option("--system", "systems", multiple=True, default=("warp", "warp-guided"))
@click.option("--seeds", default=4, show_default=True, help="Scenes.")
@click.option("--first-seed", default=7001, show_default=True)
@click.option("--frames", default="1-8", show_default=True)
@click.option("--size", default="480x288", show_default=True)
def main(*, systems: tuple[str, ...], seeds: int, first_seed: int, frames: str, size: str) -> None:
    """Print a table of scenes by systems."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        rtsr(
            "synth", work / "truth", "--seed", first_seed, "--shots", seeds, "--frames", frames,
            "--size", size, "--static-camera", "-q",
        )  # fmt: skip
        shots = sorted(p.name for p in (work / "truth").iterdir() if p.is_dir())
        print("| scene | | the edge moves | predicted to true edge | last to predicted edge |")
        print("|---|---|---:|---:|---:|")
        for system in systems:
            rtsr("extrapolate", work / "truth", work / system, "--system", system, "-q")
            every = Edges()
            for shot in shots:
                of_shot = sum(list_edges(work / "truth" / shot, work / system / shot), Edges())
                every += of_shot
                print_row(shot, system, of_shot)
            print_row("all", system, every)


def print_row(scene: str, system: str, edges: Edges) -> None:
    """One row, pixels."""
    distances = (edges.moved_px, edges.behind_px, edges.ahead_px)
    cells = ("-" if math.isnan(v) else f"{v:.2f}" for v in distances)
    print(f"| {scene} | `{system}` |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
