"""Splatting and the motion vectors built on it, against loops and against hand-made scenes."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.splatting import (
    dual_motion,
    forward_motion_by_splat,
    forward_splat,
    unreliable_mask,
)


def splat_by_loops(values, motion, depth, size):
    """The definition, pixel by pixel, for one image."""
    out = torch.zeros(values.shape[1], *size)
    best = torch.full(size, math.inf)
    for y in range(values.shape[2]):
        for x in range(values.shape[3]):
            column = math.floor(x + 0.5 + motion[0, 0, y, x].item())
            row = math.floor(y + 0.5 + motion[0, 1, y, x].item())
            is_inside = 0 <= row < size[0] and 0 <= column < size[1]
            if is_inside and depth[0, 0, y, x] < best[row, column]:
                best[row, column] = depth[0, 0, y, x]
                out[:, row, column] = values[0, :, y, x]
    return out, best.isfinite().float()


@given(
    seed=st.integers(0, 2**31 - 1),
    source=st.tuples(st.integers(1, 7), st.integers(1, 7)),
    target=st.tuples(st.integers(1, 7), st.integers(1, 7)),
)
@settings(deadline=None, max_examples=40)
def test_the_splat_is_its_definition(seed, source, target):
    generator = torch.Generator().manual_seed(seed)
    values = torch.randn(1, 2, *source, generator=generator)
    motion = torch.randn(1, 2, *source, generator=generator) * 3
    depth = torch.randint(1, 4, (1, 1, *source), generator=generator).float()
    splatted, hit_mask = forward_splat(values, motion, depth, size=target)
    expected, expected_hit = splat_by_loops(values, motion, depth, target)
    assert torch.equal(splatted[0], expected)
    assert torch.equal(hit_mask[0, 0], expected_hit)


@given(seed=st.integers(0, 2**31 - 1))
@settings(deadline=None, max_examples=15)
def test_zero_motion_splats_every_pixel_onto_itself(seed):
    values = torch.randn(2, 3, 4, 5, generator=torch.Generator().manual_seed(seed))
    motion, depth = torch.zeros(2, 2, 4, 5), torch.ones(2, 1, 4, 5)
    splatted, hit_mask = forward_splat(values, motion, depth)
    assert torch.equal(splatted, values)
    assert bool((hit_mask == 1).all())


def test_the_nearer_surface_wins_whichever_comes_first():
    values = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    motion = torch.zeros(1, 2, 1, 3)
    motion[0, 0, 0] = torch.tensor([1.0, 0.0, -1.0])
    for depths, winner in (([3.0, 2.0, 1.0], 3.0), ([1.0, 2.0, 3.0], 1.0), ([3.0, 1.0, 2.0], 2.0)):
        splatted, hit_mask = forward_splat(values, motion, torch.tensor(depths).view(1, 1, 1, 3))
        assert splatted.flatten().tolist() == [0.0, winner, 0.0]
        assert hit_mask.flatten().tolist() == [0.0, 1.0, 0.0]


def test_zero_depth_of_either_sign_is_the_nearest():
    values = torch.tensor([[[[1.0, 2.0]]]])
    motion = torch.zeros(1, 2, 1, 2)
    motion[0, 0, 0, 0] = 1.0
    for zero in (0.0, -0.0):
        splatted, _ = forward_splat(values, motion, torch.tensor([[[[zero, 1e-30]]]]))
        assert splatted[0, 0, 0, 1].item() == 1.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_sources_without_finite_depth_or_motion_are_left_out(bad):
    values, depth, motion = torch.ones(1, 1, 1, 3), torch.ones(1, 1, 1, 3), torch.zeros(1, 2, 1, 3)
    depth[..., 0] = bad
    motion[:, 1, :, 2] = bad
    assert forward_splat(values, motion, depth)[1].flatten().tolist() == [0.0, 1.0, 0.0]


def test_integer_values_keep_their_type():
    ids = torch.tensor([[[[2**31 - 1, -7]]]], dtype=torch.int32)
    splatted, _ = forward_splat(ids, torch.zeros(1, 2, 1, 2), torch.ones(1, 1, 1, 2))
    assert splatted.dtype == torch.int32
    assert torch.equal(splatted, ids)


def test_gradients_reach_the_winning_sources_only():
    values = torch.ones(1, 1, 1, 2, requires_grad=True)
    motion = torch.tensor([1.0, 0.0]).view(1, 1, 1, 2) * torch.tensor([1.0, 0.0]).view(1, 2, 1, 1)
    splatted, _ = forward_splat(values, motion, torch.tensor([[[[1.0, 2.0]]]]))
    splatted.sum().backward()
    assert values.grad.flatten().tolist() == [1.0, 0.0]


def test_sizes_that_differ_are_refused_by_name():
    with pytest.raises(ShapeMismatchError, match="depth_m"):
        forward_splat(torch.ones(1, 1, 2, 2), torch.zeros(1, 2, 2, 2), torch.ones(1, 1, 2, 3))
    with pytest.raises(ShapeMismatchError, match="dual_motion_px"):
        unreliable_mask(torch.zeros(1, 2, 2, 2), torch.zeros(1, 2, 2, 3))


@pytest.fixture
def sliding_occluder():
    """One row: a wall moving right by 1 px a frame, before it a post moving right by 3.

    Now: 0 1 2 3 [4 5] 6 7 8 9; the post stood on columns 1 and 2 before.
    """
    motion = torch.zeros(1, 2, 1, 10)
    motion[0, 0, 0] = -1.0
    motion[0, 0, 0, 4:6] = -3.0
    depth = torch.full((1, 1, 1, 10), 20.0)
    depth[..., 4:6] = 5.0
    forward_prev = torch.zeros(1, 2, 1, 10)
    forward_prev[0, 0, 0] = 1.0
    forward_prev[0, 0, 0, 1:3] = 3.0
    return motion, depth, forward_prev


def test_the_dual_vector_is_the_traditional_one_where_the_same_surface_is_seen(sliding_occluder):
    motion, _, forward_prev = sliding_occluder
    dual, known_mask = dual_motion(motion, forward_prev)
    assert known_mask.flatten().tolist() == [0.0] + [1.0] * 9
    hidden_before = [2, 3]
    for x in range(1, 10):
        expected = -3.0 if x in hidden_before else motion[0, 0, 0, x].item()
        assert dual[0, :, 0, x].tolist() == [expected, 0.0]


def test_unreliable_pixels_are_those_hidden_before_or_outside(sliding_occluder):
    motion, _, forward_prev = sliding_occluder
    mask = unreliable_mask(motion, *dual_motion(motion, forward_prev))
    assert mask.flatten().nonzero().flatten().tolist() == [0, 2, 3]


def test_the_splatted_forward_motion_finds_the_same_unreliable_pixels(sliding_occluder):
    motion, depth, forward_prev = sliding_occluder
    forward, hit_mask = forward_motion_by_splat(motion, depth)
    assert torch.equal(forward * hit_mask, forward_prev * hit_mask)
    dual, known_mask = dual_motion(motion, forward, known_prev_mask=hit_mask)
    mask = unreliable_mask(motion, dual, known_mask)
    assert mask.flatten().nonzero().flatten().tolist() == [0, 2, 3]


def test_the_threshold_counts_either_component_and_its_own_value():
    motion, dual = torch.zeros(1, 2, 1, 4), torch.zeros(1, 2, 1, 4)
    dual[0, 0, 0] = torch.tensor([0.0, 0.25, 0.0, 0.125])
    dual[0, 1, 0] = torch.tensor([0.0, 0.0, -0.5, 0.125])
    mask = unreliable_mask(motion, dual, threshold_px=0.25)
    assert mask.flatten().tolist() == [0.0, 1.0, 1.0, 0.0]


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_the_gpu_splats_the_same_bits():
    generator = torch.Generator().manual_seed(0)
    values, motion = torch.randn(2, 2, 2, 31, 37, generator=generator).unbind(0)
    depth = torch.randint(1, 4, (2, 1, 31, 37), generator=generator).float()
    on_cpu = forward_splat(values, motion * 3, depth)
    on_gpu = forward_splat(values.cuda(), (motion * 3).cuda(), depth.cuda())
    assert all(torch.equal(a, b.cpu()) for a, b in zip(on_cpu, on_gpu, strict=True))
