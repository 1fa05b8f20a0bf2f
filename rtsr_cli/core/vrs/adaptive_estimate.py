"""The analytic estimate of shading error from the frame before: no network, no reference.

    e_x = rms over the tile of |luma(x + 1, y) - luma(x, y)| / (mean luma + l),   e_y likewise
    half rate: e h(v),   quarter rate: e q(v)
    h(v) = (1 + (1.05 v)^3.1)^-0.35,   q(v) = 2.13 (1 + (0.55 v)^2.41)^-0.49

v is motion along the axis in pixels a frame, times a sensitivity   [Yang et al. 2019, and the
sample published with it]. What was not seen in the frame before is unknown to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.choices import Pool
from rtsr_cli.core.shapes import Plane, TileMap
from rtsr_cli.core.vrs.rates import DOUBLING, ShadingRate
from rtsr_cli.core.vrs.tile_pooling import tile_max, tile_mean


@dataclass(frozen=True, kw_only=True)
class AdaptiveConfig:
    """Settings, the published sample's by default.

    Attributes:
        tile: side of a tile, pixels.
        threshold: error from which a rate is too coarse.
        env_luminance: l.
        motion_sensitivity: what motion is multiplied by.
        pool: root mean square (`mean`, the paper) or maximum (`max`, the sample).
    """

    tile: int = 16
    threshold: float = 0.07
    env_luminance: float = 0.1
    motion_sensitivity: float = 0.5
    pool: Pool = Pool.MEAN


def half_rate_factor(speed: Tensor) -> Tensor:
    """h(v): blur along motion hides what half the rate leaves out."""
    return (1.0 + (1.05 * speed) ** 3.1) ** -0.35


def quarter_rate_factor(speed: Tensor) -> Tensor:
    """q(v), of a quarter of the rate."""
    return DOUBLING * (1.0 + (0.55 * speed) ** 2.41) ** -0.49


def _mask_even_samples(luma: Plane) -> Plane:
    """1 where x + y is even."""
    height, width = luma.shape[-2:]
    rows = torch.arange(height, device=luma.device).view(-1, 1)
    columns = torch.arange(width, device=luma.device)
    return ((rows + columns) % 2 == 0).to(luma.dtype).expand_as(luma)


def axis_errors(luma: Plane, config: AdaptiveConfig) -> tuple[TileMap, TileMap]:
    """(e_x, e_y) of every tile, from differences to the right and below where x + y is even.

    Args:
        luma: of a display-encoded image.
        config: tile, pool and l.
    """
    # in tiles of one pixel, every pixel counts
    sampled = _mask_even_samples(luma) if config.tile > 1 else torch.ones_like(luma)
    light = tile_mean(luma, config.tile) + config.env_luminance
    errors = []
    for dim in (-1, -2):
        # beside the last column there is none: it repeats
        end = torch.zeros_like(luma.narrow(dim, 0, 1))
        difference = torch.cat([luma.diff(dim=dim), end], dim=dim).abs() * sampled
        if config.pool is Pool.MAX:
            errors.append(tile_max(difference, config.tile) / light)
        else:
            share = tile_mean(sampled, config.tile)
            mean = tile_mean(difference.square(), config.tile) / share
            errors.append(mean.sqrt() / light)
    return errors[0], errors[1]


def scale_errors(
    error: TileMap, speed_px: TileMap, config: AdaptiveConfig
) -> tuple[TileMap, TileMap]:
    """Errors at half and at a quarter of the rate along an axis, from that axis' speed."""
    speed = speed_px.abs() * config.motion_sensitivity
    return error * half_rate_factor(speed), error * quarter_rate_factor(speed)


def adaptive_codes(
    errors: tuple[TileMap, TileMap], speeds_px: tuple[TileMap, TileMap], config: AdaptiveConfig
) -> TileMap:
    """Codes of the rates that the estimate allows.

    Per axis 1 where half the rate errs by the threshold or more, else 2 where a quarter exceeds it,
    else 4. Both axes at 4 fall back to 2 on the one with the larger error; 4 beside 1 falls back
    to 2.

    Args:
        errors: of `axis_errors`.
        speeds_px: motion of the tiles along x and y.
        config: threshold and sensitivity.
    """
    halves, steps = [], []
    for error, speed in zip(errors, speeds_px, strict=True):
        half, quarter = scale_errors(error, speed, config)
        allowed = torch.where(quarter > config.threshold, 2, 4)
        steps.append(torch.where(half >= config.threshold, 1, allowed))
        halves.append(half)
    x, y = steps
    both = (x == 4) & (y == 4)
    larger_x = halves[0] > halves[1]
    x, y = torch.where(both & larger_x, 2, x), torch.where(both & ~larger_x, 2, y)
    x, y = torch.where(y == 1, x.clamp(max=2), x), torch.where(x == 1, y.clamp(max=2), y)
    codes = torch.zeros_like(errors[0])
    for rate in ShadingRate:
        codes = torch.where((x == rate.across) & (y == rate.down), rate.code, codes)
    return codes
