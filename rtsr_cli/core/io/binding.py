"""Binding: finding a layout's buffers among file sequences and their channels."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.layouts import SCOPE, Component, Layout, Place

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
class Match:
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


def _literal(text: str) -> str:
    return text.replace("[", "[[]").replace("*", "[*]").replace("?", "[?]")


def _names(stream: str) -> tuple[str, ...]:
    """Names that a file sequence goes by: its key, and the folder of one buffer."""
    folder, separated, _ = stream.rpartition("/")
    return (stream, folder) if separated else (stream,)


def _found(place: Place, scope: _Scope, streams: Streams) -> list[tuple[str, str]]:
    """Return the first matching channel of every file sequence that has one."""
    file = place.file.replace(SCOPE, _literal(scope.file))
    channel = place.channel.replace(SCOPE, _literal(scope.channel))
    found = []
    for stream in sorted(streams):
        if any(fnmatchcase(name, file) for name in _names(stream)):
            matches = sorted(c for c in streams[stream] if fnmatchcase(c, channel))
            found += [(stream, matches[0])] if matches else []
    return found


def _stood_for(names: Iterable[str], patterns: Iterable[str]) -> list[str]:
    """What a leading `SCOPE` of the patterns can stand for among names; '' if nothing."""
    tails = {p.removeprefix(SCOPE) for p in patterns if p.startswith(SCOPE)} - {""}
    found = {n[: -len(t)] for n in names for t in tails if n.endswith(t)}
    return sorted(found) or [""]


def _scopes(layout: Layout, streams: Streams) -> list[_Scope]:
    places = [p for parts in layout.buffers.values() for c in parts for p in c.places]
    channels = {channel for held in streams.values() for channel in held}
    files = {name for stream in streams for name in _names(stream)}
    return [
        _Scope(channel=channel, file=file)
        for channel, file in product(
            _stood_for(channels, (p.channel for p in places)),
            _stood_for(files, (p.file for p in places)),
        )
    ]


def _matched(layout: Layout, scope: _Scope, streams: Streams) -> Match:
    binding: dict[Buffer, tuple[BoundComponent, ...]] = {}
    ambiguous: dict[Buffer, tuple[str, ...]] = {}
    for buffer, components in layout.buffers.items():
        for turn in range(max(len(c.places) for c in components)):
            found = [_found(c.place(turn), scope, streams) for c in components]
            if not all(found):
                continue
            if any(len(options) > 1 for options in found):
                ambiguous[buffer] = tuple(sorted({s for options in found for s, _ in options}))
            else:
                binding[buffer] = _bound(components, [options[0] for options in found])
            break
    return Match(binding=binding, ambiguous=ambiguous)


def _bound(
    components: tuple[Component, ...], found: list[tuple[str, str]]
) -> tuple[BoundComponent, ...]:
    return tuple(
        BoundComponent(stream=stream, channel=channel, factor=c.factor, offset=c.offset)
        for c, (stream, channel) in zip(components, found, strict=True)
    )


def match(layout: Layout, streams: Streams) -> Match:
    """Find a layout's buffers, and those that a choice would be a guess for.

    Where names begin with a scope, all buffers come from one: the one that holds most of them,
    the first by name among equals. Two scopes of *files* that hold the same buffers are two
    dumps, and their common buffers ambiguous.
    """
    matches = [_matched(layout, scope, streams) for scope in _scopes(layout, streams)]
    best = max(matches, key=lambda m: m.explained)
    for other in matches:
        rivals = {
            b: (best.binding[b][0].stream, other.binding[b][0].stream)
            for b in best.binding
            if b in other.binding and best.binding[b][0].stream != other.binding[b][0].stream
        }
        if len(rivals) >= SAME_SCENE:
            kept = {b: c for b, c in best.binding.items() if b not in rivals}
            return Match(binding=kept, ambiguous={**best.ambiguous, **rivals})
    return best


def bind(layout: Layout, streams: Streams) -> Binding:
    """Find a layout's buffers among file sequences and their channels.

    Raises:
        FrameFolderError: two sequences hold the same buffer, so that a choice would be a guess.
    """
    found = match(layout, streams)
    if found.ambiguous:
        raise FrameFolderError(_refusal(found.ambiguous))
    return found.binding


def _refusal(ambiguous: Mapping[Buffer, tuple[str, ...]]) -> str:
    buffer, holders = next(iter(ambiguous.items()))
    return (
        f"buffer '{buffer}' is in {len(holders)} file sequences of one folder "
        f"({', '.join(repr(h) for h in holders)}); keep one sequence a folder, or say which file "
        "in [buffers] of capture.toml"
    )


def listed_channels(streams: Streams) -> str:
    """Channels of all files for a message, cut if there are many."""
    channels = sorted({c for names in streams.values() for c in names})
    return ", ".join(channels[:LISTED]) + (", ..." if len(channels) > LISTED else "")


def detect(streams: Streams, candidates: Iterable[Layout], where: str) -> tuple[Layout, Binding]:
    """Choose the layout that explains most buffers.

    Layouts that find the same channels are one, the first in the order given; one that would
    have to guess between file sequences is out, unless it alone explains most.

    Raises:
        FrameFolderError: none explains any, two explain equally many in different ways, or the
            folder holds two dumps at once; names the choices.
    """
    found = [(layout, match(layout, streams)) for layout in candidates]
    clear = [(layout, m) for layout, m in found if not m.ambiguous and _plausible(layout, m)]
    best = max((len(m.binding) for _, m in clear), default=0)
    guess = max((m for _, m in found if m.ambiguous), key=lambda m: m.explained, default=None)
    if guess is not None and guess.explained > best:
        raise FrameFolderError(f"{where}: {_refusal(guess.ambiguous)}")
    if best == 0:
        raise FrameFolderError(
            f"{where}: no layout knows these channels ({listed_channels(streams)}); name one with "
            f"--layout ({', '.join(layout.name for layout, _ in found)}), or say which channel is "
            "which buffer in [buffers] of capture.toml"
        )
    winners = [(layout, m) for layout, m in clear if len(m.binding) == best]
    winner = winners[0]
    different = [layout.name for layout, m in winners if m.binding != winner[1].binding]
    if different:
        raise FrameFolderError(
            f"{where}: layouts {', '.join([winner[0].name, *different])} fit these channels "
            f"equally well ({listed_channels(streams)}); choose one with --layout"
        )
    _refuse_second_dump(winner, clear, where)
    return winner[0], winner[1].binding


def _plausible(layout: Layout, found: Match) -> bool:
    """Tell whether a layout may be presumed: wide patterns alone do not prove an unverified one."""
    return layout.verified or Buffer.COLOR in found.binding


def _refuse_second_dump(
    winner: tuple[Layout, Match], others: Iterable[tuple[Layout, Match]], where: str
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
