"""Lighting of a frame that was never shaded, from the last rendered one and the frame's G-buffer.

    q = lighting where radiance is divided, radiance without emission elsewhere (sky, no material)
    e = log(1 + q / k),  warped along surfaces, holes filled along surfaces
    radiance = k (exp(e) - 1) * material + emission

k is that of the rendered frame. Shadows and highlights stay where they were on their surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.enlargement import AVERAGE_LOG_LIGHTING
from rtsr_cli.core.imaging.frame_motion import chain_motion, exposure_ratio
from rtsr_cli.core.imaging.surface_history import (
    CarriedImage,
    fill_along_surfaces,
    warp_along_surfaces,
)
from rtsr_cli.core.imaging.surfaces import Surfaces, describe_surfaces, find_moving
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.lighting.lighting import decode_lighting, encode_lighting, lighting_scale_of
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx
from rtsr_cli.core.system import FrameWindow

SHADED_BUFFERS = (
    *(Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY),
    *(Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
)
"""What is read of rendered frames; motion, to get beyond them."""

UNSHADED_BUFFERS = (Buffer.MATERIAL, Buffer.SKY, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION)
"""What is read of frames that were not rendered."""

OPTIONAL_BUFFERS = (Buffer.EMISSION, Buffer.OBJECT_ID, Buffer.POSITION)
"""What is used of both where it is there."""


LEAST_WEIGHT = 0.2
"""Weight of same-surface pixels below which lighting is not known."""

LEAST_RADIANCE_WEIGHT = 1e-3
"""The same of radiance that is not divided: it holds texture, which no neighbour has."""


@dataclass(frozen=True, kw_only=True)
class PastLighting:
    """What the last rendered frame says of the current one.

    Attributes:
        rendered: that frame.
        encoded: e of it.
        own: surfaces of the current frame.
        motion_px: from the current samples to its samples.
        carried: e where its surfaces are the current ones.
        holes: 1 where too little of it is.
        filled: e everywhere.
    """

    rendered: Frame
    encoded: Image
    own: Surfaces
    motion_px: MotionPx
    carried: CarriedImage
    holes: Mask
    filled: Image


def find_rendered(window: FrameWindow) -> int:
    """Return the place in the window of the newest frame before the current one with radiance."""
    return next(i for i, past in enumerate(window.lr) if i and Buffer.COLOR in past.gbuffer)


def carry_lighting(window: FrameWindow) -> PastLighting:
    """Bring the last rendered lighting to the current frame's surfaces, once a window."""
    return window.compute_once(_carry_lighting)


def _carry_lighting(window: FrameWindow) -> PastLighting:
    place = find_rendered(window)
    now, rendered = window.current, window.lr[place]
    motion = chain_motion(window.lr[: place + 1])
    own = describe_surfaces(now, find_divided(now))
    past = describe_surfaces(rendered, rendered.gbuffer[Buffer.LIGHTING_MASK])
    encoded = encode_quantity(rendered)
    carried = warp_along_surfaces(
        encoded, motion, own.widen(find_moving(own, motion, rendered)), past
    )
    divided = find_divided(now)
    holes = find_holes(carried, divided)
    guess = guess_quantity(rendered, motion, divided)
    return PastLighting(
        rendered=rendered,
        encoded=encoded,
        own=own,
        motion_px=motion,
        carried=carried,
        holes=holes,
        filled=fill_along_surfaces(carried.values, holes, own, fallback=guess),
    )


def find_holes(carried: CarriedImage, divided: Mask) -> Mask:
    """1 where past pixels say too little of a surface: of its light, or of all that it shows."""
    least = torch.where(divided > 0.5, LEAST_WEIGHT, LEAST_RADIANCE_WEIGHT)
    return (carried.weight < least).to(carried.weight)


def guess_quantity(rendered: Frame, motion_px: MotionPx, divided: Mask) -> Image:
    """e of surfaces that were never seen: lighting is k; what is not divided, whatever was there.

    Args:
        rendered: the last rendered frame.
        motion_px: to its samples.
        divided: of the current pixels.
    """
    moved, _ = backward_warp(_encode(rendered, take_emission_out(rendered)), motion_px)
    return torch.where(divided > 0.5, AVERAGE_LOG_LIGHTING, moved)


def find_divided(frame: Frame) -> Mask:
    """1 where the G-buffer lets radiance be divided: some material in every channel, and no sky."""
    gbuffer = frame.gbuffer
    material = (gbuffer[Buffer.MATERIAL] > MATERIAL_EPSILON).all(1, keepdim=True)
    return (material & (gbuffer[Buffer.SKY] < 0.5)).to(gbuffer[Buffer.MATERIAL])


def encode_past(frame: Frame, rendered: Frame, scale: Tensor) -> Image:
    """e of a past frame at the exposure of the last rendered one.

    Args:
        frame: whose lighting it is, or radiance where nothing is divided.
        rendered: the last rendered frame.
        scale: k of it.
    """
    return encode_lighting(find_quantity(frame) * exposure_ratio(rendered, frame), scale)


def encode_quantity(rendered: Frame) -> Image:
    """e of a rendered frame, with its own k."""
    return _encode(rendered, find_quantity(rendered))


def find_quantity(frame: Frame) -> Color:
    """q: lighting where there is any, else radiance less emission."""
    divided = frame.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    return torch.where(divided, frame.gbuffer[Buffer.LIGHTING], take_emission_out(frame))


def take_emission_out(frame: Frame) -> Color:
    """Radiance less emission, never below 0."""
    radiance, emission = frame.gbuffer[Buffer.COLOR], frame.gbuffer.buffers.get(Buffer.EMISSION)
    return radiance if emission is None else (radiance - emission).clamp(min=0.0)


def _encode(frame: Frame, quantity: Color) -> Image:
    return encode_lighting(quantity, lighting_scale_of(frame))


def shade(window: FrameWindow, past: PastLighting, encoded: Image) -> Color:
    """Radiance of the current frame from e of its pixels, at its own exposure."""
    now = window.current
    quantity = decode_lighting(encoded, lighting_scale_of(past.rendered))
    quantity = quantity * exposure_ratio(now, past.rendered)
    image = torch.where(find_divided(now) > 0.5, quantity * now.gbuffer[Buffer.MATERIAL], quantity)
    emission = now.gbuffer.buffers.get(Buffer.EMISSION)
    return image if emission is None else image + emission
