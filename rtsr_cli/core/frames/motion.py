"""Motion vectors as files store them, and the one convention in memory.

In memory: pixels of the buffer's own resolution, (dx, dy), x right, y down, **previous minus
current**, jitter excluded, so that `previous_position = position + motion_px`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import torch
from torch import Tensor

from rtsr_cli.core.shapes import MotionPx, Size

Jitter = tuple[float, float]
"""Sample position minus pixel centre, (x right, y down), in pixels of its own resolution."""


class MotionUnit(StrEnum):
    """What a stored vector of 1 means."""

    PIXELS = "pixels"
    UV = "uv"
    NDC = "ndc"


class MotionDirection(StrEnum):
    """Which way a stored vector points."""

    PREVIOUS_MINUS_CURRENT = "previous-minus-current"
    CURRENT_MINUS_PREVIOUS = "current-minus-previous"
    NEXT_MINUS_CURRENT = "next-minus-current"
    CURRENT_MINUS_NEXT = "current-minus-next"

    @property
    def to_next(self) -> bool:
        """Tell whether the vectors are about the next frame, not the previous one."""
        return self in {self.NEXT_MINUS_CURRENT, self.CURRENT_MINUS_NEXT}

    @property
    def sign(self) -> float:
        """Factor that turns a stored vector into other frame minus current."""
        away = {self.CURRENT_MINUS_PREVIOUS, self.CURRENT_MINUS_NEXT}
        return -1.0 if self in away else 1.0


class YAxis(StrEnum):
    """Which way a positive vertical component points on the screen."""

    DOWN = "down"
    UP = "up"


class Axes(StrEnum):
    """Which component is stored first."""

    XY = "xy"
    YX = "yx"


@dataclass(frozen=True, kw_only=True)
class MotionConvention:
    """How a *file* stores motion; the defaults are the convention in memory.

    Attributes:
        unit: pixels of the buffer's own size, share of the screen (uv), or -1..1 across it (ndc).
        direction: where the stored vector leads; vectors to the next frame are `forward` buffers.
        y_axis: sense of the vertical component.
        axes: order of the components.
        jittered: True where the vectors contain the difference of the two frames' jitter.
        jitter_inverted: True where they contain it with the opposite sign.
        scale: factor on both components, for what the fields above cannot say.
        zero: stored value of no motion (0.5 in files that centre their vectors).
        file_offset: the vectors of a frame are in the file this many frames later.
    """

    unit: MotionUnit = MotionUnit.PIXELS
    direction: MotionDirection = MotionDirection.PREVIOUS_MINUS_CURRENT
    y_axis: YAxis = YAxis.DOWN
    axes: Axes = Axes.XY
    jittered: bool = False
    jitter_inverted: bool = False
    scale: float = 1.0
    zero: float = 0.0
    file_offset: int = 0

    @property
    def forward(self) -> MotionConvention:
        """How vectors to the next frame are stored beside these.

        A file that holds one kind only declares its direction; where `direction` is about the
        previous frame, forward vectors lead to the next one, in the same unit and axes.
        """
        direction = self.direction if self.direction.to_next else MotionDirection.NEXT_MINUS_CURRENT
        return replace(self, direction=direction, jittered=False)

    def factors(self, size: Size) -> tuple[float, float]:
        """Factors (x, y) that turn a stored vector of an image of `size` into pixels.

        The result leads to the previous frame, or to the next one where `direction` says so.
        """
        height, width = size
        unit_x, unit_y = {
            MotionUnit.PIXELS: (1.0, 1.0),
            MotionUnit.UV: (float(width), float(height)),
            MotionUnit.NDC: (width / 2.0, height / 2.0),
        }[self.unit]
        sign = self.direction.sign
        sign_y = sign if self.y_axis is YAxis.DOWN else -sign
        return sign * unit_x * self.scale, sign_y * unit_y * self.scale

    def pixels(self, stored: Tensor, size: Size, *, dim: int) -> Tensor:
        """Apply order, zero, sign and unit to vectors whose components lie along `dim`."""
        ordered = stored if self.axes is Axes.XY else stored.flip(dim)
        shape = [1] * stored.ndim
        shape[dim] = 2
        factors = torch.tensor(self.factors(size), dtype=stored.dtype, device=stored.device)
        return (ordered - self.zero) * factors.view(shape)

    def __str__(self) -> str:
        """Say it in words, the exceptional only where it holds."""
        parts = [f"{self.direction}", f"{self.unit}", f"y {self.y_axis}"]
        parts += [f"times {self.scale:g}"] if self.scale != 1.0 else []
        parts += [f"centred at {self.zero:g}"] if self.zero else []
        parts += ["components swapped (y, x)"] if self.axes is Axes.YX else []
        inverted = " inverted" if self.jitter_inverted else ""
        parts += [f"jitter included{inverted}"] if self.jittered else []
        if self.file_offset:
            where = "after" if self.file_offset > 0 else "before"
            parts.append(f"stored {abs(self.file_offset)} file {where} its frame")
        return ", ".join(parts)


def motion_to_pixels(
    stored: MotionPx,
    convention: MotionConvention,
    *,
    screen: Size | None = None,
    jitter_px: Jitter = (0.0, 0.0),
    jitter_px_prev: Jitter = (0.0, 0.0),
) -> MotionPx:
    """Convert stored vectors to `motion_px`.

    A renderer that leaves jitter in its vectors subtracts positions of two *shifted* images:
    a surface point at image position q appears at q - jitter in a frame whose samples lie at
    +jitter, so stored = motion - (jitter_prev - jitter), and the difference is added back.

    Args:
        stored: as read, (x, y) channels.
        convention: how the file stores them.
        screen: (height, width) that uv and ndc span; by default the size of `stored`.
        jitter_px: jitter of this frame, pixels of the same resolution.
        jitter_px_prev: jitter of the previous frame.
    """
    motion_px = convention.pixels(stored, screen or (stored.shape[-2], stored.shape[-1]), dim=1)
    if not convention.jittered:
        return motion_px
    shift = _jitter_shift(convention, jitter_px, jitter_px_prev)
    return motion_px + shift.to(motion_px).view(1, 2, 1, 1)


def motion_from_pixels(
    motion_px: MotionPx,
    convention: MotionConvention,
    *,
    screen: Size | None = None,
    jitter_px: Jitter = (0.0, 0.0),
    jitter_px_prev: Jitter = (0.0, 0.0),
) -> MotionPx:
    """Invert `motion_to_pixels`: what a file of this convention stores."""
    if convention.jittered:
        shift = _jitter_shift(convention, jitter_px, jitter_px_prev)
        motion_px = motion_px - shift.to(motion_px).view(1, 2, 1, 1)
    size = screen or (motion_px.shape[-2], motion_px.shape[-1])
    factors = torch.tensor(convention.factors(size), dtype=motion_px.dtype)
    stored = motion_px / factors.view(1, 2, 1, 1) + convention.zero
    return stored if convention.axes is Axes.XY else stored.flip(1)


def _jitter_shift(
    convention: MotionConvention, jitter_px: Jitter, jitter_px_prev: Jitter
) -> Tensor:
    """(x, y) to add to vectors that contain the difference of two frames' jitter."""
    sign = -1.0 if convention.jitter_inverted else 1.0
    pairs = zip(jitter_px_prev, jitter_px, strict=True)
    return torch.tensor([sign * (before - now) for before, now in pairs])
