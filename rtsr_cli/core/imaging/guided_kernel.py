"""Weights of a small frame's samples around the pixels of a large one; see `guided_enlargement`.

    log w = -f_0 |p - q|^2 / (2 s^2) - f_1 a (1 - n(p).n(q)) - f_2 d(p, q)
    d = max(0, |z(p) - z(q)| - b |grad z(p)| |p - q|) / (c z(p))

Conventions: samples are pixel (S//2, S//2) of their S x S block (see `alignment`); exponents are of
2, which costs half of what those of e cost.
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

MOST_APART, LEAST_POWER = 22.0, -100.0
"""Bounds of d log2(e), and of log2 w where its terms have factors: such weights are nothing beside
`FALLBACK_WEIGHT`, and smaller ones would soon be denormal numbers, which cost a hundredfold."""

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
        # a third of the time of asking every channel
        zero = self.normal.abs().sum(1, keepdim=True) == 0
        return (zero & (self.depth < SKY_DEPTH_M)).to(self.depth)


@dataclass(frozen=True, kw_only=True)
class GuidedSamples:
    """What is enlarged along which surfaces.

    Attributes:
        values: n c h w.
        mask: n 1 h w, 1 = counts.
        small: surfaces of the samples.
        large: of the output, n . S*h S*w.
        scale: S.
        fallback: n . S*h S*w, the first channels' or all; what stands where no sample fits, 0 for
            those behind.
    """

    values: Image
    mask: Mask
    small: SurfaceGuides
    large: SurfaceGuides
    scale: int
    fallback: Image


@dataclass(frozen=True, kw_only=True)
class Tap:
    """A sample beside a block: where it lies in a padded strip, and how far from each pixel.

    Attributes:
        top: row.
        left: column.
        nearness: log2 of the weight of a sample of the same surface, S S*w.
        exponent: the same of one that faces away by a right angle.
        distance: |p - q| in small pixels, S S*w.
    """

    top: int
    left: int
    nearness: Tensor
    exponent: Tensor
    distance: Tensor


@dataclass(frozen=True, kw_only=True)
class _Guides:
    """Planes of a strip, n 1 rows S S*w.

    Attributes:
        normal: x, y, z.
        per_depth: log2(e) / (c z).
        slope: b |grad z| log2(e) / (c z), a small pixel.
        unfaced: 1 on surfaces whose normal is 0; None where none is so.
    """

    normal: tuple[Tensor, ...]
    per_depth: Tensor
    slope: Tensor
    unfaced: Tensor | None


@dataclass(frozen=True, kw_only=True)
class SamplePlanes:
    """What strips look up of a whole frame.

    Attributes:
        around: masked channels, mask, depth, a times normal, and where there are such surfaces a
            times 1 for those whose normal is 0; borders are replicated, so that every sample has
            its neighbours, and columns repeated S times.
        blind: whether a sample lies on a surface whose normal is 0.
    """

    around: Image
    blind: bool


def gather_planes(samples: GuidedSamples) -> SamplePlanes:
    """Gather what weights of the samples depend on."""
    mask, small = samples.mask, samples.small
    unfaced = small.find_unfaced()
    blind = bool(unfaced.any())
    turned = _LOG2_E * FACING * torch.cat([small.normal, *[unfaced][: int(blind)]], dim=1)
    depth = small.depth.clamp(max=MAX_DEPTH)
    planes = torch.cat([samples.values * mask, mask, depth, turned], dim=1)
    padded = F.pad(planes, (REACH,) * 4, mode="replicate")
    return SamplePlanes(
        around=padded.repeat_interleave(samples.scale, dim=-1),
        blind=blind,
    )


def find_taps(scale: int, width: int, *, like: Tensor) -> list[Tap]:
    """Samples around a block that count at any of its pixels."""
    taps = []
    for across, down in product(range(-REACH, REACH + 1), repeat=2):
        distance = _distances(across, down, scale, like=like)
        nearness = -distance.square() / (2.0 * SPREAD**2)
        if float(nearness.max()) < math.log(LEAST_WEIGHT):
            continue
        taps.append(
            Tap(
                top=REACH + down,
                left=(REACH + across) * scale,
                nearness=(nearness * _LOG2_E).repeat(1, width),
                exponent=((nearness - FACING) * _LOG2_E).repeat(1, width),
                distance=distance.repeat(1, width),
            )
        )
    return taps


class SampleKernel:
    """Weights of the samples around the pixels of a strip."""

    def __init__(
        self, planes: SamplePlanes, strip: slice, samples: GuidedSamples, emphasis: Image | None
    ) -> None:
        """Keep what weights depend on.

        Args:
            planes: of the whole frame.
            strip: rows of small pixels.
            samples: what is enlarged.
            emphasis: factors of the terms, None = 1.
        """
        here = slice(strip.start * samples.scale, strip.stop * samples.scale)
        self.around = planes.around[:, :, strip.start : strip.stop + 2 * REACH]
        self.guides = _guides(samples.large, here, samples.scale)
        self.channels = samples.values.shape[1] + 1
        per_depth, unfaced = self.guides.per_depth, self.guides.unfaced
        self.facing = list(self.guides.normal)
        # a (n(p).n(q) - 1), 0 where p's normal is 0
        self.opposite = per_depth.new_full((1, 1, 1, 1, 1), -_LOG2_E * FACING)
        if unfaced is not None:
            self.opposite = self.opposite * (1.0 - unfaced)
        if planes.blind:
            self.facing.append(torch.ones_like(per_depth) if unfaced is None else 1.0 - unfaced)
        self.own_depth = per_depth.new_full((1, 1, 1, 1, 1), _LOG2_E / DEPTH_SHARE)
        self.power, self.apart = torch.empty_like(per_depth), torch.empty_like(per_depth)
        self.factors: tuple[Tensor, ...] = ()
        self.most_apart = MOST_APART if emphasis is None else math.inf
        if emphasis is not None:
            rows = emphasis[:, :, here]
            shape = (*rows.shape[:2], -1, samples.scale, rows.shape[3])
            self.factors = torch.split(rows.view(shape), 1, dim=1)
            self.turned = torch.empty_like(per_depth)

    def sum_samples(self, taps: Iterable[Tap], best: Plane | None) -> Tensor:
        """Sums over the samples, of each channel times weight and of weights.

        The largest weight goes into `best`.
        """
        count, _, rows, scale, width = self.power.shape
        total = self.power.new_zeros(count, self.channels, rows, scale, width)
        largest = None if best is None else best.view_as(self.power)
        for tap in taps:
            counted = self._weigh(tap)
            total.addcmul_(self.power, counted)
            if largest is not None:
                torch.maximum(largest, self.power.mul_(counted[:, -1:]), out=largest)
        return total

    def sum_slopes(self, taps: Iterable[Tap], enlarged: Image, gradient: Image) -> Tensor:
        """Gradient of the factors: sum_q w m (v - out) . gradient term_k / sum_q w m."""
        count, _, rows, scale, width = self.power.shape
        shape = (count, -1, rows, scale, width)
        gradient = gradient.reshape(shape)
        mean = (enlarged.reshape(shape) * gradient).sum(1, keepdim=True)
        total = self.power.new_full(self.power.shape, FALLBACK_WEIGHT)
        slopes = self.power.new_zeros(count, 3, rows, scale, width)
        for tap in taps:
            counted = self._weigh(tap)
            values, mask = counted[:, :-1], counted[:, -1:]
            total.addcmul_(self.power, mask)
            # masked values are 0 already
            better = (gradient * values).sum(1, keepdim=True).sub_(mean * mask).mul_(self.power)
            slopes[:, :1].addcmul_(better, tap.nearness)
            slopes[:, 1:2].addcmul_(better, self.turned)
            slopes[:, 2:].addcmul_(better, self.apart, value=-1.0)
        return slopes.div_(total).div_(_LOG2_E)

    def _weigh(self, tap: Tap) -> Tensor:
        """Put w of a sample into `power`; return its masked channels, and its mask behind."""
        guides, power, apart = self.guides, self.power, self.apart
        _, _, rows, _, width = power.shape
        there = self.around[:, :, tap.top : tap.top + rows, None, tap.left : tap.left + width]
        parts = [self.channels, *[1] * (1 + len(self.facing))]
        counted, depth, *toward = torch.split(there, parts, dim=1)
        torch.addcmul(self.own_depth, depth, guides.per_depth, value=-1.0, out=apart)
        apart.abs_().addcmul_(guides.slope, tap.distance, value=-1.0).clamp_(0.0, self.most_apart)
        if not self.factors:
            # a (n(p).n(q) - 1) - |p - q|^2 / (2 s^2) - d(p, q)
            nearest = tap.exponent
            if guides.unfaced is not None:
                nearest = nearest + _LOG2_E * FACING * guides.unfaced
            self._add_facing(nearest, toward, power)
            power.sub_(apart)
        else:
            near, facing, deep = self.factors
            self._add_facing(self.opposite, toward, self.turned)
            torch.mul(near, tap.nearness, out=power)
            power.addcmul_(facing, self.turned).addcmul_(deep, apart, value=-1.0)
            power.clamp_(min=LEAST_POWER)
        power.exp2_()
        return counted

    def _add_facing(self, start: Tensor, toward: Sequence[Tensor], out: Tensor) -> None:
        """Put start + a n(p).n(q) into a plane."""
        torch.addcmul(start, self.facing[0], toward[0], out=out)
        for own, other in zip(self.facing[1:], toward[1:], strict=True):
            out.addcmul_(own, other)


def _guides(large: SurfaceGuides, strip: slice, scale: int) -> _Guides:
    """What the weights of a strip of HR rows depend on, n . rows S S*w."""
    first, last = strip.start, strip.stop
    above, below = max(0, first - 1), min(large.depth.shape[2], last + 1)
    bounded = large.depth[:, :, above:below].clamp(min=MIN_DEPTH, max=MAX_DEPTH)
    here = slice(first - above, last - above)
    per_depth = bounded[:, :, here].reciprocal().mul_(_LOG2_E / DEPTH_SHARE)
    slope = _gradient(bounded)[:, :, here].mul(per_depth).mul_(SLOPE * scale)
    own = SurfaceGuides(normal=large.normal[:, :, strip], depth=large.depth[:, :, strip])
    unfaced = own.find_unfaced()

    def split_rows(planes: Image) -> Tensor:
        count, channels, _, width = planes.shape
        return planes.view(count, channels, -1, scale, width)

    return _Guides(
        normal=torch.split(split_rows(own.normal), 1, dim=1),
        per_depth=split_rows(per_depth),
        slope=split_rows(slope),
        unfaced=split_rows(unfaced) if bool(unfaced.any()) else None,
    )


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


def _distances(across: int, down: int, scale: int, *, like: Tensor) -> Tensor:
    """|p - q| of each pixel of a block and the sample of a block beside it: S S."""
    inside = (torch.arange(scale, device=like.device, dtype=like.dtype) - scale // 2) / scale
    squared = (down - inside).square().view(-1, 1) + (across - inside).square()
    return squared.sqrt()
