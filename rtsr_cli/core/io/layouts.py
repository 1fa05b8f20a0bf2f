"""Layouts: which channel of which file is which buffer, as declarations.

A layout is data. The reader knows none by name: it binds the patterns below to the files and
channels it finds, and a new engine is a new entry in `LAYOUTS`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.frames.conventions import Conventions
from rtsr_cli.core.frames.motion import MotionConvention, YAxis
from rtsr_cli.core.io.layout_names import LAYOUT_NAMES


@dataclass(frozen=True, kw_only=True)
class Component:
    """One channel of a buffer: `value = (stored - offset) * factor`.

    Attributes:
        channels: patterns of the channel's name, tried in order.
        stream: pattern of the file sequence that holds it, relative to the shot
            (`folder/base name`); any by default.
        factor: on the stored value.
        offset: stored value of zero.
    """

    channels: tuple[str, ...]
    stream: str = "*"
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A named arrangement of buffers in files.

    Attributes:
        name: what users type.
        description: where it comes from.
        buffers: the components of each buffer, in the buffer's channel order.
        conventions: what the names do not say.
        folders: True if each buffer is a folder of its own below the shot.
        verified: False if known from documentation only.
    """

    name: str
    description: str
    buffers: Mapping[Buffer, tuple[Component, ...]]
    conventions: Conventions = field(default_factory=Conventions)
    folders: bool = False
    verified: bool = True


@dataclass(frozen=True, kw_only=True)
class BoundComponent:
    """A component found: the stream and the channel that hold it."""

    stream: str
    channel: str
    factor: float
    offset: float


Binding = Mapping[Buffer, tuple[BoundComponent, ...]]
"""Where each buffer of a shot is."""


def named(buffer: Buffer, *prefixes: str, components: str | None = None) -> tuple[Component, ...]:
    """Components of a buffer whose channels are `prefix.component` (or `prefix` if single)."""
    suffixes = tuple(components) if components else BUFFER_SPECS[buffer].component_names
    return tuple(
        Component(channels=tuple(f"{p}.{s}" if p and s else p or s for p in prefixes))
        for s in suffixes
    )


def _single(*channels: str) -> tuple[Component, ...]:
    return (Component(channels=channels),)


RTSR = Layout(
    name="rtsr",
    description="rtsr's own channel names: R G B, albedo.*, normal.*, depth.Z, motion.*, ...",
    buffers={
        Buffer.COLOR: named(Buffer.COLOR, ""),
        Buffer.ALPHA: _single("A"),
        Buffer.ALBEDO: named(Buffer.ALBEDO, "albedo"),
        Buffer.SPECULAR: named(Buffer.SPECULAR, "specular"),
        Buffer.MATERIAL: named(Buffer.MATERIAL, "material"),
        Buffer.LIGHTING: named(Buffer.LIGHTING, "lighting"),
        Buffer.LIGHTING_MASK: _single("mask"),
        Buffer.NORMAL: named(Buffer.NORMAL, "normal"),
        Buffer.GEONORMAL: named(Buffer.GEONORMAL, "geonormal"),
        Buffer.DEPTH: _single("depth.Z", "depth"),
        Buffer.ROUGHNESS: _single("roughness"),
        Buffer.METALLIC: _single("metallic"),
        Buffer.MOTION: named(Buffer.MOTION, "motion"),
        Buffer.FORWARD: named(Buffer.FORWARD, "forward"),
        Buffer.EMISSION: named(Buffer.EMISSION, "emission"),
        Buffer.OBJECT_ID: _single("objectid"),
        Buffer.POSITION: named(Buffer.POSITION, "position"),
        Buffer.NOV: _single("nov"),
        Buffer.REACTIVE: _single("reactive"),
    },
)

BLENDER = Layout(
    name="blender",
    description="Blender multilayer: <view layer>.Combined.*, .Depth.Z, .Vector.XYZW, AOVs",
    buffers={
        Buffer.COLOR: named(Buffer.COLOR, "*.Combined"),
        Buffer.ALPHA: _single("*.Combined.A"),
        Buffer.ALBEDO: named(Buffer.ALBEDO, "*.albedo", "*.Denoising Albedo", "*.DiffCol"),
        Buffer.NORMAL: named(Buffer.NORMAL, "*.Normal"),
        Buffer.DEPTH: _single("*.Depth.Z"),
        Buffer.ROUGHNESS: _single("*.roughness.X", "*.roughness.R", "*.roughness"),
        Buffer.METALLIC: _single("*.metallic.X", "*.metallic.R", "*.metallic"),
        Buffer.MOTION: named(Buffer.MOTION, "*.Vector"),
        # Z, W lead from the next frame to this one, so both signs turn round
        Buffer.FORWARD: tuple(
            Component(channels=(f"*.Vector.{c}",), factor=-1.0) for c in ("Z", "W")
        ),
        Buffer.EMISSION: named(Buffer.EMISSION, "*.emission", "*.Emit"),
        Buffer.OBJECT_ID: _single("*.Object Index.X", "*.IndexOB.X"),
        Buffer.POSITION: named(Buffer.POSITION, "*.Position"),
    },
    conventions=Conventions(motion=MotionConvention(y_axis=YAxis.UP)),
)

LAYOUTS: Mapping[str, Layout] = dict(zip(LAYOUT_NAMES, (RTSR, BLENDER), strict=True))
"""Every preset, by name."""


def _find(component: Component, streams: Mapping[str, Collection[str]]) -> list[BoundComponent]:
    """Return the best match in every stream that has one."""
    found = []
    for stream in sorted(streams):
        if not fnmatchcase(stream, component.stream):
            continue
        for pattern in component.channels:
            matches = sorted(c for c in streams[stream] if fnmatchcase(c, pattern))
            if matches:
                found.append(
                    BoundComponent(
                        stream=stream,
                        channel=matches[0],
                        factor=component.factor,
                        offset=component.offset,
                    )
                )
                break
    return found


def _scopes(layout: Layout, streams: Mapping[str, Collection[str]]) -> list[str]:
    """What a leading `*` of the layout's patterns can stand for, e.g. the names of view layers."""
    tails = {
        pattern[1:]
        for components in layout.buffers.values()
        for component in components
        for pattern in component.channels
        if pattern.startswith("*")
    }
    channels = {channel for names in streams.values() for channel in names}
    return sorted({c[: -len(t)] for c in channels for t in tails if c.endswith(t)})


def _within(component: Component, scope: str) -> Component:
    """Replace a leading `*` by one scope, taken literally."""
    literal = scope.replace("[", "[[]").replace("*", "[*]").replace("?", "[?]")
    patterns = (literal + p[1:] if p.startswith("*") else p for p in component.channels)
    return replace(component, channels=tuple(patterns))


def bind(layout: Layout, streams: Mapping[str, Collection[str]]) -> Binding:
    """Find a layout's buffers among file sequences and their channels.

    Where names begin with a scope (a view layer), all buffers come from one: the one that holds
    most of them, the first by name among equals.

    Args:
        layout: what to look for.
        streams: for each file sequence (`folder/base name`), the channels of its files.

    Raises:
        FrameFolderError: two sequences hold the same buffer, so that a choice would be a guess.
    """
    scopes = _scopes(layout, streams) or [""]
    return max((_bind_scope(layout, scope, streams) for scope in scopes), key=len)


def _bind_scope(layout: Layout, scope: str, streams: Mapping[str, Collection[str]]) -> Binding:
    binding: dict[Buffer, tuple[BoundComponent, ...]] = {}
    for buffer, components in layout.buffers.items():
        candidates = [_find(_within(component, scope), streams) for component in components]
        if not all(candidates):
            continue
        holders = sorted({bound.stream for options in candidates for bound in options})
        if any(len(options) > 1 for options in candidates):
            raise FrameFolderError(
                f"buffer '{buffer}' is in {len(holders)} file sequences of one folder "
                f"({', '.join(repr(h) for h in holders)}); keep one sequence a folder"
            )
        binding[buffer] = tuple(options[0] for options in candidates)
    return binding


def detect(
    streams: Mapping[str, Collection[str]], candidates: Iterable[Layout], where: str
) -> tuple[Layout, Binding]:
    """Choose the layout that explains most buffers.

    Raises:
        FrameFolderError: none explains any, or two explain equally many; names the choices.
    """
    bound = [(layout, bind(layout, streams)) for layout in candidates]
    best = max(len(binding) for _, binding in bound)
    winners = [(layout, binding) for layout, binding in bound if len(binding) == best]
    channels = sorted({c for names in streams.values() for c in names})
    listed = ", ".join(channels[:12]) + (", ..." if len(channels) > 12 else "")
    if best == 0:
        raise FrameFolderError(
            f"{where}: no layout knows these channels ({listed}); "
            f"name one with --layout ({', '.join(layout.name for layout, _ in bound)})"
        )
    if len(winners) > 1:
        names = ", ".join(layout.name for layout, _ in winners)
        raise FrameFolderError(
            f"{where}: layouts {names} fit these channels equally well ({listed}); "
            "choose one with --layout"
        )
    return winners[0]
