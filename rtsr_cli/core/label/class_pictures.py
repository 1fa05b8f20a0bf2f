"""Pictures of classes: two panels, ghosting and aliasing in colours over the frame in grey.

Ghosting: red shows that history holds another surface, blue that the pixel was outside, yellow that
light changed. Aliasing: green is geometry, magenta texture.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb, luminance
from rtsr_cli.core.imaging.pixel_classes import PixelClasses
from rtsr_cli.core.imaging.resampling import box_mean
from rtsr_cli.core.shapes import Color, Mask

Shade = tuple[float, float, float]

VISIBILITY: Shade = (1.00, 0.20, 0.15)
OUTSIDE: Shade = (0.20, 0.40, 1.00)
SHADING: Shade = (1.00, 0.85, 0.10)
GEOMETRY: Shade = (0.20, 0.85, 0.30)
TEXTURE: Shade = (0.90, 0.30, 0.90)
"""Display-encoded sRGB of each class."""

LIGHTEST = 0.6
"""Grey of what is white in the frame: classes stand out."""


def draw_classes(classes: PixelClasses, color: Color, k: int) -> list[NDArray[np.uint8]]:
    """Draw a panel of ghosting and one of aliasing, h w 3.

    Args:
        classes: of the frame's pixels.
        color: linear radiance of its samples.
        k: samples of a pixel along an axis.
    """
    grey = encode_srgb(encode_reinhard(luminance(box_mean(color, k))))
    ground = (LIGHTEST * grey).expand(-1, 3, -1, -1)
    ghosting = {VISIBILITY: classes.visibility, OUTSIDE: classes.outside, SHADING: classes.shading}
    aliasing = {GEOMETRY: classes.geometry, TEXTURE: classes.texture}
    return [_paint(ground, ghosting), _paint(ground, aliasing)]


def _paint(ground: Tensor, masks: Mapping[Shade, Mask]) -> NDArray[np.uint8]:
    for shade, mask in masks.items():
        ground = torch.where(mask > 0, ground.new_tensor(shade).view(1, 3, 1, 1), ground)
    pixels: NDArray[np.uint8] = (ground[0] * 255.0).round().byte().permute(1, 2, 0).cpu().numpy()
    return pixels
