"""Cameras, analytic frames and EXR sequences that the tests of core share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.layout_files import load_layout
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import find_shots
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame

NEAR_M = 0.05

Array = NDArray[Any]


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    """Tensors of a few pixels are slower in threads, much so on a busy machine."""
    torch.set_num_threads(1)


@pytest.fixture
def make_camera() -> Callable[..., CameraMetadata]:
    """A camera at `position`, turned by `yaw` and `pitch`, z up, infinite far plane."""

    def make(
        *,
        position: tuple[float, float, float] = (1.0, -2.0, 1.5),
        yaw: float = 0.4,
        pitch: float = 0.2,
        focal: tuple[float, float] = (1.3, 2.1),
        shift: tuple[float, float] = (0.0, 0.0),
        jitter_px: tuple[float, float] = (0.0, 0.0),
    ) -> CameraMetadata:
        forward = np.array(
            [
                -math.sin(yaw) * math.cos(pitch),
                math.cos(yaw) * math.cos(pitch),
                math.sin(pitch),
            ]
        )
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        world_to_camera = np.eye(4)
        world_to_camera[:3, :3] = np.stack([right, up, -forward], axis=1)
        world_to_camera[3, :3] = -np.asarray(position) @ world_to_camera[:3, :3]
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = focal
        projection[2, 0], projection[2, 1] = shift
        projection[2, 2] = projection[2, 3] = -1.0
        projection[3, 2] = -NEAR_M
        return CameraMetadata(
            world_to_camera=torch.from_numpy(world_to_camera),
            world_to_ndc=torch.from_numpy(world_to_camera @ projection),
            jitter_px=jitter_px,
        )

    return make


def _unproject(camera: CameraMetadata, size: tuple[int, int], depth: Array) -> Array:
    """World positions (h, w, 3) of a whole frame, through the inverse of worldToNDC."""
    assert camera.world_to_ndc is not None
    to_world = np.linalg.inv(camera.world_to_ndc.numpy())
    height, width = size
    positions = np.zeros((height, width, 3))
    for row in range(height):
        for column in range(width):
            d = depth[row, column]
            x = 2.0 * (column + 0.5 + camera.jitter_px[0]) / width - 1.0
            y = 1.0 - 2.0 * (row + 0.5 + camera.jitter_px[1]) / height
            world = np.array([x * d, y * d, d - NEAR_M, d]) @ to_world
            positions[row, column] = world[:3] / world[3]
    return positions


@pytest.fixture
def unproject() -> Callable[[CameraMetadata, tuple[int, int], Array], Array]:
    """World positions of pixels by inverting worldToNDC, pixel by pixel."""
    return _unproject


@pytest.fixture
def analytic_channels() -> Callable[..., dict[str, Array]]:
    """Channels of frame `number` in rtsr's own layout: smooth patterns, a strip of sky on top."""

    def make(number: int, size: tuple[int, int] = (12, 16)) -> dict[str, Array]:
        height, width = size
        y, x = np.mgrid[0:height, 0:width].astype(np.float32)
        x = x + number
        wave = 0.5 + 0.25 * np.sin(0.7 * x) + 0.2 * np.cos(0.5 * y)
        sky = y < max(1, height // 6)
        normal = np.stack([np.sin(0.3 * x), np.cos(0.2 * y), 1.5 + 0 * x])
        normal /= np.linalg.norm(normal, axis=0)
        albedo = np.stack([wave, 0.8 * wave, 0.3 + 0 * x]) * ~sky
        emission = np.stack([0.1 * wave, 0 * x, 0.05 * wave]) * ~sky
        radiance = albedo * (1.0 + 0.5 * wave) + emission + 0.7 * sky
        channels: dict[str, Array] = {}
        for prefix, planes, names in (
            ("", radiance, "RGB"),
            ("albedo.", albedo, "RGB"),
            ("material.", (0.9 * albedo + 0.04) * ~sky, "RGB"),
            ("emission.", emission, "RGB"),
            ("normal.", normal * ~sky, "XYZ"),
        ):
            for name, plane in zip(names, planes, strict=True):
                channels[prefix + name] = plane.astype(np.float16)
        channels["depth.Z"] = np.where(sky, 65504.0, 3.0 + wave).astype(np.float32)
        channels["metallic"] = (wave > 0.6).astype(np.float16)
        channels["roughness"] = (0.2 + 0.5 * wave).astype(np.float16)
        channels["motion.X"] = np.full(size, 1.0, np.float32)
        channels["motion.Y"] = (0.25 * y).astype(np.float32)
        channels["objectid"] = ((x // 4) * ~sky).astype(np.uint32)
        return channels

    return make


@pytest.fixture
def write_frames(
    analytic_channels: Callable[..., dict[str, Array]],
) -> Callable[..., Path]:
    """Write analytic frames as EXR: numbers, size, name pattern, and a change of the channels."""

    def write(
        folder: Path,
        numbers: Sequence[int] = (1, 2, 3),
        *,
        size: tuple[int, int] = (12, 16),
        name: str = "frame.{:04d}.exr",
        only: Sequence[str] | None = None,
        change: Callable[[int, dict[str, Array]], dict[str, Array]] | None = None,
        attributes: Mapping[str, Any] | None = None,
        data_window: PixelWindow | None = None,
        display_window: PixelWindow | None = None,
    ) -> Path:
        for number in numbers:
            channels = analytic_channels(number, size)
            if only is not None:
                channels = {k: v for k, v in channels.items() if k.split(".")[0] in only}
            if change is not None:
                channels = change(number, channels)
            write_exr(
                folder / name.format(number),
                channels,
                attributes=attributes,
                data_window=data_window,
                display_window=display_window,
            )
        return folder

    return write


@pytest.fixture
def open_folder() -> Callable[..., FrameReader]:
    """Survey the one shot of a folder, with a capture given as plain fields."""

    def open_one(folder: Path, *, layout: str | None = None, **options: Any) -> FrameReader:
        declared = options.pop("capture", {})
        side_car = options.pop("side_car", {})
        (shot,) = find_shots(folder)
        return open_frames(
            shot.frames,
            layout=None if layout is None else load_layout(layout),
            capture=CaptureDeclaration.model_validate(declared),
            side_car=side_car,
            **options,
        )

    return open_one


@pytest.fixture
def make_frame() -> Callable[..., Frame]:
    """A frame in memory from buffers, with a whole-frame view."""

    def make(
        buffers: Mapping[Buffer, torch.Tensor],
        *,
        camera: CameraMetadata | None = None,
        number: int = 1,
        lighting_scale: float = 1.0,
    ) -> Frame:
        gbuffer = GBuffer(buffers, f"shot, frame {number}")
        return Frame(
            number=number,
            gbuffer=gbuffer,
            camera=camera or CameraMetadata(),
            view=View(display=gbuffer.size),
            lighting_scale=lighting_scale,
        )

    return make
