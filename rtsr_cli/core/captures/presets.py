"""Layout presets: those checked on files at hand, or made to the letter of a specification."""

from __future__ import annotations

from collections.abc import Mapping

from rtsr_cli.core.captures.buffer_expressions import name_sums
from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES
from rtsr_cli.core.captures.layouts import (
    SCOPE,
    ChannelPlace,
    Component,
    FolderTree,
    Layout,
    OpenMotion,
    UnreadPass,
    join_places,
    name_components,
    name_file_components,
    name_single_component,
)
from rtsr_cli.core.captures.presets_own import RTSR
from rtsr_cli.core.captures.presets_renderers import RENDERERS
from rtsr_cli.core.captures.presets_unreal import UNREAL
from rtsr_cli.core.captures.presets_unverified import UNVERIFIED
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention, DepthKind
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis


def _name_blender_values(*aovs: str) -> tuple[Component, ...]:
    """Names of AOVs of one value."""
    ends = (".X", ".V", ".R", "")
    return name_single_component(*(f"{SCOPE}.{aov}{end}" for aov in aovs for end in ends))


def _name_blender_vectors(buffer: Buffer, *passes: str) -> tuple[Component, ...]:
    """Names of passes that are vectors, after an AOV that is a colour."""
    return join_places(
        name_components(buffer, f"{SCOPE}.{buffer}", letters="RGB"),
        name_components(buffer, *(f"{SCOPE}.{name}" for name in (buffer, *passes))),
    )


def _sum_blender_passes(buffer: Buffer, *sums: tuple[str, ...]) -> tuple[Component, ...]:
    """An AOV that is called like the buffer, then sums of passes."""
    named = [" + ".join(f"{SCOPE}.{name}.RGB" for name in names) for names in sums]
    return name_sums(buffer, f"{SCOPE}.{buffer}.RGB", *named)


BLENDER = Layout(
    name="blender",
    description="Blender multilayer: <view layer>.Combined.*, .Depth.Z, .Vector.XYZW, AOVs",
    bright_albedo="Blender's Denoising Albedo holds reflections; its Diffuse Color, and an AOV of "
    "base colour, are above 1 only if they were multiplied",
    # AOVs that are called like rtsr's buffers come first; names of Blender 5 and of Blender 4
    buffers={
        Buffer.COLOR: name_components(Buffer.COLOR, f"{SCOPE}.Combined"),
        Buffer.ALPHA: name_single_component(f"{SCOPE}.Combined.A"),
        # `Denoising Albedo` is none: it holds what mirrors reflect
        Buffer.ALBEDO: name_components(
            Buffer.ALBEDO, *(f"{SCOPE}.{p}" for p in ("albedo", "DiffCol", "Diffuse Color"))
        ),
        Buffer.SPECULAR: name_components(
            Buffer.SPECULAR, *(f"{SCOPE}.{p}" for p in ("specular", "GlossCol", "Glossy Color"))
        ),
        # what light of each kind is multiplied by, so that their sum is what all light is
        Buffer.MATERIAL: _sum_blender_passes(
            Buffer.MATERIAL,
            ("Diffuse Color", "Glossy Color", "Transmission Color"),
            ("Diffuse Color", "Glossy Color"),
            ("DiffCol", "GlossCol", "TransCol"),
            ("DiffCol", "GlossCol"),
        ),
        Buffer.NORMAL: _name_blender_vectors(Buffer.NORMAL, "Normal"),
        Buffer.DEPTH: name_single_component(f"{SCOPE}.Depth.Z", f"{SCOPE}.Depth.V"),
        Buffer.ROUGHNESS: _name_blender_values("roughness"),
        Buffer.METALLIC: _name_blender_values("metallic"),
        Buffer.MOTION: name_components(Buffer.MOTION, f"{SCOPE}.Vector"),
        # Z, W lead from the next frame to this one, so both signs turn round
        Buffer.FORWARD: tuple(
            Component(places=(ChannelPlace(channel=f"{SCOPE}.Vector.{c}"),), factor=-1.0)
            for c in ("Z", "W")
        ),
        Buffer.EMISSION: _sum_blender_passes(
            Buffer.EMISSION,
            ("Emission", "Environment"),
            ("Emission",),
            ("Emit", "Env"),
            ("Emit",),
            ("Environment",),
            ("Env",),
        ),
        Buffer.OBJECT_ID: _name_blender_values("objectid", "object_id", "Object Index", "IndexOB"),
        Buffer.POSITION: _name_blender_vectors(Buffer.POSITION, "Position"),
        Buffer.REACTIVE: _name_blender_values("reactive"),
    },
    conventions=Conventions(motion=MotionConvention(y_axis=YAxis.UP)),
    scope="ViewLayer",
    ranked=True,
    # what the compositor makes of the view layers
    aside=("Composite",),
    # the colour of diffuse and glossy light together stand for base colour and metallic
    spare={Buffer.SPECULAR: Buffer.METALLIC},
    # base colour, metallic and roughness with the view's cosine divide 0.4 to 0.6 dB better than
    # the passes' colours, and need positions for it
    instead={
        Buffer.MATERIAL: (
            f"{SCOPE}.albedo.R",
            f"{SCOPE}.metallic*",
            f"{SCOPE}.roughness*",
            f"{SCOPE}.[Nn]ormal.[XR]",
            f"{SCOPE}.[Pp]osition.[XR]",
            f"{SCOPE}.Depth.[ZV]",
        )
    },
)

NSS = Layout(
    name="nss",
    description="Arm NSS captures: x2/{color,depth,motion}/<clip>/, ground_truth/, <clip>.json",
    buffers={
        Buffer.COLOR: name_file_components(Buffer.COLOR, "color", "ground_truth"),
        Buffer.ALPHA: (
            Component(
                places=tuple(ChannelPlace(channel="A", file=f) for f in ("color", "ground_truth"))
            ),
        ),
        Buffer.DEPTH: name_file_components(Buffer.DEPTH, "depth"),
        # `motion_m1` in data sets for frame generation, which lead further back as well
        Buffer.MOTION: name_file_components(Buffer.MOTION, "motion", "motion_gt", "motion_m1"),
    },
    conventions=Conventions(
        # jitter excluded, y down; the specification names no direction. Arm's model code fetches
        # at `grid - vector` and its Unreal exporter subtracts alike, which is followed; FSR2, whose
        # guide it refers to, has previous minus current
        motion=MotionConvention(
            unit=MotionUnit.UV, direction=MotionDirection.CURRENT_MINUS_PREVIOUS
        ),
        # forward or reversed by the side-car's ReverseZ
        depth=DepthConvention(kind=DepthKind.DEVICE),
    ),
    tree=FolderTree(
        lr="x{scale}/{buffer}/{shot}",
        hr="{buffer}/{shot}",
        lr_buffers=("color", "depth", "motion"),
        hr_buffers=("ground_truth", "motion_gt"),
        side_car="{shot}.json",
    ),
    open_motion=OpenMotion.SENSE,
    unread=(
        UnreadPass(
            name="motion_m2",
            why="its vectors lead two frames back, past the previous one that history is kept of",
        ),
    ),
)

NSRD = Layout(
    name="nsrd",
    description="NSRD data sets: {train,test}/{X4,GT}/<sequence>/<Buffer>/<frame>.exr",
    buffers={
        Buffer.LIGHTING: name_file_components(Buffer.LIGHTING, "Irradiance"),
        Buffer.MATERIAL: name_file_components(Buffer.MATERIAL, "BRDF"),
        Buffer.EMISSION: name_file_components(Buffer.EMISSION, "Emission_Sky"),
        Buffer.NORMAL: name_file_components(Buffer.NORMAL, "Normal"),
        Buffer.DEPTH: name_file_components(Buffer.DEPTH, "Depth"),
        Buffer.MOTION: name_file_components(Buffer.MOTION, "MV"),
    },
    # the published code samples the previous frame at `grid - vector` and multiplies by width
    # and height: current minus previous, shares of the screen, rows down
    conventions=Conventions(
        motion=MotionConvention(
            unit=MotionUnit.UV, direction=MotionDirection.CURRENT_MINUS_PREVIOUS
        )
    ),
    folders=True,
    tree=FolderTree(
        lr="X{scale}/{shot}/{buffer}",
        hr="GT/{shot}/{buffer}",
        lr_buffers=("Irradiance", "Normal", "Depth", "MV"),
        hr_buffers=("Irradiance", "BRDF", "Emission_Sky"),
    ),
    digits=1,
)

_ALL = (RTSR, BLENDER, NSS, NSRD, *UNREAL, *RENDERERS, *UNVERIFIED)

LAYOUTS: Mapping[str, Layout] = {
    name: next(layout for layout in _ALL if layout.name == name) for name in LAYOUT_NAMES
}
"""Every preset, by name."""
