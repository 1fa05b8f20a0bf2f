"""How gather carries and blends history, in NumPy, from docs/export.md alone; see `rebuilt`.

Of the settings that the page names the values stand here: age, change and the like.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.core.export.rebuilt import (
    Array,
    C,
    Flags,
    Side,
    clamp,
    cubic_base,
    demodulate,
    find_k,
    find_shift,
    gradient,
    material,
    move,
)
from tests.core.export.rebuilt_warps import inside

AGE, CHANGE, CHANGE_WORTH, CHANGE_AGREED, CHANGE_SPREAD = 0.9, 0.65, 2.0, 3.0, 0.5
CHANGE_FIT, FIT_POWER = 0.6, 4


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """What likeness looks at."""

    normal: Array
    position: Array
    plane: Array
    depth: Array
    kind: Array


def locate(side: Side) -> Array:
    """World positions by depth and camera; the sky lies 65504 m away."""
    height, width = side.depth.shape
    x = 2 * (np.arange(width) + 0.5 + side.jitter[0]) / width - 1
    y = 1 - 2 * (np.arange(height) + 0.5 + side.jitter[1]) / height
    p = np.linalg.inv(side.world_to_camera) @ side.world_to_ndc
    across, up = np.meshgrid((x + p[2, 0]) / p[0, 0], (y + p[2, 1]) / p[1, 1])
    z = np.minimum(side.depth, C["SKY_DEPTH"])
    points = np.stack([across * z, up * z, -z, np.ones_like(z)], axis=-1)
    world: Array = np.moveaxis((points @ np.linalg.inv(side.world_to_camera))[..., :3], -1, 0)
    return world


def describe_surfaces(side: Side, f: Array) -> Surfaces:
    divided = (f.min(0) > C["EPSILON"]) & ~side.sky
    axis = side.world_to_camera[:3, 2] / np.linalg.norm(side.world_to_camera[:3, 2])
    faced = (side.normal != 0).any(0)
    plane = np.where(faced, side.normal, axis.reshape(3, 1, 1) * ~side.sky)
    kind = np.where(side.sky, -0.5, 2 * side.buffers["objectid"] + divided)
    position = locate(side) * ~side.sky
    return Surfaces(normal=side.normal, position=position, plane=plane, depth=side.depth, kind=kind)


def find_moving(side: Side, before: Side, motion: Array) -> Flags:
    """Where motion is not that of the camera of the frame before."""
    height, width = side.depth.shape
    q = np.moveaxis(locate(side) * ~side.sky, 0, -1)
    clip = np.concatenate([q, np.ones((height, width, 1))], axis=-1) @ before.world_to_ndc
    w = np.where(clip[..., 3] > 0, clip[..., 3], np.nan)
    columns = (clip[..., 0] / w * 0.5 + 0.5) * width - before.jitter[0] - 0.5
    rows = (0.5 - 0.5 * clip[..., 1] / w) * height - before.jitter[1] - 0.5
    own_rows, own_columns = np.mgrid[:height, :width]
    camera = np.stack([columns - own_columns, rows - own_rows])
    return (np.abs(camera - motion).max(0) > C["STATIC_PX"]) & ~side.sky


def likeness(own: Surfaces, moves: Flags, other: Surfaces, y: np.ndarray, x: np.ndarray) -> Array:
    n, there = own.normal, other.normal[:, y, x]
    both = (n != 0).any(0) & (there != 0).any(0)
    turned = np.where(both, 1 - (n * there).sum(0), 0)
    share = np.where(moves, C["MOVING_SHARE"], C["PLANE_SHARE"])
    apart = np.abs((own.plane * (other.position[:, y, x] - own.position)).sum(0))
    off = apart / (share * clamp(own.depth, C["MIN_DEPTH"], C["SKY_DEPTH"]))
    alike = own.kind == other.kind[y, x]
    return np.where(alike, np.exp(-C["PLANE_FACING"] * turned - off), 0)


def carry(
    image: Array, motion: Array, own: Surfaces, moves: Flags, before: Surfaces
) -> tuple[Array, Array]:
    """Values where each pixel's surface was, and how much of them is of it."""
    height, width = own.depth.shape
    rows, columns = np.mgrid[:height, :width]
    y, x = rows + motion[1], columns + motion[0]
    top, left = np.floor(y).astype(int), np.floor(x).astype(int)
    total, weight = np.zeros_like(image), np.zeros((height, width))
    for down in (0, 1):
        for across in (0, 1):
            b = np.abs(1 - down - (y - top)) * np.abs(1 - across - (x - left))
            qy, qx = np.clip(top + down, 0, height - 1), np.clip(left + across, 0, width - 1)
            b = b * likeness(own, moves, before, qy, qx)
            total, weight = total + b * image[:, qy, qx], weight + b
    return total / np.maximum(weight, 1e-6), np.where(inside(motion), weight, 0)


@dataclass(frozen=True, kw_only=True)
class Guides:
    """What `Guided` enlarges by."""

    lr: Side
    mask: Flags
    normal: Array
    depth: Array
    scale: int


def guided(
    g: Guides, values: Array, fallback: Array, factors: Array | None = None
) -> tuple[Array, Array]:
    """Enlarged values, the fallback joining in; and the largest w m."""
    height, width = g.depth.shape
    s, z = g.scale, clamp(g.depth, C["MIN_DEPTH"], C["MAX_DEPTH"])
    slope = gradient(z) * s
    f = np.ones((3, height, width)) if factors is None else factors
    rows, columns = np.mgrid[:height, :width]
    total, weight = C["FALLBACK_WEIGHT"] * fallback, np.full_like(z, C["FALLBACK_WEIGHT"])
    fit = np.zeros_like(z)
    place = (np.arange(s) - s // 2) / s
    unfaced = (g.normal == 0).all(0) & (g.depth < C["SKY_DEPTH"])
    unfaced_lr = (g.lr.normal == 0).all(0) & ~g.lr.sky
    for y in range(-2, 3):
        for x in range(-2, 3):
            squared = (place[:, None] - y) ** 2 + (place[None] - x) ** 2
            if np.exp(-squared.min() / (2 * C["SPREAD"] ** 2)) < C["LEAST_WEIGHT"]:
                continue
            qy = np.clip(rows // s + y, 0, height // s - 1)
            qx = np.clip(columns // s + x, 0, width // s - 1)
            square = np.tile(squared, (height // s, width // s))
            facing = (g.normal * g.lr.normal[:, qy, qx]).sum(0)
            facing = np.where(unfaced | unfaced_lr[qy, qx], 1.0, facing)
            other = np.minimum(g.lr.depth[qy, qx], C["MAX_DEPTH"])
            apart = np.maximum(np.abs(z - other) - C["SLOPE"] * slope * np.sqrt(square), 0)
            power = -f[0] * square / (2 * C["SPREAD"] ** 2) - f[1] * C["FACING"] * (1 - facing)
            w = np.exp(power - f[2] * apart / (C["DEPTH_SHARE"] * z)) * g.mask[qy, qx]
            total, weight = total + w * values[:, qy, qx], weight + w
            fit = np.maximum(fit, w)
    return total / weight, fit


def enlarge_change(g: Guides, change: Array, seen: Array) -> tuple[Array, Array]:
    """d and t."""
    stacked = np.concatenate([seen[None], change, (change**2).mean(0, keepdims=True)])
    enlarged, _ = guided(g, stacked, np.zeros((5, *g.depth.shape)))
    known = enlarged[0]
    d = np.where(known > C["KNOWN_SHARE"], enlarged[1:4] / np.maximum(known, 1e-9), 0)
    every = enlarged[4] / np.maximum(known, C["KNOWN_SHARE"])
    alike = clamp(3 * (d**2).mean(0) / np.maximum(every, C["LEAST_SQUARE"]) - 2, 0, 1)
    return d, alike * share_change(change).repeat(g.scale, 0).repeat(g.scale, 1)


def share_change(change: Array) -> Array:
    """How far the eight samples around each changed as it did."""
    height, width = change.shape[1:]
    length = np.sqrt((change**2).sum(0))
    shared = np.zeros_like(length)
    for y in range(height):
        for x in range(width):
            own, others, sizes = change[:, y, x], np.zeros(3), 0.0
            for i in range(max(0, y - 1), min(height, y + 2)):
                for j in range(max(0, x - 1), min(width, x + 2)):
                    if (i, j) != (y, x):
                        others, sizes = others + change[:, i, j], sizes + length[i, j]
            least = length[y, x] * max(sizes, C["OTHERS"] * length[y, x])
            shared[y, x] = max(own @ others, 0) / max(least, C["LEAST_SQUARE"])
    return shared


@dataclass(frozen=True, kw_only=True)
class History:
    """What a frame leaves to the next, on the HR frame's own grid."""

    lighting: Array
    worth: Array
    surfaces: Surfaces


@dataclass(frozen=True, kw_only=True)
class Gathered:
    """What the graph is shown of history, and what comes of its corrections."""

    change: Array
    seen: Array
    worth_before: Array
    history: History


def gather_frame(  # noqa: PLR0915  # one step after the other, as the page has them
    pair: tuple[Side, Side],
    before: tuple[Side, Side] | None,
    history: History | None,
    lut: Array,
    *,
    r: Array,
    scale: int,
) -> Gathered:
    """One frame, (LR, HR), by the corrections that the graph gave."""
    lr, hr = pair
    lighting, divided = demodulate(lr, lut)
    k = find_k(lighting, divided)
    e = np.log1p(np.maximum(lighting, 0) / k)
    shift = find_shift(lr.jitter, scale)
    residual = (lr.jitter[0] - shift[0] / scale, lr.jitter[1] - shift[1] / scale)
    surfaces = describe_surfaces(hr, material(hr, lut))
    g = Guides(
        lr=lr, mask=divided, normal=move(hr.normal, shift), depth=move(hr.depth, shift), scale=scale
    )
    smooth = cubic_base(np.where(divided, e, 0), divided, scale, residual)
    factors = np.exp(clamp(r[:3], -C["MOST_EMPHASIS"], C["MOST_EMPHASIS"]))
    _, fit = guided(g, e, smooth)
    n = fit**FIT_POWER
    own, _ = guided(g, e, smooth, factors)
    change, seen, c = np.zeros_like(e), np.zeros_like(lr.depth), np.zeros_like(hr.depth)
    made, worth = own, n
    if history is not None and before is not None:
        motion = hr.color("motion", "XY")
        moves = find_moving(hr, before[1], motion)
        h = np.log1p(np.maximum(history.lighting, 0) / k)
        both = np.concatenate([h, history.worth[None]])
        carried, weight = carry(both, motion, surfaces, moves, history.surfaces)
        h, c = move(carried[:3], shift), move(carried[3] * weight, shift)
        at = np.s_[..., scale // 2 :: scale, scale // 2 :: scale]
        seen = (divided & (c[at] > C["COMPARED_WORTH"])).astype(float)
        change = np.where(seen > 0, e - h[at], 0)
        d, t = enlarge_change(g, change, seen)
        trusted = r[3] - t * np.maximum(r[3], 0)
        c2 = AGE * c * np.exp(clamp(trusted, -C["MOST_LOGIT"], C["MOST_LOGIT"]))
        c2 = c2 / (1 + (1 + CHANGE_AGREED * t) * (d**2).mean(0) / CHANGE_SPREAD**2)
        c2 = np.minimum(c2, C["GATHER_MOST_KEPT"] * c)
        believed = r[4] - t * np.minimum(r[4], 0)
        share = 1 / (1 + np.exp(-(np.log(CHANGE / (1 - CHANGE)) + believed)))
        settled = np.minimum(1, CHANGE_WORTH / np.maximum(c2, 1e-9))
        b = share * np.maximum(np.minimum(1, fit / CHANGE_FIT) * settled, t)
        part = c2 / np.maximum(c2 + n, C["LEAST_WORTH"])
        made = np.maximum(own + part * (h + b * d - own), 0)
        worth = c2 + n
    kept = np.minimum(worth, C["GATHER_MOST_WORTH"])
    back = (-shift[0], -shift[1])
    light = move(k * np.expm1(np.maximum(made, 0)), back)
    left = History(lighting=light, worth=move(kept, back), surfaces=surfaces)
    return Gathered(change=change, seen=seen, worth_before=c, history=left)
