"""Demodulating one frame, and back, to the channels that a file holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import torch

from rtsr_cli.core.choices import DemodulationMode
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.frames.storage import (
    MOST_LOST,
    fits_half,
    largest_magnitude,
    measure_loss,
    split_buffer,
    split_image,
)
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.imaging.derivation import (
    STRIP_PIXELS,
    DerivationConfig,
    derive_material,
)
from rtsr_cli.core.imaging.derived_geometry import derive_sky
from rtsr_cli.core.imaging.row_strips import cut_frame
from rtsr_cli.core.run.outputs import check_output
from rtsr_cli.core.shapes import Image, Mask, Size

REMEDY = "another --mode, or frames whose numbers are not near the largest float"
"""Of what not even float can hold."""


@dataclass(frozen=True, kw_only=True)
class FrameParts:
    """What is written of a frame.

    Attributes:
        channels: by name, as the file stores them.
        error: largest recomposition error relative to max(|c|, 1e-3).
        undivided: share of the pixels with mask 0.
        sky: share that is sky, among those.
        as_float: float was not asked for, but half cannot hold the frame.
    """

    channels: Mapping[str, Any]
    error: float = 0.0
    undivided: float = 0.0
    sky: float = 0.0
    as_float: bool = False


LIGHT = frozenset({Buffer.LIGHTING, Buffer.EMISSION})
"""Layers whose sum is the radiance."""


class FrameLayers:
    """The layers of one frame as its file holds them, laid down in strips of rows."""

    def __init__(self, size: Size, *, full: bool) -> None:
        """Start empty; layers are half unless `full`."""
        self.layers: dict[Buffer, torch.Tensor] = {}
        self._size = size
        self._full = full
        self._whole, self._lost = 0.0, 0.0

    @property
    def holds(self) -> bool:
        """Tell whether the layers hold the frame: nothing was too large, or too small, for half."""
        finite = all(math.isfinite(largest_magnitude(image)) for image in self.layers.values())
        return finite and self._lost <= MOST_LOST * self._whole

    def put(self, top: int, buffer: Buffer, strip: Image) -> Image:
        """Lay a strip down where it belongs; return it as it is stored."""
        full = self._full and buffer is not Buffer.LIGHTING_MASK
        if buffer not in self.layers:
            dtype = torch.float32 if full else torch.float16
            self.layers[buffer] = torch.empty(1, strip.shape[1], *self._size, dtype=dtype)
        stored = self.layers[buffer][:, :, top : top + strip.shape[2]].copy_(strip)
        if not full and buffer in LIGHT and not fits_half(strip):
            self._lost += measure_loss(strip)
        if not full and buffer in LIGHT:
            self._whole += float(strip.abs().sum())
        return strip if full else stored.float()


def demodulate_frame(frame: Frame, config: DerivationConfig, *, full: bool) -> FrameParts:
    """Demodulate one frame; divisor and emission are rounded before the division, not after.

    Only the quotient's own rounding is then left in the recomposed radiance. A frame that half
    cannot hold is made again as float.

    Raises:
        NonfiniteError: not even float can hold it; the frame is not written.
    """
    sheet = FrameLayers(frame.size, full=full)
    error, count, sky = 0.0, 0.0, 0.0
    for top, strip in cut_frame(frame, STRIP_PIXELS):
        put = partial(sheet.put, top)
        parts, of_sky = demodulate_strip(strip, config, put)
        lighting = put(Buffer.LIGHTING, parts.lighting)
        product = dm.remodulate(lighting, parts.material, parts.emission)
        error = max(error, dm.recomposition_error(strip.gbuffer[Buffer.COLOR], product))
        count += float(parts.mask.sum(dtype=torch.float64))
        sky += float((of_sky * (1.0 - parts.mask)).sum(dtype=torch.float64))
        put(Buffer.LIGHTING_MASK, parts.mask)
    if not full and not sheet.holds:
        return replace(demodulate_frame(frame, config, full=True), as_float=True)
    channels: dict[str, Any] = {}
    for buffer, image in sheet.layers.items():
        check_output(image, f"{frame.gbuffer.where}: '{buffer}' of the division", REMEDY)
        channels |= split_buffer(buffer, image, full=image.dtype == torch.float32)
    channels["mask"] = channels.pop(Buffer.LIGHTING_MASK.value)
    pixels = math.prod(frame.size)
    return FrameParts(
        channels=channels, error=error, undivided=1.0 - count / pixels, sky=sky / pixels
    )


def demodulate_strip(
    frame: Frame, config: DerivationConfig, put: Callable[[Buffer, Image], Image]
) -> tuple[dm.Demodulated, Mask]:
    """Demodulate with a divisor and an emission that a file can hold exactly, and put them there.

    Returns the parts, and what is sky.

    Args:
        frame: radiance and what its divisor follows from.
        config: the divisor.
        put: stores a layer and returns what is stored.
    """
    softplus = config.mode is DemodulationMode.SOFTPLUS
    material = put(Buffer.MATERIAL, derive_material(frame, config))
    sky: Mask = torch.zeros_like(material[:, :1]) if softplus else derive_sky(frame.gbuffer)
    emission = frame.gbuffer.buffers.get(Buffer.EMISSION) if config.has_emission else None
    parts = dm.demodulate(
        frame.gbuffer[Buffer.COLOR],
        material,
        sky=sky,
        emission=emission,
        epsilon=config.epsilon,
        stored=partial(put, Buffer.EMISSION),
    )
    if not bool(parts.mask.all()):
        # where nothing is divided the file's divisor is 1
        put(Buffer.MATERIAL, parts.material)
    return parts, sky


def recompose_frame(frame: Frame, config: DerivationConfig, *, full: bool) -> FrameParts:
    """Multiply lighting by material, and add the emission.

    Raises:
        NonfiniteError: the product is NaN or Inf somewhere; the frame is not written.
    """
    del config
    gbuffer = frame.gbuffer
    radiance = dm.remodulate(
        gbuffer[Buffer.LIGHTING],
        gbuffer[Buffer.MATERIAL],
        gbuffer.buffers.get(Buffer.EMISSION),
    )
    largest = check_output(radiance, f"{gbuffer.where}: lighting * material", REMEDY)
    as_float = not full and not fits_half(radiance, largest)
    return FrameParts(
        channels=split_image("", radiance, "RGB", full=full or as_float), as_float=as_float
    )
