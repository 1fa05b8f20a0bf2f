"""Whether LR radiance is of the very points that its G-buffer is of, or a pixel filter's mean.

    slope = median of  (log c(p) - log c(q)) / (log m(p) - log m(q))

over neighbours p, q whose material m differs; c is radiance less emission. Light differs between
neighbours whatever their material, which the median leaves out: of point samples the slope is 1.
Surfaces whose base colour is 0 tell nothing: of a pass that is empty, m has what little is left.
A filter mixes both sides of an edge, the G-buffer does not: 0.1 to 0.5. So low is it of wrong
material as well, and of edges of surfaces without textures, each under a light of its own: there it
is above 0 no more often than below.
"""

from __future__ import annotations

import math

import torch

from rtsr_cli.core.choices import MATERIAL_EPSILON, NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.shapes import Plane

FILTERED_SLOPE = 0.5
"""Slope below which radiance was filtered."""

LEAST_CONTRAST = math.log(1.35)
"""Difference of log material from which neighbours tell anything."""

LEAST_PAIRS = 100
"""Neighbours that it takes to tell."""

SURE = 5.0
"""Standard errors that a share of neighbours is off: neighbours of neighbours are no new ones."""

LEAST_RADIANCE = 1e-4

INPUTS = PairInputs(
    lr=(Buffer.COLOR, Buffer.MATERIAL, Buffer.SKY),
    lr_optional=(Buffer.EMISSION, Buffer.ALBEDO),
    on_nonfinite=NonfinitePolicy.ZERO,
    straight=True,
)
"""What is read to tell."""


def is_point_sampled(source: PairSource) -> bool:
    """Tell whether radiance is point-sampled; true where that cannot be told.

    Where nothing says how wide a filter is, that of the first frame can still be found to be there:
    by the HR material, else by slopes of LR alone that are low and mostly above 0 all the same.
    """
    width = source.filter_width_px
    if width is not None:
        return width == 0.0
    if source.looks_filtered is not None:
        return not source.looks_filtered
    if source.missing(INPUTS):
        return True
    try:
        frame = source.load(source.reader.numbers[0], INPUTS).lr
    except FrameFolderError:
        # the run names what is wrong with it
        return True
    slopes = find_slopes(frame)
    if len(slopes) < LEAST_PAIRS or float(slopes.median()) >= FILTERED_SLOPE:
        return True
    follows = float((slopes > 0.0).float().mean())
    # of light alone, or of material that is wrong, signs are as good as chance
    return follows - 0.5 <= SURE * 0.5 / math.sqrt(len(slopes))


def measure_slope(frame: Frame) -> float | None:
    """Slope of log radiance over log material of a frame; None where too little differs."""
    slopes = find_slopes(frame)
    return float(slopes.median()) if len(slopes) >= LEAST_PAIRS else None


def find_slopes(frame: Frame) -> torch.Tensor:
    """The slopes of all neighbours whose material differs, k."""
    gbuffer = frame.gbuffer
    light, material = gbuffer[Buffer.COLOR], gbuffer[Buffer.MATERIAL]
    if Buffer.EMISSION in gbuffer:
        light = light - gbuffer[Buffer.EMISSION]
    known = (light > LEAST_RADIANCE) & (material > MATERIAL_EPSILON) & (gbuffer[Buffer.SKY] < 0.5)
    usable = known.all(1, keepdim=True)
    if Buffer.ALBEDO in gbuffer:
        usable &= (gbuffer[Buffer.ALBEDO] != 0.0).any(1, keepdim=True)
    logs = [_log_mean(image) for image in (light, material)]
    slopes = []
    for dim in (2, 3):
        shown, changed = (log.diff(dim=dim) for log in logs)
        inner = usable.shape[dim] - 1
        counted = usable.narrow(dim, 1, inner) & usable.narrow(dim, 0, inner)
        counted &= changed.abs() > LEAST_CONTRAST
        slopes.append((shown / changed)[counted])
    return torch.cat(slopes)


def _log_mean(image: torch.Tensor) -> Plane:
    """Mean over the channels of the logarithm."""
    mean: Plane = image.clamp(min=LEAST_RADIANCE).log().mean(1, keepdim=True)
    return mean
