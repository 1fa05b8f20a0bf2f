"""How wide a pixel filter went over LR radiance and not over its G-buffer; measured.

    slope(G) = median of  (log c(p) - log c(q)) / (log G[m](p) - log G[m](q))     `measure_slope`

c is LR radiance, m the HR material, G a Gaussian. Material that was filtered less than radiance
changes more from pixel to pixel, and the slope is below 1; material that was filtered more, less,
and it is above. The width is the smallest one at which it is about 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.filtered_gbuffer import filter_gbuffer
from rtsr_cli.core.pairs.point_samples import FILTERED_SLOPE, measure_slope
from rtsr_cli.core.pairs.sources import FramePair, PairInputs

WIDEST_PX, STEP_PX = 0.7, 0.1
"""Standard deviations that are tried: a box of one pixel has 0.29. Beyond, and of radiance that
follows no material however wide the filter, nothing is told."""

HALVINGS = 4
"""Of a step: 0.006 pixels are left."""

MATCHED_SLOPE = 0.95
"""Slope at which widths are right on our sequences in the mean, and within 0.1 pixels on each:
light that differs along with material moves it away from 1."""

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


def measure_filter_width(pair: FramePair, scale: int) -> float | None:
    """Standard deviation of the pixel filter, LR pixels; 0 of point samples.

    None where too little differs to tell, or no width fits.

    Args:
        pair: read with `INPUTS`.
        scale: S.
    """
    lr, hr = pair.lr, pair.hr
    slope = measure_slope(lr)
    if slope is None or hr is None:
        return None
    if slope >= FILTERED_SLOPE:
        return 0.0

    def is_wide_enough(width: float) -> bool:
        found = measure_slope(_filter_frame(lr, hr, width, scale))
        return found is not None and found >= MATCHED_SLOPE

    tried = [STEP_PX * n for n in range(1, round(WIDEST_PX / STEP_PX) + 1)]
    first = next((width for width in tried if is_wide_enough(width)), None)
    if first is None:
        return None
    low, high = first - STEP_PX, first
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_wide_enough(middle) else (middle, high)
    return 0.5 * (low + high)


def measure_first(
    read: Callable[[int], FramePair], numbers: Sequence[int], scale: int
) -> float | None:
    """`measure_filter_width` of the first frame that tells: the first, the middle, the last.

    None where none does, or cannot be read: whoever reads it next says why.

    Args:
        read: number -> pair of `INPUTS`.
        numbers: of the frames.
        scale: S.
    """
    for number in _choose(numbers):
        try:
            width = measure_filter_width(read(number), scale)
        except FrameFolderError:
            return None
        if width is not None:
            return width
    return None


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
            found.append(measure_filter_width(read(number), scale))
        except FrameFolderError:
            return None
    widths = sorted(width for width in found if width is not None)
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
