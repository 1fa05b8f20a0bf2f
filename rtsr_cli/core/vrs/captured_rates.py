"""Radiance at a reduced rate: as an engine rendered it where that was captured, else emulated.

Captured rates lie beside the frames at full rate (see `pairs.auxiliary_radiance`), named
`output_<AxB>`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import torch

from rtsr_cli.core.pairs.auxiliary_radiance import AuxiliaryRadiance
from rtsr_cli.core.shapes import Color, IdMap, TileMap
from rtsr_cli.core.vrs.coarse_shading import shade_coarsely
from rtsr_cli.core.vrs.rates import REDUCED, ShadingRate
from rtsr_cli.core.vrs.reprojection import encode_display
from rtsr_cli.core.vrs.shading_error import ErrorConfig, tile_errors


def name_captured_rate(rate: ShadingRate) -> str:
    """What a captured rate is called."""
    return f"output_{rate.label}"


CAPTURED_NAMES = tuple(name_captured_rate(rate) for rate in REDUCED)


def list_captured_labels(captured: Iterable[AuxiliaryRadiance]) -> list[str]:
    """Rates that were captured."""
    names = {part.name for part in captured}
    return [rate.label for rate in REDUCED if name_captured_rate(rate) in names]


def shade_at_rate(
    color: Color, rate: ShadingRate, captured: Mapping[str, Color], object_id: IdMap | None = None
) -> Color:
    """Radiance at a rate: as captured where it was, else emulated."""
    image = captured.get(name_captured_rate(rate))
    return shade_coarsely(color, rate, object_id) if image is None else image.to(color)


def measure_true_errors(
    color: Color,
    config: ErrorConfig,
    *,
    captured: Mapping[str, Color] | None = None,
    object_id: IdMap | None = None,
    rates: Iterable[ShadingRate] = REDUCED,
) -> dict[ShadingRate, TileMap]:
    """Errors of rates against radiance at full rate.

    Args:
        color: linear radiance at full rate, 1 3 h w.
        config: metric and tiles.
        captured: radiance of captured rates by name.
        object_id: with it, emulated rates keep pixels of other objects than the sample's.
        rates: which.
    """
    wanted = tuple(rates)
    reduced = [shade_at_rate(color, rate, captured or {}, object_id) for rate in wanted]
    errors = tile_errors(encode_display(torch.cat(reduced)), encode_display(color), config)
    return dict(zip(wanted, errors.unsqueeze(1).unbind(), strict=True))
