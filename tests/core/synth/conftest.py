"""Scenes, frames, and an independent projection."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.render import render_frame
from rtsr_cli.core.synth.scene import Scene

SIZE = (64, 96)

Array = NDArray[np.float64]


@cache
def _scene(seed: int) -> Scene:
    return draw_scene(seed)


@cache
def _frame(seed: int, number: int) -> Frame:
    return render_frame(_scene(seed), number, SIZE)


@pytest.fixture
def scene_of() -> Callable[[int], Scene]:
    """Scene of a seed, made once."""
    return _scene


@pytest.fixture
def frame_of() -> Callable[[int, int], Frame]:
    """Frame of a seed and a number at 96 x 64, rendered once."""
    return _frame


def pixels_of(camera: CameraMetadata, world: Array, size: tuple[int, int]) -> Array:
    """Pixel positions (2, ...) of world points (3, ...) through worldToNDC."""
    assert camera.world_to_ndc is not None
    points = np.concatenate([world, np.ones_like(world[:1])])
    q = np.einsum("i...,ij->j...", points, camera.world_to_ndc.numpy())
    x, y = q[0] / q[3], q[1] / q[3]
    return np.stack([(x * 0.5 + 0.5) * size[1], (0.5 - 0.5 * y) * size[0]])


@pytest.fixture
def project() -> Callable[[CameraMetadata, Array, tuple[int, int]], Array]:
    """Return the projection of world points to pixels."""
    return pixels_of


@pytest.fixture
def values() -> Callable[[Frame, Buffer], NDArray[np.float64]]:
    """A buffer as a float64 array (channels, height, width)."""

    def get(frame: Frame, buffer: Buffer) -> NDArray[np.float64]:
        return frame.gbuffer[buffer][0].double().numpy()

    return get


@pytest.fixture
def centres() -> Array:
    """Pixel centres (2, height, width) of a 96 x 64 frame."""
    rows, columns = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    return np.stack([columns + 0.5, rows + 0.5])
