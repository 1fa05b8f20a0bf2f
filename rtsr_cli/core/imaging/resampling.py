"""Changing resolution: decimation as a renderer samples, pixel filters, bicubic enlargement.

Pixel centres lie at +0.5. A frame with `jitter_px` has its samples at (index + 0.5 + jitter_px);
every enlargement here takes that offset and returns an image without one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.shapes import Image, Mask

KEYS_A = -0.75
"""Slope of the cubic kernel at distance 1 [Keys 1981]; the value most libraries enlarge with."""

BICUBIC_SUPPORT_PX = 2
"""Reach of a cubic kernel to each side, in source pixels."""

ROWS, COLUMNS = 2, 3
"""Axes of an NCHW image."""

MIN_FILTERED_MASK = 0.05
"""Below this share of valid weight a mask-normalised value means nothing."""

BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)
"""Coefficients of the 4-term window [Harris 1978]."""

BLACKMAN_HARRIS_WIDTH_PX = 3.0
"""Width of the pixel filter in pixels of the filtered resolution, twice Cycles' default 1.5."""

HALTON_BASES = (2, 3)
"""Bases of x and y of the usual jitter sequence."""


def cubic_kernel(distance: Tensor, a: float = KEYS_A) -> Tensor:
    """Piecewise cubic weight at a distance in pixels [Keys 1981, Eq. 15]."""
    x = distance.abs()
    inner = ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0
    outer = ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a
    return torch.where(x <= 1.0, inner, torch.where(x < 2.0, outer, torch.zeros_like(x)))


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """A separable weight of the distance in source pixels.

    Attributes:
        weight: of a distance; even.
        support_px: reach to each side.
        normalised: divide by the sum of the weights, so that a constant stays what it is.
    """

    weight: Callable[[Tensor], Tensor]
    support_px: float
    normalised: bool = True


KEYS = Kernel(weight=cubic_kernel, support_px=2.0)
BILINEAR = Kernel(weight=lambda distance: 1.0 - distance.abs(), support_px=1.0)


@lru_cache(maxsize=256)
def _phase_taps(scale: int, jitter: float, kernel: Kernel) -> tuple[Mapping[int, float], ...]:
    """For each of the `scale` output phases, source offset -> weight (zeros left out).

    Output pixel X = S i + p has its centre at source coordinate i + (p + 0.5) / S - 0.5 - jitter.
    """
    phases = []
    for phase in range(scale):
        centre = (phase + 0.5) / scale - 0.5 - jitter
        first = math.ceil(centre - kernel.support_px)
        offsets = range(first, math.floor(centre + kernel.support_px) + 1)
        weights = kernel.weight(torch.tensor([centre - o for o in offsets], dtype=torch.float64))
        if kernel.normalised:
            weights = weights / weights.sum()
        phases.append({o: w for o, w in zip(offsets, weights.tolist(), strict=True) if w})
    return tuple(phases)


def _enlarge(image: Image, phases: Sequence[Mapping[int, float]], dim: int) -> Image:
    """Enlarge along one axis: each output phase is a weighted sum of shifted sources."""
    reach = max(abs(offset) for taps in phases for offset in taps)
    length = image.shape[dim]
    ends = (reach, reach, 0, 0) if dim == COLUMNS else (0, 0, reach, reach)
    padded = F.pad(image, ends, mode="replicate")
    shape = (*image.shape[: dim + 1], len(phases), *image.shape[dim + 1 :])
    enlarged = image.new_empty(shape)
    for phase, taps in enumerate(phases):
        total = enlarged.select(dim + 1, phase)
        terms = iter(taps.items())
        offset, weight = next(terms)
        torch.mul(padded.narrow(dim, reach + offset, length), weight, out=total)
        for offset, weight in terms:
            total.add_(padded.narrow(dim, reach + offset, length), alpha=weight)
    return enlarged.flatten(dim, dim + 1)


def upsample(image: Image, scale: int, jitter_px: Jitter = (0.0, 0.0), *, kernel: Kernel) -> Image:
    """Enlarge by a whole factor, borders replicated.

        out(X) = sum_i image(i) w(u - i),   u = (X + 0.5) / S - 0.5 - jitter      per axis

    Args:
        image: any channels, in the space the weights should act in.
        scale: S.
        jitter_px: sample position minus pixel centre of `image`.
        kernel: w.
    """
    wide = _enlarge(image, _phase_taps(scale, jitter_px[0], kernel), dim=COLUMNS)
    return _enlarge(wide, _phase_taps(scale, jitter_px[1], kernel), dim=ROWS)


def upsample_bicubic(image: Image, scale: int, jitter_px: Jitter = (0.0, 0.0)) -> Image:
    """`upsample` with the Keys kernel."""
    return upsample(image, scale, jitter_px, kernel=KEYS)


def sample_at_lr(image: Image, scale: int, jitter_px: Jitter = (0.0, 0.0)) -> Image:
    """Read a large image where the samples of a small one with `jitter_px` lie, bilinearly.

    out(i) = image(x),   x = (i + 0.5 + jitter) S - 0.5      per axis, borders replicated
    """
    for dim, jitter in ((ROWS, jitter_px[1]), (COLUMNS, jitter_px[0])):
        position = (0.5 + jitter) * scale - 0.5
        first = math.floor(position + 1e-6)
        share = max(0.0, position - first)
        lower = _every(image, scale, first, dim)
        # a sample on a pixel centre is that pixel, without its neighbour's rounding
        image = lower if share < 1e-6 else lower.lerp(_every(image, scale, first + 1, dim), share)
    return image


def _every(image: Image, step: int, start: int, dim: int) -> Image:
    index = torch.arange(start, start + image.shape[dim], step, device=image.device)
    return image.index_select(dim, index.clamp(0, image.shape[dim] - 1))


def upsample_nearest(image: Tensor, scale: int) -> Tensor:
    """Repeat every pixel scale x scale times."""
    return image.repeat_interleave(scale, dim=-2).repeat_interleave(scale, dim=-1)


def repeat_samples(image: Tensor, scale: int, jitter_px: Jitter = (0.0, 0.0)) -> Tensor:
    """Give every output pixel the nearest *sample*, any type; without jitter, `upsample_nearest`.

        out(X) = image(round(u)),   u = (X + 0.5) / S - 0.5 - jitter      per axis

    Args:
        image: n c h w.
        scale: S.
        jitter_px: sample position minus pixel centre of `image`.
    """
    for dim, jitter in ((ROWS, jitter_px[1]), (COLUMNS, jitter_px[0])):
        extent = image.shape[dim]
        place = torch.arange(extent * scale, dtype=torch.float64, device=image.device)
        index = ((place + 0.5) / scale - jitter).floor().long()
        image = image.index_select(dim, index.clamp(0, extent - 1))
    return image


def upsample_masked_bicubic(
    image: Image, mask: Mask, scale: int, jitter_px: Jitter = (0.0, 0.0)
) -> tuple[Image, Mask]:
    """Enlarge the valid pixels of an image only.

        out = bicubic(image * mask) / bicubic(mask)

    held, where a pixel that counts for nothing is near, within the range of the valid ones around:
    weights of both signs may nearly cancel, and make of 1 and 2 a value of 10.

    Returns the enlarged image and a mask, 1 where the filtered mask is at least
    `MIN_FILTERED_MASK`; elsewhere the image is 0.
    """
    if bool((mask > 0).all()):
        return upsample_bicubic(image, scale, jitter_px), upsample_nearest(mask, scale)
    values = torch.where(mask > 0, image * mask, torch.zeros_like(image))
    filtered = upsample_bicubic(torch.cat([values, mask], dim=1), scale, jitter_px)
    numerator, weight = filtered[:, :-1], filtered[:, -1:]
    supported = weight >= MIN_FILTERED_MASK
    numerator.div_(weight.clamp(min=MIN_FILTERED_MASK))
    _hold_within_valid(numerator, image, mask, scale)
    return numerator.masked_fill_(~supported, 0.0), supported.to(image.dtype)


def _hold_within_valid(enlarged: Image, image: Image, mask: Mask, scale: int) -> None:
    """Clamp, in place, to the valid ones of the 5x5 pixels around, where not all of them are."""
    count, channels, height, width = image.shape
    invalid = mask <= 0
    # most of a picture lies away from the edges of its masks
    frame, row, column = (find_largest_around(invalid.to(image)) > 0)[:, 0].nonzero(as_tuple=True)
    largest = find_largest_around(image.masked_fill(invalid, -math.inf))
    least = find_largest_around(image.neg().masked_fill_(invalid, -math.inf)).neg()
    ends = (bound[frame, :, row, column, None, None] for bound in (least, largest))
    # k c S S of the picked blocks
    blocks = enlarged.view(count, channels, height, scale, width, scale).permute(0, 2, 4, 1, 3, 5)
    blocks[frame, row, column] = torch.clamp(blocks[frame, row, column], *ends)


def find_largest_around(image: Image) -> Image:
    """Largest of the 5x5 values that a bicubic kernel sees: many times faster than pooling."""
    for dim in (ROWS, COLUMNS):
        reach, length = BICUBIC_SUPPORT_PX, image.shape[dim]
        ends = (reach, reach) if dim == COLUMNS else (0, 0, reach, reach)
        padded = F.pad(image, ends, value=-math.inf)
        image = padded.narrow(dim, 0, length)
        for step in range(1, 2 * reach + 1):
            image = torch.maximum(image, padded.narrow(dim, step, length))
    return image


def mean_3x3(image: Image) -> Image:
    """Mean of the 3x3 neighbourhood, borders replicated; a pool of windows costs five times it."""
    return _sum_3x3(F.pad(image, (1, 1, 1, 1), mode="replicate")).div_(9.0)


def sum_neighbours(image: Image) -> Image:
    """Sum of the eight pixels around each, none beyond the borders."""
    return _sum_3x3(F.pad(image, (1, 1, 1, 1))) - image


def _sum_3x3(image: Image) -> Image:
    """Sums of 3x3 neighbours, two rows and two columns fewer than there were."""
    return _sum_of_three(_sum_of_three(image, -1), -2)


def _sum_of_three(image: Image, dim: int) -> Image:
    """Sum of each three neighbours along an axis, two fewer than there were."""
    inner = image.shape[dim] - 2
    total = image.narrow(dim, 0, inner) + image.narrow(dim, 1, inner)
    return total.add_(image.narrow(dim, 2, inner))


def grow_valid(image: Image, mask: Mask, steps: int = 1) -> tuple[Image, Mask]:
    """Fill invalid pixels that touch valid ones (3x3) with the mean of those, `steps` times."""
    values = torch.where(mask > 0, image, torch.zeros_like(image))
    for _ in range(steps):
        padded = F.pad(torch.cat([values * mask, mask], dim=1), (1, 1, 1, 1))
        total = _sum_3x3(padded)
        share = total[:, -1:]
        grown = total[:, :-1] / share.clamp(min=1e-6)
        values = torch.where(mask > 0, values, torch.where(share > 0, grown, values))
        mask = (share > 0).to(mask.dtype)
    return values, mask


def _mirrored_digits(index: int, base: int) -> tuple[int, int]:
    """Numerator and denominator of the van der Corput sequence, exact."""
    numerator, denominator = 0, 1
    while index > 0:
        index, digit = divmod(index, base)
        numerator, denominator = numerator * base + digit, denominator * base
    return numerator, denominator


def radical_inverse(index: int, base: int) -> float:
    """Element `index` (from 1) of the van der Corput sequence [Halton 1964]."""
    numerator, denominator = _mirrored_digits(index, base)
    return numerator / denominator


def halton_offset(frame_number: int, block: int) -> tuple[int, int]:
    """Sample index (x, y) in a block of `block` pixels: floor(Halton(2,3)[frame] * block).

    Frames count from 1; numbers below that take the sequence's first elements again.
    """
    index = frame_number if frame_number >= 1 else 1 - frame_number
    fractions = (_mirrored_digits(index, base) for base in HALTON_BASES)
    x, y = (numerator * block // denominator for numerator, denominator in fractions)
    return x, y


def sample_jitter(offset: int, block: int) -> float:
    """Position of sample `offset` of a block, minus the block's centre, in blocks."""
    return (offset + 0.5) / block - 0.5


def decimate(image: Tensor, block: int, offset: tuple[int, int]) -> Tensor:
    """Keep sample (x, y) = `offset` of each block: image[..., y::block, x::block]."""
    return image[..., offset[1] :: block, offset[0] :: block]


def box_mean(image: Image, block: int) -> Image:
    """Mean of each block: the anti-aliased value of a pixel that holds block x block samples."""
    return F.avg_pool2d(image, block)


def _box_taps(block: int) -> Tensor:
    """One block wide, centred on a sample: an even block has half a tap at each end."""
    if block % 2:
        return torch.ones(block, dtype=torch.float64)
    taps = torch.ones(block + 1, dtype=torch.float64)
    taps[0] = taps[-1] = 0.5
    return taps


def _blackman_harris_taps(block: int) -> Tensor:
    """Blackman-Harris window, `BLACKMAN_HARRIS_WIDTH_PX` blocks wide, centred on a sample."""
    half = BLACKMAN_HARRIS_WIDTH_PX * block / 2.0
    reach = math.ceil(half) - 1
    x = torch.arange(-reach, reach + 1, dtype=torch.float64) / (2.0 * half) + 0.5
    a0, a1, a2, a3 = BLACKMAN_HARRIS
    angle = 2.0 * math.pi * x
    return a0 - a1 * torch.cos(angle) + a2 * torch.cos(2 * angle) - a3 * torch.cos(3 * angle)


FILTER_CUTOFF = 3.0
"""Standard deviations of a Gaussian beyond which nothing counts."""

PIXEL_FILTERS = {"box": _box_taps, "blackman-harris": _blackman_harris_taps}
"""Filters of the LR radiance by name; each gives the taps for a block size."""


def decimate_filtered(radiance: Image, name: str, block: int, offset: tuple[int, int]) -> Image:
    """`decimate` linear radiance after a pixel filter sized in blocks, at the kept samples only.

    The filter is centred on the sample that decimation keeps, so that radiance and G-buffer of
    the small frame share one offset; borders are replicated.
    """
    taps = PIXEL_FILTERS[name](block)
    weights = (taps / taps.sum()).tolist()
    reach = len(weights) // 2
    height, width = radiance.shape[-2:]
    padded = F.pad(radiance, (reach, reach, reach, reach), mode="replicate")
    # shifted strided sums: depthwise convolutions of three channels are many times slower
    rows = _weighted_sum(padded, weights, ROWS, range(offset[1], height, block))
    return _weighted_sum(rows, weights, COLUMNS, range(offset[0], width, block))


def measure_filter_width(name: str, block: int) -> float:
    """Standard deviation of a pixel filter, in blocks: root of sum w x^2 / sum w."""
    taps = PIXEL_FILTERS[name](block)
    reach = len(taps) // 2
    x = torch.arange(-reach, reach + 1, dtype=taps.dtype) / block
    return float(((taps * x.square()).sum() / taps.sum()).sqrt())


def filter_at_samples(image: Image, width: float, scale: int, jitter_px: Jitter) -> Image:
    """Filter an HR image around the places of the LR samples, by a Gaussian.

    out(q) = sum_i w_i image(i),   w_i ~ exp(-(i - c(q))^2 / (2 (width S)^2)) along both axes,
    c(q) = S (q + 1/2 + jitter) - 1/2,   cut off at 3 width; borders are replicated

    Args:
        image: n c S*h S*w.
        width: standard deviation, LR pixels, above 0.
        scale: S.
        jitter_px: of the LR samples, LR pixels.
    """
    reach = FILTER_CUTOFF * width * scale
    margin = math.ceil(reach + scale)
    filtered = F.pad(image, (margin,) * 4, mode="replicate")
    for dim, jitter in ((ROWS, jitter_px[1]), (COLUMNS, jitter_px[0])):
        centre = (0.5 + jitter) * scale - 0.5
        first, last = math.ceil(centre - reach), math.floor(centre + reach)
        taps = [math.exp(-0.5 * ((i - centre) / (width * scale)) ** 2)
                for i in range(first, last + 1)]  # fmt: skip
        start, count = first + margin, image.shape[dim] // scale
        kept = range(start, start + count * scale, scale)
        filtered = _weighted_sum(filtered, [tap / sum(taps) for tap in taps], dim, kept)
    return filtered


def _weighted_sum(image: Image, weights: Sequence[float], dim: int, kept: range) -> Image:
    """out(i) = sum_k w_k image(kept_i + k) along one axis."""
    last = (len(kept) - 1) * kept.step
    total: Image | None = None
    for k, weight in enumerate(weights):
        first = kept.start + k
        cut = slice(first, first + last + 1, kept.step)
        taken = image[..., cut, :] if dim == ROWS else image[..., cut]
        total = taken * weight if total is None else total.add_(taken, alpha=weight)
    assert total is not None
    return total
