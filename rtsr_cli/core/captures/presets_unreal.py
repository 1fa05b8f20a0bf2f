"""Layouts of frames out of Unreal: ExtraNet's dumps, and those of Movie Render Queue."""

from __future__ import annotations

from rtsr_cli.core.captures.layouts import (
    SCOPE,
    Component,
    Layout,
    UnreadPass,
    join_places,
    list_suffixes,
    name_components,
    name_file_components,
    name_single_component,
    name_unclaimed_components,
)
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention
from rtsr_cli.core.frames.conventions import NormalConvention as Normals
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis

CENTIMETRE = 0.01

SPECULAR_IS_NOT_F0 = (
    "Unreal's Specular (0.5 by default) is no reflectance: F0 of what is no metal is 0.08 times "
    "it, and follows from base colour and metallic with Specular at 0.5"
)
"""Why that pass is not read: rtsr's `specular` is the colour F0 itself."""


def _name_extranet(buffer: Buffer, *names: str) -> tuple[Component, ...]:
    """Spellings of a buffer behind the name of a scene, or alone."""
    return name_file_components(buffer, *(f"{SCOPE}{name}" for name in names))


EXTRANET = Layout(
    name="extranet",
    description="ExtraNet's Unreal dumps: <Scene><Buffer>.<frame>.exr, or a folder a buffer",
    buffers={
        Buffer.COLOR: _name_extranet(Buffer.COLOR, "PreTonemapHDRColor", "PreTonemapHDR"),
        Buffer.ALBEDO: _name_extranet(Buffer.ALBEDO, "BaseColor"),
        Buffer.NORMAL: _name_extranet(Buffer.NORMAL, "WorldNormal", "SceneNormal"),
        Buffer.DEPTH: _name_extranet(
            Buffer.DEPTH, "SceneDepth", "SceneDepthAndNoV", "SceneDepthWorldUnits"
        ),
        Buffer.ROUGHNESS: _name_extranet(Buffer.ROUGHNESS, "Roughness"),
        Buffer.METALLIC: _name_extranet(Buffer.METALLIC, "Metallic"),
        Buffer.MOTION: _name_extranet(
            Buffer.MOTION, "MotionVector", "MotionVectors", "MotionVectorAndMetallicAndRoughness"
        ),
        Buffer.POSITION: _name_extranet(Buffer.POSITION, "WorldPosition"),
        Buffer.NOV: _name_extranet(Buffer.NOV, "NoV"),
        Buffer.OBJECT_ID: _name_extranet(Buffer.OBJECT_ID, "MyStencil", "Stencil", "CustomStencil"),
    },
    conventions=Conventions(
        # the previous position of (row i, column j) is (i + y, j - x)
        motion=MotionConvention(direction=MotionDirection.CURRENT_MINUS_PREVIOUS, y_axis=YAxis.UP),
        # centimetres times 1e-4: 1.0 is 100 m
        depth=DepthConvention(unit_m=100.0),
        normal=Normals(sky=(-1.0, -1.0, -1.0)),
        position_unit_m=CENTIMETRE,
    ),
    folders=True,
    # without the constant
    other_depth_units=(CENTIMETRE,),
    unread=(UnreadPass(name="*Specular", why=SPECULAR_IS_NOT_F0),),
)

_PASS = "FinalImage"
"""Begins the name of every pass; behind it stands that of the pass's material."""

_OWN = "MovieRenderQueue_"
"""Begins the names of the materials that come with Movie Render Queue."""


def _name_pass(buffer: Buffer, *materials: str) -> tuple[Component, ...]:
    """A pass as a file or folder of its own, or as a layer of one file.

    Users call their materials as they like (`M_BaseColor`): what the name ends in counts.
    """
    letters = "RGB"[: len(list_suffixes(buffer))]
    exact = [f"{_PASS}{material}" for material in materials]
    loose = [f"{_PASS}*{material}" for material in materials]
    return join_places(
        name_file_components(buffer, *(f"{SCOPE}{name}" for name in [*exact, *loose])),
        *(name_components(buffer, name, letters=letters) for name in [*exact, *loose]),
    )


UNREAL_MRQ = Layout(
    name="unreal-mrq",
    description="Unreal Movie Render Queue: R G B A, FinalImageMovieRenderQueue_WorldDepth.*, ...",
    buffers={
        Buffer.COLOR: join_places(
            name_file_components(Buffer.COLOR, f"{SCOPE}{_PASS}"),
            name_unclaimed_components(*"RGB"),
            _name_pass(Buffer.COLOR, "PreTonemapHDRColor"),
        ),
        Buffer.ALPHA: join_places(
            name_single_component("A", file=f"{SCOPE}{_PASS}"),
            name_unclaimed_components("A"),
        ),
        Buffer.DEPTH: _name_pass(Buffer.DEPTH, f"{_OWN}WorldDepth", "WorldDepth", "SceneDepth"),
        # stored as 0.5 + 0.5 v
        Buffer.MOTION: tuple(
            Component(places=c.places, factor=2.0, offset=0.5)
            for c in _name_pass(
                Buffer.MOTION, f"{_OWN}MotionVectors", "MotionVectors", "MotionVector"
            )
        ),
        Buffer.NORMAL: _name_pass(Buffer.NORMAL, f"{_OWN}WorldNormal", "WorldNormal"),
        Buffer.ALBEDO: _name_pass(Buffer.ALBEDO, "BaseColor"),
        Buffer.METALLIC: _name_pass(Buffer.METALLIC, "Metallic"),
        Buffer.ROUGHNESS: _name_pass(Buffer.ROUGHNESS, "Roughness"),
        Buffer.POSITION: _name_pass(Buffer.POSITION, "WorldPosition"),
    },
    conventions=Conventions(
        # a public decoder negates x only, which is current minus previous with y up
        motion=MotionConvention(
            unit=MotionUnit.UV,
            direction=MotionDirection.CURRENT_MINUS_PREVIOUS,
            y_axis=YAxis.UP,
        ),
        depth=DepthConvention(unit_m=CENTIMETRE),
        position_unit_m=CENTIMETRE,
    ),
    folders=True,
    ranked=True,
    # documentation and decoders disagree on the factor
    open_motion=True,
    unread=tuple(
        UnreadPass(name=f"*{_PASS}*Specular{end}", why=SPECULAR_IS_NOT_F0) for end in ("", ".[RGB]")
    ),
)

UNREAL = (EXTRANET, UNREAL_MRQ)
"""Presets of frames out of Unreal."""
