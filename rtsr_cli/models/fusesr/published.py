"""What the paper and its code surround FuseSR's layers with, for the preset `paper`.

Raw lighting over softplus(F), radiance bounded, depth as stored and not warped with the history;
the output is the lighting itself, multiplied by the HR material and nothing else [FuseSR, code].
"""

from __future__ import annotations

from torch import Tensor

from rtsr_cli.core.choices import DemodulationMode
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting.lighting import LossWeights, keep_lighting, keep_picture, stored_depth
from rtsr_cli.core.shapes import Color
from rtsr_cli.models.fusesr.config import FuseSRSurroundings

MAX_RADIANCE = 10.0
"""Bound of the radiance, of the input and of the reference [FuseSR, code]."""


def bound_lighting(frame: Frame) -> Color:
    """LR lighting of radiance bounded at 10: min(c, 10) / F = L min(1, 10 / c)."""
    color = frame.gbuffer[Buffer.COLOR]
    return frame.gbuffer[Buffer.LIGHTING] * (MAX_RADIANCE / color).nan_to_num().clamp(0.0, 1.0)


def no_goal(reference: Frame, scale: Tensor) -> dict[str, Tensor]:
    """`Surroundings.goal`: radiance alone is compared."""
    del reference, scale
    return {}


PUBLISHED = FuseSRSurroundings(
    show_lighting=bound_lighting,
    show_depth=stored_depth,
    decode=keep_lighting,
    corrects_base=False,
    finish=keep_picture,
    goal=no_goal,
    max_radiance=MAX_RADIANCE,
    loss=LossWeights(log=0.0, tonemapped=0.0, radiance=1.0),
    brdf=DemodulationMode.SOFTPLUS,
    warps_depth=False,
)
