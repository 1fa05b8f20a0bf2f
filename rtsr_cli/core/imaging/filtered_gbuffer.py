"""An HR G-buffer as the pixel filter of LR radiance saw it."""

from __future__ import annotations

from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.resampling import filter_at_samples
from rtsr_cli.core.shapes import Color


def carry_radiance(hr: GBuffer) -> Color:
    """Material of what carries radiance: 0 on sky, and where it is no number."""
    material: Color = hr[Buffer.MATERIAL].nan_to_num(nan=0.0) * (1.0 - hr[Buffer.SKY])
    return material


def filter_gbuffer(
    hr: GBuffer, width: float, scale: int, jitter_px: Jitter
) -> dict[Buffer, Tensor]:
    """Filter what radiance is made of, around the places of the LR samples.

    Args:
        hr: holds material and sky; emission where it is there.
        width: standard deviation of the filter, LR pixels.
        scale: S.
        jitter_px: of the LR samples.

    Returns:
        Material, 0 where the sky is; share of the sky; emission. At the LR size.
    """
    seen = {
        Buffer.MATERIAL: carry_radiance(hr),
        Buffer.SKY: hr[Buffer.SKY],
    }
    if Buffer.EMISSION in hr:
        seen[Buffer.EMISSION] = hr[Buffer.EMISSION]
    return {
        buffer: filter_at_samples(image, width, scale, jitter_px) for buffer, image in seen.items()
    }
