"""Things that stand, hang and fly about in scenes, each a tuple of parts."""

from __future__ import annotations

import math

import numpy as np

from rtsr_cli.core.synth import materials as mat
from rtsr_cli.core.synth.scene import Material, Part, Shape, Vec3

Rng = np.random.Generator
Parts = tuple[Part, ...]

QUARTER = math.pi / 2.0


def box(
    half: Vec3, material: Material, at: Vec3 = (0.0, 0.0, 0.0), turn: Vec3 = (0.0, 0.0, 0.0)
) -> Part:
    """A box about a point."""
    return Part(shape=Shape.BOX, half_m=half, material=material, offset_m=at, turn=turn)


def ball(radius: float, material: Material, at: Vec3 = (0.0, 0.0, 0.0)) -> Part:
    """A sphere about a point."""
    return Part(shape=Shape.SPHERE, half_m=(radius,) * 3, material=material, offset_m=at)


def rod(
    radius: float, half_length: float, material: Material, at: Vec3 = (0.0, 0.0, 0.0),
    turn: Vec3 = (0.0, 0.0, 0.0),
) -> Part:  # fmt: skip
    """A cylinder about a point, upright unless turned."""
    half = (radius, radius, half_length)
    return Part(shape=Shape.CYLINDER, half_m=half, material=material, offset_m=at, turn=turn)


def crate(rng: Rng, size: float) -> Parts:
    """A box, sometimes with a smaller one on top."""
    half = (size, size * float(rng.uniform(0.7, 1.3)), size * float(rng.uniform(0.6, 1.4)))
    parts = [box(half, mat.one_of(rng, mat.THINGS), (0.0, 0.0, half[2]))]
    if rng.random() < 0.4:
        small = 0.5 * size
        at = (float(rng.uniform(-0.3, 0.3)) * size, 0.0, 2 * half[2] + small)
        parts.append(
            box((small,) * 3, mat.one_of(rng, mat.THINGS), at, (0.0, 0.0, float(rng.uniform(0, 1))))
        )
    return tuple(parts)


def globe(rng: Rng, size: float) -> Parts:
    """A ball on the ground."""
    return (ball(size, mat.one_of(rng, mat.THINGS), (0.0, 0.0, size)),)


def table(rng: Rng, size: float) -> Parts:
    """A table with thin legs and things on it."""
    height, half_x, half_y = 0.74, size * 1.5, size
    top, leg = mat.one_of(rng, (mat.planks, mat.paint, mat.tiles, mat.metal)), mat.metal(rng)
    parts = [box((half_x, half_y, 0.02), top, (0.0, 0.0, height))]
    parts += [
        rod(
            0.02,
            height / 2 - 0.01,
            leg,
            (x * (half_x - 0.06), y * (half_y - 0.06), height / 2 - 0.01),
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    for _ in range(int(rng.integers(1, 4))):
        x, y = float(rng.uniform(-0.7, 0.7)) * half_x, float(rng.uniform(-0.7, 0.7)) * half_y
        small = float(rng.uniform(0.05, 0.13))
        material = mat.at_size(mat.one_of(rng, mat.THINGS), 0.3)
        base = height + 0.02
        parts.append(
            ball(small, material, (x, y, base + small))
            if rng.random() < 0.5
            else rod(small * 0.7, small, material, (x, y, base + small))
        )
    return tuple(parts)


def shelf(rng: Rng, size: float) -> Parts:
    """Boards with books of many colours."""
    width, depth, boards = size * 1.1, 0.16, 4
    wood = mat.planks(rng)
    parts = [box((0.02, depth, 0.95), wood, (x * width, 0.0, 0.95)) for x in (-1, 1)]
    for board in range(boards):
        z = 0.1 + 0.5 * board
        parts.append(box((width, depth, 0.015), wood, (0.0, 0.0, z)))
        x = -width + 0.1
        while x < width - 0.2 and board < boards - 1:
            half = float(rng.uniform(0.03, 0.09))
            tall = float(rng.uniform(0.1, 0.2))
            if rng.random() < 0.75:
                cover = mat.at_size(mat.one_of(rng, (mat.paint, mat.text, mat.stripes)), 0.35)
                at = (x + half, -0.02, z + 0.015 + tall)
                parts.append(box((half, depth * 0.8, tall), cover, at))
            x += 2 * half + 0.01
    return tuple(parts)


def column(rng: Rng, size: float) -> Parts:
    """A round column on a square foot."""
    stone = mat.one_of(rng, (mat.plaster, mat.tiles, mat.brick))
    radius, height = 0.45 * size, float(rng.uniform(2.4, 3.6))
    return (
        box((radius * 1.3, radius * 1.3, 0.12), stone, (0.0, 0.0, 0.12)),
        rod(radius, height / 2, stone, (0.0, 0.0, 0.24 + height / 2)),
        box((radius * 1.3, radius * 1.3, 0.1), stone, (0.0, 0.0, 0.34 + height)),
    )


def railing(rng: Rng, size: float) -> Parts:
    """A fence of thin bars."""
    iron = mat.one_of(rng, (mat.metal, mat.rust, mat.paint))
    length, height = size * 2.4, 0.95
    count = int(length * 2 / 0.16)
    radius = float(rng.uniform(0.008, 0.018))
    step = 2 * length / count
    parts = [
        rod(radius, height / 2, iron, (-length + (i + 0.5) * step, 0.0, height / 2))
        for i in range(count)
    ]
    parts += [rod(0.022, length, iron, (0.0, 0.0, z), (0.0, QUARTER, 0.0)) for z in (0.12, height)]
    return tuple(parts)


def sign(rng: Rng, size: float) -> Parts:
    """A board of text on two posts."""
    half = size * 0.9
    page = mat.at_size(mat.text(rng), 2 * half)
    post = mat.metal(rng)
    height = float(rng.uniform(0.5, 1.1))
    parts = [box((half, 0.02, half), page, (0.0, 0.0, height + half))]
    parts += [
        rod(0.03, (height + half) / 2, post, (x * half * 0.8, 0.05, (height + half) / 2))
        for x in (-1, 1)
    ]
    return tuple(parts)


def mobile(rng: Rng, size: float) -> Parts:
    """Crossed bars with weights at their ends: shows rotation well."""
    bar, length = mat.metal(rng), size * 1.1
    parts = [
        rod(0.025, length, bar, turn=(0.0, QUARTER, 0.0)),
        rod(0.025, length, bar, turn=(QUARTER, 0.0, 0.0)),
        ball(0.22 * size, mat.one_of(rng, mat.THINGS)),
    ]
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        at = (x * length, y * length, 0.0)
        material = mat.one_of(rng, mat.THINGS)
        half = 0.16 * size
        parts.append(
            ball(half, material, at) if rng.random() < 0.5 else box((half,) * 3, material, at)
        )
    return tuple(parts)


def flyer(rng: Rng, size: float) -> Parts:
    """A small craft: hull, wings, fin, lamp."""
    hull = mat.one_of(rng, (mat.panels, mat.stripes, mat.metal, mat.rust, mat.paint))
    wing = mat.one_of(rng, mat.THINGS)
    glow = mat.color(rng, (0.0, 1.0), (0.3, 0.9), (2.0, 6.0))
    return (
        box((0.55 * size, 0.22 * size, 0.18 * size), hull),
        box((0.18 * size, 0.85 * size, 0.03 * size), wing, (-0.05 * size, 0.0, 0.05 * size)),
        box((0.12 * size, 0.025 * size, 0.25 * size), wing, (-0.42 * size, 0.0, 0.3 * size)),
        rod(0.1 * size, 0.2 * size, mat.metal(rng), (0.6 * size, 0.0, 0.0), (0.0, QUARTER, 0.0)),
        ball(0.07 * size, mat.lamp(glow), (-0.56 * size, 0.0, 0.0)),
    )


def tumbler(rng: Rng, size: float) -> Parts:
    """A box or barrel that turns over."""
    material = mat.one_of(rng, (*mat.THINGS, mat.text))
    if rng.random() < 0.6:
        half = 0.45 * size
        return (box((half, half * 0.8, half * 1.1), mat.at_size(material, 2 * half)),)
    return (rod(0.32 * size, 0.5 * size, material),)


STANDING = (crate, globe, table, column, sign, railing, crate, globe, shelf)
FLYING = (mobile, flyer, tumbler, flyer, tumbler)
