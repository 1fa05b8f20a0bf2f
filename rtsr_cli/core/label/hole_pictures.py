"""Pictures of holes: a panel for each past frame, the tests in colours.

Blue lies outside of the past frame; red is told by the stencil, green by normals, yellow by
positions, magenta by the depth along motion; where several tell, their mean. Grey has history,
lighter where a surface faces the camera; black panels have no past frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.shapes import Mask

COLORS: Mapping[str, tuple[float, float, float]] = {
    "outside": (0.20, 0.40, 1.00),
    "stencil": (1.00, 0.20, 0.15),
    "normal": (0.20, 0.85, 0.30),
    "position": (1.00, 0.85, 0.10),
    "depth": (0.90, 0.30, 0.90),
}
"""Display-encoded sRGB of each mask."""

DARKEST, LIGHTEST = 0.15, 0.55
"""Greys of surfaces that are seen from the side, and from the front."""


def draw_holes(panels: Iterable[Mapping[str, Mask]], frame: Frame) -> list[NDArray[np.uint8]]:
    """Draw a panel, h w 3, for each past frame.

    Args:
        panels: masks by name, of each past frame; those without a colour are not shown.
        frame: that the holes are of.
    """
    ground = _shade(frame)
    return [_draw_panel(masks, ground) for masks in panels]


def _shade(frame: Frame) -> Tensor:
    """Grey by the view cosine, where it is known."""
    facing = frame.gbuffer.buffers.get(Buffer.NOV)
    if facing is None:
        facing = torch.full_like(frame.gbuffer[Buffer.DEPTH], 0.5)
    return (DARKEST + (LIGHTEST - DARKEST) * facing).expand(-1, 3, -1, -1)


def _draw_panel(masks: Mapping[str, Mask], ground: Tensor) -> NDArray[np.uint8]:
    total, count = torch.zeros_like(ground), torch.zeros_like(ground[:, :1])
    for name, color in COLORS.items():
        if name in masks:
            total = total + masks[name] * ground.new_tensor(color).view(1, 3, 1, 1)
            count = count + masks[name]
    # what is a hole for no reason has no past frame at all
    seen = torch.where(masks["holes"] > 0, torch.zeros_like(ground), ground)
    drawn = torch.where(count > 0, total / count.clamp(min=1.0), seen)
    pixels: NDArray[np.uint8] = (drawn[0] * 255.0).round().byte().permute(1, 2, 0).cpu().numpy()
    return pixels
