from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.imaging.resampling import (
    KEYS_A,
    PIXEL_FILTERS,
    box_mean,
    cubic_kernel,
    decimate,
    decimate_filtered,
    grow_valid,
    halton_offset,
    radical_inverse,
    sample_jitter,
    upsample_bicubic,
    upsample_masked_bicubic,
    upsample_nearest,
)

JITTERS = [(0.0, 0.0), (0.125, 0.125), (0.5, -0.5), (-0.37, 0.21), (1.0, -1.0)]


def keys(distance: float, a: float = -0.75) -> float:
    """Keys 1981: the cubic convolution kernel, written out in powers."""
    s = abs(distance)
    if s < 1:
        return (a + 2) * s**3 - (a + 3) * s**2 + 1
    if s < 2:
        return a * s**3 - 5 * a * s**2 + 8 * a * s - 4 * a
    return 0.0


def slow_bicubic(image: np.ndarray, scale: int, jitter: tuple[float, float]) -> np.ndarray:
    """Every output pixel from the 4 x 4 source pixels around it, borders replicated."""
    height, width = image.shape
    out = np.zeros((height * scale, width * scale))
    for row in range(height * scale):
        for column in range(width * scale):
            u = (column + 0.5) / scale - 0.5 - jitter[0]
            v = (row + 0.5) / scale - 0.5 - jitter[1]
            total = 0.0
            for j in range(math.floor(v) - 1, math.floor(v) + 3):
                for i in range(math.floor(u) - 1, math.floor(u) + 3):
                    pixel = image[min(max(j, 0), height - 1), min(max(i, 0), width - 1)]
                    total += pixel * keys(u - i) * keys(v - j)
            out[row, column] = total
    return out


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("scale", [1, 2, 3, 4])
@pytest.mark.parametrize("jitter", JITTERS)
def test_bicubic_is_the_keys_formula_of_every_pixel(
    scale: int, jitter: tuple[float, float]
) -> None:
    image = noise(1, 1, 5, 4, seed=scale)
    found = upsample_bicubic(image, scale, jitter)[0, 0].numpy()
    assert np.allclose(found, slow_bicubic(image[0, 0].numpy(), scale, jitter), atol=2e-6)


def test_bicubic_treats_channels_and_batches_alike() -> None:
    image = noise(2, 3, 4, 5)
    whole = upsample_bicubic(image, 2, (0.25, 0.25))
    assert whole.shape == (2, 3, 8, 10)
    alone = upsample_bicubic(image[1:, 2:], 2, (0.25, 0.25))
    assert torch.allclose(whole[1:, 2:], alone, atol=1e-7)


@pytest.mark.parametrize("scale", [2, 3, 5])
@pytest.mark.parametrize("jitter", JITTERS)
def test_a_constant_image_stays_constant(scale: int, jitter: tuple[float, float]) -> None:
    image = torch.full((1, 2, 3, 4), 7.25)
    assert torch.allclose(upsample_bicubic(image, scale, jitter), torch.tensor(7.25), atol=5e-6)


@pytest.mark.parametrize(("a", "exact"), [(-0.5, True), (KEYS_A, False)])
def test_a_ramp_is_reproduced_by_the_third_order_member_alone(a: float, exact: bool) -> None:
    position = torch.linspace(2.0, 3.0, 21, dtype=torch.float64)
    taps = torch.arange(0, 6, dtype=torch.float64)
    ramp = (cubic_kernel(position[:, None] - taps, a) * taps).sum(1)
    worst = float((ramp - position).abs().max())
    assert (worst < 1e-12) == exact
    assert worst < 0.06


def test_a_ramp_is_reproduced_at_samples_and_half_way_between() -> None:
    ramp = torch.arange(9.0).view(1, 1, 1, 9).expand(1, 1, 5, 9)
    half_way = upsample_bicubic(ramp, 1, (0.5, 0.0))
    assert half_way[0, 0, 2, 3:-2].tolist() == pytest.approx([2.5, 3.5, 4.5, 5.5], abs=1e-5)
    middle = upsample_bicubic(ramp, 3)[0, 0, 7, 1::3]
    assert middle.tolist() == pytest.approx(list(range(9)), abs=1e-5)


def test_compensating_the_jitter_of_decimation_puts_a_feature_where_it_was() -> None:
    position = torch.arange(64.0) + 0.5
    wave = torch.sin(2 * math.pi * position / 32).view(1, 1, 1, 64).expand(1, 1, 64, 64)
    offset, scale = 2, 4
    jitter = sample_jitter(offset, scale)
    small = decimate(wave, scale, (offset, offset))
    aligned = upsample_bicubic(small, scale, (jitter, jitter))
    ignored = upsample_bicubic(small, scale)
    inner = (..., slice(12, -12), slice(12, -12))
    error = (aligned - wave)[inner].abs().max()
    assert error < 0.05
    assert (ignored - wave)[inner].abs().max() > 2 * error


@pytest.mark.parametrize("a", [KEYS_A, -0.5])
@pytest.mark.parametrize("shift", [0.0, 0.1, 0.5, 0.83])
def test_the_kernel_interpolates_and_its_weights_sum_to_one(a: float, shift: float) -> None:
    taps = torch.arange(-3, 4, dtype=torch.float64)
    weights = cubic_kernel(taps - shift, a)
    assert float(weights.sum()) == pytest.approx(1.0)
    expected = [keys(float(t) - shift, a) for t in taps]
    assert weights.tolist() == pytest.approx(expected, abs=1e-12)


def test_nearest_repeats_each_pixel_as_a_block() -> None:
    image = torch.tensor([[1, 2], [3, 4]]).view(1, 1, 2, 2)
    assert upsample_nearest(image, 2)[0, 0].tolist() == [
        [1, 1, 2, 2],
        [1, 1, 2, 2],
        [3, 3, 4, 4],
        [3, 3, 4, 4],
    ]


@pytest.mark.parametrize("garbage", [0.0, 1e30, -1e30, math.nan, math.inf])
@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.5, -0.3)])
def test_masked_bicubic_never_sees_invalid_pixels(
    garbage: float, jitter: tuple[float, float]
) -> None:
    mask = (noise(1, 1, 6, 7, seed=3) > 0.4).float()
    image = noise(1, 2, 6, 7, seed=4)
    clean = upsample_masked_bicubic(image * mask, mask, 3, jitter)
    dirty = upsample_masked_bicubic(
        torch.where(mask > 0, image, torch.tensor(garbage)), mask, 3, jitter
    )
    assert torch.equal(clean[0], dirty[0])
    assert torch.equal(clean[1], dirty[1])
    assert 0 < float(clean[1].mean()) < 1


def test_masked_bicubic_of_valid_pixels_only_is_plain_bicubic() -> None:
    image = noise(1, 3, 5, 6)
    enlarged, supported = upsample_masked_bicubic(image, torch.ones(1, 1, 5, 6), 4, (0.1, 0.2))
    assert torch.allclose(enlarged, upsample_bicubic(image, 4, (0.1, 0.2)), atol=1e-6)
    assert supported.min() == 1


def test_masked_bicubic_of_a_constant_is_that_constant_wherever_it_is_supported() -> None:
    mask = (noise(1, 1, 8, 8, seed=5) > 0.5).float()
    enlarged, supported = upsample_masked_bicubic(torch.full((1, 1, 8, 8), 3.0), mask, 2)
    assert torch.allclose(enlarged, 3.0 * supported, atol=1e-5)


@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.4, -0.3)])
def test_masked_bicubic_of_few_valid_pixels_stays_within_their_range(
    jitter: tuple[float, float],
) -> None:
    # alternating values, so that weights of both signs meet
    image = 1.0 + 7.0 * (torch.arange(10).view(1, 1, 1, -1) % 2).float().expand(1, 1, 10, 10)
    mask = (noise(1, 1, 10, 10, seed=6) > 0.7).float()
    enlarged, supported = upsample_masked_bicubic(image, mask, 4, jitter)
    there = enlarged[supported > 0]
    assert 1.0 <= float(there.min()) < float(there.max()) <= 8.0


def test_masked_bicubic_overshoots_as_plain_bicubic_does_away_from_invalid_pixels() -> None:
    image = torch.zeros(1, 1, 12, 12)
    image[..., 8:] = 1.0
    mask = torch.ones(1, 1, 12, 12)
    mask[..., 0, 0] = 0.0
    enlarged, _ = upsample_masked_bicubic(image, mask, 4)
    assert torch.allclose(enlarged[..., 12:, :], upsample_bicubic(image, 4)[..., 12:, :], atol=1e-6)
    assert float(enlarged.max()) > 1.05


def test_masked_bicubic_is_unsupported_where_its_weight_is_below_a_twentieth() -> None:
    mask = torch.zeros(1, 1, 1, 9)
    mask[..., 4] = 1
    _, supported = upsample_masked_bicubic(torch.ones(1, 1, 1, 9), mask, 4)
    weights = [keys((x + 0.5) / 4 - 0.5 - 4) for x in range(36)]
    assert supported[0, 0, 0].tolist() == [float(w >= 0.05) for w in weights]


def test_growing_fills_neighbours_with_the_mean_of_those_that_are_valid() -> None:
    image = torch.tensor([[2.0, math.nan, 6.0], [math.nan, 9e9, 0.0], [0.0, 0.0, 0.0]])
    mask = torch.tensor([[1.0, 0, 1], [0, 0, 0], [0, 0, 0]])
    grown, valid = grow_valid(image.view(1, 1, 3, 3), mask.view(1, 1, 3, 3))
    assert grown[0, 0, :2].tolist() == [[2.0, 4.0, 6.0], [2.0, 4.0, 6.0]]
    assert valid[0, 0].tolist() == [[1, 1, 1], [1, 1, 1], [0, 0, 0]]


def test_growing_twice_reaches_two_pixels_far() -> None:
    mask = torch.zeros(1, 1, 1, 7)
    mask[..., 3] = 1
    grown, valid = grow_valid(torch.full((1, 1, 1, 7), 5.0), mask, steps=2)
    assert valid[0, 0, 0].tolist() == [0, 1, 1, 1, 1, 1, 0]
    assert grown[0, 0, 0, 1:6].tolist() == pytest.approx([5.0] * 5)


def test_decimation_keeps_the_named_sample_of_every_block() -> None:
    image = torch.arange(48).view(1, 1, 6, 8)
    assert decimate(image, 2, (1, 0))[0, 0].tolist() == [
        [1, 3, 5, 7],
        [17, 19, 21, 23],
        [33, 35, 37, 39],
    ]


@pytest.mark.parametrize(
    ("offset", "block", "jitter"),
    [(0, 2, -0.25), (1, 2, 0.25), (1, 3, 0.0), (2, 4, 0.125), (3, 6, 0.5 / 6), (0, 1, 0.0)],
)
def test_a_samples_jitter_is_its_distance_from_the_middle_of_its_block(
    offset: int, block: int, jitter: float
) -> None:
    assert sample_jitter(offset, block) == pytest.approx(jitter)


@pytest.mark.parametrize(
    ("base", "values"),
    [
        (2, ["1/2", "1/4", "3/4", "1/8", "5/8", "3/8", "7/8", "1/16"]),
        (3, ["1/3", "2/3", "1/9", "4/9", "7/9", "2/9", "5/9", "8/9"]),
    ],
)
def test_the_radical_inverse_by_hand(base: int, values: list[str]) -> None:
    found = [radical_inverse(i, base) for i in range(1, 9)]
    assert found == pytest.approx([float(Fraction(v)) for v in values])


def test_halton_offsets_of_four_by_hand() -> None:
    # four times 1/2, 1/4, 3/4, 1/8 and 1/3, 2/3, 1/9, 4/9, rounded down
    assert [halton_offset(n, 4) for n in range(1, 5)] == [(2, 1), (1, 2), (3, 0), (0, 1)]


def test_halton_offsets_are_not_rounded_where_the_fraction_meets_a_sample() -> None:
    # 5 is 12 in base 3, mirrored 2/3 + 1/9 = 7/9, of nine samples the eighth
    assert halton_offset(5, 9)[1] == 7
    assert halton_offset(14, 27)[1] == 22


@settings(max_examples=80, deadline=None)
@given(frame=st.integers(-1000, 10_000_000), block=st.integers(1, 64))
def test_halton_offsets_stay_inside_the_block(frame: int, block: int) -> None:
    x, y = halton_offset(frame, block)
    assert 0 <= x < block
    assert 0 <= y < block


def test_halton_offsets_visit_every_column_of_a_block_equally() -> None:
    columns = [halton_offset(n, 4)[0] for n in range(0, 65)][1:]
    assert [columns.count(c) for c in range(4)] == [16, 16, 16, 16]


def test_the_box_mean_is_the_mean_of_each_block() -> None:
    image = torch.tensor([[1.0, 2, 5, 7], [3, 6, 9, 11]]).view(1, 1, 2, 4)
    assert box_mean(image, 2)[0, 0].tolist() == [[3.0, 8.0]]


@pytest.mark.parametrize("name", sorted(PIXEL_FILTERS))
@pytest.mark.parametrize("block", [2, 3, 4, 6])
def test_a_pixel_filter_is_symmetric_odd_and_peaks_in_the_middle(name: str, block: int) -> None:
    taps = PIXEL_FILTERS[name](block)
    assert len(taps) % 2 == 1
    assert torch.allclose(taps, taps.flip(0))
    assert float(taps.max()) == float(taps[len(taps) // 2])
    assert float(taps.min()) > 0


def filtered_everywhere(image: torch.Tensor, name: str, block: int) -> torch.Tensor:
    """Put the samples of every offset together."""
    whole = torch.full_like(image, torch.nan)
    for x, y in itertools.product(range(block), repeat=2):
        whole[..., y::block, x::block] = decimate_filtered(image, name, block, (x, y))
    return whole


@pytest.mark.parametrize("name", sorted(PIXEL_FILTERS))
@pytest.mark.parametrize("block", [2, 3, 4])
def test_a_pixel_filter_keeps_a_constant(name: str, block: int) -> None:
    filtered = filtered_everywhere(torch.full((1, 3, 9, 11), 0.625), name, block)
    assert filtered.shape == (1, 3, 9, 11)
    assert torch.allclose(filtered, torch.tensor(0.625), atol=1e-6)


@pytest.mark.parametrize(
    ("block", "weights"),
    [(2, [0.25, 0.5, 0.25]), (3, [1 / 3] * 3), (4, [0.125, 0.25, 0.25, 0.25, 0.125])],
)
def test_the_box_filter_of_an_even_block_has_half_a_tap_at_each_end(
    block: int, weights: list[float]
) -> None:
    impulse = torch.zeros(1, 1, 11, 11)
    impulse[..., 5, 5] = 1.0
    filtered = filtered_everywhere(impulse, "box", block)[0, 0]
    reach = len(weights) // 2
    rows = slice(5 - reach, 6 + reach)
    assert np.allclose(filtered[rows, rows].numpy(), np.outer(weights, weights), atol=1e-6)
    assert float(filtered.sum()) == pytest.approx(1.0, abs=1e-5)


def test_the_blackman_harris_filter_is_three_pixels_wide() -> None:
    block = 4
    taps = PIXEL_FILTERS["blackman-harris"](block)
    # samples strictly inside +-1.5 blocks of the centre
    assert len(taps) == 2 * 5 + 1
    window = [
        0.35875
        + 0.48829 * math.cos(2 * math.pi * x / 12)
        + 0.14128 * math.cos(4 * math.pi * x / 12)
        + 0.01168 * math.cos(6 * math.pi * x / 12)
        for x in range(-5, 6)
    ]
    assert taps.tolist() == pytest.approx(window, abs=1e-9)
