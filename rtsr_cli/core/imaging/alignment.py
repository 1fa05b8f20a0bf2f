"""Bringing HR pixels and LR samples into one fixed relation, whatever the jitter.

A network that unshuffles S x S HR pixels into one LR pixel learns where in that block the LR
sample lies. `block_shift` moves the HR grid by whole pixels so that it is sample (S//2, S//2).
"""

from __future__ import annotations

import math

import torch

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.shapes import Image


def block_shift(jitter_px: Jitter, scale: int) -> tuple[int, int]:
    """Whole HR pixels (x, y) from sample S//2 of each block to the LR sample.

    shift = round((0.5 + jitter) S - 0.5 - S//2)      per axis; half a pixel rounds up
    """
    x, y = (math.floor((0.5 + j) * scale - scale // 2 + 1e-6) for j in jitter_px)
    return x, y


def shift_jitter(jitter_px: Jitter, scale: int) -> Jitter:
    """Where LR samples lie in the blocks of a grid moved by `block_shift`, minus their centres."""
    x, y = block_shift(jitter_px, scale)
    return jitter_px[0] - x / scale, jitter_px[1] - y / scale


def shift_image(image: Image, shift: tuple[int, int]) -> Image:
    """out(p) = image(p + shift), borders replicated."""
    if shift == (0, 0):
        return image
    shifted = torch.empty_like(image)
    (to_x, from_x), (to_y, from_y) = (
        _overlap(offset, side) for offset, side in zip(shift, image.shape[:-3:-1], strict=True)
    )
    shifted[..., to_y, to_x] = image[..., from_y, from_x]
    # columns of the rows that are there, then whole rows
    middle = shifted[..., to_y, :]
    middle[..., : to_x.start] = middle[..., to_x.start, None]
    middle[..., to_x.stop :] = middle[..., to_x.stop - 1, None]
    shifted[..., : to_y.start, :] = shifted[..., to_y.start, None, :]
    shifted[..., to_y.stop :, :] = shifted[..., to_y.stop - 1, None, :]
    return shifted


def _overlap(offset: int, side: int) -> tuple[slice, slice]:
    """Where along an axis a shifted image lies in the result, and what part of it that is."""
    offset = max(1 - side, min(side - 1, offset))
    first, last = max(0, -offset), min(side, side - offset)
    return slice(first, last), slice(first + offset, last + offset)
