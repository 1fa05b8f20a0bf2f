"""How nsrd's past is brought to a frame, in NumPy, from docs/export.md alone; see `rebuilt`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.core.export.rebuilt import (
    Array,
    C,
    Flags,
    Jitter,
    Side,
    clamp,
    cubic_base,
    demodulate,
    find_k,
    find_shift,
    guided_base,
    move,
)


def places(motion: Array) -> tuple[Array, Array]:
    """Rows and columns of p."""
    rows, columns = np.mgrid[: motion.shape[1], : motion.shape[2]]
    return rows.astype(float), columns.astype(float)


def holders(motion: Array) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the pixel that holds p + motion, not clamped."""
    rows, columns = places(motion)
    return (
        (rows + np.floor(motion[1] + 0.5)).astype(int),
        (columns + np.floor(motion[0] + 0.5)).astype(int),
    )


def inside(motion: Array) -> Flags:
    y, x = holders(motion)
    return (y >= 0) & (y < motion.shape[1]) & (x >= 0) & (x < motion.shape[2])


def nearest(image: Array, motion: Array) -> Array:
    y, x = holders(motion)
    return image[..., np.clip(y, 0, image.shape[-2] - 1), np.clip(x, 0, image.shape[-1] - 1)]


def bilinear(image: Array, motion: Array) -> Array:
    rows, columns = places(motion)
    y, x = rows + motion[1], columns + motion[0]
    top, left = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = y - top, x - left

    def at(down: int, across: int) -> Array:
        height, width = image.shape[-2:]
        found: Array = image[
            ..., np.clip(top + down, 0, height - 1), np.clip(left + across, 0, width - 1)
        ]
        return found

    above = at(0, 0) * (1 - fx) + at(0, 1) * fx
    return above * (1 - fy) + (at(1, 0) * (1 - fx) + at(1, 1) * fx) * fy


def enlarge_linearly(image: Array, scale: int, jitter: Jitter) -> Array:
    for axis, offset in ((-2, jitter[1]), (-1, jitter[0])):
        length = image.shape[axis]
        u = (np.arange(scale * length) + 0.5) / scale - 0.5 - offset
        first = np.floor(u).astype(int)
        f = (u - first).reshape([-1 if i == image.ndim + axis else 1 for i in range(image.ndim)])
        before, after = (
            np.take(image, np.clip(first + k, 0, length - 1), axis=axis) for k in (0, 1)
        )
        image = before * (1 - f) + after * f
    return image


@dataclass(frozen=True, kw_only=True)
class Dual:
    """What covers a pixel's place in the past frame: its vector, and whether one is known."""

    motion: Array
    vector: Array
    known: Flags

    @property
    def unreliable(self) -> Flags:
        apart = np.abs(self.vector - self.motion)
        return ~self.known | (apart >= C["UNRELIABLE_PX"]).any(0)


def jitter_change(now: Side, before: Side) -> Array:
    return (np.array(now.jitter) - np.array(before.jitter)).reshape(2, 1, 1)


def surface_motion(side: Side) -> Array:
    return side.color("motion", "XY")


def find_dual(now: Side, before: Side) -> Dual:
    """By forward vectors where the past frame has them, else by splatting."""
    if "forward.X" not in before.buffers:
        return splat_dual(now, before)
    m1 = surface_motion(now) + jitter_change(now, before)
    known = inside(m1)
    forward = before.color("forward", "XY") + jitter_change(before, now)
    return Dual(motion=m1, vector=np.where(known, -nearest(forward, m1), m1), known=known)


def splat_dual(now: Side, before: Side) -> Dual:
    """Without forward vectors."""
    m1 = surface_motion(now) + jitter_change(now, before)
    height, width = now.depth.shape
    y, x = holders(m1)
    landed = np.full((height, width), np.inf)
    winner = np.full((height, width), -1)
    for p in range(height * width):
        row, column = y.flat[p], x.flat[p]
        if 0 <= row < height and 0 <= column < width:
            depth = min(now.depth.flat[p], C["SKY_DEPTH"])
            if depth < landed[row, column]:
                landed[row, column], winner[row, column] = depth, p
    there = nearest(winner, m1)
    known = inside(m1) & (there >= 0)
    dual = np.where(known, m1.reshape(2, -1)[:, np.maximum(there, 0)], m1)
    in_front = nearest(before.depth, m1) < C["IN_FRONT"] * now.depth
    came = nearest(surface_motion(before), m1) + jitter_change(now, before)
    return Dual(motion=m1, vector=np.where(in_front, came, dual), known=known)


def describe_frame(side: Side, lut: Array, k: float) -> Array:
    """7 channels: lighting, normal, depth."""
    lighting, divided = demodulate(side, lut)
    shown = np.where(divided, np.log1p(clamp(lighting, 0, C["MAX_LIGHTING"]) / k), 0)
    inverse = np.where(side.sky, 0, 1 / (1 + side.depth))
    return np.concatenate([shown, side.normal, inverse[None]])


@dataclass(frozen=True, kw_only=True)
class PastInputs:
    """What nsrd's graph is fed of frames before."""

    frame_0: Array
    past_1: Array
    past_2: Array
    base: Array
    last: Array
    hidden: Array


def rebuild_past(
    frames: tuple[Side, Side, Side],
    hr: Side,
    lut: Array,
    scale: int,
    *,
    predicted: Array,
    hidden: Array,
) -> PastInputs:
    """Frames t, t-1, t-2; what the graph gave for t-1."""
    now, one, two = frames
    lighting, divided = demodulate(now, lut)
    k = find_k(lighting, divided)
    frame_0 = describe_frame(now, lut, k)
    newer, older = find_dual(now, one), find_dual(one, two)
    m1 = newer.motion
    m2 = m1 + nearest(older.motion, m1)
    lost = newer.unreliable | nearest(older.unreliable, m1) | ~inside(m2)
    pasts = [
        np.concatenate(
            [
                np.where(inside(m), bilinear(describe_frame(side, lut, k), m), frame_0),
                mask[None].astype(float),
            ]
        )
        for side, m, mask in ((one, m1, newer.unreliable), (two, m2, lost))
    ]
    shift, before = (find_shift(side.jitter, scale) for side in (now, one))
    residual = (now.jitter[0] - shift[0] / scale, now.jitter[1] - shift[1] / scale)
    e = np.where(divided, np.log1p(np.maximum(lighting, 0) / k), 0)
    smooth = cubic_base(e, divided, scale, residual)
    normal, depth = move(hr.normal, shift), move(hr.depth, shift)
    base = guided_base(e, divided, now, normal, depth, smooth, scale)

    def enlarged(image: Array) -> Array:
        return enlarge_linearly(image, scale, residual)

    moved = scale * enlarged(surface_motion(now)) + (np.array(shift) - np.array(before)).reshape(
        2, 1, 1
    )
    k_before = find_k(*demodulate(one, lut))
    fetched = bilinear(k_before * np.expm1(np.maximum(predicted, 0)), moved)
    unreliable = ~inside(moved) | (enlarged(newer.known.astype(float)) <= C["ALL_KNOWN"])
    apart = np.abs(scale * enlarged(newer.vector - m1))
    unreliable |= (apart >= C["UNRELIABLE_PX"] * scale).any(0)
    last = np.log1p(clamp(fetched, 0, C["MAX_LIGHTING"]) / k) - base
    return PastInputs(
        frame_0=frame_0,
        past_1=pasts[0],
        past_2=pasts[1],
        base=base,
        last=np.where(unreliable, 0, last),
        hidden=np.where(inside(m1), nearest(hidden, m1), 0),
    )


def lesser_step(z: Array) -> Array:
    """Of both sides where they agree in sign, else 0; along x plus along y."""
    total = np.zeros_like(z)
    for axis in (0, 1):
        step = np.diff(z, axis=axis)
        edge = np.zeros_like(np.take(step, [0], axis))
        before, after = (np.concatenate(parts, axis) for parts in ((edge, step), (step, edge)))
        total += np.where(before * after > 0, np.minimum(np.abs(before), np.abs(after)), 0)
    return total


def luma(image: Array) -> Array:
    return 0.299 * image[0] + 0.587 * image[1] + 0.114 * image[2]


def reproject(now: Side, before: Side) -> Array:
    """The four channels of rt-percept."""
    m1 = surface_motion(now) + jitter_change(now, before)
    t = before.color("") / (1 + before.color(""))
    x = clamp(t, 0, 1)
    shown = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
    z = np.minimum(now.depth, C["SKY_DEPTH"])
    near = np.abs(nearest(np.minimum(before.depth, C["SKY_DEPTH"]), m1) - z)
    n, n_before = now.normal, bilinear(before.normal, m1)
    lengths = np.linalg.norm(n, axis=0) * np.linalg.norm(n_before, axis=0)
    facing = (n * n_before).sum(0) / np.where(lengths > 0, lengths, 1)
    both_sky = (np.linalg.norm(n, axis=0) == 0) & (np.linalg.norm(n_before, axis=0) == 0)
    seen = inside(m1) & (near <= C["SEEN_DEPTH"] * z + lesser_step(z))
    seen &= ((facing >= C["SEEN_FACING"]) & (lengths > 0)) | both_sky
    seen &= nearest(before.buffers["objectid"], m1) == now.buffers["objectid"]
    rotation = now.world_to_camera[:3, :3]
    rotation = rotation / np.linalg.norm(rotation, axis=0, keepdims=True)
    toward = np.einsum("ihw,ij->jhw", n, rotation)[2]
    diffuse = now.color("albedo") * (1 - now.buffers["metallic"])
    picture = luma(nearest(shown, m1)) * seen
    return np.stack([picture, seen.astype(float), luma(diffuse), toward * 0.5 + 0.5])
