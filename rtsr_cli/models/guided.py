"""`demod-guided`: lighting enlarged along the surfaces of the HR G-buffer, without any training.

`demod-bicubic` smears the lighting of a foreground over what lies behind it. Here an HR pixel takes
lighting from LR samples on its own surface only, told by normals and depth; it is what the networks
of this package correct. Kopf et al., "Joint Bilateral Upsampling", SIGGRAPH 2007; edge-stopping as
Dammertz et al., "Edge-Avoiding A-Trous Wavelet Transform", HPG 2010.

Conventions: those of `lighting.lighting`; the frame's jitter is compensated; no history.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import nn

from rtsr_cli.core.lighting.filtered_lighting import match_filter
from rtsr_cli.core.lighting.lighting import (
    GUIDES,
    HR_BUFFERS,
    HR_OPTIONAL,
    LOG_LIGHTING,
    LR_BUFFERS,
    LR_OPTIONAL,
    build_lighting_inputs,
    compose_lighting,
)
from rtsr_cli.core.lighting.radiance import HALO_PX
from rtsr_cli.core.system import FrameWindow, Prediction, State, System, build_baseline


@dataclass(frozen=True, kw_only=True)
class DemodGuidedConfig:
    """`demod-guided` has no settings."""


def predict(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Enlarge lighting, multiply by HR material, add HR emission; sky from the LR sky alone."""
    del network, state
    inputs = build_lighting_inputs(match_filter(window), LOG_LIGHTING)
    return compose_lighting(LOG_LIGHTING, window, inputs, inputs["base"])


DEMOD_GUIDED = System(
    name="demod-guided",
    summary="enlargement of lighting along HR surfaces, times HR material (baseline)",
    citation="Kopf et al. 2007; Dammertz et al. 2010; demodulation as NSRD and FuseSR",
    lr_inputs=(*LR_BUFFERS, *GUIDES),
    lr_optional=LR_OPTIONAL,
    hr_inputs=(*HR_BUFFERS, *GUIDES),
    hr_optional=HR_OPTIONAL,
    halo_px=HALO_PX,
    matches_filter=True,
    config=DemodGuidedConfig,
    build=build_baseline,
    predict=predict,
)

SYSTEMS = (DEMOD_GUIDED,)
