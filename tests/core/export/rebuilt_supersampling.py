"""What surrounds cgts, in NumPy, from docs/export.md alone; see `rebuilt`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.core.export.rebuilt import Array, C, Flags, Jitter, Side, around, clamp
from tests.core.export.rebuilt_warps import bilinear, enlarge_linearly, inside, nearest


def keys(x: Array, a: float) -> Array:
    x = np.abs(x)
    inner = ((a + 2) * x - (a + 3)) * x * x + 1
    outer = ((a * x - 5 * a) * x + 8 * a) * x - 4 * a
    return np.where(x <= 1, inner, np.where(x < 2, outer, 0))


def sum_taps(image: Array, scale: int, jitter: Jitter, kernel: str) -> Array:
    for axis, offset in ((-1, jitter[0]), (-2, jitter[1])):
        length = image.shape[axis]
        u = (np.arange(scale * length) + 0.5) / scale - 0.5 - offset
        taps = np.floor(u).astype(int)[:, None] + np.arange(-2, 4)
        apart = u[:, None] - taps
        if kernel == "cubic":
            weights = keys(apart, C["SPLAT_A"])
        else:
            weights = np.exp(-0.5 * (apart * scale / C["SAMPLE_SIGMA"]) ** 2)
            weights = weights * (np.abs(apart) <= 1.5)
        rows = np.moveaxis(image, axis, -1)[..., np.clip(taps, 0, length - 1)]
        image = np.moveaxis((rows * weights).sum(-1), -1, axis)
    return image


def splat(t: Array, scale: int, jitter: Jitter) -> tuple[Array, Array]:
    """Colour and its worth."""
    w = sum_taps(np.ones_like(t[0]), scale, jitter, "splat")
    between = clamp(sum_taps(t, scale, jitter, "cubic"), 0, C["MOST_BETWEEN"])
    worth = w + C["BETWEEN_WORTH"]
    return (sum_taps(t, scale, jitter, "splat") + C["BETWEEN_WORTH"] * between) / worth, worth


def repeat_nearest(image: Array, scale: int, jitter: Jitter) -> Array:
    for axis, offset in ((-2, jitter[1]), (-1, jitter[0])):
        length = image.shape[axis]
        u = (np.arange(scale * length) + 0.5) / scale - offset
        image = np.take(image, np.clip(np.floor(u).astype(int), 0, length - 1), axis=axis)
    return image


def find_front_motion(side: Side, scale: int) -> Array:
    """Of the nearest surface of the samples around, output pixels."""
    height, width = side.depth.shape
    (x, y), motion = side.jitter, side.color("motion", "XY")
    v = (np.arange(scale * height) + 0.5) / scale - 0.5 - y
    u = (np.arange(scale * width) + 0.5) / scale - 0.5 - x
    best = np.full((v.size, u.size), np.inf)
    apart = np.full((v.size, u.size), np.inf)
    chosen = np.zeros((2, v.size, u.size))
    for down in (0, 1):
        for across in (0, 1):
            rows, columns = np.floor(v).astype(int) + down, np.floor(u).astype(int) + across
            square = ((rows - v) ** 2)[:, None] + ((columns - u) ** 2)[None]
            reach = np.maximum(np.abs(rows - v)[:, None], np.abs(columns - u)[None])
            at = np.ix_(np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1))
            z = side.depth[at]
            nearer = (reach < C["FRONT_REACH"]) & ((z < best) | ((z == best) & (square < apart)))
            best, apart = np.where(nearer, z, best), np.where(nearer, square, apart)
            chosen = np.where(nearer, motion[(slice(None), *at)], chosen)
    return scale * chosen


def filter_samples(t: Array, guides: Array, scale: int, jitter: Jitter) -> Array:
    """By kernels of 3 x 3 samples around the LR pixel."""
    height, width = t.shape[1:]
    neighbours = around(t, 1, None)
    made = np.zeros((3, scale * height, scale * width))
    for row in range(scale):
        for column in range(scale):
            place = row * scale + column
            logits = []
            for tap in range(9):
                down = (tap // 3 - 1 + jitter[1] + 0.5) * scale - row - 0.5
                across = (tap % 3 - 1 + jitter[0] + 0.5) * scale - column - 0.5
                reach = (down**2 + across**2) / (2 * C["KERNEL_SIGMA"] ** 2)
                logits.append(guides[tap * scale**2 + place] - reach)
            shares = np.exp(np.array(logits) - np.max(logits, axis=0))
            shares /= shares.sum(0)
            total = sum(a * q for a, q in zip(shares, neighbours, strict=True))
            made[:, row::scale, column::scale] = total
    return made


def enlarge_guides(guides: Array, scale: int) -> Array:
    """Of every output pixel: logits of samples, of pixels, and corrections."""
    each = guides.reshape(-1, scale, scale, *guides.shape[1:])
    return each.transpose(0, 3, 1, 4, 2).reshape(len(each), scale * guides.shape[1], -1)


def finish(color: Array, logits: Array, share: Array) -> Array:
    """By kernels of 3 x 3 pixels."""
    steps = np.mgrid[-1:2, -1:2].reshape(2, 9, 1, 1)
    logits = logits - (steps**2).sum(0) / (2 * C["PICTURE_SIGMA"] ** 2)
    shares = np.exp(logits - logits.max(0))
    shares /= shares.sum(0)
    total = sum(b * k for b, k in zip(shares, around(color, 1, None), strict=True))
    return clamp(color + share * (total - color), 0, 1)


def fetch_sharp(image: Array, motion: Array) -> Array:
    rows, columns = np.mgrid[: image.shape[1], : image.shape[2]]
    y, x = rows + motion[1], columns + motion[0]
    top, left = np.floor(y).astype(int), np.floor(x).astype(int)
    total = np.zeros_like(image)
    for down in range(-1, 3):
        for across in range(-1, 3):
            w = keys(y - top - down, C["SHARP_A"]) * keys(x - left - across, C["SHARP_A"])
            qy = np.clip(top + down, 0, image.shape[1] - 1)
            qx = np.clip(left + across, 0, image.shape[2] - 1)
            total += w * image[:, qy, qx]
    return total


def to_ycocg(t: Array) -> Array:
    r, g, b = t
    return np.stack([(r + 2 * g + b) / 4, (r - b) / 2, (2 * g - r - b) / 4])


def from_ycocg(y: Array) -> Array:
    return np.stack([y[0] + y[1] - y[2], y[0] + y[2], y[0] - y[1] - y[2]])


@dataclass(frozen=True, kw_only=True)
class State:
    """What a frame leaves to the next."""

    color: Array
    shown: Array
    counter: Array
    worth: Array
    low: Array
    high: Array
    d: Array
    logits: Array


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What the graphs are shown, as far as it is carried."""

    color: Array
    motion: Array
    counter: Array
    low: Array
    high: Array
    history: Array
    history_worth: Array
    logits: Array
    inside: Flags
    worth: Array
    d: Array
    clipped: Array
    samples: Array
    jitter: Jitter
    scale: int


def show(side: Side, before: State | None, scale: int) -> Shown:
    t = side.color("") / (1 + side.color(""))
    color, worth = splat(t, scale, side.jitter)
    motion = find_front_motion(side, scale)
    d = repeat_nearest(np.where(side.sky, 0, 1 / side.depth), scale, side.jitter)
    low, high = (pick(around(color, 1, None), axis=0) for pick in (np.min, np.max))
    doubt = np.zeros((6, *d.shape))
    doubt[0] = C["CERTAIN"]
    there = inside(motion) if before is not None else np.zeros(d.shape, bool)
    history, counter, gained, logits = color, np.zeros(d.shape), np.zeros(d.shape), doubt
    if before is not None:
        history = np.where(there, clamp(fetch_sharp(before.color, motion), 0, 1), color)
        counter = nearest(before.counter, motion) * there
        gained = nearest(before.worth, motion) * there
        logits = np.where(there, bilinear(before.logits, motion), doubt)
        low = np.where(there, nearest(before.low, motion), low)
        high = np.where(there, nearest(before.high, motion), high)
    samples = to_ycocg(t)
    mean = np.mean(around(samples, 1, None), axis=0)
    square = np.mean(around(samples**2, 1, None), axis=0)
    deviation = np.sqrt(np.maximum(square - mean**2, 0))
    mean, deviation = (enlarge_linearly(i, scale, side.jitter) for i in (mean, deviation))
    reach = C["DEVIATIONS"] * deviation
    held = from_ycocg(clamp(to_ycocg(history), mean - reach, mean + reach))
    return Shown(
        color=color, motion=motion, counter=counter, low=low, high=high, history=history,
        history_worth=gained, logits=logits, inside=there, worth=worth, d=d,
        clipped=clamp(held, 0, 1), samples=t, jitter=side.jitter, scale=scale,
    )  # fmt: skip


def accumulate(shown: Shown, logits: Array, guides: Array, given: Array) -> State:
    """What is written, and goes on."""
    large = enlarge_guides(guides, shown.scale)
    given = given + large[18:]
    filtered = filter_samples(shown.samples, guides, shown.scale, shown.jitter)
    moving = 1 - np.exp(-np.linalg.norm(shown.motion, axis=0) / C["STILL_PX"])
    share = 1 - (1 - 1 / (1 + np.exp(-given[2]))) * (1 - C["LEAST_FILTERED"] * moving)
    frame = shown.color + share * (filtered - shown.color)
    worth = shown.worth + share * (C["FILTERED_WORTH"] - shown.worth)
    hidden = (logits[0] + C["CAUTION"] >= np.maximum(logits[1], logits[2])) | ~shown.inside
    start = np.log(worth) - np.log(np.maximum(shown.history_worth, C["LEAST_HISTORY"]))
    a = np.where(shown.inside, 1 / (1 + np.exp(-(given[0] + start))), 1)
    s = 1 / (1 + np.exp(-given[1])) * moving
    h = shown.history + s * (shown.clipped - shown.history)
    low, high = (pick(around(shown.color, 1, None), axis=0) for pick in (np.min, np.max))
    rate, most = C["RANGE_RATE"], C["CGTS_MOST_LOGIT"]
    wide_low = np.minimum(low, shown.low + rate * (low - shown.low))
    wide_high = np.maximum(high, shown.high + rate * (high - shown.high))
    color = h + a * (frame - h)
    return State(
        color=color,
        shown=finish(color, large[9:18], np.tanh(given[3])),
        counter=np.where(hidden, 0, shown.counter + 1),
        worth=np.minimum(worth / a, C["CGTS_MOST_WORTH"]),
        low=np.where(hidden, low, wide_low),
        high=np.where(hidden, high, wide_high),
        d=shown.d,
        logits=clamp(logits, -most, most),
    )
