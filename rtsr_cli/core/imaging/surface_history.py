"""Past pixels brought to the surfaces of a frame that was never shaded, and what is left open.

    out(p) = sum_q w(q) likeness(p, q) v(q) / sum_q w(q) likeness(p, q)

over the four pixels q around p's old position (w bilinear), and where no weight is left, over
valid pixels of the frame itself that lie around p, ever farther away: rings of 24 pixels at
distances that double, the nearest of which outweighs the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import torch
from torch import Tensor

from rtsr_cli.core.imaging.surfaces import Surfaces, weigh_likeness
from rtsr_cli.core.imaging.warping import bilinear_taps, inside_frame
from rtsr_cli.core.shapes import Image, Mask, MotionPx, Plane, Size
from rtsr_cli.core.threads import share_among_threads

REACHES = (1, 2, 4, 8, 16, 32, 64)
"""Spacing of a ring's pixels."""

RING = 2
"""Pixels to each side of a ring."""

RING_DECAY = 0.02
"""Weight of a ring, as a share of the one before."""

ENOUGH = 0.3
"""Weight in a ring from which farther ones are not looked at."""

UNLIKE = 1e-10
"""Weight of all rings up to which no pixel of a surface is known: others are worse than none."""

CHUNK_PIXELS = 1 << 14
"""Holes that are filled at a time, a thread."""


@dataclass(frozen=True, kw_only=True)
class CarriedImage:
    """What past pixels say of a frame.

    Attributes:
        values: n c h w, anything where `weight` is 0.
        weight: n 1 h w, 0..1: how much of it is of the same surface.
    """

    values: Image
    weight: Plane


def warp_along_surfaces(
    values: Image, motion_px: MotionPx, own: Surfaces, past: Surfaces
) -> CarriedImage:
    """Fetch past values where each pixel was, from its own surface alone.

    Args:
        values: of the past frame, n c h w.
        motion_px: from the current samples to the past ones.
        own: surfaces of the current frame.
        past: of the past frame.
    """
    channels = values.shape[1]
    packed = torch.cat([values, torch.ones_like(values[:, :1]), past.pack()], dim=1)
    packed = packed.contiguous(memory_format=torch.channels_last)
    total = torch.zeros_like(packed[:, : channels + 1])
    for tap, weight in bilinear_taps(packed, motion_px):
        likeness = weigh_likeness(own, tap[:, channels + 1 :]).mul_(weight)
        total.addcmul_(tap[:, : channels + 1], likeness)
    weight = total[:, channels:] * inside_frame(motion_px)
    return CarriedImage(
        values=total[:, :channels] / total[:, channels:].clamp(min=1e-6), weight=weight
    )


@dataclass(frozen=True, kw_only=True)
class _Pixels:
    """Pixels of a frame as rows, in which neighbours are looked up.

    Attributes:
        rows: value, 1 where it is known, and `Surfaces.pack`; the last stands for what lies
            outside.
        planes: `Surfaces.plane` and `tolerance`.
        size: (height, width).
        channels: of the value.
    """

    rows: Tensor
    planes: Tensor
    size: Size
    channels: int

    def surfaces(self, index: Tensor) -> Surfaces:
        """Surfaces of k pixels, as an image of one row."""
        packed = self.rows[index, self.channels + 1 :].T[None, :, None]
        planes = self.planes[index].T[None, :, None]
        return Surfaces(
            facing=packed[:, :4],
            position=packed[:, 4:7],
            plane=planes[:, :3],
            tolerance=planes[:, 3:],
            kind=packed[:, 7:],
        )

    def neighbours(self, index: Tensor, reach: int) -> Iterator[tuple[Tensor, float]]:
        """Index and nearness of each pixel of a ring around some."""
        height, width = self.size
        row, column = index // width, index % width
        steps = range(-RING, RING + 1)
        for down, across in product(steps, steps):
            if down == across == 0:
                continue
            there_row, there_column = row + down * reach, column + across * reach
            inside = (there_row >= 0) & (there_row < height)
            inside &= (there_column >= 0) & (there_column < width)
            there = torch.where(inside, there_row * width + there_column, height * width)
            yield there, math.exp(-(down * down + across * across) / 4.0)


def fill_along_surfaces(values: Image, holes: Mask, own: Surfaces, *, fallback: Image) -> Image:
    """Fill holes from the nearest pixels of their own surface that are none.

    Args:
        values: 1 c h w.
        holes: 1 where they are not known.
        own: surfaces of the frame.
        fallback: 1 c h w, what stands where no pixel of a surface is known.
    """
    filled = torch.where(holes > 0, fallback, values)[0].flatten(1)
    index = holes.flatten().nonzero()[:, 0]
    # a pixel's channels are one row: fetched at once
    source = torch.cat([values * (1.0 - holes), 1.0 - holes, own.pack()], dim=1)
    rows = source[0].flatten(1).T
    pixels = _Pixels(
        rows=torch.cat([rows, torch.zeros_like(rows[:1])]),
        planes=torch.cat([own.plane, own.tolerance], dim=1)[0].flatten(1).T.contiguous(),
        size=(holes.shape[2], holes.shape[3]),
        channels=len(filled),
    )

    def fill_chunk(start: int) -> None:
        chunk = index[start : start + CHUNK_PIXELS]
        found, known = _gather_rings(pixels, chunk)
        filled[:, chunk[found]] = known.T

    share_among_threads(fill_chunk, range(0, len(index), CHUNK_PIXELS))
    return filled.view_as(values[0]).unsqueeze(0)


def _gather_rings(pixels: _Pixels, index: Tensor) -> tuple[Tensor, Tensor]:
    """Of some pixels those that were filled, as places in `index`, and their values, k c."""
    total = pixels.rows.new_zeros(len(index), pixels.channels + 1)
    open_places = torch.arange(len(index), device=index.device)
    share = 1.0
    for reach in REACHES:
        ring = _sum_ring(pixels, index[open_places], reach)
        total[open_places] += share * ring
        open_places = open_places[ring[:, -1] < ENOUGH]
        if not len(open_places):
            break
        share *= RING_DECAY
    found = (total[:, -1] > UNLIKE).nonzero()[:, 0]
    known = total[found]
    return found, known[:, :-1] / known[:, -1:]


def _sum_ring(pixels: _Pixels, index: Tensor, reach: int) -> Tensor:
    """Weighted sums of the known pixels around some, and of their weights: k c+1."""
    own = pixels.surfaces(index)
    values = pixels.channels + 1
    total = pixels.rows.new_zeros(len(index), values)
    for there, nearness in pixels.neighbours(index, reach):
        row = pixels.rows.index_select(0, there)
        likeness = weigh_likeness(own, row[:, values:].T[None, :, None])[0, 0, 0]
        total.addcmul_(row[:, :values], likeness.mul_(nearness).unsqueeze(1))
    return total
