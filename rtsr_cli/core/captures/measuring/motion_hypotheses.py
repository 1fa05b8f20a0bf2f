"""Every way in which dumps are known to store motion vectors."""

from __future__ import annotations

import itertools

from rtsr_cli.core.frames.motion import Axes, MotionConvention, MotionDirection, MotionUnit, YAxis

PIXEL_SCALES = (1.0, 1 / 8, 1 / 6, 1 / 4, 1 / 3, 1 / 2, 2.0, 3.0, 4.0, 6.0, 8.0)
"""Vectors in pixels of another resolution: the ratios of upscalers."""

UV_SCALES = (1.0, 2.0)
"""2: the encoding 0.5 + 0.5 v of a vector v that spans -1..1 over the whole screen."""


def list_hypotheses(centre: float) -> list[MotionConvention]:
    """Every reading of vectors that have this centre."""
    units = [(MotionUnit.PIXELS, s) for s in PIXEL_SCALES]
    units += [(MotionUnit.UV, s) for s in UV_SCALES] + [(MotionUnit.NDC, 1.0)]
    timings = [(d, 0) for d in MotionDirection]
    timings += [(d, o) for d in MotionDirection if not d.to_next for o in (1, -1)]
    return [
        MotionConvention(
            unit=unit,
            scale=scale,
            direction=direction,
            file_offset=offset,
            y_axis=y_axis,
            axes=axes,
            zero=centre,
        )
        for (direction, offset), (unit, scale), y_axis, axes in itertools.product(
            timings, units, YAxis, Axes
        )
    ]
