"""What becomes of a rendered frame in files, and what is declared beside them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.measuring.declaration_text import (
    HEADING,
    list_motion_lines,
    write_toml_value,
)
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, VECTOR_BUFFERS, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig, derive_lighting, derive_material
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.synth.render import ALL_BUFFERS

BASE = "frame"
"""Base name of the files."""

SHOT = "0"
"""Name of the shot in data sets that keep resolutions and buffers apart."""


def holds_divided(layout: Layout) -> bool:
    """Tell whether a layout has divided lighting in place of radiance."""
    return Buffer.LIGHTING in layout.buffers and Buffer.COLOR not in layout.buffers


MOTION_STEPS = 1024
"""Vectors are rounded to this share of a pixel: the rest is noise that does not compress."""


def list_written_buffers(layout: Layout) -> tuple[Buffer, ...]:
    """Buffers that are worth their place in a file.

    Positions follow from depth and camera, so that only layouts with files of their own for each
    buffer get them.
    """
    return tuple(b for b in ALL_BUFFERS if layout.files or b is not Buffer.POSITION)


def prepare_for_storage(frame: Frame, layout: Layout) -> Frame:
    """Round vectors, and add the buffers of a layout that follow from others.

    Those are divided lighting and its divisor, where the layout has them in place of radiance.
    """
    vectors = {
        b: (frame.gbuffer[b] * MOTION_STEPS).round() / MOTION_STEPS
        for b in VECTOR_BUFFERS
        if b in frame.gbuffer
    }
    frame = replace(frame, gbuffer=frame.gbuffer.with_buffers(vectors))
    gbuffer = frame.gbuffer
    if not holds_divided(layout) or not {Buffer.ALBEDO, Buffer.DEPTH} <= set(gbuffer):
        return frame
    config = DerivationConfig()
    if Buffer.COLOR not in gbuffer:
        return replace(
            frame,
            gbuffer=gbuffer.with_buffers({Buffer.MATERIAL: derive_material(frame, config)}),
        )
    parts = derive_lighting(frame, config)
    added = {Buffer.LIGHTING: parts.lighting, Buffer.MATERIAL: parts.material}
    return replace(frame, gbuffer=gbuffer.with_buffers(added))


def describe_camera(camera: CameraMetadata, number: int, fov_deg: float) -> dict[str, Any]:
    """Header attributes of a frame's camera: matrices (row-vector), number, field of view."""
    assert camera.world_to_camera is not None
    assert camera.world_to_ndc is not None
    return {
        "worldToCamera": camera.world_to_camera.numpy().astype(np.float32),
        "worldToNDC": camera.world_to_ndc.numpy().astype(np.float32),
        "frame": number,
        "horizontalFov": float(fov_deg),
    }


def count_stored_bytes(size: Size) -> int:
    """Memory of one frame of every buffer: float32, and once more as stored."""
    channels = sum(BUFFER_SPECS[b].channels for b in LAYOUTS["rtsr"].buffers)
    return size[0] * size[1] * channels * 6


def write_declarations(
    *, layout: Layout, scale: int | None, jitter: str | None, period: int
) -> str:
    """Declarations of a shot.

    Jitter is declared as a sequence, not frame by frame: the text is then the same whichever
    `--frames` a run writes, and runs that write parts of a shot agree.

    Args:
        layout: of the files.
        scale: HR pixels per LR pixel, None for a single resolution.
        jitter: None, or the name of the sequence.
        period: its length.
    """
    sequence = {"pattern": jitter, "period": period, "first_frame": 1}
    lines = [HEADING, f"layout = {write_toml_value(layout.name)}"]
    lines += [] if scale is None else [f"scale = {scale}"]
    lines += [f"jitter_px = {write_toml_value([0.0, 0.0] if jitter is None else sequence)}"]
    has_motion = {Buffer.MOTION, Buffer.FORWARD} & set(layout.buffers)
    lines += ["[motion]", *list_motion_lines(layout.conventions.motion)] if has_motion else []
    return "\n".join(lines) + "\n"
