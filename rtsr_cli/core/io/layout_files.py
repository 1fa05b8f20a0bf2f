"""Which layout a dump has: a preset, a TOML file of the user's, `[buffers]`, or what fits best."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import Field

from rtsr_cli.core.errors import ConfigError, FrameFolderError, did_you_mean
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import Conventions
from rtsr_cli.core.io.binding import Binding, Streams, bind, detect, match
from rtsr_cli.core.io.capture import CAPTURE_FILE, Capture, ConventionTables, validated
from rtsr_cli.core.io.channel_tables import BufferTable, components_of
from rtsr_cli.core.io.layout_names import LAYOUT_SUFFIX
from rtsr_cli.core.io.layouts import Component, Layout
from rtsr_cli.core.io.presets import LAYOUTS


class LayoutFile(ConventionTables):
    """A layout of the user's own: `[buffers]`, and the convention tables of capture.toml."""

    buffers: BufferTable = Field(min_length=1)
    folders: bool = False


def read_layout(path: Path) -> Layout:
    """Read a layout file.

    Raises:
        ConfigError: not there, not TOML, or wrong fields; lists every one with its path.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: the layout cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from error
    file = validated(LayoutFile, content, path)
    return Layout(
        name=path.name,
        description=f"layout file {path.name}",
        buffers=components_of(file.buffers),
        conventions=file.conventions(Conventions()),
        folders=file.folders,
        verified=file.motion.decides(),
    )


def layout_named(name: str) -> Layout:
    """Return a preset, or the layout of a TOML file.

    Raises:
        FrameFolderError: there is no such preset; suggests one.
        ConfigError: the file is not valid.
    """
    if name.endswith(LAYOUT_SUFFIX):
        return read_layout(Path(name))
    if name not in LAYOUTS:
        raise FrameFolderError(f"no layout is called '{name}'{did_you_mean(name, LAYOUTS)}")
    return LAYOUTS[name]


def declared_buffers(name: str | None, capture: Capture) -> dict[Buffer, tuple[Component, ...]]:
    """Buffers that the user spelled out, in a layout file or in capture.toml, which holds."""
    file = {} if name is None or not name.endswith(LAYOUT_SUFFIX) else layout_named(name).buffers
    return {**file, **components_of(capture.buffers)}


def choose_layout(
    name: str | None, capture: Capture, streams: Streams, where: str
) -> tuple[Layout, Binding]:
    """Choose the layout of a frame set and find its buffers; `[buffers]` is laid over it.

    Args:
        name: preset or layout file, or None to detect one.
        capture: what the user declares; its `layout` is not looked at.
        streams: the files and their channels.
        where: folder, for messages.

    Raises:
        FrameFolderError: no layout fits, several do, or a buffer is in two file sequences.
        ConfigError: a layout file is not valid.
    """
    own = components_of(capture.buffers)
    if name is None and own:
        layout = _with_buffers(_detected(own, streams), own)
    elif name is None:
        return detect(streams, LAYOUTS.values(), where)
    else:
        layout = _with_buffers(layout_named(name), own)
    try:
        binding = bind(layout, streams)
    except FrameFolderError as error:
        raise FrameFolderError(f"{where}: {error}") from error
    if not binding:
        raise FrameFolderError(f"{where}: layout '{layout.name}' matches no channel of these files")
    return layout, binding


def _detected(own: Iterable[Buffer], streams: Streams) -> Layout | None:
    """Return the layout that explains most of what the user did not spell out, if one does."""
    spelled = frozenset(own)
    rest = [
        replace(layout, buffers={b: c for b, c in layout.buffers.items() if b not in spelled})
        for layout in LAYOUTS.values()
    ]
    clear = [layout for layout in rest if not match(layout, streams).ambiguous]
    try:
        layout, _ = detect(streams, clear, "")
    except FrameFolderError:
        return None
    return layout


def _with_buffers(layout: Layout | None, own: Mapping[Buffer, tuple[Component, ...]]) -> Layout:
    if layout is None:
        return Layout(
            name=CAPTURE_FILE, description="[buffers] of capture.toml", buffers=own, verified=False
        )
    if not own:
        return layout
    return replace(
        layout,
        name=f"{layout.name} + {CAPTURE_FILE}",
        buffers={**layout.buffers, **own},
        # nothing is known of vectors that the preset did not find itself
        verified=layout.verified and Buffer.MOTION not in own,
    )


def check_declared(
    declared: Mapping[Buffer, tuple[Component, ...]], sets: Sequence[Streams], where: str
) -> None:
    """Hold every channel that a user spelled out to be in the files of some resolution.

    Raises:
        FrameFolderError: one is in none; names buffer, channel, and the channels there are.
    """
    streams = {f"{i}/{key}": names for i, held in enumerate(sets) for key, names in held.items()}
    for buffer, components in declared.items():
        probes = [Layout(name="", description="", buffers={buffer: components})]
        if any(match(probe, held).explained for probe in probes for held in sets):
            continue
        for c in components:
            alone = Layout(name="", description="", buffers={buffer: (c,)})
            if not any(match(alone, held).explained for held in sets):
                place = c.places[0]
                files = sorted({k.partition("/")[2] for k in streams})
                known = sorted({n for names in streams.values() for n in names})
                spec = place.channel if place.file == "*" else f"{place.file}:{place.channel}"
                raise FrameFolderError(
                    f"{where}: buffer '{buffer}': no channel is called '{spec}'"
                    f"{did_you_mean(place.channel, known)}; file sequences: "
                    f"{', '.join(repr(f) for f in files)}"
                )
