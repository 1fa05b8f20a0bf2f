"""Lighting of surfaces that nothing seen belongs to: as what lies near, and faces as they do, is
lit.

    e(p) = (sum_q w(q) sqrt(e(q)) / sum_q w(q))^2
    w(q) = exp(-a (1 - n(p).n(q))) / (s^2 + |P(q) - P(p)|^2 / z(p)^2)

over the pixels q of a grid whose lighting is known, whatever surface they are of; a as surfaces are
told apart by (`core/imaging/surfaces.py`). Roots: one lamp beside many walls weighs less.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from rtsr_cli.core.imaging.enlargement import AVERAGE_LOG_LIGHTING
from rtsr_cli.core.imaging.surface_history import cut_chunks
from rtsr_cli.core.imaging.surfaces import FACING, PLANE_SHARE, Surfaces
from rtsr_cli.core.shapes import Image, Mask
from rtsr_cli.core.threads import share_among_threads

NEAR_SHARE = 0.14
"""s: distance, as a share of the depth, from which what lies farther away counts less."""

GRID_PIXELS = 2048
"""Pixels of the grid, about."""

PIXELS_AT_ONCE = 1 << 9
"""That are held against the grid by a thread."""


def guess_lighting(encoded: Image, known: Mask, own: Surfaces, pixels: Tensor) -> Tensor:
    """Guess e of some pixels, c k: that of lighting k where no pixel of the grid is known.

    Args:
        encoded: e of the frame, 1 c h w.
        known: 1 where it is known.
        own: surfaces of the frame.
        pixels: index where rows follow each other, k.
    """
    lit = find_grid(known)
    guessed = encoded.new_full((encoded.shape[1], len(pixels)), AVERAGE_LOG_LIGHTING)
    if not len(lit):
        return guessed
    normal, position = own.facing[0, :3].flatten(1), own.position[0].flatten(1)
    depth = own.tolerance[0, 0].flatten() / PLANE_SHARE
    roots = encoded[0].flatten(1)[:, lit].clamp(min=0.0).sqrt()
    values = torch.cat([roots, torch.ones_like(roots[:1])]).T.contiguous()
    # about their middle: distances of large numbers are small ones
    middle = position[:, lit].mean(1, keepdim=True)
    facing, places = normal[:, lit], (position[:, lit] - middle).T.contiguous()

    def guess_chunk(part: slice) -> None:
        chunk = pixels[part]
        weight = (normal[:, chunk].T @ facing).sub_(1.0).mul_(FACING).exp_()
        apart = torch.cdist((position[:, chunk] - middle).T.contiguous(), places)
        apart.div_(depth[chunk, None]).square_().add_(NEAR_SHARE**2)
        sums = weight.div_(apart) @ values
        guessed[:, part] = (sums[:, :-1] / sums[:, -1:]).square_().T

    share_among_threads(guess_chunk, list(cut_chunks(len(pixels), PIXELS_AT_ONCE)))
    return guessed


def find_grid(known: Mask) -> Tensor:
    """Index of the known pixels of a regular grid of about `GRID_PIXELS`, rows after each other."""
    height, width = known.shape[2:]
    step = math.ceil(math.sqrt(height * width / GRID_PIXELS))
    rows, columns = (
        torch.arange(min(step, extent) // 2, extent, step, device=known.device)
        for extent in (height, width)
    )
    grid = (rows[:, None] * width + columns).flatten()
    return grid[known.flatten()[grid] > 0.5]
