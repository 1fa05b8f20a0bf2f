"""rtsr's own layout: its names, and other tools' spellings of the same things."""

from __future__ import annotations

from rtsr_cli.core.captures.layouts import (
    ChannelPlace,
    Component,
    Layout,
    join_places,
    name_components,
    name_single_component,
)
from rtsr_cli.core.frames.buffers import Buffer

RTSR = Layout(
    name="rtsr",
    description="rtsr's own channel names: R G B, albedo.*, normal.*, depth.Z, motion.*, ...",
    buffers={
        # own names first, then other renderers' spellings of the same thing: V-Ray writes
        # components out, 3ds Max has bare ones, OIDN's splitter accepts the rest
        Buffer.COLOR: join_places(
            name_components(
                Buffer.COLOR, "", "rgba", "beauty", "Beauty", "color", "Color", "Composite.Combined"
            ),
            # luminance alone is grey
            (Component(places=(ChannelPlace(channel="Y", alone=True),)),) * 3,
        ),
        Buffer.ALPHA: name_single_component(
            "A", "rgba.A", "beauty.A", "Beauty.A", "Composite.Combined.A"
        ),
        Buffer.ALBEDO: join_places(
            name_components(Buffer.ALBEDO, "albedo", "Albedo"),
            tuple(
                Component(
                    places=(
                        ChannelPlace(channel=f"albedo.{c}"),
                        ChannelPlace(channel=f"diffuse.{c}"),
                    )
                )
                for c in ("red", "green", "blue")
            ),
        ),
        Buffer.SPECULAR: name_components(Buffer.SPECULAR, "specular"),
        Buffer.MATERIAL: name_components(Buffer.MATERIAL, "material"),
        Buffer.LIGHTING: name_components(Buffer.LIGHTING, "lighting"),
        Buffer.LIGHTING_MASK: name_single_component("mask"),
        Buffer.NORMAL: join_places(
            name_components(Buffer.NORMAL, "normal", "normals", "Normals", "N", "bump_normals"),
            name_components(
                Buffer.NORMAL,
                *("normal", "normals", "Normals", "N", "VisibleNormals", "OptixNormals"),
                letters="RGB",
            ),
            tuple(Component(places=(ChannelPlace(channel=c),)) for c in ("NX", "NY", "NZ")),
        ),
        Buffer.GEONORMAL: name_components(Buffer.GEONORMAL, "geonormal"),
        Buffer.DEPTH: name_single_component(
            "depth.Z", "depth", "Z", "depth.R", "depth.Y", "Depth.Z"
        ),
        Buffer.ROUGHNESS: name_single_component(
            "roughness", "roughness.R", "roughness.X", "roughness.Y"
        ),
        Buffer.METALLIC: name_single_component(
            "metallic", "metallic.R", "metallic.X", "metallic.Y"
        ),
        Buffer.MOTION: join_places(
            name_components(Buffer.MOTION, "motion"),
            name_components(Buffer.MOTION, "motion", letters="RG"),
            name_components(Buffer.MOTION, "motion", letters="UV"),
            tuple(Component(places=(ChannelPlace(channel=c),)) for c in ("velX", "velY")),
        ),
        Buffer.FORWARD: name_components(Buffer.FORWARD, "forward"),
        Buffer.EMISSION: name_components(Buffer.EMISSION, "emission"),
        Buffer.OBJECT_ID: name_single_component(
            "objectid", "objectid.R", "objectid.X", "objectid.Y"
        ),
        Buffer.POSITION: join_places(
            name_components(Buffer.POSITION, "position"),
            name_components(Buffer.POSITION, "position", letters="RGB"),
        ),
        Buffer.NOV: name_single_component("nov", "nov.R", "nov.X", "nov.Y"),
        Buffer.REACTIVE: name_single_component(
            "reactive", "reactive.R", "reactive.X", "reactive.Y"
        ),
    },
)
