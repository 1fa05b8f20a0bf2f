"""What a frame looks like when it is shaded at a reduced rate, from one shaded at full rate.

A full-screen lighting pass at a rate of A x B evaluates one pixel of each block and shows it on all
of them; silhouettes get blocky, too. Everything after it runs at full rate.
"""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.shapes import Color, IdMap
from rtsr_cli.core.vrs.rates import ShadingRate


def sample_index(extent: int, step: int, *, device: torch.device) -> Tensor:
    """Along an axis, the pixel whose sample each pixel shows: step // 2 of its block."""
    index = torch.arange(extent, device=device)
    return (index // step * step + step // 2).clamp(max=extent - 1)


def shade_coarsely(color: Color, rate: ShadingRate, object_id: IdMap | None = None) -> Color:
    """Repeat one sample of each block over it.

    Args:
        color: linear radiance at full rate.
        rate: pixels of a block.
        object_id: with it, a pixel of another object than the sample's keeps its own radiance, as
            when triangles are drawn at a reduced rate.
    """
    height, width = color.shape[-2:]
    rows = sample_index(height, rate.down, device=color.device)
    columns = sample_index(width, rate.across, device=color.device)

    def repeat_samples(image: Tensor) -> Tensor:
        return image.index_select(-2, rows).index_select(-1, columns)

    coarse = repeat_samples(color)
    if object_id is None:
        return coarse
    return torch.where(repeat_samples(object_id) == object_id, coarse, color)
