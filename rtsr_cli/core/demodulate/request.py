"""What `demodulate` is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from rtsr_cli.core.choices import MATERIAL_EPSILON, DemodulationMode, LutConvention
from rtsr_cli.core.run.request import FramesRequest


@dataclass(frozen=True, kw_only=True)
class DemodulateRequest(FramesRequest):
    """Divide the radiance of IN by its material term, or multiply back.

    Attributes:
        mode: what radiance is divided by.
        convention: of the split-sum table.
        epsilon: smallest divisor; below it a pixel is left undivided.
        inverse: multiply lighting by material, add emission.
        full: write float instead of half.
    """

    mode: DemodulationMode = DemodulationMode.BRDF
    convention: LutConvention = LutConvention.KARIS
    epsilon: float = MATERIAL_EPSILON
    inverse: bool = False
    full: bool = False
