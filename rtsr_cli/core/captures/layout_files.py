"""Which layout a dump has: a preset, a TOML file of the user's, `[buffers]`, or what fits best."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import Field

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.captures.buffer_expressions import explain_quotes, explain_signs
from rtsr_cli.core.captures.capture_file import (
    CAPTURE_FILE,
    CaptureDeclaration,
    ConventionTables,
    validate_content,
)
from rtsr_cli.core.captures.channel_matching import (
    Streams,
    bind_layout,
    match_layout,
)
from rtsr_cli.core.captures.channel_tables import BufferTable, build_components
from rtsr_cli.core.captures.layout_detection import detect_layout
from rtsr_cli.core.captures.layout_names import LAYOUT_SUFFIX
from rtsr_cli.core.captures.layouts import ChannelSum, Component, Layout, Term
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.documents import DocumentError, read_toml_text
from rtsr_cli.core.errors import ConfigError, FrameFolderError, LayerChoiceError, did_you_mean
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.frames.conventions import Conventions


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
        content = read_toml_text(path)
    except DocumentError as error:
        raise ConfigError(f"{path}: the layout {error}") from error
    file = validate_content(LayoutFile, content, path)
    return Layout(
        name=path.name,
        description=f"layout file {path.name}",
        buffers=build_components(file.buffers),
        conventions=file.conventions(Conventions()),
        folders=file.folders,
        # what a user spells out needs no proof, but for vectors whose sense is left open
        verified=Buffer.MOTION not in file.buffers or file.motion.decides(),
    )


def load_layout(name: str) -> Layout:
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


def list_declared_buffers(
    name: str | None, layout: Layout | None, capture: CaptureDeclaration
) -> dict[Buffer, tuple[Component, ...]]:
    """Buffers that the user spelled out, in a layout file or in capture.toml, which holds.

    Args:
        name: of a preset or layout file, as the user gave it.
        layout: of that name.
        capture: what the user declares.
    """
    spelled = layout is not None and name is not None and name.endswith(LAYOUT_SUFFIX)
    file = layout.buffers if layout is not None and spelled else {}
    return {**file, **build_components(capture.buffers)}


def choose_layout(
    named: Layout | None,
    capture: CaptureDeclaration,
    streams: Streams,
    where: str,
    layer: str | None = None,
) -> tuple[Layout, Binding]:
    """Choose the layout of a frame set and find its buffers; `[buffers]` is laid over it.

    What `[buffers]` names in files of the other resolution alone is the layout's own in these.

    Args:
        named: preset or layout file that is named, or None to detect one.
        capture: what the user declares; its `layout` is not looked at.
        streams: the files and their channels.
        where: folder, for messages.
        layer: of which buffers are taken where several layers of a file hold them.

    Raises:
        FrameFolderError: no layout fits, several do, or a buffer is in two file sequences or
            layers.
    """
    own = {
        buffer: components
        for buffer, components in build_components(capture.buffers).items()
        if _are_held({buffer: components}, streams)
    }
    if named is None and not own:
        return detect_layout(streams, LAYOUTS.values(), where, layer)
    layout = _replace_buffers(named or _detect_layout(own, streams, where, layer), own)
    try:
        binding = bind_layout(layout, streams, layer)
    except LayerChoiceError as error:
        raise LayerChoiceError(f"{where}: {error}", error.layers, error.buffer) from error
    except FrameFolderError as error:
        raise FrameFolderError(f"{where}: {error}") from error
    if not any(map(len, binding.values())):
        raise FrameFolderError(f"{where}: layout '{layout.name}' matches no channel of these files")
    return layout, binding


def _detect_layout(
    own: Iterable[Buffer], streams: Streams, where: str, layer: str | None
) -> Layout | None:
    """Return the layout that explains most of what the user did not spell out, if one does.

    Who spells channels out does not mean a preset that nobody has verified.
    """
    spelled = frozenset(own)
    rest = [
        replace(layout, buffers={b: c for b, c in layout.buffers.items() if b not in spelled})
        for layout in LAYOUTS.values()
        if layout.verified
    ]
    clear = [layout for layout in rest if not match_layout(layout, streams).ambiguous]
    try:
        layout, _ = detect_layout(streams, clear, where, layer)
    except LayerChoiceError:
        raise
    except FrameFolderError:
        return None
    return layout


def _replace_buffers(layout: Layout | None, own: Mapping[Buffer, tuple[Component, ...]]) -> Layout:
    if layout is None:
        return Layout(
            name=CAPTURE_FILE,
            description="[buffers] of capture.toml",
            buffers=own,
            verified=Buffer.MOTION not in own,
        )
    if not own:
        return layout
    conventions = layout.conventions
    if any(c.is_computed for c in own.get(Buffer.ROUGHNESS, ())):
        # who computes roughness computes what is perceptual, whatever the layout's own channel is
        conventions = replace(conventions, roughness=Conventions().roughness)
    return replace(
        layout,
        name=f"{layout.name} + {CAPTURE_FILE}",
        conventions=conventions,
        buffers={**layout.buffers, **own},
        # nothing is known of vectors that the preset did not find itself
        verified=layout.verified and Buffer.MOTION not in own,
    )


def list_absent(
    declared: Mapping[Buffer, tuple[Component, ...]], sets: Sequence[Streams]
) -> tuple[Buffer, ...]:
    """Return the buffers that a user spelled out and that no resolution's files hold.

    Args:
        declared: buffers, as they are spelled out.
        sets: file sequences and channels of each resolution.
    """
    return tuple(
        buffer
        for buffer, components in declared.items()
        if not any(_are_held({buffer: components}, streams) for streams in sets)
    )


def check_declared(
    declared: Mapping[Buffer, tuple[Component, ...]],
    sets: Sequence[Streams],
    where: str,
    sources: Mapping[Buffer, str],
) -> None:
    """Hold every channel that a user spelled out to be in the files of some resolution.

    Args:
        declared: buffers, as they are spelled out.
        sets: file sequences and channels of each resolution.
        where: folder, for messages.
        sources: the file that each buffer is spelled out in.

    Raises:
        FrameFolderError: one is in none; names buffer, channel, and the channels there are.
    """
    for buffer in list_absent(declared, sets):
        components = declared[buffer]
        for term in (term for component in components for term in component.terms):
            part = Component(places=(ChannelSum(terms=(term,)),))
            if not any(_are_held({buffer: (part,)}, streams) for streams in sets):
                text = _describe_absence(buffer, term, sets, sources.get(buffer, ""))
                raise FrameFolderError(f"{where}: {text}")


def _are_held(buffers: Mapping[Buffer, tuple[Component, ...]], streams: Streams) -> bool:
    return match_layout(Layout(name="", description="", buffers=buffers), streams).explained > 0


LETTERS = ("RGB", "XYZ", "UVW")
"""Components as they are written, in turn."""


def _find_letters(buffer: Buffer, channel: str, channels: Sequence[str]) -> str:
    """The channels of a buffer that are there under other letters: `normal.XYZ` for `normal.R`."""
    stem, _, letter = channel.rpartition(".")
    count = BUFFER_SPECS[buffer].channels
    for letters in (every[:count] for every in LETTERS):
        held = all(f"{stem}.{one}" in channels for one in letters)
        if held and count > 1 and letter not in letters and letter in "".join(LETTERS):
            return f"{stem}.{letters}"
    return ""


def _describe_absence(buffer: Buffer, term: Term, sets: Sequence[Streams], source: str) -> str:
    place = term.place
    spec = place.channel if place.file == "*" else f"{place.file}:{place.channel}"
    channels = sorted({c for streams in sets for names in streams.values() for c in names})
    files = sorted({key for streams in sets for key in streams})
    column = f"column {term.column}" if term.column else ""
    written = ", ".join(filter(None, (source, column)))
    stands = f"; it stands in {written}" if written else ""
    named = ""
    if place.file != "*":
        said = ", ".join(repr(key) for key in files if key) or "none, for files that are numbers"
        named = f"; before the colon stands what a file is called without its number, here {said}"
    meant = _find_letters(buffer, place.channel, channels)
    strange = explain_signs(place.channel) or explain_quotes(place.channel, channels)
    return (
        f"buffer '{buffer}': no channel is called '{spec}'"
        f"{did_you_mean(place.channel, channels, meant=meant)}{strange}{stands}{named}"
    )
