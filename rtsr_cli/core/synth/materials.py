"""Random materials by what they are made of."""

from __future__ import annotations

import colorsys
from dataclasses import replace

import numpy as np

from rtsr_cli.core.synth.scene import Material, Pattern, Vec3

Rng = np.random.Generator

GOLD: Vec3 = (0.91, 0.66, 0.28)
COPPER: Vec3 = (0.85, 0.45, 0.30)
STEEL: Vec3 = (0.56, 0.57, 0.58)
SILVER: Vec3 = (0.90, 0.89, 0.86)
BRASS: Vec3 = (0.80, 0.62, 0.33)
"""Base colours of metals, linear."""

INK: Vec3 = (0.03, 0.03, 0.035)


def color(
    rng: Rng, hue: tuple[float, float], saturation: tuple[float, float], value: tuple[float, float]
) -> Vec3:
    """Random linear colour within ranges of hue (turns), saturation and value."""
    h, s, v = (float(rng.uniform(*span)) for span in (hue, saturation, value))
    return colorsys.hsv_to_rgb(h % 1.0, s, v)


def any_color(rng: Rng) -> Vec3:
    """Paint of any hue."""
    return color(rng, (0.0, 1.0), (0.3, 0.9), (0.12, 0.7))


def grey(rng: Rng, low: float = 0.15, high: float = 0.6) -> Vec3:
    """Stone and concrete."""
    return color(rng, (0.03, 0.17), (0.02, 0.32), (low, high))


def _shift(rng: Rng) -> tuple[float, float]:
    u, v = rng.uniform(0.0, 1.0, 2).tolist()
    return u, v


def brick(rng: Rng) -> Material:
    """Brick wall with mortar."""
    return Material(
        pattern=Pattern.BRICKS,
        colors=(color(rng, (-0.02, 0.09), (0.3, 0.75), (0.15, 0.5)), grey(rng, 0.3, 0.65)),
        tone=0.45,
        roughness=(0.75, 0.95),
        bump=float(rng.uniform(0.8, 1.6)),
        size_m=float(rng.uniform(0.8, 1.6)),
        shift=_shift(rng),
    )


def tiles(rng: Rng) -> Material:
    """Glossy tiles with grout."""
    return Material(
        pattern=Pattern.TILES,
        colors=(any_color(rng) if rng.random() < 0.5 else grey(rng, 0.3, 0.75), grey(rng)),
        tone=0.3,
        roughness=(float(rng.uniform(0.12, 0.45)), 0.85),
        bump=1.0,
        size_m=float(rng.uniform(1.0, 2.4)),
        shift=_shift(rng),
    )


def checker(rng: Rng) -> Material:
    """Two-coloured checker, polished."""
    dark = color(rng, (0.0, 1.0), (0.0, 0.5), (0.03, 0.12))
    return Material(
        pattern=Pattern.CHECKER,
        colors=(color(rng, (0.05, 0.15), (0.0, 0.3), (0.5, 0.8)), dark),
        tone=0.2,
        roughness=(float(rng.uniform(0.12, 0.5)), float(rng.uniform(0.12, 0.5))),
        bump=0.3,
        size_m=float(rng.uniform(1.2, 4.0)),
        shift=_shift(rng),
    )


def planks(rng: Rng) -> Material:
    """Wooden boards."""
    wood = color(rng, (0.05, 0.1), (0.45, 0.75), (0.12, 0.5))
    return Material(
        pattern=Pattern.PLANKS,
        colors=(wood, INK),
        tone=0.45,
        roughness=(float(rng.uniform(0.3, 0.65)), 0.9),
        bump=1.0,
        size_m=float(rng.uniform(1.0, 2.2)),
        shift=_shift(rng),
    )


def plaster(rng: Rng) -> Material:
    """Stained plaster or concrete."""
    tinted = rng.random() < 0.4
    base = color(rng, (0.0, 1.0), (0.15, 0.55), (0.3, 0.7)) if tinted else grey(rng, 0.35, 0.75)
    stain = color(rng, (0.05, 0.3), (0.05, 0.3), (0.2, 0.5))
    return Material(
        pattern=Pattern.PLASTER,
        colors=(base, stain),
        tone=0.25,
        roughness=(0.9, 0.75),
        bump=float(rng.uniform(0.4, 1.2)),
        size_m=float(rng.uniform(2.0, 4.0)),
        shift=_shift(rng),
    )


def cobbles(rng: Rng) -> Material:
    """Paving stones; wet ones shine."""
    wet = rng.random() < 0.35
    return Material(
        pattern=Pattern.COBBLES,
        colors=(grey(rng, 0.2, 0.5), grey(rng, 0.05, 0.15)),
        tone=0.5,
        roughness=(0.25, 0.5) if wet else (0.75, 0.95),
        bump=float(rng.uniform(0.5, 0.9)),
        size_m=float(rng.uniform(1.2, 2.4)),
        shift=_shift(rng),
    )


def stripes(rng: Rng) -> Material:
    """Painted stripes."""
    return Material(
        pattern=Pattern.STRIPES,
        colors=(any_color(rng), INK if rng.random() < 0.5 else grey(rng, 0.6, 0.85)),
        tone=0.2,
        roughness=(0.45, 0.5),
        size_m=float(rng.uniform(0.4, 1.2)),
        shift=_shift(rng),
    )


def dots(rng: Rng) -> Material:
    """Dots on paint or cloth."""
    return Material(
        pattern=Pattern.DOTS,
        colors=(any_color(rng), grey(rng, 0.5, 0.85)),
        roughness=(0.5, 0.6),
        size_m=float(rng.uniform(0.4, 1.0)),
        shift=_shift(rng),
    )


def weave(rng: Rng) -> Material:
    """Cloth."""
    base = any_color(rng)
    r, g, b = (0.55 * c for c in base)
    return Material(
        pattern=Pattern.WEAVE,
        colors=(base, (r, g, b)),
        tone=0.3,
        roughness=(0.85, 0.95),
        bump=1.2,
        size_m=float(rng.uniform(0.3, 0.7)),
        shift=_shift(rng),
    )


def text(rng: Rng) -> Material:
    """Printed page or sign; `size_m` is the page."""
    dark = rng.random() < 0.35
    paper, ink = grey(rng, 0.6, 0.85), color(rng, (0.0, 1.0), (0.0, 0.9), (0.02, 0.25))
    return Material(
        pattern=Pattern.TEXT,
        colors=(ink, paper) if dark else (paper, ink),
        tone=0.12,
        roughness=(0.5, 0.4),
        bump=0.3,
        size_m=1.0,
        shift=(0.5, 0.5),
    )


def metal(rng: Rng) -> Material:
    """Bare metal, from brushed to polished."""
    base = (GOLD, COPPER, STEEL, SILVER, BRASS)[int(rng.integers(5))]
    roughness = float(rng.uniform(0.1, 0.45))
    return Material(
        pattern=Pattern.PLAIN,
        colors=(base, base),
        tone=0.12,
        roughness=(roughness, roughness),
        metallic=(1.0, 1.0),
        bump=0.4,
        size_m=float(rng.uniform(0.5, 1.5)),
        shift=_shift(rng),
    )


def panels(rng: Rng) -> Material:
    """Riveted metal plates, painted or bare."""
    painted = rng.random() < 0.5
    return Material(
        pattern=Pattern.PANELS,
        colors=(any_color(rng) if painted else STEEL, (0.25, 0.25, 0.26)),
        tone=0.25,
        roughness=(float(rng.uniform(0.3, 0.55)), 0.4),
        metallic=(0.0 if painted else 1.0, 1.0),
        bump=1.0,
        size_m=float(rng.uniform(1.0, 2.5)),
        shift=_shift(rng),
    )


def rust(rng: Rng) -> Material:
    """Metal that rusts in patches."""
    return Material(
        pattern=Pattern.RUST,
        colors=(STEEL if rng.random() < 0.6 else any_color(rng), (0.30, 0.11, 0.05)),
        tone=0.35,
        roughness=(0.3, 0.9),
        metallic=(1.0, 0.0),
        bump=1.0,
        size_m=float(rng.uniform(0.8, 2.0)),
        shift=_shift(rng),
    )


def paint(rng: Rng) -> Material:
    """Plain paint or plastic."""
    base = any_color(rng)
    roughness = float(rng.uniform(0.15, 0.8))
    return Material(
        colors=(base, base),
        tone=0.08,
        roughness=(roughness, roughness),
        bump=0.2,
        size_m=float(rng.uniform(0.5, 2.0)),
        shift=_shift(rng),
    )


def windows(rng: Rng) -> Material:
    """A facade with windows, some of them lit."""
    glow = color(rng, (0.08, 0.14), (0.2, 0.6), (0.6, 1.0)) if rng.random() < 0.5 else (0.0,) * 3
    return Material(
        pattern=Pattern.WINDOWS,
        colors=(grey(rng, 0.2, 0.6), (0.04, 0.05, 0.06)),
        tone=0.2,
        roughness=(0.8, 0.12),
        bump=0.6,
        glow=glow,
        size_m=float(rng.uniform(5.0, 8.0)),
        shift=_shift(rng),
    )


def lamp(glow: Vec3) -> Material:
    """A shining surface."""
    return Material(colors=((0.7,) * 3, (0.7,) * 3), roughness=(0.4, 0.4), tone=0.05, glow=glow)


def at_size(material: Material, size_m: float) -> Material:
    """Return the material with another period."""
    return replace(material, size_m=size_m)


FLOORS = (checker, tiles, planks, cobbles, plaster, panels)
WALLS = (brick, plaster, tiles, panels, planks)
THINGS = (paint, metal, rust, stripes, dots, weave, planks, tiles, panels, checker, brick)
GROUNDS = (cobbles, checker, tiles, plaster, brick)


def one_of(rng: Rng, makers: tuple) -> Material:  # type: ignore[type-arg]
    """Material of a random kind."""
    material: Material = makers[int(rng.integers(len(makers)))](rng)
    return material
