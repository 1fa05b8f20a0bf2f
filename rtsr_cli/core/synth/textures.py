"""Baked texture patterns and looking them up.

A pattern is a tile of `TEXELS` x `TEXELS` texels that repeats without a seam. Each texel holds four
values: mask (0..1, which of two materials), tone (about -1..1, a variation of brightness), and the
slopes of a height field along u and v. All levels down to one texel are stored, each the mean of
the one below. Patterns are the same for every seed: scenes differ by colours, sizes and shifts.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.synth.glyphs import poster
from rtsr_cli.core.synth.scene import Pattern

TEXELS = 1024
LEVELS = int(math.log2(TEXELS)) + 1
CHANNELS = 4

Field: TypeAlias = NDArray[Any]
"""TEXELS x TEXELS values."""

Baked = tuple[Field, Field, Field]
"""Mask, tone and height (in periods)."""


def _axes() -> tuple[Field, Field]:
    """u along columns and v along rows, at texel centres."""
    centres = ((np.arange(TEXELS) + 0.5) / TEXELS).astype(np.float32)
    return centres[None, :], centres[:, None]


def _noise(seed: int, *, slope: float = 1.6, low: float = 2.0, stretch: float = 1.0) -> Field:
    """Seamless noise of unit deviation whose amplitude falls as frequency^-slope above `low`.

    `stretch` > 1 draws it out along u.
    """
    white = np.random.default_rng(seed).standard_normal((TEXELS, TEXELS), dtype=np.float32)
    fy = np.fft.fftfreq(TEXELS, 1.0 / TEXELS).astype(np.float32)[:, None]
    fx = np.fft.rfftfreq(TEXELS, 1.0 / TEXELS).astype(np.float32)[None, :] * stretch
    radius = np.sqrt(fx * fx + fy * fy)
    gain = np.maximum(radius, low) ** -slope
    gain[0, 0] = 0.0
    field = np.fft.irfft2(np.fft.rfft2(white) * gain, s=(TEXELS, TEXELS)).astype(np.float32)
    scaled: Field = field / field.std()
    return scaled


def _step(value: Field, width: float) -> Field:
    """0 below -width / 2, 1 above +width / 2, linear between."""
    share: Field = np.clip(value / width + 0.5, 0.0, 1.0).astype(np.float32)
    return share


def _cells(
    count_u: int, count_v: int, seed: int, offset: float = 0.0
) -> tuple[Field, Field, Field]:
    """Distance to the nearest cell border (periods) along u and v, and a random value a cell.

    Every other row is shifted by `offset` cells.
    """
    u, v = _axes()
    row = np.floor(v * count_v)
    x = u * count_u + offset * (row % 2)
    column = np.floor(x) % count_u
    fraction_u, fraction_v = x - np.floor(x), v * count_v - row
    along_u = np.minimum(fraction_u, 1 - fraction_u) / count_u
    along_v = np.minimum(fraction_v, 1 - fraction_v) / count_v + 0 * u
    values = np.random.default_rng(seed).uniform(-1, 1, (count_v, count_u)).astype(np.float32)
    picked = values[row.astype(int) + 0 * column.astype(int), column.astype(int)]
    return along_u.astype(np.float32), along_v.astype(np.float32), picked


def _zero() -> Field:
    return np.zeros((TEXELS, TEXELS), dtype=np.float32)


def _plain() -> Baked:
    return _zero() + 1.0, 0.35 * _noise(11, slope=1.2), 0.0006 * _noise(12)


def _checker() -> Baked:
    u, v = _axes()
    mask = ((np.floor(u * 4) + np.floor(v * 4)) % 2).astype(np.float32)
    return mask, 0.5 * _noise(21, slope=1.3, low=6), 0.0003 * _noise(22)


def _bricks() -> Baked:
    along_u, along_v, random = _cells(4, 8, 31, offset=0.5)
    rough = 0.0015 * _noise(32, slope=1.1, low=10)
    border = np.minimum(along_u, along_v) + rough
    mortar = 1.0 - _step(border - 0.009, 0.004)
    height = 0.010 * (1.0 - mortar) * _step(border - 0.016, 0.02) + 0.0012 * _noise(33, slope=1.4)
    return mortar, 0.7 * random + 0.35 * _noise(34, slope=0.9, low=8), height


def _tiles() -> Baked:
    along_u, along_v, random = _cells(4, 4, 41)
    border = np.minimum(along_u, along_v)
    grout = 1.0 - _step(border - 0.006, 0.002)
    height = 0.004 * _step(border - 0.01, 0.012)
    veins = np.abs(_noise(42, slope=2.0, low=3))
    return grout, 0.5 * random - np.exp(-veins * 18) + 0.2 * _noise(43, slope=1.0), height


def _planks() -> Baked:
    along_u, along_v, random = _cells(2, 8, 51, offset=0.5)
    gap = 1.0 - _step(np.minimum(along_u, along_v) - 0.0025, 0.0015)
    grain = _noise(52, slope=0.9, low=14, stretch=14.0)
    height = 0.003 * (1.0 - gap) + 0.0004 * grain
    return gap, 0.6 * random + 0.45 * grain, height


def _plaster() -> Baked:
    stain = _step(_noise(61, slope=1.9) - 0.6, 1.4)
    return stain, 0.45 * _noise(62, slope=0.8, low=16), 0.0010 * _noise(63, slope=1.3, low=12)


def _stripes() -> Baked:
    u, v = _axes()
    phase = (4 * u + 4 * v) % 1.0
    return _step(np.abs(phase - 0.5) - 0.25, 0.01), 0.4 * _noise(71, slope=1.1), _zero()


def _text() -> Baked:
    # v grows upwards on a wall, rows of a page downwards
    bitmap = poster(128)[::-1]
    mask = np.kron(bitmap, np.ones((TEXELS // 128, TEXELS // 128), dtype=np.float32))
    return mask, 0.25 * _noise(81, slope=1.2), 0.0004 * _noise(82, slope=1.2, low=30)


def _panels() -> Baked:
    along_u, along_v, random = _cells(2, 3, 91)
    border = np.minimum(along_u, along_v)
    seam = 1.0 - _step(border - 0.004, 0.002)
    rivet_u, rivet_v, _ = _cells(8, 12, 92)
    near = np.hypot(1 / 16 - rivet_u, 1 / 24 - rivet_v)
    rim = (border < 0.065).astype(np.float32)
    rivet = rim * (1.0 - _step(near - 0.008, 0.006))
    scratch = _noise(93, slope=0.6, low=20, stretch=0.06)
    height = 0.004 * (1.0 - seam) + 0.005 * rivet
    return np.maximum(seam, 0.6 * rivet), 0.5 * random + 0.25 * scratch, height


def _weave() -> Baked:
    u, v = _axes()
    a, b = np.sin(2 * np.pi * 48 * u), np.sin(2 * np.pi * 48 * v)
    mask = _step(a * b, 0.6)
    height = 0.0012 * (np.abs(a) * mask + np.abs(b) * (1 - mask))
    return mask, 0.4 * _noise(101, slope=1.4) + 0.2 * np.abs(a * b), height.astype(np.float32)


def _dots() -> Baked:
    along_u, along_v, random = _cells(6, 6, 111)
    centre = np.hypot(1 / 12 - along_u, 1 / 12 - along_v)
    radius = 0.035 + 0.02 * random
    return 1.0 - _step(centre - radius, 0.003), 0.3 * _noise(112, slope=1.1), _zero()


def _rust() -> Baked:
    field = _noise(121, slope=1.7, low=3)
    mask = _step(field - 0.5, 0.08)
    height = 0.0025 * mask * (0.4 + 0.6 * np.abs(_noise(122, slope=0.9, low=20)))
    return mask, 0.6 * _noise(123, slope=0.9, low=8), height


def _cobbles() -> Baked:
    """Rounded stones: the cells of jittered points, by their two nearest distances."""
    count = 9
    u, v = _axes()
    x, y = u * count + 0 * v, v * count + 0 * u
    shift = np.random.default_rng(131).uniform(0.1, 0.9, (3, count, count)).astype(np.float32)
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    nearest, second, value = _zero() + 9.0, _zero() + 9.0, _zero()
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            r, c = (row + i) % count, (column + j) % count
            distance = np.hypot(column + j + shift[0, r, c] - x, row + i + shift[1, r, c] - y)
            closer = distance < nearest
            second = np.where(closer, nearest, np.minimum(second, distance))
            value = np.where(closer, shift[2, r, c], value)
            nearest = np.where(closer, distance, nearest)
    border = (second - nearest).astype(np.float32)
    joint = 1.0 - _step(border - 0.12, 0.08)
    height = 0.02 * np.sqrt(np.clip(border, 0.0, 0.7)) + 0.0008 * _noise(132, slope=1.2)
    tone = 1.4 * (value - 0.5) + 0.3 * _noise(133, slope=0.9, low=8)
    return joint, tone.astype(np.float32), height.astype(np.float32)


def _windows() -> Baked:
    along_u, along_v, random = _cells(4, 4, 141)
    inside = np.minimum(along_u - 0.05, along_v - 0.035)
    bar_u, bar_v, _ = _cells(8, 8, 142)
    pane = _step(inside, 0.002) * _step(np.minimum(bar_u, bar_v) - 0.003, 0.002)
    return pane * (0.15 + 0.85 * (random > 0.1)), 0.4 * random, 0.006 * (1.0 - _step(inside, 0.01))


_BAKERS: Mapping[Pattern, Callable[[], Baked]] = {
    Pattern.PLAIN: _plain,
    Pattern.CHECKER: _checker,
    Pattern.BRICKS: _bricks,
    Pattern.TILES: _tiles,
    Pattern.PLANKS: _planks,
    Pattern.PLASTER: _plaster,
    Pattern.STRIPES: _stripes,
    Pattern.TEXT: _text,
    Pattern.PANELS: _panels,
    Pattern.WEAVE: _weave,
    Pattern.DOTS: _dots,
    Pattern.RUST: _rust,
    Pattern.COBBLES: _cobbles,
    Pattern.WINDOWS: _windows,
}


@dataclass(frozen=True)
class Texture:
    """Levels of a pattern, finest first, one after the other: (texels of all levels, 4), half."""

    texels: Tensor


_BASES = torch.tensor(
    [sum((TEXELS >> i) ** 2 for i in range(level)) for level in range(LEVELS)], dtype=torch.int32
)
"""First texel of each level."""


@functools.cache
def bake_texture(pattern: Pattern) -> Texture:
    """Bake a pattern; kept for the process (11 MiB each)."""
    mask, tone, height = _BAKERS[pattern]()
    slope_u = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * (TEXELS / 2)
    slope_v = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * (TEXELS / 2)
    level = np.stack([np.broadcast_to(p, height.shape) for p in (mask, tone, slope_u, slope_v)], -1)
    levels = []
    for _ in range(LEVELS):
        levels.append(level.reshape(-1, CHANNELS))
        half = max(1, level.shape[0] // 2)
        if level.shape[0] > 1:
            level = level.reshape(half, 2, half, 2, CHANNELS).mean(axis=(1, 3))
    return Texture(torch.from_numpy(np.concatenate(levels).astype(np.float16)))


def look_up(texels: Texture, u: Tensor, v: Tensor, level: Tensor) -> Tensor:
    """Trilinear look-up that repeats in u and v.

    Args:
        texels: a baked pattern.
        u, v: position in periods, one value a sample.
        level: 0 = finest; clamped to those there are.

    Returns:
        (samples, 4): mask, tone, slopes.
    """
    u, v = u - u.floor(), v - v.floor()
    level = level.clamp(0.0, LEVELS - 1.001)
    lower = level.floor()
    first = _bilinear(texels, u, v, lower.int())
    second = _bilinear(texels, u, v, lower.int() + 1)
    return first.lerp_(second, (level - lower)[:, None])


def _bilinear(texels: Texture, u: Tensor, v: Tensor, level: Tensor) -> Tensor:
    side = torch.bitwise_right_shift(torch.full_like(level, TEXELS), level)
    x, y = u * side - 0.5, v * side - 0.5
    x0, y0 = x.floor(), y.floor()
    last = side - 1
    left, top = x0.int() & last, y0.int() & last
    right, bottom = (left + 1) & last, (top + 1) & last
    base = _BASES.index_select(0, level)
    upper, lower = base + top * side, base + bottom * side
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]

    def row(start: Tensor) -> Tensor:
        a = texels.texels.index_select(0, start + left).float()
        return a.lerp_(texels.texels.index_select(0, start + right).float(), fx)

    return row(upper).lerp_(row(lower), fy)
