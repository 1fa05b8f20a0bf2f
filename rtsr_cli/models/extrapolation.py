"""`warp`, `warp-guided`: frames between rendered ones, without any training.

`warp` fetches the last rendered radiance where each pixel was. `warp-guided` fetches its lighting,
from the pixel's own surface alone, fills what was not seen from the surface around, and multiplies
by the new frame's material: what a network corrects. Guo et al., ExtraNet, SIGGRAPH Asia 2021, for
the task; surfaces as Dammertz et al., HPG 2010.

Conventions: motion leads from samples to samples; every frame's jitter is taken into account.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import nn

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.frame_motion import chain_motion, exposure_ratio
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.lighting.past_lighting import (
    OPTIONAL_BUFFERS,
    SHADED_BUFFERS,
    UNSHADED_BUFFERS,
    carry_lighting,
    find_rendered,
    shade,
)
from rtsr_cli.core.system import FrameWindow, Prediction, State, System, build_baseline


@dataclass(frozen=True, kw_only=True)
class WarpConfig:
    """`warp` has no settings."""


@dataclass(frozen=True, kw_only=True)
class WarpGuidedConfig:
    """`warp-guided` has no settings."""


def warp(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Fetch radiance along the vectors: bilinear, the border repeated outside."""
    del network, state
    place = find_rendered(window)
    now, rendered = window.current, window.lr[place]
    moved, _ = backward_warp(rendered.gbuffer[Buffer.COLOR], chain_motion(window.lr[: place + 1]))
    return Prediction(image=moved * exposure_ratio(now, rendered))


def warp_guided(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Carry lighting along surfaces, fill holes along surfaces, multiply by the new material."""
    del network, state
    past = carry_lighting(window)
    return Prediction(
        image=shade(window, past, past.filled),
        debug={"log_lighting": past.filled, "hole": past.holes},
    )


WARP = System(
    name="warp",
    summary="the last rendered frame, moved along the vectors (baseline)",
    citation="backward warping",
    task=SystemTask.EXTRAPOLATE,
    lr_inputs=(Buffer.COLOR, Buffer.MOTION),
    unshaded_inputs=(Buffer.MOTION,),
    scales=(1,),
    history_frames=1,
    halo_px=None,
    config=WarpConfig,
    build=build_baseline,
    predict=warp,
)

WARP_GUIDED = System(
    name="warp-guided",
    summary="past lighting carried and filled along surfaces, times the new material (baseline)",
    citation="Dammertz et al. 2010; demodulation as ExtraNet, SIGGRAPH Asia 2021",
    task=SystemTask.EXTRAPOLATE,
    lr_inputs=SHADED_BUFFERS,
    lr_optional=OPTIONAL_BUFFERS,
    unshaded_inputs=UNSHADED_BUFFERS,
    unshaded_optional=OPTIONAL_BUFFERS,
    scales=(1,),
    history_frames=1,
    halo_px=None,
    config=WarpGuidedConfig,
    build=build_baseline,
    predict=warp_guided,
)

SYSTEMS = (WARP, WARP_GUIDED)
