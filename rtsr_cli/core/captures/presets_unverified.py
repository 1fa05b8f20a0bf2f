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
)
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import (
    Conventions,
    DepthConvention,
    DepthKind,
    RoughnessKind,
    SpecularWorkflow,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis

_MRQ = "FinalImageMovieRenderQueue_"
"""Begins the names of Movie Render Queue's own passes; those of custom ones are `FinalImage...`."""


def _mrq_components(buffer: Buffer, *passes: str) -> tuple[Component, ...]:
    """A pass as a file of its own, or as a layer of one file."""
    letters = "RGB"
    layers = [
        name_components(buffer, p, letters=letters[: _layer_components(buffer)]) for p in passes
    ]
    return join_places(name_file_components(buffer, *(f"{SCOPE}{p}" for p in passes)), *layers)


def _layer_components(buffer: Buffer) -> int:
    return len(name_file_components(buffer, ""))


UNREAL_MRQ = Layout(
    name="unreal-mrq",
    description="Unreal Movie Render Queue: R G B A, FinalImageMovieRenderQueue_WorldDepth.*, ...",
    buffers={
        Buffer.COLOR: join_places(
            name_file_components(Buffer.COLOR, f"{SCOPE}FinalImage"),
            name_components(Buffer.COLOR, ""),
        ),
        Buffer.ALPHA: join_places(
            name_single_component("A", file=f"{SCOPE}FinalImage"), name_single_component("A")
        ),
        Buffer.DEPTH: _mrq_components(Buffer.DEPTH, f"{_MRQ}WorldDepth"),
        # stored as 0.5 + 0.5 v
        Buffer.MOTION: tuple(
            Component(places=c.places, factor=2.0, offset=0.5)
            for c in _mrq_components(Buffer.MOTION, f"{_MRQ}MotionVectors")
        ),
        Buffer.NORMAL: _mrq_components(Buffer.NORMAL, f"{_MRQ}WorldNormal"),
        Buffer.ALBEDO: _mrq_components(
            Buffer.ALBEDO, "FinalImageBaseColor", "FinalImage*BaseColor"
        ),
        Buffer.METALLIC: _mrq_components(
            Buffer.METALLIC, "FinalImageMetallic", "FinalImage*Metallic"
        ),
        Buffer.ROUGHNESS: _mrq_components(
            Buffer.ROUGHNESS, "FinalImageRoughness", "FinalImage*Roughness"
        ),
    },
    conventions=Conventions(
        # a public decoder negates x only, which is current minus previous with y up
        motion=MotionConvention(
            unit=MotionUnit.UV,
            direction=MotionDirection.CURRENT_MINUS_PREVIOUS,
            y_axis=YAxis.UP,
        ),
        depth=DepthConvention(unit_m=0.01),
    ),
    folders=True,
    verified=False,
)


def _falcor_components(
    buffer: Buffer, *outputs: str, letters: str = "RGB"
) -> tuple[Component, ...]:
    """An output of any render pass: `<name>.<output>.<frame>.exr`."""
    return name_file_components(buffer, *(f"?*.{output}" for output in outputs), letters=letters)


FALCOR = Layout(
    name="falcor",
    description="Falcor (Mogwai): <name>.<output>.<frame>.exr, one file an output",
    buffers={
        Buffer.COLOR: _falcor_components(Buffer.COLOR, "color", "output", "outColor"),
        Buffer.ALBEDO: _falcor_components(Buffer.ALBEDO, "diffuseOpacity"),
        Buffer.SPECULAR: _falcor_components(Buffer.SPECULAR, "specRough"),
        Buffer.ROUGHNESS: _falcor_components(Buffer.ROUGHNESS, "specRough", letters="A"),
        Buffer.EMISSION: _falcor_components(Buffer.EMISSION, "emissive"),
        Buffer.NORMAL: _falcor_components(Buffer.NORMAL, "normW", "guideNormalW"),
        Buffer.POSITION: _falcor_components(Buffer.POSITION, "posW"),
        Buffer.MOTION: _falcor_components(Buffer.MOTION, "mvec"),
        # `depth` is the device's, which one layout cannot read beside this one
        Buffer.DEPTH: _falcor_components(Buffer.DEPTH, "linearZ"),
    },
    conventions=Conventions(
        motion=MotionConvention(unit=MotionUnit.UV), specular=SpecularWorkflow.F0
    ),
    digits=1,
    verified=False,
)


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
            name_components(Buffer.COLOR, "Beauty", ""),
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

MITSUBA = Layout(
    name="mitsuba",
    description="Mitsuba AOVs: R G B, <name>.R/G/B albedo, <name>.X/Y/Z normals, <name>.T depth",
    buffers={
        Buffer.COLOR: name_components(Buffer.COLOR, "", "image", "*path"),
        Buffer.ALPHA: name_single_component("A"),
        Buffer.ALBEDO: name_components(Buffer.ALBEDO, "albedo", "alb*", "*albedo*"),
        Buffer.NORMAL: name_components(
            Buffer.NORMAL, "normal", "sh_normal", "nn", "*norm*", "*nrm*"
        ),
        Buffer.POSITION: name_components(Buffer.POSITION, "position", "pos*", "*pos*"),
        Buffer.DEPTH: name_single_component("depth.T", "*.T"),
    },
    conventions=Conventions(depth=DepthConvention(kind=DepthKind.RAY)),
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

UNVERIFIED = (UNREAL_MRQ, FALCOR, UNITY, MITSUBA, NUKE)
"""They run only where a measurement or the user agrees."""
