"""Colours of whole frames that are a few per cent apart between the sizes.

    l(q) = log(mean of HR in q's block) - log(LR at q),    a channel

Of right pairs the middle of all l is 0 to a hundredth, wherever in textures samples lie, and l is 0
to a thousandth where a block and what surrounds it are of one colour. A tint moves all of them
alike, in every part of the picture; another base colour of one object does not. Where textures are
finer than blocks, thin dark joints between bright bricks move the middle, too; their samples are
no brighter than the brightest pixel around, as those of a tint are.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.shapes import Image, Mask

LEAST_TINT, LEAST_OF_TEXTURES = 0.02, 0.03
"""Least |middle of l| that is a tint, where blocks of one colour tell, and where there are none:
right sequences have 0.0001 and 0.01 at most."""

LEAST_COLOUR = 0.02
"""Darker ones tell nothing: 8 bits leave a tenth of them."""

LEAST_APART = 1.0 / 255.0
"""Least difference of the colours: twice what 8 bits leave."""

LEAST_SAMPLES = 64
"""That tell; fewer tell nothing."""

SURE = 10.0
"""Standard errors of the middle that a tint is away from 0 at least."""

ERROR_OF_MIDDLE = 1.86
"""Standard error of the middle of one of Gauss's distribution, times its root of n, as a multiple
of the middle distance from it."""

SURE_STRAYS = 3.0
"""Deviations of chance by which a tint has fewer samples beyond the pixels around than none has."""

FLAT = 5e-3
"""Ratio above 1 of the colours around a sample that are called one."""

ALIKE, MOST = 0.01, 0.9
"""Difference of l up to which blocks of one colour agree, and the share that has to."""

PARTS, MOST_PARTS = 4, 0.75
"""Parts of the picture to each side, and how many of them, as a share, have to be nearer to the
tint than to none."""


def measure_tint(image: Image, seen: Image, told: Mask, scale: int) -> tuple[float, ...] | None:
    """How many times LR's colours HR's are, a channel; None where that is 1 in all.

    Args:
        image: of LR samples, 1 x C x H x W, linear.
        seen: of HR pixels, 1 x C x SH x SW.
        told: True at LR samples of surfaces.
        scale: S.
    """
    small, mean = image.double(), F.avg_pool2d(seen.double(), scale)
    known = told & (small > LEAST_COLOUR) & (mean > LEAST_COLOUR)
    known &= torch.isfinite(small) & torch.isfinite(mean)
    high = F.max_pool2d(seen.double(), scale + 2, scale, padding=1)
    low = -F.max_pool2d(-seen.double(), scale + 2, scale, padding=1)
    flat = known & (high <= low * (1.0 + FLAT))
    channels = range(small.shape[1])
    found = [
        _settle(small[0, c], mean[0, c], known[0, c], flat[0, c], (low[0, c], high[0, c]))
        for c in channels
    ]
    telling = [factor for factor in found if factor is not None]
    if all(factor == 1.0 for factor in telling):
        return None
    # a channel that is dark, or has hardly any colour, is as the others, if those are alike
    alike = max(telling) <= min(telling) * (1.0 + FLAT)
    return tuple((telling[0] if alike else 1.0) if f is None else f for f in found)


def _settle(
    small: Tensor, mean: Tensor, known: Tensor, flat: Tensor, around: tuple[Tensor, Tensor]
) -> float | None:
    """The factor of a channel; 1 where there is none for sure, None where nothing tells.

    Args:
        small, mean: of LR, and of HR in their blocks.
        known, flat: where they tell, and where HR is of one colour.
        around: the least and the largest of HR in and around the blocks.
    """
    count = int(known.sum())
    if count < LEAST_SAMPLES:
        return None
    logs = (mean / small).log()
    middle, error = _find_middle(logs[known])
    least = max(LEAST_OF_TEXTURES, SURE * error)
    if int(flat.sum()) >= LEAST_SAMPLES:
        exact, _ = _find_middle(logs[flat])
        agreeing = float(((logs[flat] - exact).abs() <= ALIKE).double().mean())
        if agreeing < MOST or abs(exact - middle) > ALIKE + SURE * error:
            return 1.0
        middle, least = exact, LEAST_TINT
    elif not _explains_strays(small[known], (around[0][known], around[1][known]), middle):
        return 1.0
    if abs(middle) <= least or not _is_everywhere(logs, known, middle):
        return 1.0
    apart = float((mean - small)[known].abs().median())
    return math.exp(middle) if apart > LEAST_APART else None


def _explains_strays(small: Tensor, around: tuple[Tensor, Tensor], middle: float) -> bool:
    """Tell whether fewer samples are out of the range of the pixels around with a tint, for sure.

    Args:
        small: samples, n.
        around: least and largest pixels around, n each.
        middle: logarithm of the tint.
    """
    low, high = around

    def count(tint: float) -> int:
        least, most = low / tint * (1.0 - ALIKE), high / tint * (1.0 + ALIKE)
        return int(((small < least) | (small > most)).sum())

    plain, tinted = count(1.0), count(math.exp(middle))
    return plain - tinted > SURE_STRAYS * math.sqrt(plain + tinted)


def _find_middle(values: Tensor) -> tuple[float, float]:
    """The middle value, and its standard error."""
    middle = values.median()
    distance = (values - middle).abs().median()
    return float(middle), ERROR_OF_MIDDLE * float(distance) / math.sqrt(len(values))


def _is_everywhere(logs: Tensor, known: Tensor, middle: float) -> bool:
    """Tell whether most parts of the picture are nearer to a tint than to none."""
    parts = [
        values[mask]
        for rows, marked in zip(logs.chunk(PARTS), known.chunk(PARTS), strict=True)
        for values, mask in zip(rows.chunk(PARTS, 1), marked.chunk(PARTS, 1), strict=True)
    ]
    middles = [float(part.median()) for part in parts if len(part) >= LEAST_SAMPLES // 2]
    near = [abs(part - middle) < abs(part) for part in middles]
    return bool(near) and sum(near) >= MOST_PARTS * len(near)
