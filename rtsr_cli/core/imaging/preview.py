"""Radiance as 8-bit pictures, for people to look at."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.imaging.primaries import to_rec709
from rtsr_cli.core.shapes import Color


def encode_preview(color: Color, space: ColorSpace | None = None) -> NDArray[np.uint8]:
    """Linear radiance to display: Rec.709, c/(1+c), sRGB curve, 8 bit; non-finite pixels magenta.

    Args:
        color: linear radiance.
        space: its primaries; None is taken for Rec.709.
    """
    linear = to_rec709(torch.nan_to_num(color[0:1].float()), space)
    encoded = encode_srgb(encode_reinhard(linear))[0]
    finite = torch.isfinite(color[0]).all(0)
    magenta = torch.tensor([1.0, 0.0, 1.0]).view(3, 1, 1)
    pixels = torch.where(finite.cpu(), encoded.cpu(), magenta)
    array: NDArray[np.uint8] = (pixels * 255.0 + 0.5).to(torch.uint8).permute(1, 2, 0).numpy()
    return array
