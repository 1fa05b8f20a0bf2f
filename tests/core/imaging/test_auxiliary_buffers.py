"""Auxiliary buffers: the sign of every offset, where samples are taken, what is carried on."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.imaging.auxiliary_buffers import (
    FRONT_REACH_PX,
    RANGE_RATE,
    count_frames,
    enlarge_depth,
    enlarge_front_motion,
    enlarge_motion,
    measure_depth_difference,
    merge_range,
    span_colors,
)
from rtsr_cli.core.imaging.color import decode_reinhard, encode_reinhard, relight_reinhard
from rtsr_cli.core.imaging.resampling import (
    decimate,
    repeat_samples,
    sample_jitter,
    upsample_nearest,
)
from rtsr_cli.core.imaging.sample_splats import interpolate_samples, splat_samples

SCALE = 2
OFFSETS = [(x, y) for y in range(4) for x in range(4)]
"""Samples (x, y) of a block of 4 x 4 capture pixels: 2 x 2 output pixels of 2 x 2 samples."""


def edge_at(column: float) -> torch.Tensor:
    """A capture of 4 samples a pixel and axis, 0 left of an edge, 1 right of it; in output px."""
    place = (torch.arange(64) + 0.5) / 2.0
    return (place >= column).float().expand(1, 1, 32, 64)


def jitter_of(offset: tuple[int, int]) -> tuple[float, float]:
    return sample_jitter(offset[0], 4), sample_jitter(offset[1], 4)


@pytest.mark.parametrize("offset", OFFSETS)
def test_an_edge_stays_where_it_is_whatever_the_jitter(offset: tuple[int, int]) -> None:
    """The edge of the enlarged frame is within one LR pixel of the true one, never biased."""
    capture = edge_at(15.0)
    color = decimate(capture, 4, offset).expand(1, 3, -1, -1)
    cubic = interpolate_samples(color, jitter_of(offset), SCALE, a=-0.75)
    # the sum of a row says where the edge is: 32 pixels less those before it
    assert 32.0 - float(cubic[0, 0, 8].sum()) == pytest.approx(15.0, abs=1.01)
    nearest = repeat_samples(decimate(capture, 4, offset), SCALE, jitter_of(offset))
    assert 32.0 - float(nearest[0, 0, 8].sum()) == pytest.approx(15.0, abs=1.01)


@pytest.mark.parametrize(("jitter", "column"), [(0.25, 1), (-0.25, 0)])
def test_a_sample_counts_where_it_lies(jitter: float, column: int) -> None:
    """Samples a quarter of an LR pixel off its centre lie on every second output pixel."""
    color = torch.rand(1, 3, 6, 6, generator=torch.Generator().manual_seed(2))
    offset = (jitter, jitter)
    summed, weight = splat_samples(color, offset, SCALE, sigma_px=0.4)
    between = interpolate_samples(color, offset, SCALE, a=-0.75)
    own = (..., slice(column, None, 2), slice(column, None, 2))
    assert float(weight[own].min()) > 0.99
    assert float(weight[..., 1 - column :: 2, :].max()) < 0.1
    torch.testing.assert_close(summed[own], color, atol=0.05, rtol=0.0)
    torch.testing.assert_close(between[own], color)


def test_over_all_jitters_the_edge_is_in_the_middle() -> None:
    for column in (13.0, 14.5, 16.0):
        ends = []
        for offset in OFFSETS:
            color = decimate(edge_at(column), 4, offset).expand(1, 3, -1, -1)
            summed, weight = splat_samples(color, jitter_of(offset), SCALE, sigma_px=0.4)
            ends.append((summed, weight))
        mean = sum(s for s, _ in ends) / sum(w for _, w in ends)
        assert 32.0 - float(mean[0, 0, 8].sum()) == pytest.approx(column, abs=0.15)


def test_without_jitter_the_nearest_sample_is_the_pixel_s_own() -> None:
    image = torch.arange(12.0).view(1, 1, 3, 4)
    assert torch.equal(repeat_samples(image, 3), upsample_nearest(image, 3))
    assert repeat_samples(image.int(), 2).dtype == torch.int32


def test_the_nearest_sample_follows_the_jitter() -> None:
    image = torch.tensor([[1.0, 2.0, 3.0]]).view(1, 1, 1, 3)
    # samples lie 0.3 LR pixels to the right: at 0.8, 1.8, 2.8; pixels at 0.25, 0.75, 1.25 ...
    assert repeat_samples(image, 2, (0.3, 0.0))[0, 0, 0].tolist() == [1, 1, 1, 2, 2, 3]
    assert repeat_samples(image, 2, (-0.3, 0.0))[0, 0, 0].tolist() == [1, 2, 2, 3, 3, 3]


def test_depth_is_reversed() -> None:
    depth = torch.tensor([2.0, 4.0, SKY_DEPTH_M]).view(1, 1, 1, 3)
    assert enlarge_depth(depth, 2, (0.0, 0.0))[0, 0, 0].tolist() == [0.5, 0.5, 0.25, 0.25, 0, 0]


def test_motion_is_the_nearest_surface_s_within_one_pixel_in_output_pixels() -> None:
    depth = torch.tensor([9.0, 9.0, 9.0, 2.0, 2.0]).view(1, 1, 1, 5)
    motion = torch.zeros(1, 2, 1, 5)
    motion[:, 0, :, 3:] = 1.5
    large = enlarge_motion(motion, depth, 2, (0.0, 0.0))
    assert large[0, 0, 0].tolist() == [0, 0, 0, 0, 3, 3, 3, 3, 3, 3]


@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.375, -0.125), (-0.25, 0.25)])
def test_front_motion_is_that_of_the_nearest_surface_around(
    jitter: tuple[float, float],
) -> None:
    generator = torch.Generator().manual_seed(4)
    depth = 1.0 + torch.rand(1, 1, 5, 6, generator=generator)
    motion = torch.rand(1, 2, 5, 6, generator=generator)
    large = enlarge_front_motion(motion, depth, 2, jitter)
    for row in range(2, 8):
        for column in range(2, 10):
            v, u = (row + 0.5) / 2 - 0.5 - jitter[1], (column + 0.5) / 2 - 0.5 - jitter[0]
            near = [
                (float(depth[0, 0, y, x]), y, x)
                for y in range(5)
                for x in range(6)
                if max(abs(y - v), abs(x - u)) < FRONT_REACH_PX
            ]
            _, y, x = min(near)
            assert torch.equal(large[0, :, row, column], 2.0 * motion[0, :, y, x])


def test_front_motion_widens_a_silhouette_to_the_samples_beside_it() -> None:
    depth = torch.tensor([9.0, 9.0, 9.0, 2.0, 2.0]).view(1, 1, 1, 5)
    motion = torch.zeros(1, 2, 1, 5)
    motion[:, 0, :, 3:] = 1.5
    large = enlarge_front_motion(motion, depth, 2, (-0.125, 0.0))
    # 0.625 LR pixels from the foreground's first sample, 0.375 from the background's last
    assert large[0, 0, 0].tolist() == [0, 0, 0, 0, 0, 3, 3, 3, 3, 3]


def test_what_was_hidden_has_a_difference_above_zero() -> None:
    """Equation 10: history was nearer."""
    now = torch.tensor([0.25, 0.25, 0.5, 0.0, 0.25]).view(1, 1, 1, 5)
    before = torch.tensor([0.25, 0.5, 0.25, 0.0, 0.25]).view(1, 1, 1, 5)
    inside = torch.tensor([1.0, 1.0, 1.0, 1.0, 0.0]).view(1, 1, 1, 5)
    difference = measure_depth_difference(now, before, inside)
    assert difference[0, 0, 0].tolist() == [0.0, 0.5, -0.5, 0.0, 1.0]


def test_the_range_holds_three_by_three_pixels() -> None:
    color = torch.rand(2, 3, 7, 9, generator=torch.Generator().manual_seed(1))
    span = span_colors(color)
    padded = torch.nn.functional.pad(color, (1, 1, 1, 1), mode="replicate")
    blocks = padded.unfold(2, 3, 1).unfold(3, 3, 1).flatten(4)
    assert torch.equal(span[:, :3], blocks.amin(4))
    assert torch.equal(span[:, 3:], blocks.amax(4))


def test_a_range_fades_and_begins_anew() -> None:
    own = torch.tensor([0.4, 0.4, 0.4, 0.6, 0.6, 0.6]).view(1, 6, 1, 1).expand(1, 6, 1, 2)
    carried = torch.tensor([0.0, 0.5, 0.4, 1.0, 0.5, 0.6]).view(1, 6, 1, 1).expand(1, 6, 1, 2)
    useless = torch.tensor([0.0, 1.0]).view(1, 1, 1, 2)
    merged = merge_range(own, carried, useless)
    expected = [0.4 * RANGE_RATE, 0.4, 0.4, 1.0 - 0.4 * RANGE_RATE, 0.6, 0.6]
    assert merged[0, :, 0, 0].tolist() == pytest.approx(expected)
    assert torch.equal(merged[..., 1], own[..., 1])


def test_the_counter_counts_and_begins_anew() -> None:
    carried = torch.tensor([0.0, 5.0, 5.0]).view(1, 1, 1, 3)
    useless = torch.tensor([0.0, 0.0, 1.0]).view(1, 1, 1, 3)
    assert count_frames(carried, useless)[0, 0, 0].tolist() == [1.0, 6.0, 0.0]


def test_exposure_is_changed_without_expanding() -> None:
    color = torch.tensor([0.0, 0.2, 1.0, 90.0])
    gain = torch.tensor(2.5)
    changed = decode_reinhard(relight_reinhard(encode_reinhard(color), gain))
    torch.testing.assert_close(changed, 2.5 * color, rtol=1e-4, atol=1e-6)
