"""Buffers of numbers in files whose compression alters numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.lossy_channels import ChannelCompression, find_lossy_channels
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import say_frames

NUMBER_BUFFERS = (
    Buffer.NORMAL,
    Buffer.GEONORMAL,
    Buffer.VIEW_NORMAL,
    Buffer.MOTION,
    Buffer.FORWARD,
    Buffer.DEPTH,
    Buffer.POSITION,
    Buffer.OBJECT_ID,
)
"""Buffers that are no pictures: a difference that no eye sees spoils them."""

ID_WORD = "crypto"
"""In the names of channels that hold ids (Cryptomatte), which no buffer takes."""


@dataclass(frozen=True, kw_only=True)
class LossyBuffer:
    """A buffer, or channels of ids, that lossy compression touches.

    Attributes:
        compression: names, several where frames differ.
        altered: channels whose numbers it alters.
        spared: channels that it leaves alone because of their names.
        frames: in which it was found.
    """

    compression: tuple[str, ...]
    altered: tuple[str, ...]
    spared: tuple[str, ...]
    frames: tuple[int, ...]


@dataclass
class _Found:
    """What is found of one buffer while frames come in."""

    compression: dict[str, None] = field(default_factory=dict)
    altered: dict[str, None] = field(default_factory=dict)
    spared: dict[str, None] = field(default_factory=dict)
    frames: dict[int, None] = field(default_factory=dict)

    def add(self, number: int, channel: str, known: ChannelCompression) -> None:
        self.compression[known.compression] = None
        (self.altered if known.altered else self.spared)[channel] = None
        self.frames[number] = None

    def result(self) -> LossyBuffer:
        return LossyBuffer(
            compression=tuple(self.compression),
            altered=tuple(self.altered),
            spared=tuple(c for c in self.spared if c not in self.altered),
            frames=tuple(self.frames),
        )


def find_lossy_buffers(
    reader: FrameReader, unknown: Mapping[str, Iterable[str]], numbers: Sequence[int]
) -> dict[str, LossyBuffer]:
    """Return what lossy compression touches, by buffer; ids that no buffer takes are `ids`.

    Args:
        reader: of the frames.
        unknown: by file sequence, channels that no buffer takes.
        numbers: frames to look at.
    """
    places = {
        (c.stream, c.channel): buffer.value
        for buffer in NUMBER_BUFFERS
        for bound in (reader.binding.get(buffer, ()), *reader.samples.get(buffer, ()))
        for c in bound
    }
    places |= {
        (stream, channel): "ids"
        for stream, channels in unknown.items()
        for channel in channels
        if ID_WORD in channel.lower()
    }
    found: dict[str, _Found] = {}
    for number in numbers:
        for stream in sorted({stream for stream, _ in places}):
            try:
                channels = find_lossy_channels(reader.path(number, stream))
            except (OSError, KeyError):
                # what cannot be read, or is not there, is a problem of its own
                continue
            for channel, known in channels.items():
                if (stream, channel) in places:
                    found.setdefault(places[stream, channel], _Found()).add(number, channel, known)
    return {name: found[name].result() for name in dict.fromkeys(places.values()) if name in found}


def describe_lossy(lossy: Mapping[str, LossyBuffer]) -> list[str]:
    """Say which buffers of numbers are stored with losses, a sentence each."""
    return [_describe_one(name, buffer) for name, buffer in lossy.items()]


def _describe_one(name: str, buffer: LossyBuffer) -> str:
    compression, frames = "/".join(buffer.compression), say_frames(buffer.frames)
    where = f"'{name}' is stored with {compression}, a lossy compression, in {frames}: "
    spared = f"{', '.join(buffer.spared)} is spared because of its name" if buffer.spared else ""
    altered = f"{', '.join(buffer.altered)} is altered" if buffer.altered else ""
    listed = ", ".join(part for part in (altered, spared) if part)
    return f"{where}{listed}; write numbers with zip, zips or piz"
