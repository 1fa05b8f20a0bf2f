"""What surrounds fusesr-fast, in NumPy, from docs/export.md alone: its constants are read there.

Nothing here may import rtsr_cli: a reader of the page has none of it. Images are c h w.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Jitter = tuple[float, float]

PAGE = Path(__file__).parents[3] / "docs" / "export.md"


def read_constants(page: str) -> dict[str, float]:
    """`static const float NAME = value;` of a page."""
    found = re.findall(r"^static const \w+ (\w+) = ([^;]+);", page, re.MULTILINE)
    return {name: float(value) for name, value in found}


C = read_constants(PAGE.read_text(encoding="utf-8"))


@dataclass(frozen=True, kw_only=True)
class Side:
    """Buffers of a frame, world matrices of its camera, jitter."""

    buffers: dict[str, Array]
    world_to_camera: Array
    world_to_ndc: Array
    jitter: Jitter

    def color(self, name: str, letters: str = "RGB") -> Array:
        stem = f"{name}." if name else ""
        return np.stack([self.buffers[stem + letter] for letter in letters])

    @property
    def normal(self) -> Array:
        stored = self.color("normal", "XYZ")
        length = np.linalg.norm(stored, axis=0)
        return stored / np.where(length > 0, length, 1)

    @property
    def depth(self) -> Array:
        return self.buffers["depth.Z"]

    @property
    def sky(self) -> Flags:
        return self.depth >= C["SKY_DEPTH"]


def clamp(values: Array, least: float, most: float) -> Array:
    return np.minimum(np.maximum(values, least), most)


# demodulate ---------------------------------------------------------------------------------


def view_cosine(side: Side) -> Array:
    height, width = side.depth.shape
    x = 2 * (np.arange(width) + 0.5 + side.jitter[0]) / width - 1
    y = 1 - 2 * (np.arange(height) + 0.5 + side.jitter[1]) / height
    p = np.linalg.inv(side.world_to_camera) @ side.world_to_ndc
    across, up = np.meshgrid((x + p[2, 0]) / p[0, 0], (y + p[2, 1]) / p[1, 1])
    toward = -np.stack([across, up, -np.ones_like(across)])
    world = np.einsum("ij,jhw->ihw", side.world_to_camera[:3, :3], toward)
    normal = side.normal
    lengths = np.linalg.norm(world, axis=0) * np.linalg.norm(normal, axis=0)
    cosine = clamp((world * normal).sum(0) / np.maximum(lengths, 1e-12), 0, 1)
    return np.where((normal == 0).all(0) & ~side.sky, 1.0, cosine)


def sample_linear_clamp(table: Array, u: Array, v: Array) -> Array:
    size = table.shape[-1]
    x, y = (clamp(t * size - 0.5, 0, size - 1) for t in (u, v))
    left, top = (np.minimum(t.astype(int), size - 2) for t in (x, y))
    fx, fy = x - left, y - top
    above = table[:, top, left] * (1 - fx) + table[:, top, left + 1] * fx
    below = table[:, top + 1, left] * (1 - fx) + table[:, top + 1, left + 1] * fx
    return above * (1 - fy) + below * fy


def material(side: Side, lut: Array) -> Array:
    ab = sample_linear_clamp(lut, view_cosine(side), side.buffers["roughness"])
    metallic, albedo = side.buffers["metallic"], side.color("albedo")
    f0 = C["DIELECTRIC_F0"] + (albedo - C["DIELECTRIC_F0"]) * metallic
    return np.minimum((1 - metallic) * albedo + f0 * ab[0] + ab[1], C["MOST_MATERIAL"])


def demodulate(lr: Side, lut: Array) -> tuple[Array, Flags]:
    f, radiance = material(lr, lut), lr.color("")
    divided = (f.min(0) > C["EPSILON"]) & ~lr.sky
    emission = np.minimum(np.maximum(lr.color("emission"), 0), radiance)
    quotient = np.maximum(radiance - emission, 0) / np.where(divided, f, 1)
    return np.where(divided, quotient, radiance - emission), divided


# encode, align ------------------------------------------------------------------------------


def find_k(lighting: Array, divided: Flags) -> float:
    logs = np.log(np.maximum(lighting[:, divided], 0) + C["LIGHTING_FLOOR"])
    return float(np.exp(logs.mean())) if divided.any() else 1.0


def find_shift(jitter: Jitter, scale: int) -> tuple[int, int]:
    x, y = (int(np.floor((0.5 + j) * scale - scale // 2 + 1e-6)) for j in jitter)
    return x, y


def move(image: Array, shift: tuple[int, int]) -> Array:
    """out[p] = image[clamp(p + shift)]."""
    height, width = image.shape[-2:]
    y = np.clip(np.arange(height) + shift[1], 0, height - 1)
    x = np.clip(np.arange(width) + shift[0], 0, width - 1)
    return image[..., y[:, None], x[None]]


# cubic --------------------------------------------------------------------------------------


def cubic_weight(x: Array) -> Array:
    a, x = C["KEYS_A"], np.abs(x)
    inner = (a + 2) * x**3 - (a + 3) * x**2 + 1
    outer = a * x**3 - 5 * a * x**2 + 8 * a * x - 4 * a
    return np.where(x <= 1, inner, np.where(x < 2, outer, 0))


def cubic(image: Array, scale: int, jitter: Jitter) -> Array:
    for axis, offset in ((-1, jitter[0]), (-2, jitter[1])):
        length = image.shape[axis]
        u = (np.arange(scale * length) + 0.5) / scale - 0.5 - offset
        first = np.floor(u).astype(int) - 1
        taps = first[:, None] + np.arange(4)
        weights = cubic_weight(u[:, None] - taps)
        rows = np.moveaxis(image, axis, -1)[..., np.clip(taps, 0, length - 1)]
        image = np.moveaxis((rows * weights).sum(-1), -1, axis)
    return image


def around(image: Array, reach: int, fill: float | None) -> list[Array]:
    """The (2 reach + 1)^2 neighbours of every pixel; None repeats the border."""
    ends = [(0, 0)] * (image.ndim - 2) + [(reach, reach)] * 2
    how = {"mode": "edge"} if fill is None else {"constant_values": fill}
    padded = np.pad(image, ends, **how)  # type: ignore[call-overload]
    height, width = image.shape[-2:]
    steps = range(2 * reach + 1)
    return [padded[..., y : y + height, x : x + width] for y in steps for x in steps]


def grow(image: Array, mask: Flags, steps: int) -> tuple[Array, Flags]:
    for _ in range(steps):
        total, count = (sum(around(t, 1, 0.0)) for t in (image * mask, mask.astype(float)))
        image = np.where(mask, image, np.where(count > 0, total / np.maximum(count, 1e-6), image))
        mask = count > 0
    return image, mask


def repeat(image: Array, scale: int) -> Array:
    return image.repeat(scale, -1).repeat(scale, -2)


def masked_cubic(image: Array, mask: Flags, scale: int, jitter: Jitter) -> tuple[Array, Flags]:
    weight = cubic(mask.astype(float), scale, jitter)
    reached = weight >= C["MIN_FILTERED_MASK"]
    smooth = cubic(image * mask, scale, jitter) / np.where(reached, weight, 1)
    return held(smooth, image, mask, scale), reached


def held(smooth: Array, image: Array, mask: Flags, scale: int) -> Array:
    partial = np.any(around((~mask).astype(float), 2, 0.0), axis=0)
    most = np.max(around(np.where(mask, image, -np.inf), 2, -np.inf), axis=0)
    least = np.min(around(np.where(mask, image, np.inf), 2, np.inf), axis=0)
    ends = (repeat(np.where(partial, i, f), scale) for i, f in ((least, -np.inf), (most, np.inf)))
    return clamp(smooth, *ends)


def cubic_base(e: Array, divided: Flags, scale: int, jitter: Jitter) -> Array:
    if divided.all():
        return cubic(e, scale, jitter)
    smooth, reached = masked_cubic(e, divided, scale, jitter)
    grown, near = grow(e, divided, 1)
    return np.where(reached, smooth, repeat(np.where(near, grown, np.log(2)), scale))


# guided base --------------------------------------------------------------------------------


def gradient(depth: Array) -> Array:
    lesser = []
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        before = np.insert(step, 0, np.take(step, 0, axis), axis)
        after = np.insert(step, step.shape[axis], np.take(step, -1, axis), axis)
        lesser.append(np.minimum(before, after))
    return np.maximum(*lesser)


def guided_base(
    e: Array, mask: Flags, lr: Side, normal: Array, depth: Array, fallback: Array, scale: int
) -> Array:
    height, width = depth.shape
    z = clamp(depth, C["MIN_DEPTH"], C["MAX_DEPTH"])
    slope = gradient(z) * scale
    rows, columns = np.mgrid[:height, :width]
    total, weight = C["FALLBACK_WEIGHT"] * fallback, np.full((height, width), C["FALLBACK_WEIGHT"])
    inside = (np.arange(scale) - scale // 2) / scale
    unfaced = (normal == 0).all(0) & (depth < C["SKY_DEPTH"])
    unfaced_lr = (lr.normal == 0).all(0) & ~lr.sky
    for y in range(-2, 3):
        for x in range(-2, 3):
            squared = (inside[:, None] - y) ** 2 + (inside[None] - x) ** 2
            if np.exp(-squared.min() / (2 * C["SPREAD"] ** 2)) < C["LEAST_WEIGHT"]:
                continue
            qy = np.clip(rows // scale + y, 0, height // scale - 1)
            qx = np.clip(columns // scale + x, 0, width // scale - 1)
            square = np.tile(squared, (height // scale, width // scale))
            facing = (normal * lr.normal[:, qy, qx]).sum(0)
            facing = np.where(unfaced | unfaced_lr[qy, qx], 1.0, facing)
            other = np.minimum(lr.depth[qy, qx], C["MAX_DEPTH"])
            apart = np.abs(z - other) - C["SLOPE"] * slope * np.sqrt(square)
            power = -square / (2 * C["SPREAD"] ** 2) - C["FACING"] * (1 - facing)
            power -= np.maximum(apart, 0) / (C["DEPTH_SHARE"] * z)
            w = np.exp(power) * mask[qy, qx]
            total += w * e[:, qy, qx]
            weight += w
    return total / weight


# compose ------------------------------------------------------------------------------------


def bound(enlarged: Array, encoded: Array, scale: int) -> Array:
    brightest = np.max(around(encoded, 2, -np.inf), axis=0)
    return np.minimum(enlarged, repeat(np.maximum(brightest, C["HIGHLIGHT"]), scale))


def expand(t: Array) -> Array:
    t = clamp(t, 0, C["MOST_RADIANCE"] / (1 + C["MOST_RADIANCE"]))
    return t / (1 - t)


def enlarge_radiance(color: Array, scale: int, jitter: Jitter) -> Array:
    t = color / (1 + color)
    return expand(bound(cubic(t, scale, jitter), t, scale))


def enlarge_sky(color: Array, sky: Flags, scale: int, jitter: Jitter) -> Array:
    t = color / (1 + color)
    own, reached = masked_cubic(t, sky, scale, jitter)
    grown, near = (repeat(i, scale) for i in grow(t, sky, int(C["SKY_REACH"])))
    own = np.where(reached, own, np.where(near, grown, cubic(t, scale, jitter)))
    return expand(bound(own, t, scale))


def any_within(mask: Flags, reach: int) -> Flags:
    return np.any(around(mask.astype(float), reach, 0.0), axis=0)


def find_undivided(lr: Side, hr: Side, divided: Flags, f_hr: Array, scale: int) -> Flags:
    faintest, unlit = f_hr.min(0), ~divided & ~lr.sky
    usable = (faintest > C["EPSILON"]) & ~hr.sky
    empty = ~usable & ~hr.sky
    beside = move(any_within(empty, 1), find_shift(lr.jitter, scale))
    single = unlit & ~beside[scale // 2 :: scale, scale // 2 :: scale]
    corner = single[1:, 1:] & single[1:, :-1] & single[:-1, 1:] & single[:-1, :-1]
    wrong = np.zeros_like(single)
    for rows in (slice(1, None), slice(None, -1)):
        for columns in (slice(1, None), slice(None, -1)):
            wrong[rows, columns] |= corner
    faint = usable & (faintest <= C["FAINT"] * C["EPSILON"])
    lost = usable & repeat(any_within(wrong, int(C["LOST_REACH"])), scale)
    return empty | lost | (faint & repeat(any_within(unlit, 2), scale))


def put_undivided(image: Array, lr: Side, hr: Side, undivided: Flags, divided: Flags) -> Array:
    color, scale = lr.color(""), hr.depth.shape[0] // lr.depth.shape[0]
    unlit = ~divided & ~lr.sky
    whole = enlarge_radiance(color, scale, lr.jitter)
    emission, emission_hr = np.maximum(lr.color("emission"), 0), hr.color("emission")
    rest = np.maximum(color - emission, 0)
    own, other = (np.max(around((t * unlit).max(0), 2, 0.0), axis=0) for t in (emission, rest))
    lamp = repeat((own > 0) & (other <= C["LIT_SHARE"] * own), scale)
    lamp &= (emission_hr > 0).any(0) | ~repeat(any_within(divided, 2), scale)
    shines = (emission_hr > C["EMISSION_SHARE"] * whole).any(0) | lamp
    apart = enlarge_radiance(rest, scale, lr.jitter) + emission_hr
    return np.where(undivided, np.where(shines, apart, whole), image)


@dataclass(frozen=True, kw_only=True)
class Rebuilt:
    """What is fed, and what is made of what comes back."""

    frame_0: Array
    hr: Array
    base: Array
    compose: Callable[[Array], Array]


def rebuild(lr: Side, hr: Side, lut: Array, scale: int) -> Rebuilt:
    """Everything around the graph."""
    lighting, divided = demodulate(lr, lut)
    k = find_k(lighting, divided)
    e = np.where(divided, np.log1p(np.maximum(lighting, 0) / k), 0)
    shown = np.where(divided, np.log1p(clamp(lighting, 0, C["MAX_LIGHTING"]) / k), 0)
    inverse = np.where(lr.sky, 0, 1 / (1 + lr.depth))
    shift = find_shift(lr.jitter, scale)
    residual = (lr.jitter[0] - shift[0] / scale, lr.jitter[1] - shift[1] / scale)
    f_hr = material(hr, lut)
    normal, depth, f = move(hr.normal, shift), move(hr.depth, shift), move(f_hr, shift)
    smooth = cubic_base(e, divided, scale, residual)
    base = guided_base(e, divided, lr, normal, depth, smooth, scale)

    def compose(predicted: Array) -> Array:
        brightest = (k * np.expm1(np.maximum(base, 0))).max(0)
        most, fading = C["MAX_LIGHTING"], 1 - C["FADING_SHARE"]
        predicted = base + (predicted - base) * clamp((most - brightest) / (fading * most), 0, 1)
        made = k * np.expm1(np.maximum(predicted, 0)) * f + move(hr.color("emission"), shift)
        image = np.maximum(move(made, (-shift[0], -shift[1])), 0)
        sky = enlarge_sky(lr.color(""), lr.sky, scale, lr.jitter)
        undivided = find_undivided(lr, hr, divided, f_hr, scale)
        whole = np.where(hr.sky, sky, image)
        return put_undivided(whole, lr, hr, undivided, divided)

    return Rebuilt(
        frame_0=np.concatenate([shown, inverse[None], lr.normal]), hr=f, base=base, compose=compose
    )
