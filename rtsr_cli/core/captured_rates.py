"""Radiance at a reduced rate: as an engine rendered it where that was captured, else emulated.

Captured are channels `output_<AxB>.R/G/B` beside those at full rate, or frames of the same numbers
in a folder `output_<AxB>/` beside them; both are stored as radiance at full rate is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.exr import Plane, read_header
from rtsr_cli.core.io.nonfinite import NonfinitePolicy, checked
from rtsr_cli.core.io.opening import ReadOptions, open_single
from rtsr_cli.core.io.pairs import PairSource
from rtsr_cli.core.io.passing import Passed, resized
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.shapes import Color, IdMap, Size, TileMap
from rtsr_cli.core.vrs.coarse import coarse_shading
from rtsr_cli.core.vrs.errors import ErrorConfig, tile_errors
from rtsr_cli.core.vrs.rates import REDUCED, Rate
from rtsr_cli.core.vrs.reprojection import displayed

COMPONENTS = "RGB"


def captured_name(rate: Rate) -> str:
    """Name of a folder, and before the dot of channels."""
    return f"output_{rate.label}"


def captured_channels(rate: Rate) -> tuple[str, ...]:
    """Names of the channels of a rate."""
    return tuple(f"{captured_name(rate)}.{component}" for component in COMPONENTS)


@dataclass(frozen=True, kw_only=True)
class CapturedRate(Passed):
    """Radiance at a rate: read as the reader's own radiance is.

    Attributes:
        rate: of it.
        policy: for NaN and Inf.
    """

    rate: Rate
    policy: NonfinitePolicy

    def read(self, number: int, size: Size) -> dict[str, Plane]:
        """Read the radiance of a frame.

        Raises:
            FrameFolderError: a file is damaged, or holds NaN or Inf that are errors.
        """
        frame, _ = checked(self.reader.read(number, (Buffer.COLOR,)), self.policy)
        planes = frame.gbuffer[Buffer.COLOR][0].numpy()
        names = captured_channels(self.rate)
        return {name: resized(plane, size) for name, plane in zip(names, planes, strict=True)}


def captured_rates(
    source: PairSource, numbers: Collection[int], options: ReadOptions, policy: NonfinitePolicy
) -> tuple[CapturedRate, ...]:
    """Find what was captured of a shot.

    Args:
        source: frames at full rate.
        numbers: those that are wanted.
        options: how to read.
        policy: for NaN and Inf.

    Raises:
        FrameFolderError: a rate is there in part only, or at another size.
        RtsrError: its frames cannot be understood.
    """
    found = []
    for rate in REDUCED:
        reader = _folder(source, rate, numbers, options) or _channels(source.reader, rate)
        if reader is not None:
            places = tuple((c.stream, c.channel) for c in reader.binding[Buffer.COLOR])
            found.append(
                CapturedRate(reader=reader, channels=places, stands_in={}, rate=rate, policy=policy)
            )
    return tuple(found)


def told(captured: Iterable[CapturedRate]) -> str:
    """Which rates were captured, for people."""
    labels = ", ".join(part.rate.label for part in captured)
    return f"captured rates {labels}" if labels else "emulated rates"


def _channels(reader: FrameReader, rate: Rate) -> FrameReader | None:
    """Read the channels of a rate as if they were the frame's radiance; None without any."""
    components = reader.binding.get(Buffer.COLOR, ())
    if not components:
        return None
    stream = components[0].stream
    number = reader.numbers[0]
    there = read_header(reader.path(number, stream)).channels
    lacking = [name for name in captured_channels(rate) if name not in there]
    if len(lacking) == len(COMPONENTS):
        return None
    if lacking:
        raise FrameFolderError(
            f"{reader.where(number)}: channel {lacking[0]} is missing beside the others of "
            f"{captured_name(rate)}; capture R, G and B, or none"
        )
    named = zip(components, captured_channels(rate), strict=True)
    places = tuple(replace(component, channel=name) for component, name in named)
    return replace(reader, binding={**reader.binding, Buffer.COLOR: places})


def _folder(
    source: PairSource, rate: Rate, numbers: Collection[int], options: ReadOptions
) -> FrameReader | None:
    """Survey the folder of a rate; None if there is none."""
    own = source.reader
    folder = own.frames.root / captured_name(rate)
    if not folder.is_dir():
        return None
    shots = list(open_single(folder, options))
    if len(shots) != 1 or Buffer.COLOR not in shots[0][1].reader.stored:
        raise FrameFolderError(
            f"{folder}: expected the frames of the folder above at {rate.label}, with their "
            "radiance, and no folders below; move them here"
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
    return reader


def reduced_radiance(
    color: Color, rate: Rate, captured: Mapping[str, Plane], object_id: IdMap | None = None
) -> Color:
    """Radiance at a rate: as captured where it was, else emulated."""
    planes = [captured[name] for name in captured_channels(rate) if name in captured]
    if len(planes) < len(COMPONENTS):
        return coarse_shading(color, rate, object_id)
    stacked = np.stack([plane.astype(np.float32) for plane in planes])
    return torch.from_numpy(stacked)[None].to(color)


def true_errors(
    color: Color,
    config: ErrorConfig,
    *,
    captured: Mapping[str, Plane] | None = None,
    object_id: IdMap | None = None,
    rates: Iterable[Rate] = REDUCED,
) -> dict[Rate, TileMap]:
    """Errors of rates against radiance at full rate.

    Args:
        color: linear radiance at full rate.
        config: metric and tiles.
        captured: planes of captured rates by channel name.
        object_id: with it, emulated rates keep pixels of other objects than the sample's.
        rates: which.
    """
    full = displayed(color)
    return {
        rate: tile_errors(
            displayed(reduced_radiance(color, rate, captured or {}, object_id)), full, config
        )
        for rate in rates
    }
