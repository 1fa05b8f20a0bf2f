"""Binding: finding a layout's buffers among file sequences and their channels."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import partial
from itertools import product

from rtsr_cli.core.captures.bound_channels import Binding, BoundBuffer, BoundChannel, BoundSum
from rtsr_cli.core.captures.layouts import SCOPE, ChannelPlace, ChannelSum, Component, Layout
from rtsr_cli.core.errors import FrameFolderError, LayerChoiceError
from rtsr_cli.core.frames.buffers import Buffer

Streams = Mapping[str, Collection[str]]
"""For each file sequence (`folder/base name`), the channels of its files."""

UNNAMED = "unnamed"
"""What users call the layer of channels without one: R, G, B."""

SAME_SCENE = 2
"""Buffers that two scopes must both hold, in different files, to be two dumps in one folder."""


@dataclass(frozen=True, kw_only=True)
class LayoutMatch:
    """What a layout finds.

    Attributes:
        binding: buffers, and where they are.
        ambiguous: buffers that several file sequences hold.
        rivals: buffers that several layers of one file hold; the binding has the first.
        scope: layer that all buffers come from, empty if the names have none.
        layers: names of all layers that hold a buffer.
        labels: names of the layers that the bound channels, or their rivals, are of.
    """

    binding: Binding
    ambiguous: Mapping[Buffer, tuple[str, ...]]
    rivals: Mapping[Buffer, tuple[str, ...]] = field(default_factory=dict)
    scope: str = ""
    layers: tuple[str, ...] = ()
    labels: frozenset[str] = frozenset()

    @property
    def explained(self) -> int:
        """Number of buffers, ambiguous ones included."""
        return len(self.binding) + len(self.ambiguous)

    @property
    def streams(self) -> frozenset[str]:
        """File sequences that hold the buffers."""
        return frozenset(c.stream for bound in self.binding.values() for c in bound)

    def knows(self, layer: str | None) -> bool:
        """Tell whether a layer is among those that were found."""
        return layer in self.layers or layer in self.labels


@dataclass(frozen=True, kw_only=True)
class _Scope:
    """What `SCOPE` stands for, in names of channels and of file sequences."""

    channel: str = ""
    file: str = ""


@dataclass(frozen=True, kw_only=True)
class _Claims:
    """What a layout calls by a name: file sequences, and channels that no pattern takes."""

    streams: frozenset[str]
    channels: frozenset[str]


NO_CLAIMS = _Claims(streams=frozenset(), channels=frozenset())


def _escape_pattern(text: str) -> str:
    return text.replace("[", "[[]").replace("*", "[*]").replace("?", "[?]")


_Held = tuple[str, str]
"""A file sequence, and a channel of its files."""


def _list_names(stream: str) -> tuple[str, ...]:
    """Names that a file sequence goes by: its key, and the folder of one buffer."""
    folder, separated, _ = stream.rpartition("/")
    return (stream, folder) if separated else (stream,)


def _name_layer(channel: str) -> str:
    """The layer of a channel: its name without the component."""
    return channel.rpartition(".")[0] or UNNAMED


def _find_channels(
    place: ChannelPlace, scope: _Scope, streams: Streams, claims: _Claims
) -> list[_Held]:
    """Return the first matching channel of every layer of every file sequence that has one."""
    file = place.file.replace(SCOPE, _escape_pattern(scope.file))
    found: list[_Held] = []
    for stream in sorted(streams):
        if place.alone and not _is_alone(place.channel, streams):
            continue
        if place.unclaimed and claims.streams:
            continue
        if any(fnmatchcase(name, file) for name in _list_names(stream)):
            layers: dict[str, str] = {}
            for channel in _match_names(place, scope, streams[stream], claims):
                layers.setdefault(_name_layer(channel), channel)
            found += [(stream, channel) for channel in layers.values()]
    return found


def _list_claims(layout: Layout, scope: _Scope, streams: Streams) -> _Claims:
    places = layout.places
    files = {p.file.replace(SCOPE, _escape_pattern(scope.file)) for p in places} - {"*"}
    return _Claims(
        streams=frozenset(
            stream
            for stream in streams
            if any(fnmatchcase(name, file) for name in _list_names(stream) for file in files)
        ),
        channels=frozenset(
            p.channel.replace(SCOPE, scope.channel) for p in places if not p.is_pattern
        ),
    )


def _is_alone(channel: str, streams: Streams) -> bool:
    others = {name for held in streams.values() for name in held if len(name) == 1}
    return len(streams) == 1 and others <= {channel, "A", "Z"}


def _match_names(
    place: ChannelPlace, scope: _Scope, names: Collection[str], claims: _Claims
) -> list[str]:
    if not place.is_pattern:
        name = place.channel.replace(SCOPE, scope.channel)
        full = f"{scope.channel}.{name}"
        if place.scoped and name not in names and full in names:
            return [full]
        return [name] if name in names else []
    pattern = place.channel.replace(SCOPE, _escape_pattern(scope.channel))
    fitting = sorted(n for n in names if n not in claims.channels and fnmatchcase(n, pattern))
    if not place.without:
        return fitting
    return [n for n in fitting if f"{_name_layer(n)}.{place.without}" not in names]


def _find_scope_texts(names: Iterable[str], patterns: Iterable[str]) -> list[str]:
    """What a leading `SCOPE` of the patterns can stand for among names; '' if nothing."""
    tails = {p.removeprefix(SCOPE) for p in patterns if p.startswith(SCOPE)} - {""}
    texts = {n[: -len(t)] for n in names for t in tails if n.endswith(t)}
    return sorted(texts) or [""]


def _list_scopes(layout: Layout, streams: Streams) -> list[_Scope]:
    channels = {channel for held in streams.values() for channel in held}
    files = {name for stream in streams for name in _list_names(stream)}
    patterns = [_complete_name(place, channels) for place in layout.places]
    return [
        _Scope(channel=channel, file=file)
        for channel, file in product(
            _find_scope_texts(channels, patterns),
            _find_scope_texts(files, (p.file for p in layout.places)),
        )
    ]


def _complete_name(place: ChannelPlace, channels: Collection[str]) -> str:
    """Return a channel's name with the scope that a user left out, if it is not there without."""
    lacks = place.scoped and not place.is_pattern and "." in place.channel
    return f"{SCOPE}.{place.channel}" if lacks and place.channel not in channels else place.channel


def _match_scope(layout: Layout, scope: _Scope, streams: Streams, layer: str | None) -> LayoutMatch:
    binding: dict[Buffer, BoundBuffer] = {}
    ambiguous: dict[Buffer, tuple[str, ...]] = {}
    rivals: dict[Buffer, tuple[str, ...]] = {}
    labels: set[str] = set()
    layers: dict[str, None] = {}
    claims = _list_claims(layout, scope, streams)
    find = partial(_find_channels, scope=scope, streams=streams, claims=claims)
    for buffer, components in layout.buffers.items():
        options, dumps = _find_options(components, find, ranked=layout.ranked)
        if dumps:
            ambiguous[buffer] = dumps
        if not options:
            continue
        labels |= options.keys()
        chosen = layer if layer in options else next(iter(options))
        binding[buffer] = options[chosen]
        if len(several := _list_rivals(options, components)) > 1:
            layers |= dict.fromkeys(several)
            if layer not in options:
                rivals[buffer] = several
    return LayoutMatch(
        binding=_drop_spares(layout, binding, scope, streams),
        ambiguous=ambiguous,
        rivals=rivals,
        scope=scope.channel,
        layers=tuple(layers),
        labels=frozenset(labels),
    )


def _drop_spares(
    layout: Layout, binding: Binding, scope: _Scope, streams: Streams
) -> dict[Buffer, BoundBuffer]:
    """Leave out what other buffers or channels say better."""
    dropped = {buffer for buffer, better in layout.spare.items() if better in binding}
    names = {name for held in streams.values() for name in held}
    for buffer, channels in layout.instead.items():
        places = [ChannelPlace(channel=channel) for channel in channels]
        said = all(_match_names(place, scope, names, NO_CLAIMS) for place in places)
        if said and buffer in binding and binding[buffer].is_computed:
            dropped.add(buffer)
    return {buffer: bound for buffer, bound in binding.items() if buffer not in dropped}


def _list_rivals(
    options: Mapping[str, object], components: tuple[Component, ...]
) -> tuple[str, ...]:
    """Layers between which a choice would be a guess; a single channel of none is in no layer."""
    if len(components) > 1:
        return tuple(options)
    first = next(iter(options))
    return () if first == UNNAMED else tuple(name for name in options if name != UNNAMED)


def _find_options(
    components: tuple[Component, ...],
    find: Callable[[ChannelPlace], list[_Held]],
    *,
    ranked: bool,
) -> tuple[dict[str, BoundBuffer], tuple[str, ...]]:
    """Find the layers that hold a buffer, in the order of turns; or the sequences that all do.

    After the first layer, others of the same files count where they are called by a name and no
    pattern, unless names of the buffer are ranked.
    """
    options: dict[str, BoundBuffer] = {}
    for turn in range(max(len(c.places) for c in components)):
        sums = [c.sum_of(turn) for c in components]
        places = [term.place for one in sums for term in one.terms]
        if options and (ranked or any(place.is_pattern for place in places)):
            continue
        held = [find(place) for place in places]
        if not all(held):
            continue
        sequences = {s for found in held for s, _ in found}
        if any(len({s for s, _ in found}) > 1 for found in held):
            if not options:
                return {}, tuple(sorted(sequences))
            continue
        for label, channels in _group_by_layer(held).items():
            bound = _bind_sums(sums, channels)
            same = not options or sequences == {c.stream for c in next(iter(options.values()))}
            if same and bound not in options.values():
                options.setdefault(label, bound)
    return options, ()


def _group_by_layer(held: Sequence[list[_Held]]) -> dict[str, list[_Held]]:
    """Group what was found of each channel by layers that have all of them.

    What is computed of several layers is in none; the first of each that is found is taken.
    """
    layers = [{_name_layer(channel): (stream, channel) for stream, channel in h} for h in held]
    common = [name for name in layers[0] if all(name in found for found in layers)] if held else []
    if not common:
        first = [found[0] for found in held]
        names = dict.fromkeys(_name_layer(channel) for _, channel in first)
        return {next(iter(names), UNNAMED): first}
    return {name: [found[name] for found in layers] for name in common}


def _bind_sums(sums: Sequence[ChannelSum], channels: Iterable[_Held]) -> BoundBuffer:
    """Put channels that were found in the places of the terms that they were found for."""
    found = iter(channels)
    return BoundBuffer(
        tuple(
            BoundSum(
                terms=tuple(
                    BoundChannel(stream=stream, channel=channel, factor=t.factor, offset=t.offset)
                    for t, (stream, channel) in zip(one.terms, found, strict=False)
                ),
                constant=one.constant,
            )
            for one in sums
        )
    )


def match_layout(layout: Layout, streams: Streams, layer: str | None = None) -> LayoutMatch:
    """Find a layout's buffers, and those that a choice would be a guess for.

    Where names begin with a scope, all buffers come from one: the layer that is asked for, or the
    one that holds most of them, the first by name among equals. Buffers that another one holds,
    too, are rivals. Two scopes of *files* that hold the same buffers are two dumps, and their
    common buffers ambiguous.
    """
    every = [_match_scope(layout, s, streams, layer) for s in _list_scopes(layout, streams)]
    matches = [m for m in every if layer and m.scope == layer] or every
    best = max(matches, key=lambda m: m.explained)
    scopes = dict.fromkeys(m.scope for m in every if m.scope and m.explained)
    rivals = {**best.rivals, **_find_rival_scopes(layout, best, matches)}
    best = replace(best, rivals=rivals, layers=tuple(dict.fromkeys([*scopes, *best.layers])))
    for other in matches:
        dumps = {
            b: (mine[0].stream, theirs[0].stream)
            for b, mine in best.binding.items()
            if (theirs := other.binding.get(b)) and mine and mine[0].stream != theirs[0].stream
        }
        if len(dumps) >= SAME_SCENE and other.scope == best.scope:
            kept = {b: c for b, c in best.binding.items() if b not in dumps}
            return replace(best, binding=kept, ambiguous={**best.ambiguous, **dumps})
    return best


def _find_rival_scopes(
    layout: Layout, best: LayoutMatch, matches: Iterable[LayoutMatch]
) -> dict[Buffer, tuple[str, ...]]:
    """Buffers that other scopes of channels hold, too, each with the scopes."""
    if best.scope in layout.aside:
        return {}
    others = [m for m in matches if m.scope not in {best.scope, *layout.aside}]
    held = {
        b: [m.scope for m in others if m.binding.get(b, bound) != bound]
        for b, bound in best.binding.items()
    }
    return {b: tuple(sorted([best.scope, *scopes])) for b, scopes in held.items() if scopes}


def bind_layout(layout: Layout, streams: Streams, layer: str | None = None) -> Binding:
    """Find a layout's buffers among file sequences and their channels.

    Args:
        layout: what to look for.
        streams: the files and their channels.
        layer: of which buffers are taken where several layers hold them.

    Raises:
        FrameFolderError: two sequences, or two layers, hold the same buffer, so that a choice
            would be a guess.
    """
    matched = match_layout(layout, streams, layer)
    if matched.ambiguous:
        raise FrameFolderError(make_ambiguity_error(matched.ambiguous))
    if matched.rivals:
        raise make_layer_error(matched.rivals)
    return matched.binding


def make_layer_error(rivals: Mapping[Buffer, Sequence[str]], where: str = "") -> LayerChoiceError:
    """Make the error of buffers that several layers hold, with the choices."""
    buffer, layers = next(iter(rivals.items()))
    names = tuple(dict.fromkeys(name for found in rivals.values() for name in found))
    before = f"{where}: " if where else ""
    return LayerChoiceError(
        f"{before}buffer '{buffer}' is in {len(layers)} layers of one file "
        f"({', '.join(map(repr, layers))}); choose one with --layer NAME (capture.toml: "
        'layer = "NAME"), or say which channels in [buffers] of capture.toml',
        names,
        buffer,
    )


def make_ambiguity_error(ambiguous: Mapping[Buffer, tuple[str, ...]]) -> str:
    """Say which buffer several file sequences hold, and the remedy."""
    buffer, holders = next(iter(ambiguous.items()))
    return (
        f"buffer '{buffer}' is in {len(holders)} file sequences of one folder "
        f"({', '.join(repr(h) for h in holders)}); keep one sequence a folder, or say which file "
        "in [buffers] of capture.toml"
    )
