"""Demodulating one frame, and back, to the channels that a file holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import torch

from rtsr_cli.core.derive import STRIP_PIXELS, DerivationConfig, derive_material, derive_sky
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.io.outputs import buffer_channels, image_channels
from rtsr_cli.core.shapes import Color, Image, Mask, Size


@dataclass(frozen=True, kw_only=True)
class FrameParts:
    """What is written of a frame.

    Attributes:
        channels: by name, as the file stores them.
        error: largest recomposition error relative to max(|c|, 1e-3).
        undivided: share of the pixels with mask 0.
    """

    channels: Mapping[str, Any]
    error: float = 0.0
    undivided: float = 0.0


def as_stored(image: Color, *, full: bool) -> Color:
    """Return the values that a file will hold."""
    return image if full else image.half().float()


def divided(frame: Frame, config: DerivationConfig, *, full: bool) -> FrameParts:
    """Demodulate one frame; divisor and emission are rounded before the division, not after.

    Only the quotient's own rounding is then left in the recomposed radiance.
    """
    layers: dict[Buffer, torch.Tensor] = {}
    error, count = 0.0, 0.0
    for top, strip in strips(frame):
        parts = divide(strip, config, full=full)
        lighting = as_stored(parts.lighting, full=full)
        product = dm.remodulate(lighting, parts.material, parts.emission)
        error = max(error, dm.recomposition_error(strip.gbuffer[Buffer.COLOR], product))
        count += float(parts.mask.sum(dtype=torch.float64))
        for buffer, image in (
            (Buffer.LIGHTING, lighting),
            (Buffer.MATERIAL, parts.material),
            (Buffer.LIGHTING_MASK, parts.mask),
            (Buffer.EMISSION, parts.emission),
        ):
            if image is not None:
                wide = full and buffer is not Buffer.LIGHTING_MASK
                _lay(layers, buffer, image, top, frame.size, full=wide)
    channels: dict[str, Any] = {}
    for buffer, image in layers.items():
        channels |= buffer_channels(buffer, image, full=image.dtype == torch.float32)
    channels["mask"] = channels.pop(Buffer.LIGHTING_MASK.value)
    height, width = frame.size
    return FrameParts(channels=channels, error=error, undivided=1.0 - count / (height * width))


def strips(frame: Frame) -> Iterator[tuple[int, Frame]]:
    """Cut a frame into strips of rows whose intermediates stay in the cache; with their tops."""
    height, width = frame.size
    rows = max(1, STRIP_PIXELS // width)
    for top in range(0, height, rows):
        yield top, frame.crop(top, 0, (min(rows, height - top), width))


def _lay(
    layers: dict[Buffer, torch.Tensor],
    buffer: Buffer,
    strip: Image,
    top: int,
    size: Size,
    *,
    full: bool,
) -> None:
    """Put a strip where it belongs in a picture of the whole frame, as the file stores it."""
    if buffer not in layers:
        dtype = torch.float32 if full else torch.float16
        layers[buffer] = torch.empty(1, strip.shape[1], *size, dtype=dtype)
    layers[buffer][:, :, top : top + strip.shape[2]].copy_(strip)


def divide(frame: Frame, config: DerivationConfig, *, full: bool) -> dm.Demodulated:
    """Demodulate with a divisor and an emission that a file can hold exactly."""
    softplus = config.mode is dm.DemodulationMode.SOFTPLUS
    material = as_stored(derive_material(frame, config), full=full)
    sky: Mask = torch.zeros_like(material[:, :1]) if softplus else derive_sky(frame.gbuffer)
    emission = None if softplus else frame.gbuffer.buffers.get(Buffer.EMISSION)
    return dm.demodulate(
        frame.gbuffer[Buffer.COLOR],
        material,
        sky=sky,
        emission=emission,
        epsilon=config.epsilon,
        stored=lambda image: as_stored(image, full=full),
    )


def recomposed(frame: Frame, config: DerivationConfig, *, full: bool) -> FrameParts:
    """Multiply lighting by material, and add the emission."""
    del config
    gbuffer = frame.gbuffer
    radiance = dm.remodulate(
        gbuffer[Buffer.LIGHTING],
        gbuffer[Buffer.MATERIAL],
        gbuffer.buffers.get(Buffer.EMISSION),
    )
    return FrameParts(channels=image_channels("", radiance, "RGB", full=full))
