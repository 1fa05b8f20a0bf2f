"""Lighting of a frame that was never shaded, from the last rendered one and the frame's G-buffer.

    q = lighting where radiance is divided, radiance without emission elsewhere (sky, no material)
    e = log(1 + q / k),  warped along surfaces, holes filled along surfaces
    radiance = k (exp(e) - 1) * material + emission

k is that of the rendered frame. What no past pixel and none around shows is lit as what is seen
(`unseen_lighting`); where nothing is divided it is what lay there. Shadows and highlights stay
where they were on their surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import chain_motion, exposure_ratio
from rtsr_cli.core.imaging.surface_history import (
    CarriedImage,
    fill_along_surfaces,
    warp_with_and_without,
)
from rtsr_cli.core.imaging.surfaces import Surfaces, describe_surfaces, find_moving
from rtsr_cli.core.imaging.warping import warp_pixels
from rtsr_cli.core.lighting.lighting import decode_lighting, encode_lighting, lighting_scale_of
from rtsr_cli.core.lighting.unseen_lighting import guess_lighting
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
        moving: 1 where motion is not the camera's.
        carried: e where its surfaces are the current ones.
        plain: e along the vectors, whatever surface it is of, the border repeated.
        holes: 1 where too little of it is.
        filled: e everywhere.
    """

    rendered: Frame
    encoded: Image
    own: Surfaces
    motion_px: MotionPx
    moving: Mask
    carried: CarriedImage
    plain: Image
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
    divided = now.compute_once(find_divided)
    own = describe_surfaces(now, divided)
    moving = find_moving(own, motion, rendered)
    encoded = encode_quantity(rendered)
    carried, plain = warp_with_and_without(
        encoded, motion, own.widen(moving), rendered.compute_once(pack_surfaces)
    )
    holes = find_holes(carried, divided)
    known = (1.0 - holes) * divided

    def guess(pixels: Tensor) -> Tensor:
        lit = divided.flatten()[pixels] > 0.5
        guessed = encoded.new_empty(encoded.shape[1], len(pixels))
        guessed[:, lit] = guess_lighting(carried.values, known, own, pixels[lit])
        guessed[:, ~lit] = fetch_radiance(rendered, motion, pixels[~lit])
        return guessed

    return PastLighting(
        rendered=rendered,
        encoded=encoded,
        own=own,
        motion_px=motion,
        moving=moving,
        carried=carried,
        plain=plain,
        holes=holes,
        filled=fill_along_surfaces(carried.values, holes, own, fallback=guess),
    )


def pack_surfaces(rendered: Frame) -> Image:
    """`Surfaces.pack` of a rendered frame."""
    return describe_surfaces(rendered, rendered.gbuffer[Buffer.LIGHTING_MASK]).pack()


def find_holes(carried: CarriedImage, divided: Mask) -> Mask:
    """1 where past pixels say too little of a surface: of its light, or of all that it shows."""
    least = torch.where(divided > 0.5, LEAST_WEIGHT, LEAST_RADIANCE_WEIGHT)
    return (carried.weight < least).to(carried.weight)


def fetch_radiance(rendered: Frame, motion_px: MotionPx, pixels: Tensor) -> Tensor:
    """e of what lay where some pixels were, without its emission: c k.

    Args:
        rendered: the last rendered frame.
        motion_px: to its samples.
        pixels: index where rows follow each other, k.
    """
    radiance = take_emission_out(rendered)
    if not len(pixels):
        return radiance.new_empty(radiance.shape[1], 0)
    return warp_pixels(_encode(rendered, radiance), motion_px[0].flatten(1)[:, pixels], pixels)


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
    divided = now.compute_once(find_divided)
    image = torch.where(divided > 0.5, quantity * now.gbuffer[Buffer.MATERIAL], quantity)
    emission = now.gbuffer.buffers.get(Buffer.EMISSION)
    return image if emission is None else image + emission
