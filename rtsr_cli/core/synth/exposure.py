"""Exposure of a scene, as a photographer would set it once for a whole shot."""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.color import luminance
from rtsr_cli.core.synth.arrangements import arranged
from rtsr_cli.core.synth.render import render_frame
from rtsr_cli.core.synth.scene import Scene

METER_SIZE = (36, 64)
"""(height, width) of the frame that is measured."""

MEDIAN_RADIANCE = 0.22
"""Median luminance that exposure leads to."""

METERED_FRAME = 1


def random_scene(seed: int) -> Scene:
    """Scene of a seed: place, things, materials, lights, animation and exposure.

    The median luminance of a small first frame comes to `MEDIAN_RADIANCE`.
    """
    scene = arranged(seed)
    frame = render_frame(scene, METERED_FRAME, METER_SIZE, buffers=(Buffer.COLOR,), threads=1)
    median = float(luminance(frame.gbuffer[Buffer.COLOR]).median())
    return replace(scene, exposure=MEDIAN_RADIANCE / max(median, 1e-4))
