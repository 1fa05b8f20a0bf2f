"""Frames of a scene as files, and what is declared beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.io.exr import Plane, write_exr
from rtsr_cli.core.io.outputs import to_half
from rtsr_cli.core.io.presets import LAYOUTS

BASE = "frame"
"""Base name of the files."""

WRITABLE_LAYOUTS = ("rtsr",)

FULL_PRECISION = frozenset({Buffer.DEPTH, Buffer.MOTION, Buffer.FORWARD, Buffer.POSITION})
"""Buffers stored as float; half would round away sub-pixel motion and millimetres."""


def frame_path(folder: Path, number: int) -> Path:
    """`<folder>/frame.NNNN.exr`."""
    return folder / f"{BASE}.{'-' if number < 0 else ''}{abs(number):04d}.exr"


def _channels(frame: Frame) -> dict[str, Plane]:
    """Name the planes as rtsr's own layout does, each in the type it is stored in."""
    names = LAYOUTS["rtsr"].buffers
    channels: dict[str, Plane] = {}
    for buffer, tensor in frame.gbuffer.items():
        for component, plane in zip(names[buffer], tensor[0], strict=True):
            stored: Plane
            if buffer is Buffer.OBJECT_ID:
                stored = plane.numpy().view(np.uint32)
            elif buffer in FULL_PRECISION:
                stored = plane.numpy()
            else:
                stored = to_half(plane)
            channels[component.places[0].channel] = stored
    return channels


def write_frame(
    folder: Path, base: str, frame: Frame, layout: str, attributes: Mapping[str, Any]
) -> None:
    """Write a frame's buffers as `<folder>/<base>.NNNN.exr`.

    Raises:
        OutputError: the file cannot be written.
    """
    assert layout in WRITABLE_LAYOUTS
    path = folder / frame_path(folder, frame.number).name.replace(BASE, base, 1)
    write_exr(path, _channels(frame), attributes=attributes)


def camera_attributes(camera: CameraMetadata, number: int, fov_deg: float) -> dict[str, Any]:
    """Header attributes of a frame's camera: matrices (row-vector), number, field of view."""
    assert camera.world_to_camera is not None
    assert camera.world_to_ndc is not None
    return {
        "worldToCamera": camera.world_to_camera.numpy().astype(np.float32),
        "worldToNDC": camera.world_to_ndc.numpy().astype(np.float32),
        "frame": number,
        "horizontalFov": float(fov_deg),
    }


def stored_bytes(size: tuple[int, int]) -> int:
    """Memory of one frame of every buffer: float32, and once more as stored."""
    channels = sum(BUFFER_SPECS[b].channels for b in LAYOUTS["rtsr"].buffers)
    return size[0] * size[1] * channels * 6


CAPTURE = """\
# What the frames beside this file hold; every field is optional, see the README.
layout = "{layout}"
{scale}{jitter}
[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
jittered = false
"""


def capture_text(*, layout: str, scale: int | None, jitter: str | None, period: int) -> str:
    """Declarations of a shot.

    Jitter is declared as a sequence, not frame by frame: the text is then the same whichever
    `--frames` a run writes, and runs that write parts of a shot agree.

    Args:
        layout: of the files.
        scale: HR pixels per LR pixel, None for a single resolution.
        jitter: None, or the name of the sequence.
        period: its length.
    """
    value = (
        "[0.0, 0.0]"
        if jitter is None
        else f'{{ pattern = "{jitter}", period = {period}, first_frame = 1 }}'
    )
    return CAPTURE.format(
        layout=layout,
        scale="" if scale is None else f"scale = {scale}\n",
        jitter=f"jitter_px = {value}\n",
    )
