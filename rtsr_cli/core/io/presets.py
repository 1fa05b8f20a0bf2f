"""Layout presets: those checked on files at hand, or made to the letter of a specification."""

from __future__ import annotations

from collections.abc import Mapping

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions, DepthConvention, DepthKind
from rtsr_cli.core.frames.conventions import NormalConvention as Normals
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis
from rtsr_cli.core.io.layout_names import LAYOUT_NAMES
from rtsr_cli.core.io.layouts import (
    SCOPE,
    Component,
    Layout,
    Place,
    Tree,
    either,
    in_file,
    named,
    single,
)
from rtsr_cli.core.io.presets_unverified import UNVERIFIED

CENTIMETRE = 0.01

RTSR = Layout(
    name="rtsr",
    description="rtsr's own channel names: R G B, albedo.*, normal.*, depth.Z, motion.*, ...",
    buffers={
        # own names first, then other renderers' spellings of the same thing: V-Ray writes
        # components out, 3ds Max has bare ones, OIDN's splitter accepts the rest
        Buffer.COLOR: named(Buffer.COLOR, "", "rgba", "beauty", "Beauty", "Composite.Combined"),
        Buffer.ALPHA: single("A", "rgba.A", "beauty.A", "Beauty.A", "Composite.Combined.A"),
        Buffer.ALBEDO: either(
            named(Buffer.ALBEDO, "albedo", "Albedo"),
            tuple(
                Component(places=(Place(channel=f"albedo.{c}"), Place(channel=f"diffuse.{c}")))
                for c in ("red", "green", "blue")
            ),
        ),
        Buffer.SPECULAR: named(Buffer.SPECULAR, "specular"),
        Buffer.MATERIAL: named(Buffer.MATERIAL, "material"),
        Buffer.LIGHTING: named(Buffer.LIGHTING, "lighting"),
        Buffer.LIGHTING_MASK: single("mask"),
        Buffer.NORMAL: either(
            named(Buffer.NORMAL, "normal", "normals", "Normals", "N", "bump_normals"),
            named(
                Buffer.NORMAL,
                *("normal", "normals", "Normals", "N", "VisibleNormals", "OptixNormals"),
                letters="RGB",
            ),
            tuple(Component(places=(Place(channel=c),)) for c in ("NX", "NY", "NZ")),
        ),
        Buffer.GEONORMAL: named(Buffer.GEONORMAL, "geonormal"),
        Buffer.DEPTH: single("depth.Z", "depth", "Z", "depth.R", "depth.Y", "Depth.Z"),
        Buffer.ROUGHNESS: single("roughness", "roughness.R", "roughness.X", "roughness.Y"),
        Buffer.METALLIC: single("metallic", "metallic.R", "metallic.X", "metallic.Y"),
        Buffer.MOTION: either(
            named(Buffer.MOTION, "motion"),
            named(Buffer.MOTION, "motion", letters="RG"),
            named(Buffer.MOTION, "motion", letters="UV"),
            tuple(Component(places=(Place(channel=c),)) for c in ("velX", "velY")),
        ),
        Buffer.FORWARD: named(Buffer.FORWARD, "forward"),
        Buffer.EMISSION: named(Buffer.EMISSION, "emission"),
        Buffer.OBJECT_ID: single("objectid", "objectid.R", "objectid.X", "objectid.Y"),
        Buffer.POSITION: either(
            named(Buffer.POSITION, "position"), named(Buffer.POSITION, "position", letters="RGB")
        ),
        Buffer.NOV: single("nov", "nov.R", "nov.X", "nov.Y"),
        Buffer.REACTIVE: single("reactive", "reactive.R", "reactive.X", "reactive.Y"),
    },
)

BLENDER = Layout(
    name="blender",
    description="Blender multilayer: <view layer>.Combined.*, .Depth.Z, .Vector.XYZW, AOVs",
    buffers={
        Buffer.COLOR: named(Buffer.COLOR, f"{SCOPE}.Combined"),
        Buffer.ALPHA: single(f"{SCOPE}.Combined.A"),
        Buffer.ALBEDO: named(
            Buffer.ALBEDO, f"{SCOPE}.albedo", f"{SCOPE}.Denoising Albedo", f"{SCOPE}.DiffCol"
        ),
        Buffer.NORMAL: named(Buffer.NORMAL, f"{SCOPE}.Normal"),
        Buffer.DEPTH: single(f"{SCOPE}.Depth.Z"),
        Buffer.ROUGHNESS: single(*(f"{SCOPE}.roughness{c}" for c in (".X", ".R", ""))),
        Buffer.METALLIC: single(*(f"{SCOPE}.metallic{c}" for c in (".X", ".R", ""))),
        Buffer.MOTION: named(Buffer.MOTION, f"{SCOPE}.Vector"),
        # Z, W lead from the next frame to this one, so both signs turn round
        Buffer.FORWARD: tuple(
            Component(places=(Place(channel=f"{SCOPE}.Vector.{c}"),), factor=-1.0)
            for c in ("Z", "W")
        ),
        Buffer.EMISSION: named(Buffer.EMISSION, f"{SCOPE}.emission", f"{SCOPE}.Emit"),
        Buffer.OBJECT_ID: single(f"{SCOPE}.Object Index.X", f"{SCOPE}.IndexOB.X"),
        Buffer.POSITION: named(Buffer.POSITION, f"{SCOPE}.Position"),
    },
    conventions=Conventions(motion=MotionConvention(y_axis=YAxis.UP)),
    scope="ViewLayer",
)

EXTRANET = Layout(
    name="extranet",
    description="ExtraNet's Unreal dumps: <Scene><Buffer>.<frame>.exr, or a folder a buffer",
    buffers={
        Buffer.COLOR: in_file(Buffer.COLOR, f"{SCOPE}PreTonemapHDRColor"),
        Buffer.ALBEDO: in_file(Buffer.ALBEDO, f"{SCOPE}BaseColor"),
        Buffer.NORMAL: in_file(Buffer.NORMAL, f"{SCOPE}WorldNormal"),
        Buffer.DEPTH: in_file(Buffer.DEPTH, f"{SCOPE}SceneDepth"),
        Buffer.ROUGHNESS: in_file(Buffer.ROUGHNESS, f"{SCOPE}Roughness"),
        Buffer.METALLIC: in_file(Buffer.METALLIC, f"{SCOPE}Metallic"),
        Buffer.MOTION: in_file(Buffer.MOTION, f"{SCOPE}MotionVector"),
        Buffer.POSITION: in_file(Buffer.POSITION, f"{SCOPE}WorldPosition"),
        Buffer.NOV: in_file(Buffer.NOV, f"{SCOPE}NoV"),
        Buffer.OBJECT_ID: in_file(Buffer.OBJECT_ID, f"{SCOPE}MyStencil", f"{SCOPE}Stencil"),
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
)

NSS = Layout(
    name="nss",
    description="Arm NSS captures: x2/{color,depth,motion}/<clip>/, ground_truth/, <clip>.json",
    buffers={
        Buffer.COLOR: in_file(Buffer.COLOR, "color", "ground_truth"),
        Buffer.ALPHA: (
            Component(places=tuple(Place(channel="A", file=f) for f in ("color", "ground_truth"))),
        ),
        Buffer.DEPTH: in_file(Buffer.DEPTH, "depth"),
        Buffer.MOTION: in_file(Buffer.MOTION, "motion", "motion_gt"),
    },
    conventions=Conventions(
        # the specification names no direction: that of FSR2, previous minus current with y down;
        # jitter excluded
        motion=MotionConvention(unit=MotionUnit.UV),
        # forward or reversed by the side-car's ReverseZ
        depth=DepthConvention(kind=DepthKind.DEVICE),
    ),
    tree=Tree(
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
        Buffer.LIGHTING: in_file(Buffer.LIGHTING, "Irradiance"),
        Buffer.MATERIAL: in_file(Buffer.MATERIAL, "BRDF"),
        Buffer.EMISSION: in_file(Buffer.EMISSION, "Emission_Sky"),
        Buffer.NORMAL: in_file(Buffer.NORMAL, "Normal"),
        Buffer.DEPTH: in_file(Buffer.DEPTH, "Depth"),
        Buffer.MOTION: in_file(Buffer.MOTION, "MV"),
    },
    # the published code samples the previous frame at `grid - vector` and multiplies by width
    # and height: current minus previous, shares of the screen, rows down
    conventions=Conventions(
        motion=MotionConvention(
            unit=MotionUnit.UV, direction=MotionDirection.CURRENT_MINUS_PREVIOUS
        )
    ),
    folders=True,
    tree=Tree(
        lr="X{scale}/{shot}/{buffer}",
        hr="GT/{shot}/{buffer}",
        lr_buffers=("Irradiance", "Normal", "Depth", "MV"),
        hr_buffers=("Irradiance", "BRDF", "Emission_Sky"),
    ),
    digits=1,
)

_ALL = (RTSR, BLENDER, EXTRANET, NSS, NSRD, *UNVERIFIED)

LAYOUTS: Mapping[str, Layout] = {
    name: next(layout for layout in _ALL if layout.name == name) for name in LAYOUT_NAMES
}
"""Every preset, by name."""
