"""Motion vectors as files store them, and the one convention in memory.

In memory: pixels of the buffer's own resolution, (dx, dy), x right, y down, **previous minus
current**, jitter excluded, so that `previous_position = position + motion_px`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import torch

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


class YAxis(StrEnum):
    """Which way a positive second component points on the screen."""

    DOWN = "down"
    UP = "up"


@dataclass(frozen=True, kw_only=True)
class MotionConvention:
    """How a *file* stores motion; the defaults are the convention in memory.

    Attributes:
        unit: pixels of the buffer's own size, share of the screen (uv), or -1..1 across it (ndc).
        direction: whether the stored vector leads to the previous frame or from it.
        y_axis: sense of the second component.
        jittered: True where the vectors contain the difference of the two frames' jitter.
        scale: factor on both components, for what the fields above cannot say.
    """

    unit: MotionUnit = MotionUnit.PIXELS
    direction: MotionDirection = MotionDirection.PREVIOUS_MINUS_CURRENT
    y_axis: YAxis = YAxis.DOWN
    jittered: bool = False
    scale: float = 1.0

    def factors(self, size: Size) -> tuple[float, float]:
        """Factors (x, y) that turn a stored vector of an image of `size` into `motion_px`."""
        height, width = size
        unit_x, unit_y = {
            MotionUnit.PIXELS: (1.0, 1.0),
            MotionUnit.UV: (float(width), float(height)),
            MotionUnit.NDC: (width / 2.0, height / 2.0),
        }[self.unit]
        sign = 1.0 if self.direction is MotionDirection.PREVIOUS_MINUS_CURRENT else -1.0
        sign_y = sign if self.y_axis is YAxis.DOWN else -sign
        return sign * unit_x * self.scale, sign_y * unit_y * self.scale


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
    x, y = convention.factors(screen or (stored.shape[-2], stored.shape[-1]))
    motion_px = stored * torch.tensor([x, y], dtype=stored.dtype).view(1, 2, 1, 1)
    if not convention.jittered:
        return motion_px
    shift = [jitter_px_prev[0] - jitter_px[0], jitter_px_prev[1] - jitter_px[1]]
    return motion_px + torch.tensor(shift, dtype=stored.dtype).view(1, 2, 1, 1)


def motion_from_pixels(
    motion_px: MotionPx,
    convention: MotionConvention,
    *,
    screen: Size | None = None,
    jitter_px: Jitter = (0.0, 0.0),
    jitter_px_prev: Jitter = (0.0, 0.0),
) -> MotionPx:
    """Invert `motion_to_pixels`: what a file of this convention stores."""
    x, y = convention.factors(screen or (motion_px.shape[-2], motion_px.shape[-1]))
    if convention.jittered:
        shift = [jitter_px_prev[0] - jitter_px[0], jitter_px_prev[1] - jitter_px[1]]
        motion_px = motion_px - torch.tensor(shift, dtype=motion_px.dtype).view(1, 2, 1, 1)
    return motion_px / torch.tensor([x, y], dtype=motion_px.dtype).view(1, 2, 1, 1)
