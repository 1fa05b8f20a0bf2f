"""Enlargement that keeps to the surfaces of a large G-buffer: joint bilateral upsampling.

    out(p) = sum_q w(p, q) m(q) v(q) / sum_q w(p, q) m(q)
    w = exp(-|p - q|^2 / (2 s^2) - a (1 - n(p).n(q)) - d(p, q))
    d = max(0, |z(p) - z(q)| - b |grad z(p)| |p - q|) / (c z(p))

over the small frame's samples q near p: those whose normal is that of p and whose depth is that of
p's plane count; where p or q is a surface whose normal is 0, which says nothing, its depth alone
does (n(p).n(q) = 1) [Kopf et al. 2007, with the edge-stopping functions of Dammertz et al. 2010].

Conventions: samples are pixel (S//2, S//2) of their S x S block (see `alignment`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.shapes import Image, Mask, Plane, Vector3
from rtsr_cli.core.threads import share_among_threads

REACH = 2
"""Samples to each side."""

SPREAD = 0.7
"""s, small pixels."""

FACING = 32.0
"""a."""

SLOPE = 1.5
"""b: how much of the surface's own slope is no difference."""

DEPTH_SHARE = 0.02
"""c: difference in depth, as a share of it, that takes off a factor of e."""

MIN_DEPTH, MAX_DEPTH = 1e-6, 1e6
"""Bounds of the depth; the larger one stands for the sky's."""

FALLBACK_WEIGHT = 1e-4
"""Of the cubic enlargement, which is all there is where no sample fits."""

LEAST_WEIGHT = 0.01
"""Samples whose spatial weight stays below this at every pixel are left out."""

STRIP_VALUES = 98304
"""Of a plane of a strip: few enough for the caches, enough to be worth a call."""

_LOG2_E = math.log2(math.e)


@dataclass(frozen=True, kw_only=True)
class SurfaceGuides:
    """What tells surfaces apart.

    Attributes:
        normal: n 3 h w, unit; 0 on sky, and on surfaces whose normal is not known.
        depth: n 1 h w, metres, `SKY_DEPTH_M` or more on sky.
    """

    normal: Vector3
    depth: Plane

    def find_unfaced(self) -> Mask:
        """1 on surfaces whose normal is 0."""
        zero = (self.normal == 0).all(1, keepdim=True) & (self.depth < SKY_DEPTH_M)
        return zero.to(self.depth)


@dataclass(frozen=True, kw_only=True)
class _Tap:
    """A sample beside a block: where it lies in a padded strip, and how far from each pixel.

    Attributes:
        top: row.
        left: column.
        exponent: log2 of the weight of a sample that faces away by a right angle, S S*w.
        distance: |p - q| in small pixels, S S*w.
    """

    top: int
    left: int
    exponent: Tensor
    distance: Tensor


@dataclass(frozen=True, kw_only=True)
class _Guides:
    """Planes of a strip, n 1 rows S S*w.

    Attributes:
        normal: x, y, z.
        per_depth: log2(e) / (c z).
        slope: b |grad z| log2(e) / (c z), a small pixel.
        unfaced: 1 on surfaces whose normal is 0; None where no surface of either frame is so.
    """

    normal: tuple[Tensor, ...]
    per_depth: Tensor
    slope: Tensor
    unfaced: Tensor | None


def _gradient(depth: Plane) -> Plane:
    """Lesser absolute difference to both sides, the larger one of the two axes."""
    lesser = []
    for dim in (-1, -2):
        step = depth.diff(dim=dim).abs_()
        inner = step.shape[dim] - 1
        both = torch.minimum(step.narrow(dim, 0, inner), step.narrow(dim, 1, inner))
        # at the ends, there is one side only
        lesser.append(torch.cat([step.narrow(dim, 0, 1), both, step.narrow(dim, inner, 1)], dim))
    return torch.maximum(lesser[0], lesser[1])


def upsample_guided(
    values: Image,
    mask: Mask,
    small: SurfaceGuides,
    large: SurfaceGuides,
    *,
    scale: int,
    fallback: Image,
) -> Image:
    """Enlarge values along surfaces, without a gradient.

    Works in strips of rows whose planes stay in the processor's caches, at any number of threads
    with the same result; weights are found once for all channels.

    Args:
        values: n c h w.
        mask: n 1 h w, 1 = counts.
        small: of the samples.
        large: of the output, n . S*h S*w.
        scale: S.
        fallback: n . S*h S*w, the first channels' or all; what stands where no sample fits, 0 for
            those behind.
    """
    return _enlarge(values, mask, small, large, scale=scale, fallback=fallback, fit=None)


def upsample_guided_and_fit(
    values: Image,
    mask: Mask,
    small: SurfaceGuides,
    large: SurfaceGuides,
    *,
    scale: int,
    fallback: Image,
) -> tuple[Image, Plane]:
    """`upsample_guided`, and how well the best sample of each output pixel fits.

    fit(p) = max_q w(p, q) m(q),   1 where p is a sample itself
    """
    fit = torch.zeros_like(large.depth)
    enlarged = _enlarge(values, mask, small, large, scale=scale, fallback=fallback, fit=fit)
    return enlarged, fit


def _enlarge(
    values: Image,
    mask: Mask,
    small: SurfaceGuides,
    large: SurfaceGuides,
    *,
    scale: int,
    fallback: Image,
    fit: Plane | None,
) -> Image:
    """Enlarge, and write into `fit` how well the best sample fits where that is asked for."""
    count, _, height, width = values.shape
    unfaced = large.find_unfaced(), small.find_unfaced()
    blind = any(bool(mask.any()) for mask in unfaced)
    facing = _LOG2_E * FACING * small.normal
    planes = [values * mask, mask, small.depth.clamp(max=MAX_DEPTH), facing]
    samples = _widen([*planes, *([_LOG2_E * FACING * unfaced[1]] if blind else [])], scale)
    taps = _find_taps(scale, width, like=values)
    enlarged = values.new_empty(count, values.shape[1], *fallback.shape[2:])
    rows = _strip_rows(height, count * scale * scale * width)

    def enlarge_strip(top: int) -> None:
        bottom = min(height, top + rows)
        around = samples[:, :, top : bottom + 2 * REACH]
        here = slice(top * scale, bottom * scale)
        best = None if fit is None else fit[:, :, here]
        guides = _guides(large, unfaced[0] if blind else None, here.start, here.stop, scale)
        total = _weigh_samples(around, guides, taps, best)
        total = total.flatten(2, 3)
        total[:, : fallback.shape[1]].add_(fallback[:, :, here], alpha=FALLBACK_WEIGHT)
        torch.div(total[:, :-1], total[:, -1:].add_(FALLBACK_WEIGHT), out=enlarged[:, :, here])

    share_among_threads(enlarge_strip, range(0, height, rows))
    return enlarged


def _strip_rows(height: int, row_values: int) -> int:
    """Rows of each of the fewest strips, about equally high, that are not too large."""
    most = max(1, STRIP_VALUES // row_values)
    return math.ceil(height / math.ceil(height / most))


def _widen(planes: Sequence[Image], scale: int) -> Image:
    """Replicate the borders, so that every sample has its neighbours; repeat columns S times."""
    padded = F.pad(torch.cat(list(planes), dim=1), (REACH,) * 4, mode="replicate")
    return padded.repeat_interleave(scale, dim=-1)


def _find_taps(scale: int, width: int, *, like: Tensor) -> list[_Tap]:
    """Samples around a block that count at any of its pixels."""
    taps = []
    for across, down in product(range(-REACH, REACH + 1), repeat=2):
        distance = _distances(across, down, scale, like=like)
        nearness = -distance.square() / (2.0 * SPREAD**2)
        if float(nearness.max()) < math.log(LEAST_WEIGHT):
            continue
        exponent = (nearness - FACING) * _LOG2_E
        taps.append(
            _Tap(
                top=REACH + down,
                left=(REACH + across) * scale,
                exponent=exponent.repeat(1, width),
                distance=distance.repeat(1, width),
            )
        )
    return taps


def _guides(
    large: SurfaceGuides, unfaced: Mask | None, first: int, last: int, scale: int
) -> _Guides:
    """What the weights of HR rows first..last depend on, n . rows S S*w."""
    above, below = max(0, first - 1), min(large.depth.shape[2], last + 1)
    bounded = large.depth[:, :, above:below].clamp(min=MIN_DEPTH, max=MAX_DEPTH)
    here = slice(first - above, last - above)
    per_depth = bounded[:, :, here].reciprocal().mul_(_LOG2_E / DEPTH_SHARE)
    slope = _gradient(bounded)[:, :, here].mul(per_depth).mul_(SLOPE * scale)

    def split_rows(planes: Image) -> Tensor:
        count, channels, _, width = planes.shape
        return planes.view(count, channels, -1, scale, width)

    return _Guides(
        normal=torch.split(split_rows(large.normal[:, :, first:last]), 1, dim=1),
        per_depth=split_rows(per_depth),
        slope=split_rows(slope),
        unfaced=None if unfaced is None else split_rows(unfaced[:, :, first:last]),
    )


def _weigh_samples(
    samples: Image, guides: _Guides, taps: Iterable[_Tap], best: Plane | None
) -> Tensor:
    """Return sums over the samples, of each channel times weight and of weights.

    The largest weight goes into `best`. Exponents are of 2, which costs half of what those of e
    cost.
    """
    per_depth, slope, unfaced = guides.per_depth, guides.slope, guides.unfaced
    count, _, rows, scale, width = per_depth.shape
    facing = [*guides.normal, *([] if unfaced is None else [1.0 - unfaced])]
    channels = samples.shape[1] - 1 - len(facing)
    own_depth = per_depth.new_full((1, 1, 1, 1, 1), _LOG2_E / DEPTH_SHARE)
    total = per_depth.new_zeros(count, channels, rows, scale, width)
    power, apart = torch.empty_like(per_depth), torch.empty_like(per_depth)
    largest = None if best is None else best.view_as(per_depth)
    for tap in taps:
        there = samples[:, :, tap.top : tap.top + rows, None, tap.left : tap.left + width]
        counted, depth, *toward = torch.split(there, [channels, *[1] * (1 + len(facing))], dim=1)
        # a (n(p).n(q) - 1) - |p - q|^2 / (2 s^2) - d(p, q)
        nearest = tap.exponent
        if unfaced is not None:
            nearest = nearest + _LOG2_E * FACING * unfaced
        torch.addcmul(nearest, facing[0], toward[0], out=power)
        for own, other in zip(facing[1:], toward[1:], strict=True):
            power.addcmul_(own, other)
        torch.addcmul(own_depth, depth, per_depth, value=-1.0, out=apart)
        apart.abs_().addcmul_(slope, tap.distance, value=-1.0).clamp_(min=0.0)
        total.addcmul_(power.sub_(apart).exp2_(), counted)
        if largest is not None:
            torch.maximum(largest, power.mul_(counted[:, -1:]), out=largest)
    return total


def _distances(across: int, down: int, scale: int, *, like: Tensor) -> Tensor:
    """|p - q| of each pixel of a block and the sample of a block beside it: S S."""
    inside = (torch.arange(scale, device=like.device, dtype=like.dtype) - scale // 2) / scale
    squared = (down - inside).square().view(-1, 1) + (across - inside).square()
    return squared.sqrt()
