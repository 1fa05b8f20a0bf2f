"""Layouts: which channel of which file is which buffer, as declarations.

A layout is data. The reader knows none by name: it binds the patterns below to the files and
channels it finds, and a new engine is a new entry in `presets`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from fnmatch import fnmatchcase
from functools import cached_property

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.frames.conventions import Conventions

SCOPE = "<scope>"
"""Begins a pattern whose first part is one name for all buffers: a view layer, a scene."""

PATTERN = frozenset("*?[")
"""Letters that make a pattern of a name."""


@dataclass(frozen=True, kw_only=True)
class ChannelPlace:
    """Where a channel can be: patterns (`fnmatch`) of its name and of its file sequence.

    A file sequence is known by its key (`folder/base name` relative to the shot) and, where each
    buffer has a folder, by that folder's name alone. `alone` are channels of one letter that mean
    something only in the one file sequence of a frame set, beside no others but alpha and depth.
    `scoped` are names that a user may have written without their scope.
    `unclaimed` are channels that mean something only where no file sequence is a buffer's by name.
    A pattern fits no layer that has the component `without`, too.
    """

    channel: str
    file: str = "*"
    alone: bool = False
    unclaimed: bool = False
    without: str = ""
    scoped: bool = False

    @property
    def is_pattern(self) -> bool:
        """Tell whether the channel's name is a guess: a pattern, but for the scope."""
        return not PATTERN.isdisjoint(self.channel)


@dataclass(frozen=True, kw_only=True)
class Term:
    """One channel in a sum: `(stored - offset) * factor`.

    Attributes:
        place: where the channel can be.
        factor: on the stored value.
        offset: stored value of zero.
        column: where the user wrote it, counted from 1; 0 where it is in no text.
    """

    place: ChannelPlace
    factor: float = 1.0
    offset: float = 0.0
    column: int = field(default=0, compare=False)


@dataclass(frozen=True, kw_only=True)
class ChannelSum:
    """What one channel of a buffer is computed of: the sum of its terms, and a constant.

    Attributes:
        terms: channels that are added; none for a constant.
        constant: what is added to them.
    """

    terms: tuple[Term, ...] = ()
    constant: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Component:
    """One channel of a buffer: `value = (stored - offset) * factor`, or a sum.

    Attributes:
        places: where it can be, or of which channels it is the sum, tried in order; all
            components of a buffer take the same turn.
        factor: on the stored value of a place; a sum has its own.
        offset: stored value of zero, likewise.
    """

    places: tuple[ChannelPlace | ChannelSum, ...]
    factor: float = 1.0
    offset: float = 0.0

    def sum_of(self, turn: int) -> ChannelSum:
        """Return the sum of a turn; the last one stands for those that are not there."""
        return self._sums[min(turn, len(self.places) - 1)]

    @cached_property
    def _sums(self) -> tuple[ChannelSum, ...]:
        """The sum of every turn, made once: files are held against every layout."""
        return tuple(map(self._make_sum, self.places))

    def _make_sum(self, place: ChannelPlace | ChannelSum) -> ChannelSum:
        if isinstance(place, ChannelSum):
            return place
        return ChannelSum(terms=(Term(place=place, factor=self.factor, offset=self.offset),))

    @property
    def terms(self) -> Iterator[Term]:
        """Channels of every turn."""
        for turn in range(len(self.places)):
            yield from self.sum_of(turn).terms

    @property
    def is_computed(self) -> bool:
        """Tell whether it is a sum or a constant in every turn, and in none a channel."""
        return not any(True for _ in self.channels)

    @property
    def channels(self) -> Iterator[Term]:
        """Channels of the turns that are one channel each, and nothing is added to it."""
        sums = (self.sum_of(turn) for turn in range(len(self.places)))
        return (s.terms[0] for s in sums if len(s.terms) == 1 and s.constant == 0.0)


@dataclass(frozen=True, kw_only=True)
class FolderTree:
    """Folders of a data set that keeps resolutions and buffers apart.

    Templates of paths below the data set's root, with the fields `{buffer}`, `{shot}` and, for
    LR, `{scale}` (whole numbers; `1_5` means 1.5).

    Attributes:
        lr, hr: folder of one buffer of one shot.
        lr_buffers, hr_buffers: the buffers' folders, as they are written.
        side_car: JSON file of a shot's cameras.
    """

    lr: str
    hr: str
    lr_buffers: tuple[str, ...]
    hr_buffers: tuple[str, ...]
    side_car: str | None = None


def _rank_channel(name: str) -> tuple[str, int, str]:
    return name[:-1], "RGBAXYZW".find(name[-1:]), name


@dataclass(frozen=True, kw_only=True)
class UnreadPass:
    """What a layout knows and does not read.

    Attributes:
        name: pattern of the name of its channels or its file sequence.
        why: said to the user.
        unless: buffer that it would stand in for; nothing is said where that one is there.
    """

    name: str
    why: str
    unless: Buffer | None = None


class OpenMotion(StrEnum):
    """What sources leave open, or disagree about, of how vectors are stored."""

    NOTHING = "nothing"
    SIZE = "size"
    SENSE = "sense"


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A named arrangement of buffers in files.

    Attributes:
        name: what users type.
        description: where it comes from.
        buffers: the components of each buffer, in the buffer's channel order.
        conventions: what the names do not say.
        folders: True if each buffer may be a folder of its own below the shot.
        tree: folders of a whole data set, for layouts that have such.
        scope: what `SCOPE` in a channel's name is written as.
        ranked: whether the names of a buffer are several passes of one renderer, the better ones
            first; else they are spellings of one thing, of which a file has one.
        aside: scopes that are no layers of their own: what is made of the others.
        spare: buffers that are not read where another one is there, which says the same.
        instead: patterns of channels that, where there is one of each, say better what is otherwise
            computed of a buffer's passes, which then is not read.
        digits: digits of a frame number, as it is written.
        verified: False if known from documentation only.
        marks: patterns of channels of which one has to be there for the layout to be detected.
        open_motion: what of the vectors sources leave open, so that they are read only where a
            measurement fits (`size`), or tells their direction as well (`sense`).
        other_depth_units: metres in a unit of depth that is met with as well; it is read where the
            layout's own would make kilometres of the frames.
        unread: what is known and not read.
        bright_albedo: what base colours above 1 are in such files, in words.
    """

    name: str
    description: str
    buffers: Mapping[Buffer, tuple[Component, ...]]
    conventions: Conventions = field(default_factory=Conventions)
    folders: bool = False
    tree: FolderTree | None = None
    scope: str = ""
    ranked: bool = False
    aside: tuple[str, ...] = ()
    spare: Mapping[Buffer, Buffer] = field(default_factory=dict)
    instead: Mapping[Buffer, tuple[str, ...]] = field(default_factory=dict)
    digits: int = 4
    verified: bool = True
    marks: tuple[str, ...] = ()
    open_motion: OpenMotion = OpenMotion.NOTHING
    other_depth_units: tuple[float, ...] = ()
    unread: tuple[UnreadPass, ...] = ()
    bright_albedo: str = "it holds reflections or light, or was multiplied"

    def list_unread(self, streams: Mapping[str, Collection[str]]) -> dict[str, UnreadPass]:
        """What is known and not read of file sequences and their channels, by name."""
        names = [*streams, *(stream.rpartition("/")[0] for stream in streams)]
        # channels come in any order; red, or x, is named first
        names += [c for channels in streams.values() for c in sorted(channels, key=_rank_channel)]
        return {n: u for u in self.unread for n in names if fnmatchcase(n, u.name)}

    @cached_property
    def places(self) -> tuple[ChannelPlace, ...]:
        """Where any channel of any buffer can be."""
        components = (c for components in self.buffers.values() for c in components)
        return tuple(term.place for component in components for term in component.terms)

    @property
    def files(self) -> tuple[str, ...]:
        """Patterns of the file sequences that hold one buffer each."""
        patterns = {place.file for place in self.places}
        return tuple(sorted(p for p in patterns if p.replace(SCOPE, "*") != "*"))

    @property
    def known_files(self) -> tuple[str, ...]:
        """`files`, and patterns of what is known and not read: it is found, to be named."""
        return (*self.files, *(unread.name for unread in self.unread))


def list_suffixes(buffer: Buffer, letters: str | None = None) -> tuple[str, ...]:
    """Suffix of each channel of a buffer: its own letters, or the given ones."""
    return tuple(letters) if letters else BUFFER_SPECS[buffer].component_names


def name_components(
    buffer: Buffer, *prefixes: str, letters: str | None = None, file: str = "*"
) -> tuple[Component, ...]:
    """Components of a buffer whose channels are `prefix.letter` (or `prefix` if single)."""
    return tuple(
        Component(
            places=tuple(
                ChannelPlace(channel=f"{p}.{s}" if p and s else p or s, file=file) for p in prefixes
            )
        )
        for s in list_suffixes(buffer, letters)
    )


def name_unclaimed_components(*channels: str) -> tuple[Component, ...]:
    """Components of a buffer whose channels have no layer: R, G, B of the file of all passes."""
    return tuple(
        Component(places=(ChannelPlace(channel=channel, unclaimed=True),)) for channel in channels
    )


def name_single_component(*channels: str, file: str = "*") -> tuple[Component, ...]:
    """Return the only component of a buffer, by the names it can have."""
    return (Component(places=tuple(ChannelPlace(channel=c, file=file) for c in channels)),)


def join_places(*options: tuple[Component, ...]) -> tuple[Component, ...]:
    """Join the places of several arrangements of one buffer, in order; factors are the first's."""
    return tuple(
        Component(
            places=tuple(place for component in turns for place in component.places),
            factor=turns[0].factor,
            offset=turns[0].offset,
        )
        for turns in zip(*options, strict=True)
    )


def name_file_components(
    buffer: Buffer, *files: str, letters: str = "RGB"
) -> tuple[Component, ...]:
    """Components of a buffer that has files of its own, with plain channels."""
    count = BUFFER_SPECS[buffer].channels
    return tuple(
        Component(places=tuple(ChannelPlace(channel=c, file=f) for f in files))
        for c in letters[:count]
    )
