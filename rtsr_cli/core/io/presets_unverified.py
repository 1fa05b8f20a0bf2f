"""Layout presets from documentation only: nobody has checked them on files of their engines."""

from __future__ import annotations

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import (
    Conventions,
    DepthConvention,
    DepthKind,
    RoughnessKind,
    SpecularWorkflow,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis
from rtsr_cli.core.io.layouts import (
    SCOPE,
    Component,
    Layout,
    either,
    in_file,
    named,
    single,
)

_MRQ = "FinalImageMovieRenderQueue_"
"""Begins the names of Movie Render Queue's own passes; those of custom ones are `FinalImage...`."""


def _mrq(buffer: Buffer, *passes: str) -> tuple[Component, ...]:
    """A pass as a file of its own, or as a layer of one file."""
    letters = "RGB"
    layers = [named(buffer, p, letters=letters[: _channels(buffer)]) for p in passes]
    return either(in_file(buffer, *(f"{SCOPE}{p}" for p in passes)), *layers)


def _channels(buffer: Buffer) -> int:
    return len(in_file(buffer, ""))


UNREAL_MRQ = Layout(
    name="unreal-mrq",
    description="Unreal Movie Render Queue: R G B A, FinalImageMovieRenderQueue_WorldDepth.*, ...",
    buffers={
        Buffer.COLOR: either(in_file(Buffer.COLOR, f"{SCOPE}FinalImage"), named(Buffer.COLOR, "")),
        Buffer.ALPHA: either(single("A", file=f"{SCOPE}FinalImage"), single("A")),
        Buffer.DEPTH: _mrq(Buffer.DEPTH, f"{_MRQ}WorldDepth"),
        # stored as 0.5 + 0.5 v
        Buffer.MOTION: tuple(
            Component(places=c.places, factor=2.0, offset=0.5)
            for c in _mrq(Buffer.MOTION, f"{_MRQ}MotionVectors")
        ),
        Buffer.NORMAL: _mrq(Buffer.NORMAL, f"{_MRQ}WorldNormal"),
        Buffer.ALBEDO: _mrq(Buffer.ALBEDO, "FinalImageBaseColor", "FinalImage*BaseColor"),
        Buffer.METALLIC: _mrq(Buffer.METALLIC, "FinalImageMetallic", "FinalImage*Metallic"),
        Buffer.ROUGHNESS: _mrq(Buffer.ROUGHNESS, "FinalImageRoughness", "FinalImage*Roughness"),
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


def _falcor(buffer: Buffer, *outputs: str, letters: str = "RGB") -> tuple[Component, ...]:
    """An output of any render pass: `<name>.<output>.<frame>.exr`."""
    return in_file(buffer, *(f"?*.{output}" for output in outputs), letters=letters)


FALCOR = Layout(
    name="falcor",
    description="Falcor (Mogwai): <name>.<output>.<frame>.exr, one file an output",
    buffers={
        Buffer.COLOR: _falcor(Buffer.COLOR, "color", "output", "outColor"),
        Buffer.ALBEDO: _falcor(Buffer.ALBEDO, "diffuseOpacity"),
        Buffer.SPECULAR: _falcor(Buffer.SPECULAR, "specRough"),
        Buffer.ROUGHNESS: _falcor(Buffer.ROUGHNESS, "specRough", letters="A"),
        Buffer.EMISSION: _falcor(Buffer.EMISSION, "emissive"),
        Buffer.NORMAL: _falcor(Buffer.NORMAL, "normW", "guideNormalW"),
        Buffer.POSITION: _falcor(Buffer.POSITION, "posW"),
        Buffer.MOTION: _falcor(Buffer.MOTION, "mvec"),
        # `depth` is the device's, which one layout cannot read beside this one
        Buffer.DEPTH: _falcor(Buffer.DEPTH, "linearZ"),
    },
    conventions=Conventions(
        motion=MotionConvention(unit=MotionUnit.UV), specular=SpecularWorkflow.F0
    ),
    digits=1,
    verified=False,
)


def _unity(buffer: Buffer, *names: str) -> tuple[Component, ...]:
    """An AOV as a file of its own, or as a part of one file."""
    letters = "RGB"
    parts = [named(buffer, n, letters=letters[: _channels(buffer)]) for n in names]
    return either(in_file(buffer, *(f"{SCOPE}{n}" for n in names)), *parts)


UNITY = Layout(
    name="unity",
    description="Unity Recorder AOVs (HDRP): parts of one file, or one sequence an AOV",
    buffers={
        Buffer.COLOR: either(
            in_file(Buffer.COLOR, f"{SCOPE}Beauty"), named(Buffer.COLOR, "Beauty", "")
        ),
        Buffer.ALBEDO: _unity(Buffer.ALBEDO, "Albedo"),
        Buffer.SPECULAR: _unity(Buffer.SPECULAR, "Specular"),
        Buffer.NORMAL: _unity(Buffer.NORMAL, "Normal", "Normals"),
        Buffer.DEPTH: _unity(Buffer.DEPTH, "Depth"),
        Buffer.ROUGHNESS: _unity(Buffer.ROUGHNESS, "Smoothness"),
        Buffer.METALLIC: _unity(Buffer.METALLIC, "Metal", "Metallic"),
        Buffer.MOTION: _unity(Buffer.MOTION, "MotionVectors", "MotionVector"),
        Buffer.EMISSION: _unity(Buffer.EMISSION, "Emissive", "Emission"),
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
        Buffer.COLOR: named(Buffer.COLOR, "", "image", "*path"),
        Buffer.ALPHA: single("A"),
        Buffer.ALBEDO: named(Buffer.ALBEDO, "albedo", "alb*", "*albedo*"),
        Buffer.NORMAL: named(Buffer.NORMAL, "normal", "sh_normal", "nn", "*norm*", "*nrm*"),
        Buffer.POSITION: named(Buffer.POSITION, "position", "pos*", "*pos*"),
        Buffer.DEPTH: single("depth.T", "*.T"),
    },
    conventions=Conventions(depth=DepthConvention(kind=DepthKind.RAY)),
    verified=False,
)

NUKE = Layout(
    name="nuke",
    description="Nuke layers: R G B A, depth.Z, forward.u/v, backward.u/v",
    buffers={
        Buffer.COLOR: named(Buffer.COLOR, "", "rgba"),
        Buffer.ALPHA: single("A", "rgba.A"),
        Buffer.DEPTH: single("depth.Z"),
        Buffer.MOTION: named(Buffer.MOTION, "backward", letters="uv"),
        Buffer.FORWARD: named(Buffer.FORWARD, "forward", letters="uv"),
    },
    conventions=Conventions(motion=MotionConvention(y_axis=YAxis.UP)),
    verified=False,
)

UNVERIFIED = (UNREAL_MRQ, FALCOR, UNITY, MITSUBA, NUKE)
"""They run only where a measurement or the user agrees."""
