"""Visual error of a reduced shading rate: per pixel, then per tile.

    JN = E / (L + l)      [Cardoso et al. 2022, Eq. 7-9]

E is an error, L the mean luma of the 4 x 4 block of the full-rate image, l the luminance of the
environment: Weber's law. Images are display-encoded, 0..1; luma is that of Rec. 601.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import torch

from rtsr_cli.core.choices import Pool, VrsMetric
from rtsr_cli.core.metrics.fidelity import squared_error_map
from rtsr_cli.core.metrics.flip import DEFAULT_PPD, ldr_flip, pixels_per_degree
from rtsr_cli.core.metrics.lpips import Lpips
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Color, Plane, TileMap
from rtsr_cli.core.vrs.tile_pooling import pool_tiles, tile_mean

REC601 = (0.299, 0.587, 0.114)

LUMA_BLOCK_PX = 4
"""Side of the blocks whose mean luma an error is divided by."""

PUBLISHED_ENV_LUMINANCE = 1e-10
"""None at all, but no division by zero [rt-percept, code]."""

MIN_MSE = 1e-10
"""Mean squared error that stands for none: 100 dB."""


JUST_NOTICED: Mapping[VrsMetric, float] = {
    VrsMetric.JNFLIP: 0.25,
    VrsMetric.FLIP: 0.1,
    VrsMetric.JNYANG: 0.2,
    VrsMetric.PSNR: 35.0,
    VrsMetric.LPIPS: 0.1,
}
"""Errors that are just not noticed; JNFLIP's is the published one."""

PPD_BY_WIDTH = 0.0
"""Stands for the published code's rule: a monitor as wide as it is far away shows the image."""


def rec601_luma(image: Color) -> Plane:
    """Rec. 601 luma of a display-encoded image."""
    weights = image.new_tensor(REC601).view(1, 3, 1, 1)
    return (image * weights).sum(dim=1, keepdim=True)


def block_luma(full: Color) -> Plane:
    """L: mean luma of each 4 x 4 block, at every pixel."""
    means = tile_mean(rec601_luma(full), LUMA_BLOCK_PX)
    height, width = full.shape[-2:]
    large = means.repeat_interleave(LUMA_BLOCK_PX, -2).repeat_interleave(LUMA_BLOCK_PX, -1)
    return large[..., :height, :width]


@dataclass(frozen=True, kw_only=True)
class ErrorConfig:
    """How tile errors are measured.

    Attributes:
        metric: per-pixel error.
        tile: side of a tile, pixels.
        pool: of pixels into tiles; PSNR always takes the mean of its squared errors.
        env_luminance: l of Weber's law.
        ppd: pixels per degree, for FLIP; 0 = width pi / 180, of the image or crop that is looked at
            [rt-percept, code].
    """

    metric: VrsMetric = VrsMetric.JNFLIP
    tile: int = 16
    pool: Pool = Pool.MAX
    env_luminance: float = PUBLISHED_ENV_LUMINANCE
    ppd: float = DEFAULT_PPD

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: one is below 0, or none.
        """
        check_numbers(self, "error", {"env_luminance": 0.0, "ppd": 0.0})

    def ppd_at(self, width_px: int) -> float:
        """Pixels per degree of an image."""
        return self.ppd if self.ppd != PPD_BY_WIDTH else pixels_per_degree(1.0, width_px, 1.0)


def _measure_flip(coarse: Color, full: Color, config: ErrorConfig) -> Plane:
    return ldr_flip(coarse, full, config.ppd_at(full.shape[-1])).unsqueeze(1)


def _adaptation(full: Color, config: ErrorConfig) -> Plane:
    """L + l, never 0."""
    return (block_luma(full) + config.env_luminance).clamp(min=PUBLISHED_ENV_LUMINANCE)


def _measure_noticeable_flip(coarse: Color, full: Color, config: ErrorConfig) -> Plane:
    return _measure_flip(coarse, full, config) / _adaptation(full, config)


def _measure_noticeable_luma(coarse: Color, full: Color, config: ErrorConfig) -> Plane:
    difference = (rec601_luma(full) - rec601_luma(coarse)).abs()
    return difference / _adaptation(full, config)


def _square_error(coarse: Color, full: Color, config: ErrorConfig) -> Plane:
    del config
    return squared_error_map(coarse, full.expand_as(coarse)).unsqueeze(1)


@cache
def _load_lpips(device: torch.device) -> Lpips:
    return Lpips.load(device=device)


def _measure_lpips(coarse: Color, full: Color, config: ErrorConfig) -> Plane:
    del config
    return _load_lpips(full.device).map(coarse, full.expand_as(coarse)).unsqueeze(1)


_PIXEL_ERRORS: dict[VrsMetric, Callable[[Color, Color, ErrorConfig], Plane]] = {
    VrsMetric.FLIP: _measure_flip,
    VrsMetric.JNFLIP: _measure_noticeable_flip,
    VrsMetric.JNYANG: _measure_noticeable_luma,
    VrsMetric.PSNR: _square_error,
    VrsMetric.LPIPS: _measure_lpips,
}


def pixel_errors(coarse: Color, full: Color, config: ErrorConfig) -> Plane:
    """Error at every pixel; of PSNR the squared one.

    Args:
        coarse: display-encoded images at reduced rates.
        full: the same at full rate, one of each or one of all.
        config: metric and its settings.

    Raises:
        ShapeMismatchError: sizes differ.
        MetricError: LPIPS on a frame that is too small, or without its weights.
    """
    return _PIXEL_ERRORS[config.metric](coarse, full, config)


def tile_errors(coarse: Color, full: Color, config: ErrorConfig) -> TileMap:
    """Error of every tile, arguments as of `pixel_errors`; of PSNR decibels."""
    errors = pixel_errors(coarse, full, config)
    if config.metric is not VrsMetric.PSNR:
        return pool_tiles(errors, config.tile, config.pool)
    return -10.0 * torch.log10(tile_mean(errors, config.tile).clamp(min=MIN_MSE))


def to_amplitude(values: TileMap, metric: VrsMetric) -> TileMap:
    """What rates are compared and extrapolated by: larger is worse, 0 is none.

    Of PSNR the root of the mean squared error, 10^(-dB / 20).
    """
    return torch.pow(10.0, values / -20.0) if metric is VrsMetric.PSNR else values


def from_amplitude(values: TileMap, metric: VrsMetric) -> TileMap:
    """Undo `to_amplitude`."""
    if metric is not VrsMetric.PSNR:
        return values
    return -20.0 * torch.log10(values.clamp(min=MIN_MSE**0.5))
