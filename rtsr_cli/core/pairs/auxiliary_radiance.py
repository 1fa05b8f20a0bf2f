"""Further radiance of a shot's frames, captured beside their own: at a reduced rate, for example.

Channels `<name>.R/G/B` beside those of the frame, or frames of the same numbers in a folder
`<name>/` beside them; both are stored as the frame's radiance is, unless the folder has a
capture.toml of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Set
from dataclasses import dataclass, replace

import numpy as np
import torch

from rtsr_cli.core.captures.bound_channels import bind_channels
from rtsr_cli.core.captures.capture_file import CAPTURE_FILE
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import Plane
from rtsr_cli.core.files.folders import is_file, is_folder
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.pairs.nonfinite import apply_policy
from rtsr_cli.core.pairs.opening import ReadOptions, open_single_sets
from rtsr_cli.core.pairs.passthrough import PassedChannels, resize_plane
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.shapes import Color, Size

COMPONENTS = "RGB"


def name_channels(name: str) -> tuple[str, ...]:
    """Channels that radiance of a name lies in."""
    return tuple(f"{name}.{component}" for component in COMPONENTS)


@dataclass(frozen=True, kw_only=True)
class AuxiliaryRadiance(PassedChannels):
    """Radiance of a name: read as the reader's own radiance is.

    Attributes:
        name: of it.
        policy: for NaN and Inf.
    """

    name: str
    policy: NonfinitePolicy

    def image(self, number: int) -> Color:
        """Read the radiance of a frame.

        Raises:
            FrameFolderError: a file is damaged, or holds NaN or Inf that are errors.
        """
        frame, _ = apply_policy(self.reader.read(number, (Buffer.COLOR,)), self.policy)
        return frame.gbuffer[Buffer.COLOR]

    def read(self, number: int, size: Size) -> dict[str, Plane]:
        """Read its planes by channel, errors as of `image`."""
        planes = self.image(number)[0].numpy()
        named = zip(name_channels(self.name), planes, strict=True)
        return {name: resize_plane(plane, size) for name, plane in named}


def find_auxiliary(
    source: PairSource,
    names: Iterable[str],
    numbers: Collection[int],
    options: ReadOptions,
    policy: NonfinitePolicy,
) -> tuple[AuxiliaryRadiance, ...]:
    """Find what was captured beside a shot's frames.

    Args:
        source: the frames.
        names: of radiance that may be there.
        numbers: frames that are wanted.
        options: how to read.
        policy: for NaN and Inf.

    Raises:
        FrameFolderError: something is there in part only, or at another size.
        RtsrError: its frames cannot be understood.
    """
    radiance = []
    held = _list_held_channels(source.reader, numbers)
    for name in names:
        reader = _open_folder(source, name, numbers, options) or _open_channels(
            source.reader, name, held
        )
        if reader is not None:
            places = tuple((c.stream, c.channel) for c in reader.binding[Buffer.COLOR])
            radiance.append(
                AuxiliaryRadiance(
                    reader=reader, channels=places, stands_in={}, name=name, policy=policy
                )
            )
    return tuple(radiance)


def join_planes(planes: Mapping[str, Plane], names: Iterable[str]) -> dict[str, Color]:
    """Put the planes of `AuxiliaryRadiance.read` together: name -> 1 3 h w."""
    images = {}
    for name in names:
        parts = [planes[channel] for channel in name_channels(name) if channel in planes]
        if len(parts) == len(COMPONENTS):
            images[name] = torch.from_numpy(np.stack(parts).astype(np.float32))[None]
    return images


def _list_held_channels(reader: FrameReader, numbers: Collection[int]) -> dict[int, Set[str]]:
    """Channels of the files that hold the frames' radiance."""
    if Buffer.COLOR not in reader.binding:
        return {}
    stream = reader.binding[Buffer.COLOR][0].stream
    return {n: reader.channels_of(n, stream) for n in sorted(numbers)}


def _open_channels(
    reader: FrameReader, name: str, held: Mapping[int, Set[str]]
) -> FrameReader | None:
    """Read the channels of a name as if they were the frame's radiance; None without any."""
    wanted = set(name_channels(name))
    if not any(wanted & there for there in held.values()):
        return None
    for number, there in held.items():
        if lacking := sorted(wanted - there):
            raise FrameFolderError(
                f"{reader.where(number)}: channel {lacking[0]} is missing, others of {name} are "
                "in these frames; capture R, G and B of every frame, or choose --frames without"
            )
    first = [component.terms[0] for component in reader.binding[Buffer.COLOR].components]
    named = zip(first, name_channels(name), strict=True)
    places = bind_channels(*(replace(own, channel=channel) for own, channel in named))
    return replace(reader, binding={**reader.binding, Buffer.COLOR: places})


def _open_folder(
    source: PairSource, name: str, numbers: Collection[int], options: ReadOptions
) -> FrameReader | None:
    """Survey the folder of a name; None if there is none."""
    own = source.reader
    folder = own.frames.root / name
    if not is_folder(folder):
        return None
    shots = list(open_single_sets(folder, options))
    if len(shots) != 1 or Buffer.COLOR not in shots[0][1].reader.stored:
        raise FrameFolderError(
            f"{folder}: expected the frames of the folder above, as {name}, with their radiance, "
            "and no folders below; move them here"
        )
    reader = shots[0][1].reader
    if reader.size != own.size:
        raise FrameFolderError(
            f"{folder}: {reader.size[1]} x {reader.size[0]} pixels, the frames beside it are "
            f"{own.size[1]} x {own.size[0]}; capture both at one size"
        )
    lacking = sorted(set(numbers) - set(reader.numbers))
    if lacking:
        raise FrameFolderError(
            f"{folder}: frame {lacking[0]} is missing; capture it, or choose --frames without"
        )
    return reader if is_file(folder / CAPTURE_FILE) else _read_alike(reader, own)


def _read_alike(reader: FrameReader, own: FrameReader) -> FrameReader:
    """Read radiance by what is known of that of other frames: factors, colour space, exposure."""
    theirs, known = reader.binding[Buffer.COLOR], own.binding.get(Buffer.COLOR)
    if known is not None and len(theirs) == len(known):
        theirs = theirs.scaled_like(known)
    return replace(
        reader,
        binding={**reader.binding, Buffer.COLOR: theirs},
        conventions=own.conventions,
        cameras={n: own.cameras.get(n, camera) for n, camera in reader.cameras.items()},
    )
