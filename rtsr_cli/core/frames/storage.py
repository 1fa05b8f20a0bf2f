"""From memory's convention to a file's: the inverse of `conventions.to_memory`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import (
    StoredFrame,
    depth_from_metres,
    normal_from_world,
    roughness_from_perceptual,
)
from rtsr_cli.core.frames.motion import motion_from_pixels


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
