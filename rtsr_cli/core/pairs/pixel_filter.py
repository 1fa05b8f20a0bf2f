"""How wide a pixel filter went over LR radiance and not over its G-buffer; measured.

    share(w) = share of neighbours p, q with  LEAST < slope(w) < MOST
    slope(w) = (log c(p) - log c(q)) / (log G_w[m](p) - log G_w[m](q))        `find_slopes`

c is LR radiance, m the HR material, G_w a Gaussian of standard deviation w. Material that was
filtered less than radiance changes more from pixel to pixel, and slopes are below 1; material that
was filtered more, less, and they are above. The width is that at which most are about 1.

Slopes are low as well where a surface's material is wrong, or where light differs along with
material, as at the edges of surfaces without textures. But no filter mends those: a width counts
where it explains more neighbours than none does, by far more than chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.filtered_gbuffer import filter_gbuffer
from rtsr_cli.core.pairs.point_samples import (
    FILTERED_SLOPE,
    LEAST_PAIRS,
    find_slopes,
    measure_slope,
)
from rtsr_cli.core.pairs.sources import FramePair, PairInputs

WIDEST_PX, STEP_PX = 0.8, 0.1
"""Standard deviations that are tried: a box of one pixel has 0.29. Beyond, and of radiance that
follows no material however wide the filter, nothing is told."""

LEAST, MOST = 0.75, 1.6
"""Slopes that are about 1: light differs along with material. With these bounds widths are within
0.05 pixels of the truth on each of our sequences, and right in the mean."""

GAIN, SURE = 1.2, 4.0
"""How many times more neighbours a filter explains than none does, and by how many standard errors
more; of our sequences filters explain 1.35 to 2.5 times as many as none, by 6 errors and more."""

APART_PX = 0.2
"""How far every measured width has to be from a declared one that is doubted: of our sequences,
filtered or not, each has a frame that is nearer to the truth."""

MOST_SKY = 0.5
"""Share of the sky from which a sample is none of a surface."""

INPUTS = PairInputs(
    lr=(Buffer.COLOR, Buffer.MATERIAL, Buffer.SKY),
    lr_optional=(Buffer.EMISSION, Buffer.ALBEDO),
    hr=(Buffer.MATERIAL, Buffer.SKY),
    hr_optional=(Buffer.EMISSION,),
    on_nonfinite=NonfinitePolicy.ZERO,
    straight=True,
)
"""What is read to tell."""


class Explained(NamedTuple):
    """How many neighbours a width explains.

    Attributes:
        share: of those whose material differs, 0..1.
        pairs: how many those are.
    """

    share: float
    pairs: int

    def is_better_than(self, other: Explained) -> bool:
        """Tell whether it is by more than chance."""
        error = math.sqrt(sum(e.share / max(e.pairs, 1) for e in (self, other)))
        return self.share > max(GAIN * other.share, other.share + SURE * error)


class FilterFinding(NamedTuple):
    """What radiance and HR material tell of a pixel filter.

    Attributes:
        width_px: standard deviation, LR pixels; 0 of point samples; None where no width that was
            tried is told.
        filtered: whether a filter explains more neighbours than none, though it may be wider than
            those tried.
    """

    width_px: float | None
    filtered: bool


def measure_filter(pair: FramePair, scale: int) -> FilterFinding | None:
    """Measure the pixel filter of a frame; None where too little differs to tell.

    Args:
        pair: read with `INPUTS`.
        scale: S.
    """
    slope = measure_slope(pair.lr)
    if slope is None or pair.hr is None:
        return None
    if slope >= FILTERED_SLOPE:
        return FilterFinding(0.0, filtered=False)
    none, *tried = _try_widths(pair.lr, pair.hr, scale)
    best = max(range(len(tried)), key=lambda n: tried[n].share)
    filtered = tried[best].is_better_than(none)
    if not filtered or best == len(tried) - 1:
        return FilterFinding(None, filtered)
    shares = [explained.share for explained in (none, *tried)][best : best + 3]
    return FilterFinding(STEP_PX * (best + 1 + _find_peak(*shares)), filtered)


def _try_widths(lr: Frame, hr: Frame, scale: int) -> list[Explained]:
    """What no filter explains, and then each width that is tried."""
    steps = range(1, round(WIDEST_PX / STEP_PX) + 1)
    filtered = (_filter_frame(lr, hr, STEP_PX * n, scale) for n in steps)
    return [_explain(frame) for frame in chain([lr], filtered)]


def _explain(frame: Frame) -> Explained:
    """Count the neighbours of a frame whose radiance changes as its material does."""
    slopes = find_slopes(frame)
    if len(slopes) < LEAST_PAIRS:
        return Explained(0.0, len(slopes))
    about_one = (slopes > LEAST) & (slopes < MOST)
    return Explained(float(about_one.float().mean()), len(slopes))


def _find_peak(before: float, most: float, after: float) -> float:
    """Where the parabola through three values is highest, from the middle one, in steps."""
    bend = before - 2.0 * most + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


def measure_first(
    read: Callable[[int], FramePair], numbers: Sequence[int], scale: int
) -> FilterFinding | None:
    """`measure_filter` of the first frame that tells a width: the first, the middle, the last.

    Where none does, what the first one that tells anything says; None where none does that either,
    or one cannot be read: whoever reads it next says why.

    Args:
        read: number -> pair of `INPUTS`.
        numbers: of the frames.
        scale: S.
    """
    first = None
    for number in _choose(numbers):
        try:
            found = measure_filter(read(number), scale)
        except FrameFolderError:
            return first
        if found is not None and found.width_px is not None:
            return found
        first = first or found
    return first


def find_other_width(
    read: Callable[[int], FramePair], numbers: Sequence[int], scale: int, declared_px: float
) -> float | None:
    """The width that frames have, where all that tell are far from the declared one; else None.

    Args:
        read: number -> pair of `INPUTS`.
        numbers: of the frames.
        scale: S.
        declared_px: standard deviation, LR pixels.
    """
    found = []
    for number in _choose(numbers):
        try:
            found.append(measure_filter(read(number), scale))
        except FrameFolderError:
            return None
    widths = sorted(f.width_px for f in found if f is not None and f.width_px is not None)
    # narrow filters look like point samples
    apart = [(width or min(declared_px, STEP_PX)) - declared_px for width in widths]
    if not apart or not (min(apart) > APART_PX or max(apart) < -APART_PX):
        return None
    return widths[len(widths) // 2]


def _choose(numbers: Sequence[int]) -> tuple[int, ...]:
    """The first, the middle, the last."""
    return tuple(dict.fromkeys((numbers[0], numbers[len(numbers) // 2], numbers[-1])))


def _filter_frame(lr: Frame, hr: Frame, width: float, scale: int) -> Frame:
    """The LR frame with a G-buffer that was filtered as its radiance is."""
    filtered = filter_gbuffer(hr.gbuffer, width, scale, lr.camera.jitter_px)
    filtered[Buffer.SKY] = (filtered[Buffer.SKY] > MOST_SKY).to(filtered[Buffer.SKY])
    return replace(lr, gbuffer=lr.gbuffer.with_buffers(filtered))
