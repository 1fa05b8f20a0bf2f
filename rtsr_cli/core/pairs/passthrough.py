"""Channels that `upscale` only hands through, as `--passthrough` names them.

A channel comes from the frames of the output's size as it is stored where they have it, else from
the LR frames, each pixel repeated. Radiance of the large frames is never among them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

from rtsr_cli.core.captures.layouts import SCOPE
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.channel_names import strip_view
from rtsr_cli.core.files.exr import Plane, read_header
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.shapes import Size

LAYER_NAME = "/name"
"""Ends the attribute that names the layer which a group belongs to: `cryptomatte/<id>/name`, beside
`cryptomatte/<id>/manifest` and others."""

PICTURE_ATTRIBUTES = frozenset(
    {
        "adoptedNeutral", "aperture", "capDate", "chromaticities", "colorInteropID", "envmap",
        "expTime", "focus", "framesPerSecond", "isoSpeed", "keyCode", "lookModTransform",
        "oiio:ColorSpace", "pixelAspectRatio", "renderingTransform", "screenWindowCenter",
        "screenWindowWidth", "timeCode", "whiteLuminance", "worldToCamera", "worldToNDC",
        "wrapmodes", "xDensity",
    }
)  # fmt: skip
"""Attributes that describe one picture: an output has those of the frame that it is made of."""

PROVENANCE = "rtsr:"

OUTPUT_CHANNELS = frozenset("RGBA")
"""What the output calls its own; wildcards do not match these."""


@dataclass(frozen=True, kw_only=True)
class PassedChannels:
    """Channels, each with the stream that holds it, that one reader hands through.

    Attributes:
        reader: where they are.
        channels: (stream, channel), sorted.
        stands_in: number -> number of the frame whose channels are taken.
    """

    reader: FrameReader
    channels: tuple[tuple[str, str], ...]
    stands_in: dict[int, int]

    def files(self, number: int) -> tuple[Path, ...]:
        """Files that hold the channels of a frame."""
        source = self.stands_in.get(number, number)
        return tuple(self.reader.path(source, stream) for stream in self._streams)

    def list_held_channels(self, number: int) -> frozenset[str]:
        """Names of all channels of these files."""
        source = self.stands_in.get(number, number)
        held = (self.reader.channels_of(source, stream) for stream in self._streams)
        return frozenset[str]().union(*held)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the channels."""
        return frozenset(channel for _, channel in self.channels)

    @cached_property
    def _streams(self) -> tuple[str, ...]:
        return tuple(sorted({stream for stream, _ in self.channels}))

    def read_attributes(self, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Attributes of the headers that a frame's channels come from, in two parts.

        Returns:
            those that are the channels' own, and others, which an output may hold already.

        Raises:
            FrameFolderError: a file is damaged.
        """
        source = self.stands_in.get(number, number)
        found: dict[str, Any] = {}
        for stream in self._streams:
            channels = [channel for held, channel in self.channels if held == stream]
            found |= read_header(self.reader.path(source, stream)).attributes_of(channels)
        return _split_attributes(found, self.names)

    def read(self, number: int, size: Size) -> dict[str, Plane]:
        """Read the channels of a frame at a size; numbers stay what they are.

        Raises:
            FrameFolderError: a file is damaged, or lacks a channel.
        """
        planes = self.reader.read_stored(self.stands_in.get(number, number), self.channels)
        return {channel: resize_plane(plane, size) for (_, channel), plane in planes.items()}


def _split_attributes(
    attributes: Mapping[str, Any], channels: Collection[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tell groups of attributes that name a channel's layer from the others.

    Groups that name layers of other channels are in neither, nor is what describes one picture.
    """
    layers = {
        name.removesuffix(LAYER_NAME): str(value)
        for name, value in attributes.items()
        if name.endswith(LAYER_NAME)
    }
    own: dict[str, Any] = {}
    others: dict[str, Any] = {}
    for name, value in attributes.items():
        layer = layers.get(name.rpartition("/")[0])
        if layer is None:
            if name not in PICTURE_ATTRIBUTES and not name.startswith(PROVENANCE):
                others[name] = value
        elif any(layer in channel for channel in channels):
            own[name] = value
    return own, others


def join_attributes(
    attributes: Mapping[str, Any], passed: Iterable[PassedChannels], number: int
) -> dict[str, Any]:
    """Return the attributes of an output, with those that its passed channels bring along.

    Args:
        attributes: of the frame that the output is made of.
        passed: channels that are handed through.
        number: of the frame.

    Raises:
        FrameFolderError: a file is damaged.
    """
    joined = dict(attributes)
    for part in passed:
        own, others = part.read_attributes(number)
        joined = {**others, **joined, **own}
    return joined


def resize_plane(plane: Plane, size: Size) -> Plane:
    """Repeat each pixel, or take the middle one of each block, without any arithmetic."""
    up, down = size[0] // plane.shape[0], plane.shape[0] // size[0]
    if up > 1:
        return plane.repeat(up, 0).repeat(up, 1)
    return plane[down // 2 :: down, down // 2 :: down] if down > 1 else plane


def find_passthrough(
    source: PairSource, patterns: Sequence[str], *, radiance: bool = True
) -> tuple[PassedChannels, ...]:
    """Find the channels that match any of the patterns, and check that every frame has them.

    Args:
        source: of the frames.
        patterns: of channels' names.
        radiance: whether radiance of LR frames may be among them.

    Raises:
        FrameFolderError: a pattern names an output's own channel or matches nothing, or two files
            of a frame have a channel of that name.
    """
    root = source.reader.frames.root
    for pattern in patterns:
        if pattern in OUTPUT_CHANNELS:
            raise FrameFolderError(
                f"{root}: --passthrough {pattern} would replace the output's own channel; "
                "the output's R G B A are what the system makes"
            )
    small = [r for r in source.readers if r is source.reader and r.size == source.lr_size]
    large = [r for r in source.readers if r not in small]
    taken: set[str] = set()
    groups: list[PassedChannels] = []
    for reader in (*large, *small):
        offered = _list_offered(reader, with_radiance=radiance and reader in small)
        chosen = _match_patterns(reader, [c for c in offered if c[1] not in taken], patterns)
        taken |= {channel for _, channel in chosen}
        if chosen:
            held = {} if reader is source.reader else dict(source.reader.held)
            groups.append(PassedChannels(reader=reader, channels=chosen, stands_in=held))
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in taken):
            raise FrameFolderError(
                f"{root}: no channel matches --passthrough {pattern}; "
                f"there are: {', '.join(_list_names(source.readers))}"
            )
    for passed in groups:
        _check_frames(passed, source.reader.numbers)
    return tuple(groups)


def _list_offered(reader: FrameReader, *, with_radiance: bool) -> list[tuple[str, str]]:
    """List a reader's channels, each with its stream, that could be handed through."""
    radiance = {
        (c.stream, c.channel)
        for buffer in RADIANCE_BUFFERS & reader.stored
        for c in reader.binding[buffer]
    }
    places = [
        term.place
        for buffer in RADIANCE_BUFFERS & set(reader.layout.buffers)
        for component in reader.layout.buffers[buffer]
        for term in component.terms
    ]
    offered = []
    for stream, by_number in reader.channels.items():
        first = next(iter(by_number.values()))
        views = reader.views.get(stream, {})
        for channel in sorted(first - reader.subsampled[stream] - OUTPUT_CHANNELS):
            plain = strip_view(channel, views.get(channel, ""))
            is_radiance = (stream, channel) in radiance or any(
                fnmatchcase(plain, place.channel.replace(SCOPE, "*"))
                and fnmatchcase(stream, place.file.replace(SCOPE, "*"))
                for place in places
            )
            if with_radiance or not is_radiance:
                offered.append((stream, channel))
    return offered


def _match_patterns(
    reader: FrameReader, offered: Sequence[tuple[str, str]], patterns: Sequence[str]
) -> tuple[tuple[str, str], ...]:
    chosen = [c for c in offered if any(fnmatchcase(c[1], pattern) for pattern in patterns)]
    twice = [name for name, count in Counter(name for _, name in chosen).items() if count > 1]
    if twice:
        raise FrameFolderError(
            f"{reader.frames.root}: --passthrough matches channel '{twice[0]}' of several files "
            "of one frame; name channels that only one of them has"
        )
    return tuple(sorted(chosen))


def _list_names(readers: Iterable[FrameReader]) -> list[str]:
    return sorted({c for reader in readers for _, c in _list_offered(reader, with_radiance=False)})


def _check_frames(passed: PassedChannels, numbers: Iterable[int]) -> None:
    wanted = {channel for _, channel in passed.channels}
    lacking = [number for number in numbers if wanted - passed.list_held_channels(number)]
    if lacking:
        raise FrameFolderError(
            f"{passed.reader.frames.root}, {say_frames(lacking)}: channels of "
            f"--passthrough are missing ({', '.join(sorted(wanted))} are in other frames)"
        )
