"""Lines in a plot, as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

WIDTH, HEIGHT, LEFT, TOP, LOW, RIGHT = 640, 320, 60, 24, 58, 12
COLORS = ("#1f77b4", "#d6601f", "#2ca02c", "#9467bd", "#8c564b")
TICKS = 5


@dataclass(frozen=True)
class Curve:
    """A name and points (x, y)."""

    name: str
    points: Sequence[tuple[float, float]]


def drawn(curves: Sequence[Curve], *, across: str, up: str) -> str:
    """Draw curves over axes that start at 0; values below are drawn at 0."""
    right = max(x for curve in curves for x, _ in curve.points) or 1.0
    top = 1.1 * max(y for curve in curves for _, y in curve.points) or 1.0
    wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - LOW

    def place(x: float, y: float) -> tuple[float, float]:
        return LEFT + wide * x / right, TOP + high * (1.0 - max(0.0, y) / top)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
    ]
    for step in range(TICKS):
        share = step / (TICKS - 1)
        _, y = place(0.0, top * share)
        x, floor = place(right * share, 0.0)
        parts += [
            f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>',
            f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{top * share:.3g}</text>',
            f'<text x="{x:.1f}" y="{floor + 16:.1f}" text-anchor="middle">'
            f"{right * share:.3g}</text>",
        ]
    for number, curve in enumerate(curves):
        color = COLORS[number % len(COLORS)]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*p) for p in curve.points))
        parts += [
            f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>',
            f'<text x="{LEFT + 120 * number}" y="{HEIGHT - 6}" fill="{color}">{curve.name}</text>',
        ]
    middle = LEFT + wide / 2
    parts += [
        f'<text x="{LEFT}" y="16">{up}</text>',
        f'<text x="{middle:.0f}" y="{HEIGHT - 26}" text-anchor="middle">{across}</text></svg>',
    ]
    return "\n".join(parts) + "\n"
