"""Variable-rate shading: tile errors and the analytic estimate against a float64 oracle."""

from __future__ import annotations

import json
import math
import runpy
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.choices import Pool, VrsMetric
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.vrs.adaptive_estimate import (
    AdaptiveConfig,
    adaptive_codes,
    axis_errors,
    half_rate_factor,
    quarter_rate_factor,
)
from rtsr_cli.core.vrs.coarse_shading import shade_coarsely
from rtsr_cli.core.vrs.rates import (
    REDUCED,
    ShadingRate,
    choose_codes,
    extrapolate_errors,
    rate_shares,
    shaded_share,
)
from rtsr_cli.core.vrs.shading_error import (
    PPD_BY_WIDTH,
    ErrorConfig,
    from_amplitude,
    pixel_errors,
    rec601_luma,
    tile_errors,
    to_amplitude,
)
from rtsr_cli.core.vrs.tile_pooling import pixel_shares, tile_max, tile_mean

METRICS = Path(__file__).parents[1] / "metrics"
ORACLE = json.loads((Path(__file__).parent / "vrs_tiles.json").read_text(encoding="utf-8"))


RECIPE = SimpleNamespace(**runpy.run_path(str(METRICS / "recipe.py")))


def shown(pixels: Any) -> Tensor:
    return torch.from_numpy(pixels.copy()).permute(2, 0, 1)[None].double() / 255.0


FULL = shown(RECIPE.ldr_reference())
COARSE = shown(RECIPE.ldr_test(RECIPE.ldr_reference()))


def expected(*keys: str) -> Tensor:
    value: Any = ORACLE
    for key in keys:
        value = value[key]
    return torch.tensor(value, dtype=torch.float64)[None, None]


def close(found: Tensor, wanted: Tensor, tolerance: float = 1e-6) -> bool:
    return found.shape == wanted.shape and bool((found.double() - wanted).abs().max() <= tolerance)


@pytest.mark.parametrize(
    ("metric", "env_luminance", "name", "tolerance"),
    [
        (VrsMetric.JNYANG, 1e-10, "JNYang_tile16_max_l0", 1e-6),
        (VrsMetric.JNYANG, 0.05, "JNYang_tile16_max_l0p05", 1e-6),
        (VrsMetric.JNFLIP, 1e-10, "JNFLIP_tile16_max_l0", 5e-5),
        (VrsMetric.JNFLIP, 0.05, "JNFLIP_tile16_max_l0p05", 5e-5),
    ],
)
def test_tile_errors_are_the_oracles(
    metric: VrsMetric, env_luminance: float, name: str, tolerance: float
) -> None:
    config = ErrorConfig(metric=metric, env_luminance=env_luminance)
    dtype = torch.float64 if metric is VrsMetric.JNYANG else torch.float32
    found = tile_errors(COARSE.to(dtype), FULL.to(dtype), config)
    assert close(found, expected(name), tolerance)


def test_luma_and_its_error_are_the_oracles() -> None:
    assert close(tile_mean(rec601_luma(FULL), 16), expected("mean_luma_tile16"))
    error = (rec601_luma(FULL) - rec601_luma(COARSE)).abs()
    assert close(tile_max(error, 16), expected("E_luma_tile16_max"))


@pytest.mark.parametrize("pool", list(Pool))
def test_the_analytic_error_is_the_oracles(pool: Pool) -> None:
    kind = "rms" if pool is Pool.MEAN else "max"
    found = axis_errors(rec601_luma(FULL), AdaptiveConfig(pool=pool))
    for axis, error in zip("xy", found, strict=True):
        assert close(error, expected("nas", f"error_{kind}_{axis}"))


def test_motion_factors_are_the_oracles() -> None:
    scale = ORACLE["motion_scale"]
    speed = torch.tensor(scale["v"], dtype=torch.float64)
    assert torch.allclose(half_rate_factor(speed), torch.tensor(scale["h"]).double(), atol=1e-7)
    assert torch.allclose(quarter_rate_factor(speed), torch.tensor(scale["q"]).double(), atol=1e-7)


def codes_of(light: Tensor, motion_px: float) -> Tensor:
    config = AdaptiveConfig()
    errors = axis_errors(light, config)
    still = torch.zeros_like(errors[0])
    return adaptive_codes(errors, (still + motion_px, still), config)


LABELS = {rate.code: rate.label for rate in ShadingRate}


def counted(codes: Tensor) -> dict[str, int]:
    return dict(Counter(LABELS[int(code)] for code in codes.flatten()))


def soft_luma() -> Tensor:
    pixels = (RECIPE.ldr_reference() // 6 + 100).astype("uint8")
    light = rec601_luma(shown(pixels))
    light[..., :64] = light[..., :64].mean()
    light[..., 64:128] = 0.4 + (light[..., 64:128] - 0.4) / 4.0
    return light


def test_analytic_rates_are_the_oracles() -> None:
    # the oracle's motion is 2 px a frame once the sensitivity has scaled it
    for light, known in (
        (rec601_luma(FULL), ORACLE["nas"]),
        (soft_luma(), ORACLE["nas"]["soft_luma"]),
    ):
        assert counted(codes_of(light, 0.0)) == known["rate_counts_rms_no_motion"]
        assert counted(codes_of(light, 4.0)) == known["rate_counts_rms_scaled_motion_2px_x"]
    known = ORACLE["nas"]["soft_luma"]
    for motion, name in ((0.0, "row_0"), (4.0, "row_0_scaled_motion_2px_x")):
        row = codes_of(soft_luma(), motion)[0, 0, 0]
        assert [LABELS[int(code)] for code in row] == known[name]


def test_codes_are_those_of_d3d12() -> None:
    codes = {rate.label: rate.code for rate in ShadingRate}
    assert codes == {"1x1": 0, "1x2": 1, "2x1": 4, "2x2": 5, "2x4": 6, "4x2": 9, "4x4": 10}
    # D3D12_MAKE_COARSE_SHADING_RATE: log2 of the width, shifted by 2, or log2 of the height
    for rate in ShadingRate:
        assert rate.code == (rate.across.bit_length() - 1) << 2 | rate.down.bit_length() - 1


def tiles(*values: float) -> Tensor:
    return torch.tensor(values).view(1, 1, 1, -1)


def test_rates_are_extrapolated_by_equation_10() -> None:
    found = extrapolate_errors(
        {ShadingRate.HALF_Y: tiles(0.1, 0.3), ShadingRate.HALF_X: tiles(0.2, 0.1)}
    )
    assert torch.allclose(found[ShadingRate.HALF], tiles(0.2, 0.3))
    assert torch.allclose(found[ShadingRate.QUARTER_Y], tiles(0.213, 0.639))
    assert torch.allclose(found[ShadingRate.QUARTER_X], tiles(0.426, 0.3))
    assert torch.allclose(found[ShadingRate.QUARTER], tiles(0.426, 0.639))
    known = extrapolate_errors(
        {
            ShadingRate.HALF_Y: tiles(0.1),
            ShadingRate.HALF_X: tiles(0.2),
            ShadingRate.QUARTER_Y: tiles(0.5),
            ShadingRate.QUARTER_X: tiles(0.05),
        }
    )
    assert torch.equal(known[ShadingRate.QUARTER_X], tiles(0.05))
    assert torch.equal(known[ShadingRate.QUARTER], tiles(0.5))


def test_the_cheapest_rate_below_the_threshold_is_chosen() -> None:
    none = tiles(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    errors = {rate: none.clone() for rate in REDUCED}
    errors[ShadingRate.QUARTER][..., 0] = 0.1
    errors[ShadingRate.QUARTER_X][..., 1], errors[ShadingRate.QUARTER_Y][..., 1] = 0.15, 0.05
    errors[ShadingRate.HALF][..., 2] = 0.1
    errors[ShadingRate.HALF_X][..., 3], errors[ShadingRate.HALF_Y][..., 3] = 0.1, 0.15
    errors[ShadingRate.HALF_Y][..., 4] = 0.2
    codes = choose_codes(errors, 0.2)
    assert codes.flatten().tolist() == [10, 6, 5, 4, 0, 0]
    expected_share = (1 / 16 + 1 / 8 + 1 / 4 + 1 / 2 + 2) / 6
    shares = rate_shares(codes, torch.full_like(codes, 1 / codes.numel()))
    assert shaded_share(shares) == pytest.approx(expected_share)


@pytest.mark.parametrize("rate", REDUCED, ids=[rate.label for rate in REDUCED])
def test_a_block_shows_the_sample_at_its_middle(rate: ShadingRate) -> None:
    image = torch.arange(1 * 3 * 8 * 12).view(1, 3, 8, 12).float()
    coarse = shade_coarsely(image, rate)
    for row in range(8):
        for column in range(12):
            y = row // rate.down * rate.down + rate.down // 2
            x = column // rate.across * rate.across + rate.across // 2
            assert torch.equal(coarse[..., row, column], image[..., y, x])


def test_blocks_at_the_border_keep_within_the_frame() -> None:
    image = torch.rand(1, 3, 5, 7)
    coarse = shade_coarsely(image, ShadingRate.QUARTER)
    assert torch.equal(coarse[..., 4, 6], image[..., 4, 6])
    assert torch.equal(coarse[..., 4, 4], image[..., 4, 6])


def test_kept_edges_show_no_other_object() -> None:
    image = torch.rand(1, 3, 4, 4)
    ids = torch.zeros(1, 1, 4, 4, dtype=torch.int32)
    ids[..., 0] = 7
    coarse = shade_coarsely(image, ShadingRate.QUARTER, ids)
    assert torch.equal(coarse[..., 0], image[..., 0])
    assert torch.equal(coarse[..., 1:], image[..., 2:3, 2:3].expand(1, 3, 4, 3))


@pytest.mark.parametrize("size", [(32, 48), (33, 50), (5, 3)])
def test_no_tile_is_lost(size: tuple[int, int]) -> None:
    image = torch.rand(1, 1, *size) + 0.1
    largest, mean = tile_max(image, 16), tile_mean(image, 16)
    down, across = math.ceil(size[0] / 16), math.ceil(size[1] / 16)
    assert largest.shape == mean.shape == (1, 1, down, across)
    for row in range(down):
        for column in range(across):
            part = image[..., 16 * row : 16 * row + 16, 16 * column : 16 * column + 16]
            assert float(largest[0, 0, row, column]) == float(part.max())
            assert float(mean[0, 0, row, column]) == pytest.approx(float(part.mean()), rel=1e-5)


def test_tiles_at_the_border_count_by_their_pixels() -> None:
    codes = torch.tensor(
        [[[[ShadingRate.QUARTER.code, ShadingRate.FULL.code]]]], dtype=torch.float32
    )
    pixels = pixel_shares((10, 20), 16, codes)
    assert pixels.flatten().tolist() == pytest.approx([0.8, 0.2])
    shares = rate_shares(codes, pixels)
    assert shares["4x4"] == pytest.approx(0.8)
    assert shaded_share(shares) == pytest.approx(0.8 / 16 + 0.2)


def test_psnr_is_of_the_mean_squared_error_of_a_tile() -> None:
    full = torch.zeros(1, 3, 32, 16)
    coarse = full.clone()
    coarse[..., :16, :] = 0.1
    found = tile_errors(coarse, full, ErrorConfig(metric=VrsMetric.PSNR))
    assert found.flatten().tolist() == pytest.approx([20.0, 100.0], abs=1e-4)
    worse = to_amplitude(found, VrsMetric.PSNR)
    assert worse.flatten().tolist() == pytest.approx([0.1, 1e-5], rel=1e-4)
    assert torch.allclose(from_amplitude(worse, VrsMetric.PSNR), found)


def test_darkness_is_what_env_luminance_bounds() -> None:
    full = torch.full((1, 3, 16, 16), 1e-4)
    coarse = full + 1e-3
    bare = pixel_errors(coarse, full, ErrorConfig(metric=VrsMetric.JNYANG))
    lit = pixel_errors(coarse, full, ErrorConfig(metric=VrsMetric.JNYANG, env_luminance=0.1))
    assert float(bare.max()) == pytest.approx(10.0, rel=1e-3)
    assert float(lit.max()) == pytest.approx(0.01, rel=2e-2)


@pytest.mark.parametrize("metric", [VrsMetric.JNFLIP, VrsMetric.JNYANG])
def test_black_is_no_division_by_zero(metric: VrsMetric) -> None:
    full = torch.zeros(1, 3, 16, 32)
    config = ErrorConfig(metric=metric, env_luminance=0.0)
    assert float(tile_errors(full, full, config).max()) == 0.0
    assert 1e6 < float(tile_errors(full + 0.5, full, config).min()) < math.inf


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_numbers_below_zero_are_refused(value: float) -> None:
    with pytest.raises(ConfigError, match="env_luminance"):
        ErrorConfig(env_luminance=value)


def test_pixels_per_degree_may_follow_the_width() -> None:
    by_width = ErrorConfig(metric=VrsMetric.FLIP, ppd=PPD_BY_WIDTH)
    assert by_width.ppd_at(1920) == pytest.approx(33.51, abs=0.01)  # [rt-percept, code]
    full = torch.rand(1, 3, 64, 96, generator=torch.Generator().manual_seed(3))
    coarse = shade_coarsely(full, ShadingRate.HALF)
    same = ErrorConfig(metric=VrsMetric.FLIP, ppd=by_width.ppd_at(96))
    assert torch.equal(tile_errors(coarse, full, by_width), tile_errors(coarse, full, same))
    assert not torch.equal(
        tile_errors(coarse, full, by_width),
        tile_errors(coarse, full, ErrorConfig(metric=VrsMetric.FLIP)),
    )
