"""Labels of `rtsr label --kind cgts` against what object ids say, on captures with exact buffers.

    rtsr synth shot --samples 2 --size 192x112 --frames 1-4 --seed 3
    python benchmarks/classes.py shot --samples 2

Visibility: the frame before shows, in any sample of the pixel at the end of the vector, another
object that is nearer by 1 % and moves otherwise by more than a pixel. Geometry: samples of it show
several objects; for precision also several faces, whose normals are 5 degrees apart, of one.
Precision is the share of what is labelled that is so, recall that of what is so that is labelled;
beside them, what lies within a pixel of the other counts, too. For shadows see
`benchmarks/shading_changes.py`.
"""

from __future__ import annotations

import argparse
import math
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.pixel_classes import classify_pixels
from rtsr_cli.core.imaging.sample_ranges import pick_nearest, reverse_depth, split_samples
from rtsr_cli.core.imaging.warping import fetch_nearest, inside_frame
from rtsr_cli.core.label.class_labels import CLASS_BUFFERS, OPTIONAL
from rtsr_cli.core.pairs.opening import ReadOptions
from rtsr_cli.core.pairs.sampled_frames import open_sampled_frames
from rtsr_cli.core.pairs.sources import PairInputs

CHORD = 2.0 - 2.0 * math.cos(math.radians(5.0))
"""Squared distance of unit normals that are 5 degrees apart."""


def show_another(now: Frame, before: Frame, k: int) -> Tensor:
    """True where the frame before shows another, nearer object that moves otherwise."""
    depth = now.gbuffer[Buffer.DEPTH]
    own_id = pick_nearest(now.gbuffer[Buffer.OBJECT_ID], depth, k)
    motion = pick_nearest(now.gbuffer[Buffer.MOTION], depth, k) / k
    own = pick_nearest(reverse_depth(depth), depth, k)
    held = {b: split_samples(before.gbuffer[b], k) for b in (Buffer.OBJECT_ID, Buffer.MOTION)}
    nearness = split_samples(reverse_depth(before.gbuffer[Buffer.DEPTH]), k)
    marked = torch.zeros_like(own, dtype=torch.bool)
    for i in range(k * k):
        there = fetch_nearest(nearness[:, :, i], motion)
        moved = fetch_nearest(held[Buffer.MOTION][:, :, i] / k, motion) - motion
        other = fetch_nearest(held[Buffer.OBJECT_ID][:, :, i], motion) != own_id
        apart = moved.square().sum(1, keepdim=True) > 1.0
        marked |= other & apart & (there - own > 0.01 * there)
    return marked & (inside_frame(motion) > 0)


def show_several(now: Frame, k: int) -> tuple[Tensor, Tensor]:
    """True where samples show several objects; and where these or several faces."""
    ids = split_samples(now.gbuffer[Buffer.OBJECT_ID], k)
    normals = split_samples(now.gbuffer[Buffer.GEONORMAL], k)
    chord = (normals - normals[:, :, :1]).square().sum(1).amax(1, keepdim=True)
    several = ids.amax(2) != ids.amin(2)
    return several, several | (chord > CHORD)


def count(found: Tensor, so: Tensor, possible: Tensor) -> Tensor:
    """Found, of these possible; so, of these found; then the second and fourth within a pixel.

    Args:
        found: what is labelled.
        so: what must be.
        possible: what may be.
    """
    near_possible, near_found = (
        functional.max_pool2d(m.float(), 3, stride=1, padding=1) > 0 for m in (possible, found)
    )
    parts = (found, found & possible, so, so & found, found & near_possible, so & near_found)
    return torch.tensor([float(part.sum()) for part in parts])


def main() -> None:
    """Print precision and recall of every shot."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("captures", type=Path, nargs="+")
    parser.add_argument("--samples", type=int, default=2)
    arguments = parser.parse_args()
    k, inputs = arguments.samples, PairInputs(lr=CLASS_BUFFERS, lr_optional=OPTIONAL)
    print("shot, class: pixels so; precision, recall (strict); within a pixel")
    for folder in arguments.captures:
        totals = {"visibility": torch.zeros(6), "geometry": torch.zeros(6)}
        for name, source in open_sampled_frames(folder, ReadOptions(), CLASS_BUFFERS, k):
            frames = [source.load(n, inputs).lr for n in source.reader.numbers]
            for before, now in pairwise(frames):
                classes = classify_pixels([now, before], k)
                hidden = (classes.visibility > 0) & (classes.outside == 0)
                totals["visibility"] += count(hidden, *[show_another(now, before, k)] * 2)
                totals["geometry"] += count(classes.geometry > 0, *show_several(now, k))
            for kind, total in totals.items():
                found, hits, true, met, near_hits, near_met = total.tolist()
                shown = [hits / found, met / true, near_hits / found, near_met / true]
                strict, near = (
                    " ".join(f"{v:.3f}" for v in part) for part in (shown[:2], shown[2:])
                )
                print(f"{folder.name}/{name}, {kind}: {true:.0f}; {strict}; {near}")


if __name__ == "__main__":
    main()
