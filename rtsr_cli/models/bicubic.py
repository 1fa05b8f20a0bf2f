"""`bicubic` and `demod-bicubic`: the baselines that a network has to beat.

`bicubic` enlarges tone-mapped radiance with the Keys kernel. `demod-bicubic` divides radiance by
the material term first, enlarges the smooth lighting, and multiplies by the material at the
target size, whose detail is exact.

Conventions: linear Rec.709 radiance in and out; the frame's jitter is compensated, so that both
are free of the offset that decimation leaves; no history.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import torch
from torch import nn

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.color import decode_log, encode_log
from rtsr_cli.core.imaging.demodulation import remodulate
from rtsr_cli.core.imaging.enlargement import (
    enlarge_log_lighting,
    enlarge_masked_radiance,
    enlarge_radiance,
)
from rtsr_cli.core.imaging.resampling import BICUBIC_SUPPORT_PX
from rtsr_cli.core.lighting.radiance import HALO_PX, add_undivided
from rtsr_cli.core.system import FrameWindow, Prediction, State, System, build_baseline

JITTER_REACH_PX = 1
"""Pixels that a jitter of up to half a pixel can add to a kernel's reach, rounded up."""


@dataclass(frozen=True, kw_only=True)
class BicubicConfig:
    """`bicubic` has no settings."""


@dataclass(frozen=True, kw_only=True)
class DemodBicubicConfig:
    """Settings of `demod-bicubic`.

    Attributes:
        grow_px: how far the nearest valid lighting is spread (3x3 steps) into pixels that no
            valid pixel reaches through the kernel.
    """

    grow_px: int = 1


def predict_bicubic(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Enlarge c / (1 + c) and expand."""
    del network, state
    frame = window.current
    color = frame.gbuffer[Buffer.COLOR]
    return Prediction(image=enlarge_radiance(color, window.scale, frame.camera.jitter_px))


def predict_demod_bicubic(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Enlarge lighting, multiply by HR material, add HR emission; sky from the LR sky alone."""
    del state
    config = cast(DemodBicubicConfig, network.config)
    frame, hr, scale = window.current, window.hr, window.scale
    if hr is None:
        raise MissingBufferError(f"{frame.gbuffer.where}: demod-bicubic needs HR material")
    jitter_px = frame.camera.jitter_px
    samples, mask = frame.gbuffer[Buffer.LIGHTING], frame.gbuffer[Buffer.LIGHTING_MASK]
    encoded = enlarge_log_lighting(
        encode_log(samples, frame.lighting_scale), mask, scale, jitter_px, grow_px=config.grow_px
    )
    lighting = decode_log(encoded, frame.lighting_scale)
    emission = hr.gbuffer.buffers.get(Buffer.EMISSION)
    surface = remodulate(lighting, hr.gbuffer[Buffer.MATERIAL], emission)
    hr_sky = hr.gbuffer[Buffer.SKY] > 0.5
    image = surface
    if bool(hr_sky.any()):
        color, sky = frame.gbuffer[Buffer.COLOR], frame.gbuffer[Buffer.SKY]
        image = torch.where(hr_sky, enlarge_masked_radiance(color, sky, scale, jitter_px), surface)
    image = add_undivided(window, image)
    return Prediction(
        image=image, debug={"lighting": lighting, "hr_material": hr.gbuffer[Buffer.MATERIAL]}
    )


BICUBIC = System(
    name="bicubic",
    summary="cubic enlargement of tone-mapped radiance (baseline)",
    citation="Keys 1981, a = -0.75",
    lr_inputs=(Buffer.COLOR,),
    halo_px=BICUBIC_SUPPORT_PX + JITTER_REACH_PX,
    config=BicubicConfig,
    build=build_baseline,
    predict=predict_bicubic,
)

DEMOD_BICUBIC = System(
    name="demod-bicubic",
    summary="cubic enlargement of lighting, times HR material (baseline)",
    citation="demodulation as NSRD (CVPR 2024) and FuseSR (SIGGRAPH Asia 2023)",
    lr_inputs=(Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY),
    lr_optional=(Buffer.EMISSION,),
    hr_inputs=(Buffer.MATERIAL, Buffer.SKY),
    hr_optional=(Buffer.EMISSION,),
    halo_px=HALO_PX,
    config=DemodBicubicConfig,
    build=build_baseline,
    predict=predict_demod_bicubic,
)

SYSTEMS = (BICUBIC, DEMOD_BICUBIC)
