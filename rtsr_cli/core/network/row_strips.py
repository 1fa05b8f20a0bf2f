"""Running convolutions over a large frame strip by strip: the same result in less memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import Tensor


def run_in_strips(
    run: Callable[[Mapping[str, Tensor]], Tensor],
    images: Mapping[str, Tensor],
    *,
    rows: int,
    halo: int,
) -> Tensor:
    """Run a function of images on horizontal strips, and join what it gives.

    Args:
        run: named images -> an image; an output row depends on `halo` rows to each side.
        images: n c H w each; heights are whole multiples of the smallest, that of LR.
        rows: LR rows of a strip, without its halo.
        halo: LR rows.

    Returns:
        What `run` gives for the whole, up to rounding.
    """
    height = min(image.shape[2] for image in images.values())
    if height <= rows:
        return run(images)
    parts = []
    for top in range(0, height, rows):
        bottom = min(height, top + rows)
        first, last = max(0, top - halo), min(height, bottom + halo)
        strip = run({name: _cut_rows(image, height, first, last) for name, image in images.items()})
        scale = strip.shape[2] // (last - first)
        parts.append(strip[:, :, (top - first) * scale : (bottom - first) * scale])
    return torch.cat(parts, dim=2)


def _cut_rows(image: Tensor, height: int, first: int, last: int) -> Tensor:
    """Rows of an image that cover LR rows."""
    scale = image.shape[2] // height
    return image[:, :, first * scale : last * scale]
