"""Where each buffer of a frame set is: channels of file sequences, and what is computed of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

from rtsr_cli.core.captures.buffer_expressions import write_sum
from rtsr_cli.core.frames.buffers import Buffer


@dataclass(frozen=True, kw_only=True)
class BoundChannel:
    """A channel found, in the stream that holds it: its value is `(stored - offset) * factor`."""

    stream: str
    channel: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def is_plain(self) -> bool:
        """Tell whether the value is what is stored."""
        return self.factor == 1.0 and self.offset == 0.0


@dataclass(frozen=True, kw_only=True)
class BoundSum:
    """One channel of a buffer: the sum of some channels, and a constant."""

    terms: tuple[BoundChannel, ...] = ()
    constant: float = 0.0

    @property
    def is_one_channel(self) -> bool:
        """Tell whether it is a channel of a file, and nothing is added to it."""
        return len(self.terms) == 1 and self.constant == 0.0

    def multiplied(self, factor: float, added: float = 0.0) -> BoundSum:
        """Return `factor` times the same, and a constant."""
        terms = tuple(replace(t, factor=t.factor * factor) for t in self.terms)
        return BoundSum(terms=terms, constant=self.constant * factor + added)


@dataclass(frozen=True)
class BoundBuffer:
    """What a buffer is made of; to iterate over it is to go through all channels that it takes.

    Attributes:
        components: in the order of the buffer's channels.
    """

    components: tuple[BoundSum, ...]

    def __iter__(self) -> Iterator[BoundChannel]:
        """Go through the channels of the files; there are none of a constant."""
        return (term for component in self.components for term in component.terms)

    def __len__(self) -> int:
        """Count the channels of the files."""
        return sum(len(component.terms) for component in self.components)

    def __getitem__(self, index: int) -> BoundChannel:
        """Return a channel of the files, counted over all components."""
        return list(self)[index]

    @property
    def is_computed(self) -> bool:
        """Tell whether it is more than channels of files, one a component."""
        return not all(component.is_one_channel for component in self.components)

    @property
    def is_as_stored(self) -> bool:
        """Tell whether it is channels of files, one a component, and no factor is on any."""
        return not self.is_computed and all(channel.is_plain for channel in self)

    @property
    def is_inverted(self) -> bool:
        """Tell whether a channel is taken from something: `1 - x`."""
        return any(channel.factor < 0.0 for channel in self)

    def renamed(self, names: Mapping[tuple[str, str], str]) -> BoundBuffer:
        """Return the same of channels that are called otherwise.

        Args:
            names: by stream and channel, the name in its place.
        """
        return self._changed(lambda c: replace(c, channel=names[c.stream, c.channel]))

    def scaled_like(self, other: BoundBuffer) -> BoundBuffer:
        """Return channels that are as many, with the factors and constants of another buffer's."""
        scales = iter(other)

        def scale(channel: BoundChannel) -> BoundChannel:
            like = next(scales)
            return replace(channel, factor=like.factor, offset=like.offset)

        return self._changed(scale)

    def moved_to(self, stream: str) -> BoundBuffer:
        """Return the same channels of another file sequence."""
        return self._changed(lambda c: replace(c, stream=stream))

    def multiplied(self, factor: float, added: float = 0.0) -> BoundBuffer:
        """Return `factor` times the same, and a constant."""
        return BoundBuffer(tuple(c.multiplied(factor, added) for c in self.components))

    def tinted(self, factors: Sequence[float]) -> BoundBuffer:
        """Return each component times a factor of its own.

        Raises:
            ValueError: there are not as many factors as components.
        """
        pairs = zip(self.components, factors, strict=True)
        return BoundBuffer(tuple(component.multiplied(factor) for component, factor in pairs))

    def _changed(self, change: Callable[[BoundChannel], BoundChannel]) -> BoundBuffer:
        return BoundBuffer(
            tuple(replace(c, terms=tuple(change(t) for t in c.terms)) for c in self.components)
        )

    def list_values(self) -> list[object]:
        """Return what it is made of as plain values, for stamps."""
        if not self.is_computed:
            return [asdict(channel) for channel in self]
        return [asdict(component) for component in self.components]

    def describe(self, *, streams: bool) -> str:
        """Say what it is made of, with one letter a component: `Diffuse.RGB + Glossy.RGB`.

        Args:
            streams: whether channels are named with their file sequence.
        """
        if all(component == self.components[0] for component in self.components):
            return _write_sum(self.components[0], streams=streams)
        joined = _join_components(self.components)
        if joined is not None:
            return _write_sum(joined, streams=streams)
        return ", ".join(_write_sum(component, streams=streams) for component in self.components)


Binding = Mapping[Buffer, BoundBuffer]
"""Where each buffer of a shot is."""


def bind_channels(*channels: BoundChannel) -> BoundBuffer:
    """Return a buffer of channels as they are, one a component."""
    return BoundBuffer(tuple(BoundSum(terms=(channel,)) for channel in channels))


def _join_components(components: tuple[BoundSum, ...]) -> BoundSum | None:
    """Write components of the same layers as one: their last letters together; None if unlike."""
    first = components[0]
    alike = all(
        len(c.terms) == len(first.terms) and c.constant == first.constant for c in components
    )
    if not alike:
        return None
    terms = [
        _join_channels(together) for together in zip(*(c.terms for c in components), strict=True)
    ]
    known = tuple(term for term in terms if term is not None)
    return BoundSum(terms=known, constant=first.constant) if len(known) == len(terms) else None


def _join_channels(channels: tuple[BoundChannel, ...]) -> BoundChannel | None:
    first = channels[0]
    names = [c.channel.rpartition(".") for c in channels]
    layers = {
        (c.stream, c.factor, c.offset, n[0], len(n[2]))
        for c, n in zip(channels, names, strict=True)
    }
    if len(layers) > 1 or len(names[0][2]) != 1:
        return None
    letters = "".join(name[2] for name in names)
    return BoundChannel(
        stream=first.stream,
        channel=f"{names[0][0]}{names[0][1]}{letters}",
        factor=first.factor,
        offset=first.offset,
    )


def _write_sum(component: BoundSum, *, streams: bool) -> str:
    """Write a sum as users do; stored values of zero are a part of the constant."""
    terms = [
        (t.factor, f"{t.stream}:{t.channel}" if streams and t.stream else t.channel)
        for t in component.terms
    ]
    return write_sum(terms, component.constant - sum(t.factor * t.offset for t in component.terms))
