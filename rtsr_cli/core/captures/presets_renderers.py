"""Layouts of Mitsuba and Falcor, by their own source and files."""

from __future__ import annotations

from rtsr_cli.core.captures.layouts import (
    ChannelPlace,
    Component,
    Layout,
    UnreadPass,
    join_places,
    name_components,
    name_file_components,
    name_single_component,
)
from rtsr_cli.core.captures.presets_own import RTSR
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import (
    Conventions,
    DepthConvention,
    DepthKind,
    SpecularWorkflow,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionUnit


def _name_falcor(buffer: Buffer, *outputs: str, letters: str = "RGB") -> tuple[Component, ...]:
    """An output of any render pass: `<name>.<pass>.<output>.<frame>.exr`, or with alpha.

    Outputs that are marked with alpha are `<name>.<pass>.<output>.<frame>.RGBA.exr`.
    """
    files = (f"?*.{output}{mask}" for mask in ("", ".RGBA") for output in outputs)
    return name_file_components(buffer, *files, letters=letters)


FALCOR = Layout(
    name="falcor",
    description="Falcor (Mogwai): <name>.<output>.<frame>.exr, one file an output",
    buffers={
        Buffer.COLOR: _name_falcor(Buffer.COLOR, "color", "output", "outColor"),
        # what is left for diffuse light, and F0: no metal takes from them once more
        Buffer.ALBEDO: _name_falcor(Buffer.ALBEDO, "diffuseOpacity"),
        Buffer.SPECULAR: _name_falcor(Buffer.SPECULAR, "specRough"),
        Buffer.ROUGHNESS: _name_falcor(Buffer.ROUGHNESS, "specRough", letters="A"),
        Buffer.EMISSION: _name_falcor(Buffer.EMISSION, "emissive"),
        Buffer.NORMAL: _name_falcor(Buffer.NORMAL, "normW", "guideNormalW"),
        Buffer.GEONORMAL: _name_falcor(Buffer.GEONORMAL, "faceNormalW"),
        Buffer.POSITION: _name_falcor(Buffer.POSITION, "posW"),
        Buffer.MOTION: _name_falcor(Buffer.MOTION, "mvec"),
        # depth along the camera's axis where rays are traced; G-buffers that are rasterised leave
        # out the near plane
        Buffer.DEPTH: _name_falcor(Buffer.DEPTH, "linearZ"),
    },
    # position in the previous frame minus that in this one, shares of the screen, y down; jitter
    # is taken out by the pass itself
    conventions=Conventions(
        motion=MotionConvention(unit=MotionUnit.UV), specular=SpecularWorkflow.F0
    ),
    digits=1,
    ranked=True,
    unread=(
        UnreadPass(
            name="?*.depth",
            why="the device's depth; mark the output linearZ as well",
            unless=Buffer.DEPTH,
        ),
        UnreadPass(
            name="?*.mvecW",
            why="motion in the world; mark the output mvec as well",
            unless=Buffer.MOTION,
        ),
    ),
)


def _name_albedo() -> tuple[Component, ...]:
    """The layer of an AOV of type `albedo`: nested integrators alone have R, G, B and A."""
    named = name_components(Buffer.ALBEDO, "albedo", "alb*", "*albedo*")
    other = tuple(Component(places=(ChannelPlace(channel=f"*.{c}", without="A"),)) for c in "RGB")
    return join_places(named, other)


MITSUBA = Layout(
    name="mitsuba",
    description="Mitsuba AOVs: R G B, <name>.R/G/B albedo, <name>.X/Y/Z normals, <name>.T depth",
    bright_albedo="on conductors Mitsuba's albedo is the BRDF along the normal times pi, neither "
    "diffuse reflectance nor F0",
    # users name their AOVs: their types' names and those of the documentation come first, then
    # what tells a type; what scripts add is called as in rtsr's own layout
    buffers={
        **RTSR.buffers,
        Buffer.COLOR: name_components(Buffer.COLOR, "", "image", "img", "*path"),
        Buffer.ALPHA: name_single_component("A"),
        Buffer.ALBEDO: _name_albedo(),
        Buffer.NORMAL: name_components(
            Buffer.NORMAL,
            *("normal", "sh_normal", "nn", "n", "N", "ns", "sn", "sh_n", "normals"),
            *("*norm*", "*nrm*", "*Norm*"),
        ),
        Buffer.GEONORMAL: name_components(
            Buffer.GEONORMAL, "geonormal", "geo_normal", "gn", "ng", "geo_n", "gnormal"
        ),
        Buffer.POSITION: name_components(
            Buffer.POSITION, "position", "p", "P", "xyz", "pos*", "*pos*"
        ),
        # alone in its last letter; without it in files of Mitsuba before 3.6
        Buffer.DEPTH: name_single_component("depth.T", "*.T", "depth", "dd.y", "depth.Y"),
        Buffer.OBJECT_ID: name_single_component(
            *("objectid", "objectid.R", "shape_index.I", "si.I", "id.I", "*shape*.I", "shape_index")
        ),
    },
    conventions=Conventions(depth=DepthConvention(kind=DepthKind.RAY)),
    ranked=True,
    marks=("*.T", "*.I", "sh_normal.X", "geo_normal.X"),
)

RENDERERS = (MITSUBA, FALCOR)
"""Presets of renderers that write what their source says."""
