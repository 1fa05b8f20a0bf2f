"""Rectangles of pixels: data windows, display windows, and what lies in both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction


@dataclass(frozen=True, kw_only=True)
class PixelWindow:
    """A rectangle of pixels: first pixel (`left`, `top`), size (`width`, `height`)."""

    left: int
    top: int
    width: int
    height: int

    def seen_from(self, display: PixelWindow) -> PixelWindow:
        """Return where it lies in an image plane, whatever that one's origin."""
        return self.moved(-display.left, -display.top)

    def moved(self, right: int, down: int) -> PixelWindow:
        """Return the same rectangle elsewhere."""
        return replace(self, left=self.left + right, top=self.top + down)

    def holds(self, other: PixelWindow) -> bool:
        """Tell whether another rectangle lies inside."""
        return (
            self.left <= other.left
            and self.top <= other.top
            and self.left + self.width >= other.left + other.width
            and self.top + self.height >= other.top + other.height
        )

    def joined(self, other: PixelWindow) -> PixelWindow:
        """Return the smallest rectangle around this and another."""
        left, top = min(self.left, other.left), min(self.top, other.top)
        right = max(self.left + self.width, other.left + other.width)
        bottom = max(self.top + self.height, other.top + other.height)
        return PixelWindow(left=left, top=top, width=right - left, height=bottom - top)

    def __str__(self) -> str:
        """As users write it: 64 x 48 at (0, 0)."""
        return f"{self.width} x {self.height} at ({self.left}, {self.top})"

    def common(self, other: PixelWindow) -> PixelWindow | None:
        """Return the rectangle that lies in this and in another; None if there is none."""
        left, top = max(self.left, other.left), max(self.top, other.top)
        width = min(self.left + self.width, other.left + other.width) - left
        height = min(self.top + self.height, other.top + other.height) - top
        if width < 1 or height < 1:
            return None
        return PixelWindow(left=left, top=top, width=width, height=height)

    def at_ratio(self, ratio: Fraction) -> PixelWindow:
        """Return the pixels that the rectangle touches at `ratio` times the resolution."""
        left, top = math.floor(self.left * ratio), math.floor(self.top * ratio)
        right = math.ceil((self.left + self.width) * ratio)
        bottom = math.ceil((self.top + self.height) * ratio)
        return PixelWindow(left=left, top=top, width=right - left, height=bottom - top)
