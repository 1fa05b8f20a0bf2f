"""Exposure of a scene, as a photographer would set it once for a whole shot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.color import luminance
from rtsr_cli.core.synth.render import render_frame
from rtsr_cli.core.synth.scene import Scene
from rtsr_cli.core.synth.scene_kinds import arrange_scene

METER_SIZE = (36, 64)
"""(height, width) of the frame that is measured."""

MEDIAN_RADIANCE = (0.2, 0.46)
"""Median luminance that exposure leads to; the seed chooses where between."""

METERED_FRAME = 1


def draw_scene(seed: int) -> Scene:
    """Scene of a seed: place, things, materials, lights, animation and exposure.

    The median luminance of a small first frame comes to a value of `MEDIAN_RADIANCE`.
    """
    scene = arrange_scene(seed)
    frame = render_frame(scene, METERED_FRAME, METER_SIZE, buffers=(Buffer.COLOR,), threads=1)
    median = float(luminance(frame.gbuffer[Buffer.COLOR]).median())
    wanted = float(np.random.default_rng([seed, 21]).uniform(*MEDIAN_RADIANCE))
    return replace(scene, exposure=wanted / max(median, 1e-4))
