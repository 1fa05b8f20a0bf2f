"""Radiance at a reduced rate: as an engine rendered it where that was captured, else emulated.

Captured are channels `output_<AxB>.R/G/B` beside those at full rate, or frames of the same numbers
in a folder `output_<AxB>/` beside them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePath

import numpy as np
import torch

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.exr import Plane, read_header
from rtsr_cli.core.io.opening import ReadOptions, open_single
from rtsr_cli.core.io.pairs import PairSource
from rtsr_cli.core.io.passing import Passed
from rtsr_cli.core.shapes import Color, IdMap, TileMap
from rtsr_cli.core.vrs.coarse import coarse_shading
from rtsr_cli.core.vrs.errors import ErrorConfig, tile_errors
from rtsr_cli.core.vrs.rates import REDUCED, Rate
from rtsr_cli.core.vrs.reprojection import displayed

COMPONENTS = "RGB"


def captured_name(rate: Rate) -> str:
    """Name of a folder, and before the dot of channels."""
    return f"output_{rate.label}"


FOLDERS = frozenset(captured_name(rate) for rate in Rate)
"""Folders that hold no shot of their own."""


def captured_channels(rate: Rate) -> tuple[str, ...]:
    """Names of the channels of a rate."""
    return tuple(f"{captured_name(rate)}.{component}" for component in COMPONENTS)


def open_shots(folder: Path, options: ReadOptions) -> Iterator[tuple[str, PairSource]]:
    """Shots of IN but those of captured rates.

    Raises:
        RtsrError: as `open_single`.
    """
    for name, source in open_single(folder, options):
        if PurePath(name).name not in FOLDERS:
            yield name, source


def stored_channels(source: PairSource) -> list[str]:
    """Channels of captured rates that the frames themselves hold."""
    files = source.reader.files(source.reader.numbers[0], source.reader.stored)
    there = {channel for path in files for channel in read_header(path).channels}
    return [name for rate in REDUCED for name in captured_channels(rate) if name in there]


def beside(source: PairSource, options: ReadOptions) -> tuple[Passed, ...]:
    """Captured rates in folders beside the frames.

    Raises:
        FrameFolderError: such a folder lacks a frame, or its frames are of another size.
        RtsrError: its frames cannot be understood.
    """
    found = []
    for rate in REDUCED:
        folder = source.reader.frames.root / captured_name(rate)
        if not folder.is_dir():
            continue
        [(_, captured)] = open_single(folder, options)
        reader = captured.reader
        if reader.size != source.reader.size:
            raise FrameFolderError(
                f"{folder}: {reader.size[1]} x {reader.size[0]} pixels, the frames beside it are "
                f"{source.reader.size[1]} x {source.reader.size[0]}; capture both at one size"
            )
        lacking = sorted(set(source.reader.numbers) - set(reader.numbers))
        if lacking:
            raise FrameFolderError(
                f"{folder}: frame {lacking[0]} is missing; capture it, or choose --frames without"
            )
        components = reader.binding[Buffer.COLOR]
        found.append(
            Passed(
                reader=reader,
                channels=tuple((c.stream, c.channel) for c in components),
                names=captured_channels(rate),
                stands_in={},
            )
        )
    return tuple(found)


def reduced_radiance(
    color: Color, rate: Rate, captured: Mapping[str, Plane], object_id: IdMap | None = None
) -> Color:
    """Radiance at a rate: as captured where all of its channels are there, else emulated."""
    planes = [captured.get(name) for name in captured_channels(rate)]
    held = [plane for plane in planes if plane is not None]
    if len(held) < len(planes):
        return coarse_shading(color, rate, object_id)
    stacked = np.stack([plane.astype(np.float32) for plane in held])
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
