"""From memory to a file: the inverse of `conventions.to_memory`, number formats, channel names."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.frames.conventions import (
    StoredFrame,
    depth_from_metres,
    normal_from_world,
    roughness_from_perceptual,
)
from rtsr_cli.core.frames.motion import motion_from_pixels
from rtsr_cli.core.shapes import Image

MAX_HALF = 65504.0
"""The largest finite half: no radiance in a half file is above it."""

MOST_LOST = 0.01
"""Share of a frame's radiance that half may round away; of numbers from 6e-5 on it is 0.0005."""

HALF_STEP = 2.0**-24
"""Between the smallest halves: what is below half of it becomes 0."""

FEW_STEP = 61
"""One of so many pixels is looked at first."""

FLOAT_BUFFERS = frozenset({Buffer.DEPTH, Buffer.MOTION, Buffer.FORWARD, Buffer.POSITION})
"""Buffers that half precision would spoil; the others are colours and shares."""


def from_memory(buffer: Buffer, image: Tensor, frame: StoredFrame) -> Tensor:
    """Convert one buffer from memory's convention to its file's.

    Raises:
        MissingBufferError: the conversion needs camera matrices that are not there.
    """
    convert = _CONVERSIONS.get(buffer)
    return convert(image, frame) if convert else image


def _depth(image: Tensor, frame: StoredFrame) -> Tensor:
    return depth_from_metres(
        image, frame.conventions.depth, frame.camera, frame.view, where=frame.where
    )


def _motion(image: Tensor, frame: StoredFrame) -> Tensor:
    return motion_from_pixels(
        image,
        frame.conventions.motion,
        screen=frame.view.display,
        jitter_px=frame.camera.jitter_px,
        jitter_px_prev=frame.jitter_px_prev,
    )


def _forward(image: Tensor, frame: StoredFrame) -> Tensor:
    return motion_from_pixels(image, frame.conventions.motion.forward, screen=frame.view.display)


def _roughness(image: Tensor, frame: StoredFrame) -> Tensor:
    return roughness_from_perceptual(image, frame.conventions.roughness)


def _normal(image: Tensor, frame: StoredFrame) -> Tensor:
    return normal_from_world(image, frame.conventions.normal, frame.camera, where=frame.where)


def _position(image: Tensor, frame: StoredFrame) -> Tensor:
    return image / frame.conventions.metres_per_position


_CONVERSIONS: Mapping[Buffer, Callable[[Tensor, StoredFrame], Tensor]] = {
    Buffer.DEPTH: _depth,
    Buffer.MOTION: _motion,
    Buffer.FORWARD: _forward,
    Buffer.ROUGHNESS: _roughness,
    Buffer.NORMAL: _normal,
    Buffer.GEONORMAL: _normal,
    Buffer.POSITION: _position,
}


def largest_magnitude(image: Tensor) -> float:
    """Largest |value|, NaN where one is NaN; above `MAX_HALF` no half file can hold it."""
    low, high = (float(bound) for bound in torch.aminmax(image))
    return high if math.isnan(high) else max(abs(low), abs(high))


def fits_half(image: Tensor, largest: float | None = None) -> bool:
    """Tell whether half holds an image: no value beyond its range, and hardly any radiance lost.

    sum |x - half(x)| <= MOST_LOST sum |x|, which is so wherever mean |x| >= HALF_STEP / MOST_LOST,
    as no value loses more than 2^-11 of itself, or half a step. A few pixels tell that of most.

    Args:
        image: of any shape.
        largest: `largest_magnitude` of it, where that is known.
    """
    if (largest_magnitude(image) if largest is None else largest) > MAX_HALF:
        return False
    enough = image.numel() * HALF_STEP / MOST_LOST
    few = image.flatten()[::FEW_STEP]
    if float(few.abs().sum(dtype=torch.float64)) >= enough:
        return True
    whole = float(image.abs().sum(dtype=torch.float64))
    return whole >= enough or measure_loss(image) <= MOST_LOST * whole


def measure_loss(image: Tensor) -> float:
    """sum |x - half(x)|: what half rounds away."""
    return float((image - round_to_half(image).to(image.dtype)).abs().sum(dtype=torch.float64))


def round_to_half(values: Tensor) -> Tensor:
    """Round to half; values beyond its range become its largest finite value."""
    return values.clamp(-MAX_HALF, MAX_HALF).to(torch.float16)


def to_half(plane: Tensor) -> NDArray[np.float16]:
    """`round_to_half`, as an array, rounded once whatever the plane's own type."""
    if plane.dtype == torch.float64:
        # torch would round to float first
        return plane.clamp(-MAX_HALF, MAX_HALF).cpu().numpy().astype(np.float16)
    half: NDArray[np.float16] = round_to_half(plane).cpu().numpy()
    return half


def split_image(
    prefix: str, image: Image, components: str, *, full: bool = False
) -> dict[str, NDArray[Any]]:
    """Name the planes of an image `prefix.component` (`component` without a prefix).

    Args:
        prefix: layer name.
        image: 1 x c x h x w.
        components: one letter a channel; none if the layer's name is the channel's.
        full: store float instead of half.
    """
    planes = image[0] if image.dtype == torch.float16 and not full else image[0].float()
    names = [f"{prefix}.{c}" if prefix else c for c in components] or [prefix]
    return {
        name: planes[i].cpu().numpy() if full else to_half(planes[i])
        for i, name in enumerate(names)
    }


def split_buffer(buffer: Buffer, image: Image, *, full: bool = False) -> dict[str, Any]:
    """Name a buffer's planes as the canonical layout does."""
    return split_image(buffer.value, image, BUFFER_SPECS[buffer].components, full=full)
