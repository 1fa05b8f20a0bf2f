"""What the visual-error network sees: the frame before, brought to this one, and its G-buffer.

Pictures are display-encoded, c / (1 + c) and sRGB, as the error is measured on them; normals are in
camera space and 0..1. What is not seen in the frame before is 0, and the mask says so. Radiance of
the frame itself, which is not shaded yet, is never looked at.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.shapes import Color, Image, Mask
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.core.vrs.reprojection import encode_display, reproject
from rtsr_cli.core.vrs.shading_error import rec601_luma
from rtsr_cli.models.rt_percept.config import NetworkInputs, RtPerceptConfig

DIELECTRIC_F0 = 0.04

ALWAYS = (Buffer.COLOR, Buffer.MOTION, Buffer.DEPTH, Buffer.NORMAL, Buffer.VIEW_NORMAL)
BUFFERS = (*ALWAYS, Buffer.ALBEDO)
"""Of the four channels; the larger sets see more where it is there."""

OPTIONAL = (Buffer.METALLIC, Buffer.ROUGHNESS, Buffer.NOV, Buffer.EMISSION, Buffer.OBJECT_ID)

Channels = Callable[[Frame, Color, Mask], Image]
"""(frame, reprojected picture, mask of what was seen) -> channels."""


def _view_normal(frame: Frame) -> Image:
    return frame.gbuffer[Buffer.VIEW_NORMAL] * 0.5 + 0.5


def _plane_or_zero(frame: Frame, buffer: Buffer) -> Image:
    """A buffer, 0 where it is not there."""
    held = frame.gbuffer.buffers.get(buffer)
    return torch.zeros_like(frame.gbuffer[Buffer.DEPTH]) if held is None else held


def _diffuse_color(frame: Frame) -> Color:
    """Albedo times what is no metal."""
    return frame.gbuffer[Buffer.ALBEDO] * (1.0 - _plane_or_zero(frame, Buffer.METALLIC))


def _specular_color(frame: Frame) -> Color:
    """F0 = lerp(0.04, albedo, metallic)."""
    metallic = _plane_or_zero(frame, Buffer.METALLIC)
    return DIELECTRIC_F0 * (1.0 - metallic) + frame.gbuffer[Buffer.ALBEDO] * metallic


def _four_channels(frame: Frame, picture: Color, seen: Mask) -> Image:
    """Reprojected red, mask, diffuse red, z of the normal."""
    normal_z = _view_normal(frame)[:, 2:]
    return torch.cat([picture[:, :1], seen, _diffuse_color(frame)[:, :1], normal_z], dim=1)


def _luma(frame: Frame, picture: Color, seen: Mask) -> Image:
    """Luma of the reprojected picture, mask, luma of the diffuse colour, z of the normal."""
    normal_z = _view_normal(frame)[:, 2:]
    return torch.cat(
        [rec601_luma(picture), seen, rec601_luma(_diffuse_color(frame)), normal_z], dim=1
    )


def _reuse(frame: Frame, picture: Color, seen: Mask) -> Image:
    """Reprojected red, diffuse and specular red, z of the normal."""
    del seen
    normal_z = _view_normal(frame)[:, 2:]
    parts = [picture[:, :1], _diffuse_color(frame)[:, :1], _specular_color(frame)[:, :1], normal_z]
    return torch.cat(parts, dim=1)


def _three_channels(frame: Frame, picture: Color, seen: Mask) -> Image:
    """The reprojected picture alone."""
    del frame, seen
    return picture


def _sixteen_channels(frame: Frame, picture: Color, seen: Mask) -> Image:
    """Mask, normal, diffuse, shadow, roughness, specular, n.v, emission.

    No file holds a shadow buffer: its channel is 0.
    """
    del picture
    emission = frame.gbuffer.buffers.get(Buffer.EMISSION)
    shown = torch.zeros_like(frame.gbuffer[Buffer.ALBEDO])
    parts = [
        seen,
        _view_normal(frame),
        _diffuse_color(frame),
        torch.zeros_like(seen),
        _plane_or_zero(frame, Buffer.ROUGHNESS),
        _specular_color(frame),
        _plane_or_zero(frame, Buffer.NOV),
        shown if emission is None else encode_display(emission),
    ]
    return torch.cat(parts, dim=1)


def _nineteen_channels(frame: Frame, picture: Color, seen: Mask) -> Image:
    """Every candidate."""
    return torch.cat([picture, _sixteen_channels(frame, picture, seen)], dim=1)


SETS: dict[NetworkInputs, tuple[int, Channels]] = {
    NetworkInputs.FOUR: (4, _four_channels),
    NetworkInputs.LUMA: (4, _luma),
    NetworkInputs.THREE: (3, _three_channels),
    NetworkInputs.SIXTEEN: (16, _sixteen_channels),
    NetworkInputs.NINETEEN: (19, _nineteen_channels),
    NetworkInputs.REUSE: (4, _reuse),
}
"""Number of channels, and what makes them."""


def prepare(config: RtPerceptConfig, window: FrameWindow) -> Tensors:
    """`seen`: channels of the network; `mask`: 1 where the frame before shows the surface."""
    before = reproject(window)
    _, channels = SETS[config.inputs]
    seen = channels(window.current, before.picture, before.seen)
    return {"seen": seen, "mask": before.seen}
