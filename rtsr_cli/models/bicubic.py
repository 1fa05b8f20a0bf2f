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
import torch.nn.functional as F
from torch import nn

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import decode_log, decode_reinhard, encode_log, encode_reinhard
from rtsr_cli.core.imaging.demodulation import remodulate
from rtsr_cli.core.imaging.resampling import (
    BICUBIC_SUPPORT_PX,
    grow_valid,
    upsample_bicubic,
    upsample_masked_bicubic,
    upsample_nearest,
)
from rtsr_cli.core.shapes import Color, Mask
from rtsr_cli.core.system import Prediction, State, System, Window, build_baseline

HIGHLIGHT = 0.5
"""Tone-mapped value (radiance 1) from which overshoot is bounded."""

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


def predict_bicubic(network: nn.Module, window: Window, state: State) -> Prediction:
    """Enlarge c / (1 + c) and expand."""
    del network, state
    frame = window.current
    return Prediction(image=_upsample_radiance(frame.gbuffer[Buffer.COLOR], frame, window.scale))


def _upsample_radiance(color: Color, frame: Frame, scale: int) -> Color:
    encoded = encode_reinhard(color)
    enlarged = upsample_bicubic(encoded, scale, frame.camera.jitter_px)
    return decode_reinhard(bounded_highlights(enlarged, encoded, scale))


def bounded_highlights(enlarged: Color, encoded: Color, scale: int) -> Color:
    """Hold overshoot beside highlights at the brightest of the 5x5 samples around.

    In c / (1 + c) an overshoot of a hundredth above 0.99 is radiance without bound; below
    `HIGHLIGHT` the kernel's overshoot is the sharpening that it is meant to be.
    """
    reach = 2 * BICUBIC_SUPPORT_PX + 1
    brightest = F.max_pool2d(encoded, reach, stride=1, padding=BICUBIC_SUPPORT_PX)
    bound = upsample_nearest(brightest.clamp(min=HIGHLIGHT), scale)
    return torch.minimum(enlarged, bound)


def upsample_lighting(frame: Frame, scale: int, grow_px: int) -> Color:
    """Enlarge log lighting over divided pixels; beyond their reach, the nearest valid lighting.

    The log is that of `encode_log` with the frame's k; where nothing valid is near, lighting is k.
    """
    mask = frame.gbuffer[Buffer.LIGHTING_MASK]
    encoded = encode_log(frame.gbuffer[Buffer.LIGHTING], frame.lighting_scale)
    jitter_px = frame.camera.jitter_px
    smooth, supported = upsample_masked_bicubic(encoded, mask, scale, jitter_px)
    if bool(supported.all()):
        return decode_log(smooth, frame.lighting_scale)
    grown, reached = grow_valid(encoded, mask, grow_px)
    average = encode_log(torch.full_like(encoded, frame.lighting_scale), frame.lighting_scale)
    nearest = upsample_nearest(torch.where(reached > 0, grown, average), scale)
    return decode_log(torch.where(supported > 0, smooth, nearest), frame.lighting_scale)


def _upsample_where(color: Color, mask: Mask, frame: Frame, scale: int) -> Color:
    """Enlarge the radiance of some pixels only; where none is near, plain bicubic."""
    encoded = encode_reinhard(color)
    jitter_px = frame.camera.jitter_px
    own, supported = upsample_masked_bicubic(encoded, mask, scale, jitter_px)
    if not bool(supported.all()):
        own = torch.where(supported > 0, own, upsample_bicubic(encoded, scale, jitter_px))
    return decode_reinhard(bounded_highlights(own, encoded, scale))


def predict_demod_bicubic(network: nn.Module, window: Window, state: State) -> Prediction:
    """Enlarge lighting, multiply by HR material, add HR emission; sky from the LR sky alone."""
    del state
    config = cast(DemodBicubicConfig, network.config)
    frame, hr, scale = window.current, window.hr, window.scale
    if hr is None:
        raise MissingBufferError(f"{frame.gbuffer.where}: demod-bicubic needs HR material")
    lighting = upsample_lighting(frame, scale, config.grow_px)
    emission = hr.gbuffer.buffers.get(Buffer.EMISSION)
    surface = remodulate(lighting, hr.gbuffer[Buffer.MATERIAL], emission)
    hr_sky = hr.gbuffer[Buffer.SKY] > 0.5
    image = surface
    if bool(hr_sky.any()):
        color, sky = frame.gbuffer[Buffer.COLOR], frame.gbuffer[Buffer.SKY]
        image = torch.where(hr_sky, _upsample_where(color, sky, frame, scale), surface)
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
    hr_inputs=(Buffer.MATERIAL, Buffer.SKY),
    hr_optional=(Buffer.EMISSION,),
    halo_px=BICUBIC_SUPPORT_PX + JITTER_REACH_PX + 1,
    config=DemodBicubicConfig,
    build=build_baseline,
    predict=predict_demod_bicubic,
)

SYSTEMS = (BICUBIC, DEMOD_BICUBIC)
