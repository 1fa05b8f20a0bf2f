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
    height, width = image.shape[-2:]
    columns = torch.arange(width, device=image.device).add(shift[0]).clamp(0, width - 1)
    rows = torch.arange(height, device=image.device).add(shift[1]).clamp(0, height - 1)
    return image.index_select(-2, rows).index_select(-1, columns)
