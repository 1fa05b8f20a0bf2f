"""Binding: finding a layout's buffers among file sequences and their channels."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product

from rtsr_cli.core.captures.layouts import SCOPE, ChannelPlace, Component, Layout
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer

Streams = Mapping[str, Collection[str]]
"""For each file sequence (`folder/base name`), the channels of its files."""

LISTED = 12
"""Channels that a message names before it is cut."""

SAME_SCENE = 2
"""Buffers that two scopes must both hold, in different files, to be two dumps in one folder."""


@dataclass(frozen=True, kw_only=True)
class BoundComponent:
    """A component found: the stream and the channel that hold it."""

    stream: str
    channel: str
    factor: float
    offset: float


Binding = Mapping[Buffer, tuple[BoundComponent, ...]]
"""Where each buffer of a shot is."""


@dataclass(frozen=True, kw_only=True)
class LayoutMatch:
    """What a layout finds: buffers, and those that several file sequences hold."""

    binding: Binding
    ambiguous: Mapping[Buffer, tuple[str, ...]]

    @property
    def explained(self) -> int:
        """Number of buffers, ambiguous ones included."""
        return len(self.binding) + len(self.ambiguous)

    @property
    def streams(self) -> frozenset[str]:
        """File sequences that hold the buffers."""
        return frozenset(c.stream for components in self.binding.values() for c in components)


@dataclass(frozen=True, kw_only=True)
class _Scope:
    """What `SCOPE` stands for, in names of channels and of file sequences."""

    channel: str = ""
    file: str = ""


def _escape_pattern(text: str) -> str:
    return text.replace("[", "[[]").replace("*", "[*]").replace("?", "[?]")


def _list_names(stream: str) -> tuple[str, ...]:
    """Names that a file sequence goes by: its key, and the folder of one buffer."""
    folder, separated, _ = stream.rpartition("/")
    return (stream, folder) if separated else (stream,)


def _find_channels(place: ChannelPlace, scope: _Scope, streams: Streams) -> list[tuple[str, str]]:
    """Return the first matching channel of every file sequence that has one."""
    file = place.file.replace(SCOPE, _escape_pattern(scope.file))
    channel = place.channel.replace(SCOPE, _escape_pattern(scope.channel))
    channels = []
    for stream in sorted(streams):
        if any(fnmatchcase(name, file) for name in _list_names(stream)):
            matches = sorted(c for c in streams[stream] if fnmatchcase(c, channel))
            channels += [(stream, matches[0])] if matches else []
    return channels


def _find_scope_texts(names: Iterable[str], patterns: Iterable[str]) -> list[str]:
    """What a leading `SCOPE` of the patterns can stand for among names; '' if nothing."""
    tails = {p.removeprefix(SCOPE) for p in patterns if p.startswith(SCOPE)} - {""}
    texts = {n[: -len(t)] for n in names for t in tails if n.endswith(t)}
    return sorted(texts) or [""]


def _list_scopes(layout: Layout, streams: Streams) -> list[_Scope]:
    places = [p for parts in layout.buffers.values() for c in parts for p in c.places]
    channels = {channel for held in streams.values() for channel in held}
    files = {name for stream in streams for name in _list_names(stream)}
    return [
        _Scope(channel=channel, file=file)
        for channel, file in product(
            _find_scope_texts(channels, (p.channel for p in places)),
            _find_scope_texts(files, (p.file for p in places)),
        )
    ]


def _match_scope(layout: Layout, scope: _Scope, streams: Streams) -> LayoutMatch:
    binding: dict[Buffer, tuple[BoundComponent, ...]] = {}
    ambiguous: dict[Buffer, tuple[str, ...]] = {}
    for buffer, components in layout.buffers.items():
        for turn in range(max(len(c.places) for c in components)):
            channels = [_find_channels(c.place(turn), scope, streams) for c in components]
            if not all(channels):
                continue
            if any(len(options) > 1 for options in channels):
                ambiguous[buffer] = tuple(sorted({s for options in channels for s, _ in options}))
            else:
                binding[buffer] = _bind_components(components, [options[0] for options in channels])
            break
    return LayoutMatch(binding=binding, ambiguous=ambiguous)


def _bind_components(
    components: tuple[Component, ...], channels: list[tuple[str, str]]
) -> tuple[BoundComponent, ...]:
    return tuple(
        BoundComponent(stream=stream, channel=channel, factor=c.factor, offset=c.offset)
        for c, (stream, channel) in zip(components, channels, strict=True)
    )


def match_layout(layout: Layout, streams: Streams) -> LayoutMatch:
    """Find a layout's buffers, and those that a choice would be a guess for.

    Where names begin with a scope, all buffers come from one: the one that holds most of them,
    the first by name among equals. Two scopes of *files* that hold the same buffers are two
    dumps, and their common buffers ambiguous.
    """
    matches = [_match_scope(layout, scope, streams) for scope in _list_scopes(layout, streams)]
    best = max(matches, key=lambda m: m.explained)
    for other in matches:
        rivals = {
            b: (best.binding[b][0].stream, other.binding[b][0].stream)
            for b in best.binding
            if b in other.binding and best.binding[b][0].stream != other.binding[b][0].stream
        }
        if len(rivals) >= SAME_SCENE:
            kept = {b: c for b, c in best.binding.items() if b not in rivals}
            return LayoutMatch(binding=kept, ambiguous={**best.ambiguous, **rivals})
    return best


def bind_layout(layout: Layout, streams: Streams) -> Binding:
    """Find a layout's buffers among file sequences and their channels.

    Raises:
        FrameFolderError: two sequences hold the same buffer, so that a choice would be a guess.
    """
    matched = match_layout(layout, streams)
    if matched.ambiguous:
        raise FrameFolderError(_make_ambiguity_error(matched.ambiguous))
    return matched.binding


def _make_ambiguity_error(ambiguous: Mapping[Buffer, tuple[str, ...]]) -> str:
    buffer, holders = next(iter(ambiguous.items()))
    return (
        f"buffer '{buffer}' is in {len(holders)} file sequences of one folder "
        f"({', '.join(repr(h) for h in holders)}); keep one sequence a folder, or say which file "
        "in [buffers] of capture.toml"
    )


def list_channels(streams: Streams) -> str:
    """Channels of all files for a message, cut if there are many."""
    channels = sorted({c for names in streams.values() for c in names})
    return ", ".join(channels[:LISTED]) + (", ..." if len(channels) > LISTED else "")


def detect_layout(
    streams: Streams, candidates: Iterable[Layout], where: str
) -> tuple[Layout, Binding]:
    """Choose the layout that explains most buffers.

    Layouts that find the same channels are one, the first in the order given; one that would
    have to guess between file sequences is out, unless it alone explains most.

    Raises:
        FrameFolderError: none explains any, two explain equally many in different ways, or the
            folder holds two dumps at once; names the choices.
    """
    matches = [(layout, match_layout(layout, streams)) for layout in candidates]
    clear = [(layout, m) for layout, m in matches if not m.ambiguous and _is_plausible(layout, m)]
    best = max((len(m.binding) for _, m in clear), default=0)
    guess = max((m for _, m in matches if m.ambiguous), key=lambda m: m.explained, default=None)
    if guess is not None and guess.explained > best:
        raise FrameFolderError(f"{where}: {_make_ambiguity_error(guess.ambiguous)}")
    if best == 0:
        raise FrameFolderError(
            f"{where}: no layout knows these channels ({list_channels(streams)}); name one with "
            f"--layout ({', '.join(layout.name for layout, _ in matches)}), or say which channel "
            "is which buffer in [buffers] of capture.toml"
        )
    winners = [(layout, m) for layout, m in clear if len(m.binding) == best]
    winner = winners[0]
    different = [layout.name for layout, m in winners if m.binding != winner[1].binding]
    if different:
        raise FrameFolderError(
            f"{where}: layouts {', '.join([winner[0].name, *different])} fit these channels "
            f"equally well ({list_channels(streams)}); choose one with --layout"
        )
    _refuse_second_dump(winner, clear, where)
    return winner[0], winner[1].binding


def _is_plausible(layout: Layout, matched: LayoutMatch) -> bool:
    """Tell whether a layout may be presumed: wide patterns alone do not prove an unverified one."""
    return layout.verified or Buffer.COLOR in matched.binding


def _refuse_second_dump(
    winner: tuple[Layout, LayoutMatch], others: Iterable[tuple[Layout, LayoutMatch]], where: str
) -> None:
    layout, chosen = winner
    for other, m in others:
        shared = [b for b in m.binding if b in chosen.binding]
        if shared and not m.streams & chosen.streams:
            raise FrameFolderError(
                f"{where}: holds two dumps: layout {layout.name} in "
                f"{', '.join(map(repr, sorted(chosen.streams)))} and layout {other.name} in "
                f"{', '.join(map(repr, sorted(m.streams)))}, both with '{shared[0]}'; keep one a "
                "folder, or choose one with --layout"
            )
