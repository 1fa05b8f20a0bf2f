"""Past pixels brought to the surfaces of a frame that was never shaded, and what is left open.

    out(p) = sum_q w(q) likeness(p, q) v(q) / sum_q w(q) likeness(p, q)

over the four pixels q around p's old position (w bilinear), and where no weight is left, over
valid pixels of the frame itself that lie around p, ever farther away: rings of 24 pixels at
distances that double, the nearest of which outweighs the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from itertools import product

import torch
from torch import Tensor
from torch.nn.functional import pad

from rtsr_cli.core.imaging.row_strips import cut_pixels
from rtsr_cli.core.imaging.surfaces import Surfaces, weigh_likeness
from rtsr_cli.core.imaging.warping import bilinear_places, inside_frame
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

STEPS = tuple(s for s in product(range(-RING, RING + 1), repeat=2) if s != (0, 0))
"""(down, across) of a ring's pixels, in its spacing."""

MARGIN = RING * REACHES[-1]
"""How far rings reach."""

NEARNESS = tuple(math.exp(-(down * down + across * across) / 4.0) for down, across in STEPS)
"""Their weights."""

PIXELS_AT_ONCE = 1 << 14
"""That are fetched by a thread."""

HOLES_AT_ONCE = 1 << 11
"""That are filled by a thread, from 24 pixels each."""


@dataclass(frozen=True, kw_only=True)
class CarriedImage:
    """What past pixels say of a frame.

    Attributes:
        values: n c h w, anything where `weight` is 0.
        weight: n 1 h w, 0..1: how much of it is of the same surface.
        inside: n 1 h w, 1 where the pixel lay within the past frame; else `weight` is 0.
    """

    values: Image
    weight: Plane
    inside: Mask


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
    packed = past.pack()
    parts = [
        _warp_one(values[i, None], motion_px[i, None], own.pick(i), packed[i, None])
        for i in range(len(values))
    ]
    if len(parts) == 1:
        return parts[0]
    names = [f.name for f in fields(CarriedImage)]
    return CarriedImage(**{n: torch.cat([getattr(part, n) for part in parts]) for n in names})


def warp_with_and_without(
    values: Image, motion_px: MotionPx, own: Surfaces, packed: Image
) -> tuple[CarriedImage, Image]:
    """Fetch past values along surfaces, and beside it of whatever surface, the border repeated.

    Args:
        values: of the past frame, 1 c h w.
        motion_px: from the current samples to the past ones.
        own: surfaces of the current frame.
        packed: `Surfaces.pack` of the past frame.

    Returns:
        `warp_along_surfaces`, and `backward_warp` of the values.
    """
    plain = torch.zeros_like(values)
    return _warp_one(values, motion_px, own, packed, plain), plain


def _warp_one(
    values: Image,
    motion_px: MotionPx,
    own: Surfaces,
    packed: Image,
    plain: Image | None = None,
) -> CarriedImage:
    """`warp_along_surfaces` of one frame of a batch; what lies there is added to `plain`."""
    channels, (height, width) = values.shape[1], values.shape[2:]
    pictures, past = values[0].flatten(1), packed[0].flatten(1)
    carried = torch.empty_like(values)
    weights, inside = torch.empty_like(own.kind), torch.empty_like(own.kind)

    def carry_rows(rows: range) -> None:
        pixels = slice(rows.start * width, rows.stop * width)
        surfaces = own.take(pixels)
        total = pictures.new_zeros(channels + 1, len(rows) * width)
        for index, weight in bilinear_places(motion_px, rows):
            if not weight.any():
                # what stands still, or moves by whole pixels, needs one of the four
                continue
            place = index.flatten()
            tap, there = pictures.index_select(1, place), past.index_select(1, place)
            likeness = weigh_likeness(surfaces, there[None, :, None])[0, 0]
            weight = weight.view_as(likeness)
            if plain is not None:
                plain[0].flatten(1)[:, pixels].addcmul_(tap, weight)
            likeness.mul_(weight)
            total[:channels].addcmul_(tap, likeness)
            total[channels:].add_(likeness)
        summed, weight = total[:channels], total[channels:]
        carried[0].flatten(1)[:, pixels] = summed.div_(weight.clamp(min=1e-6))
        within = inside_frame(motion_px, rows)
        inside[:, :, rows.start : rows.stop] = within
        weights[0].flatten(1)[:, pixels] = weight.mul_(within.view_as(weight))

    share_among_threads(carry_rows, cut_pixels((height, width), PIXELS_AT_ONCE))
    return CarriedImage(values=carried, weight=weights, inside=inside)


def cut_chunks(pixels: int, at_once: int) -> Iterator[slice]:
    """Cut a row of pixels where what is computed of a part stays in the cache."""
    return (slice(first, first + at_once) for first in range(0, pixels, at_once))


@dataclass(frozen=True, kw_only=True)
class _Pixels:
    """Pixels of a frame as planes of one row each, in which neighbours are looked up.

    Attributes:
        planes: value, and `Surfaces.pack`.
        own: surfaces.
        kinds: `Surfaces.kind` where the value is known, else NaN, which is like nothing; with a
            margin as wide as the farthest ring.
        size: (height, width), without the margin.
        channels: of the value.
    """

    planes: Tensor
    own: Surfaces
    kinds: Tensor
    size: Size
    channels: int

    def find_kin(self, index: Tensor, reach: int) -> Tensor:
        """Which pixels of a ring around k pixels are known, and of the same kind: 24 k."""
        width = self.size[1]
        wide = width + 2 * MARGIN
        place = (index // width + MARGIN) * wide + index % width + MARGIN
        places = place + _list_steps(reach, wide, index.device)
        return self.kinds.take(places) == self.kinds_of(index)

    def kinds_of(self, index: Tensor) -> Tensor:
        """Kind of k pixels, known or not."""
        return self.planes[-1].index_select(0, index)

    def sum_ring(self, index: Tensor, kin: Tensor, reach: int) -> Tensor:
        """Weighted sums of the kin around k pixels, and of their weights: c+1 k.

        Args:
            index: of the pixels.
            kin: `find_kin`.
            reach: spacing of the ring.
        """
        height, width = self.size
        there = index + _list_steps(reach, width, index.device)
        there.clamp_(0, height * width - 1)
        fetched = self.planes.index_select(1, there.flatten()).view(len(self.planes), *there.shape)
        likeness = weigh_likeness(self.own.take(index), fetched[None, self.channels :])[0, 0]
        likeness.mul_(kin).mul_(likeness.new_tensor(NEARNESS).unsqueeze(1))
        values = (fetched[: self.channels] * likeness).sum(1)
        return torch.cat([values, likeness.sum(0, keepdim=True)])


def _list_steps(reach: int, width: int, device: torch.device) -> Tensor:
    """How far the pixels of a ring lie behind its middle where rows follow each other, 24 1."""
    steps = [reach * (down * width + across) for down, across in STEPS]
    return torch.tensor(steps, device=device).unsqueeze(1)


def fill_along_surfaces(
    values: Image, holes: Mask, own: Surfaces, *, fallback: Callable[[Tensor], Tensor]
) -> Image:
    """Fill holes from the nearest pixels of their own surface that are none.

    Args:
        values: 1 c h w.
        holes: 1 where they are not known.
        own: surfaces of the frame.
        fallback: index of k pixels, where rows follow each other -> c k, what stands where no pixel
            of a surface is known.
    """
    marked = holes > 0
    filled = values[0].flatten(1).clone()
    index = marked.flatten().nonzero()[:, 0]
    unlike = torch.ones_like(index, dtype=torch.bool)
    pixels = _Pixels(
        planes=torch.cat([values.masked_fill(marked, 0.0), own.pack()], dim=1)[0].flatten(1),
        own=own,
        kinds=pad(own.kind.masked_fill(marked, math.nan), [MARGIN] * 4, value=math.nan),
        size=(holes.shape[2], holes.shape[3]),
        channels=len(filled),
    )

    def fill_chunk(part: slice) -> None:
        chunk = index[part]
        found, known = _gather_rings(pixels, chunk)
        filled[:, chunk[found]] = known
        unlike[part.start + found] = False

    share_among_threads(fill_chunk, list(cut_chunks(len(index), HOLES_AT_ONCE)))
    if bool(unlike.any()):
        unknown = index[unlike]
        filled[:, unknown] = fallback(unknown)
    return filled.view_as(values[0]).unsqueeze(0)


def _gather_rings(pixels: _Pixels, index: Tensor) -> tuple[Tensor, Tensor]:
    """Of some pixels those that were filled, as places in `index`, and their values, c k."""
    total = pixels.planes.new_zeros(pixels.channels + 1, len(index))
    still_open = torch.arange(len(index), device=index.device)
    share = 1.0
    for reach in REACHES:
        kin = pixels.find_kin(index[still_open], reach)
        seen = kin.any(0).nonzero()[:, 0]
        places = still_open[seen]
        ring = pixels.sum_ring(index[places], kin[:, seen], reach)
        total[:, places] += share * ring
        closed = torch.zeros_like(kin[0])
        closed[seen] = ring[-1] >= ENOUGH
        still_open = still_open[~closed]
        if not len(still_open):
            break
        share *= RING_DECAY
    found = (total[-1] > UNLIKE).nonzero()[:, 0]
    sums = total[:, found]
    return found, sums[:-1] / sums[-1:]
