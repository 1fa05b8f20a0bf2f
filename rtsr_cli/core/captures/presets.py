"""Layout presets: those checked on files at hand, or made to the letter of a specification."""

from __future__ import annotations

from collections.abc import Mapping

from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES
from rtsr_cli.core.captures.layouts import (
    SCOPE,
    ChannelPlace,
    Component,
    FolderTree,
    Layout,
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


def _name_blender_value(aov: str) -> tuple[str, ...]:
    """Names of an AOV of one value."""
    return tuple(f"{SCOPE}.{aov}{component}" for component in (".X", ".V", ".R", ""))


BLENDER = Layout(
    name="blender",
    description="Blender multilayer: <view layer>.Combined.*, .Depth.Z, .Vector.XYZW, AOVs",
    buffers={
        Buffer.COLOR: name_components(Buffer.COLOR, f"{SCOPE}.Combined"),
        Buffer.ALPHA: name_single_component(f"{SCOPE}.Combined.A"),
        # names of Blender 5 after those of Blender 4
        Buffer.ALBEDO: name_components(
            Buffer.ALBEDO,
            *(f"{SCOPE}.{p}" for p in ("albedo", "Denoising Albedo", "DiffCol", "Diffuse Color")),
        ),
        Buffer.SPECULAR: name_components(Buffer.SPECULAR, f"{SCOPE}.Glossy Color"),
        Buffer.NORMAL: name_components(Buffer.NORMAL, f"{SCOPE}.Normal"),
        Buffer.DEPTH: name_single_component(f"{SCOPE}.Depth.Z", f"{SCOPE}.Depth.V"),
        Buffer.ROUGHNESS: name_single_component(*_name_blender_value("roughness")),
        Buffer.METALLIC: name_single_component(*_name_blender_value("metallic")),
        Buffer.MOTION: name_components(Buffer.MOTION, f"{SCOPE}.Vector"),
        # Z, W lead from the next frame to this one, so both signs turn round
        Buffer.FORWARD: tuple(
            Component(places=(ChannelPlace(channel=f"{SCOPE}.Vector.{c}"),), factor=-1.0)
            for c in ("Z", "W")
        ),
        Buffer.EMISSION: name_components(
            Buffer.EMISSION, *(f"{SCOPE}.{p}" for p in ("emission", "Emit", "Emission"))
        ),
        Buffer.OBJECT_ID: name_single_component(
            *(f"{SCOPE}.{p}.{c}" for p in ("Object Index", "IndexOB") for c in "XV")
        ),
        Buffer.POSITION: name_components(Buffer.POSITION, f"{SCOPE}.Position"),
    },
    conventions=Conventions(motion=MotionConvention(y_axis=YAxis.UP)),
    scope="ViewLayer",
    ranked=True,
    # what the compositor makes of the view layers
    aside=("Composite",),
    # the colour of diffuse and glossy light together stand for base colour and metallic
    spare={Buffer.SPECULAR: Buffer.METALLIC},
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
        # the specification names no direction: that of FSR2, previous minus current with y down,
        # jitter excluded. Arm's Unreal exporter subtracts the other way round, as measurement tells
        motion=MotionConvention(unit=MotionUnit.UV),
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
