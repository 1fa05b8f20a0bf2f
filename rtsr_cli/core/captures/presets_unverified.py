"""Layout presets from documentation only: nobody has checked them on files of their engines."""

from __future__ import annotations

from rtsr_cli.core.captures.layouts import (
    SCOPE,
    Component,
    Layout,
    join_places,
    name_components,
    name_file_components,
    name_single_component,
    name_unclaimed_components,
)
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import (
    Conventions,
    RoughnessKind,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis


def _layer_components(buffer: Buffer) -> int:
    return len(name_file_components(buffer, ""))


def _unity_components(buffer: Buffer, *names: str) -> tuple[Component, ...]:
    """An AOV as a file of its own, or as a part of one file."""
    letters = "RGB"
    parts = [
        name_components(buffer, n, letters=letters[: _layer_components(buffer)]) for n in names
    ]
    return join_places(name_file_components(buffer, *(f"{SCOPE}{n}" for n in names)), *parts)


UNITY = Layout(
    name="unity",
    description="Unity Recorder AOVs (HDRP): parts of one file, or one sequence an AOV",
    buffers={
        Buffer.COLOR: join_places(
            name_file_components(Buffer.COLOR, f"{SCOPE}Beauty"),
            name_components(Buffer.COLOR, "Beauty"),
            name_unclaimed_components(*"RGB"),
        ),
        Buffer.ALBEDO: _unity_components(Buffer.ALBEDO, "Albedo"),
        Buffer.SPECULAR: _unity_components(Buffer.SPECULAR, "Specular"),
        Buffer.NORMAL: _unity_components(Buffer.NORMAL, "Normal", "Normals"),
        Buffer.DEPTH: _unity_components(Buffer.DEPTH, "Depth"),
        Buffer.ROUGHNESS: _unity_components(Buffer.ROUGHNESS, "Smoothness"),
        Buffer.METALLIC: _unity_components(Buffer.METALLIC, "Metal", "Metallic"),
        Buffer.MOTION: _unity_components(Buffer.MOTION, "MotionVectors", "MotionVector"),
        Buffer.EMISSION: _unity_components(Buffer.EMISSION, "Emissive", "Emission"),
    },
    conventions=Conventions(
        motion=MotionConvention(
            unit=MotionUnit.UV,
            direction=MotionDirection.CURRENT_MINUS_PREVIOUS,
            y_axis=YAxis.UP,
        ),
        roughness=RoughnessKind.SMOOTHNESS,
    ),
    folders=True,
    verified=False,
)

NUKE = Layout(
    name="nuke",
    description="Nuke layers: R G B A, depth.Z, forward.u/v, backward.u/v",
    buffers={
        Buffer.COLOR: name_components(Buffer.COLOR, "", "rgba"),
        Buffer.ALPHA: name_single_component("A", "rgba.A"),
        Buffer.DEPTH: name_single_component("depth.Z"),
        Buffer.MOTION: name_components(Buffer.MOTION, "backward", letters="uv"),
        Buffer.FORWARD: name_components(Buffer.FORWARD, "forward", letters="uv"),
    },
    conventions=Conventions(motion=MotionConvention(y_axis=YAxis.UP)),
    verified=False,
)

UNVERIFIED = (UNITY, NUKE)
"""They run only where a measurement or the user agrees."""
