"""Radiance at a reduced rate: as an engine rendered it where that was captured, else emulated.

Captured rates lie beside the frames at full rate (see `io.beside`), named `output_<AxB>`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import torch

from rtsr_cli.core.io.beside import Beside
from rtsr_cli.core.shapes import Color, IdMap, TileMap
from rtsr_cli.core.vrs.coarse import coarse_shading
from rtsr_cli.core.vrs.errors import ErrorConfig, tile_errors
from rtsr_cli.core.vrs.rates import REDUCED, Rate
from rtsr_cli.core.vrs.reprojection import displayed


def captured_name(rate: Rate) -> str:
    """What a captured rate is called."""
    return f"output_{rate.label}"


CAPTURED_NAMES = tuple(captured_name(rate) for rate in REDUCED)


def labels(captured: Iterable[Beside]) -> list[str]:
    """Rates that were captured."""
    names = {part.name for part in captured}
    return [rate.label for rate in REDUCED if captured_name(rate) in names]


def reduced_radiance(
    color: Color, rate: Rate, captured: Mapping[str, Color], object_id: IdMap | None = None
) -> Color:
    """Radiance at a rate: as captured where it was, else emulated."""
    found = captured.get(captured_name(rate))
    return coarse_shading(color, rate, object_id) if found is None else found.to(color)


def true_errors(
    color: Color,
    config: ErrorConfig,
    *,
    captured: Mapping[str, Color] | None = None,
    object_id: IdMap | None = None,
    rates: Iterable[Rate] = REDUCED,
) -> dict[Rate, TileMap]:
    """Errors of rates against radiance at full rate.

    Args:
        color: linear radiance at full rate, 1 3 h w.
        config: metric and tiles.
        captured: radiance of captured rates by name.
        object_id: with it, emulated rates keep pixels of other objects than the sample's.
        rates: which.
    """
    wanted = tuple(rates)
    reduced = [reduced_radiance(color, rate, captured or {}, object_id) for rate in wanted]
    found = tile_errors(displayed(torch.cat(reduced)), displayed(color), config)
    return dict(zip(wanted, found.unsqueeze(1).unbind(), strict=True))
