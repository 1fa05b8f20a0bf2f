"""What extranet is shown of past lighting, in NumPy, from docs/export.md alone; see `rebuilt`.

Frames t-1 alone: those before follow the same formulas.
"""

from __future__ import annotations

import numpy as np

from tests.core.export.rebuilt import Array, C, Flags, Side, demodulate, find_k, material
from tests.core.export.rebuilt_history import (
    Surfaces,
    carry,
    describe_surfaces,
    find_moving,
    likeness,
)
from tests.core.export.rebuilt_warps import bilinear, jitter_change, surface_motion

REACH = 2


def fill(values: Array, holes: Flags, own: Surfaces, moves: Flags, fallback: Array) -> Array:
    """Holes from what lies around, ever farther away; `moves` widens no tolerance among own."""
    height, width = holes.shape
    rows, columns = np.mgrid[:height, :width]
    sums, total = np.zeros_like(values), np.zeros((height, width))
    still_open, share, r = holes.copy(), 1.0, 1
    while r <= C["FARTHEST_RING"]:
        ring = np.zeros((height, width))
        for down in range(-REACH, REACH + 1):
            for across in range(-REACH, REACH + 1):
                if (down, across) == (0, 0):
                    continue
                y, x = rows + r * down, columns + r * across
                there = (y >= 0) & (y < height) & (x >= 0) & (x < width)
                qy, qx = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
                w = likeness(own, moves, own, qy, qx) * there * ~holes[qy, qx] * still_open
                w = w * np.exp(-(down * down + across * across) / 4.0)
                sums, ring = sums + share * w * values[:, qy, qx], ring + w
        total = total + share * ring
        still_open = still_open & (ring < C["ENOUGH"])
        share, r = share * C["RING_DECAY"], 2 * r
    filled = np.where(total > C["UNLIKE"], sums / np.maximum(total, 1e-30), fallback)
    return np.where(holes, filled, values)


def guess(values: Array, known: Flags, own: Surfaces) -> Array:
    """Lighting of what nothing seen belongs to, by what lies near and faces as it does."""
    height, width = known.shape
    step = int(np.ceil(np.sqrt(width * height / C["GRID_PIXELS"])))
    top, left = min(step, height) // 2, min(step, width) // 2
    rows, columns = np.mgrid[top:height:step, left:width:step]
    chosen = known[rows, columns]
    q = rows[chosen], columns[chosen]
    if not len(q[0]):
        return np.full_like(values, np.log(2))
    facing = np.einsum("chw,cq->hwq", own.normal, own.normal[:, *q])
    apart = own.position[:, :, :, None] - own.position[:, *q][:, None, None]
    w = np.exp(-C["PLANE_FACING"] * (1 - facing)) / (
        C["NEAR_SHARE"] ** 2 + (apart**2).sum(0) / own.depth[..., None] ** 2
    )
    guessed: Array = (np.einsum("hwq,cq->chw", w, np.sqrt(values[:, *q])) / w.sum(-1)) ** 2
    return guessed


def show_past(now: Side, before: Side, lut: Array) -> tuple[Array, Flags]:
    """`base` and where it is filled, of a frame without radiance and the rendered one before."""
    lighting, divided = demodulate(before, lut)
    k = find_k(lighting, divided)
    rest = np.maximum(before.color("") - before.color("emission"), 0)
    e = np.log1p(np.where(divided, np.maximum(lighting, 0), rest) / k)
    m1 = surface_motion(now) + jitter_change(now, before)
    own = describe_surfaces(now, material(now, lut))
    past = describe_surfaces(before, material(before, lut))
    value, weight = carry(e, m1, own, find_moving(now, before, m1), past)
    lit = (material(now, lut).min(0) > C["EPSILON"]) & ~now.sky
    holes = weight < np.where(lit, C["LEAST_SEEN"], C["LEAST_SEEN_RADIANCE"])
    unseen = np.where(lit, guess(value, lit & ~holes, own), bilinear(np.log1p(rest / k), m1))
    return fill(value, holes, own, np.zeros_like(holes), unseen), holes
