"""Properties of the warps on small images; numbers by hand or by torch's own resampling."""

from __future__ import annotations

import itertools

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn import functional

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.disocclusion import (
    DisocclusionThresholds,
    SurfaceBuffers,
    disocclusion_mask,
    position_tolerance_m,
)
from rtsr_cli.core.imaging.warping import (
    backward_warp,
    compose_motion,
    dilate_motion,
    find_nearest_pixels,
    inside_frame,
    upsample_motion,
    warp_pixels,
)

MODES = ("nearest", "bilinear", "bicubic", "sharp")
sizes = st.tuples(st.integers(1, 9), st.integers(1, 9))
seeds = st.integers(0, 2**31 - 1)


def random_image(seed: int, size: tuple[int, int], channels: int = 3, batch: int = 2):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(batch, channels, *size, generator=generator)


def constant_motion(dx: float, dy: float, size: tuple[int, int], batch: int = 1):
    return (
        torch.tensor([dx, dy], dtype=torch.float32)
        .view(1, 2, 1, 1)
        .expand(batch, 2, *size)
        .contiguous()
    )


@pytest.mark.parametrize("mode", MODES)
@given(seed=seeds, size=sizes)
@settings(deadline=None, max_examples=25)
def test_zero_motion_is_the_identity_exactly(mode, seed, size):
    image = random_image(seed, size)
    warped, inside = backward_warp(image, torch.zeros(2, 2, *size), mode=mode)
    assert torch.equal(warped, image)
    assert bool((inside == 1).all())


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [(1, 20011), (9973, 2), (479, 641)])
def test_zero_motion_is_the_identity_at_large_odd_sizes(mode, size):
    image = random_image(3, size, channels=2, batch=1)
    warped, inside = backward_warp(image, torch.zeros(1, 2, *size), mode=mode)
    assert torch.equal(warped, image)
    assert bool((inside == 1).all())


@pytest.mark.parametrize("mode", MODES)
@given(seed=seeds, size=sizes, dx=st.integers(-4, 4), dy=st.integers(-4, 4))
@settings(deadline=None, max_examples=25)
def test_whole_pixel_motion_is_a_roll_where_it_stays_inside(mode, seed, size, dx, dy):
    image = random_image(seed, size)
    warped, inside = backward_warp(image, constant_motion(dx, dy, size, batch=2), mode=mode)
    rolled = torch.roll(image, shifts=(-dy, -dx), dims=(2, 3))
    h, w = size
    for y, x in itertools.product(range(h), range(w)):
        is_inside = 0 <= y + dy < h and 0 <= x + dx < w
        assert bool((inside[:, 0, y, x] == float(is_inside)).all())
        if is_inside:
            assert torch.equal(warped[..., y, x], rolled[..., y, x])


def test_half_a_pixel_to_the_right_is_the_mean_of_two_pixels():
    image = torch.tensor([[[[1.0, 3.0, 7.0]]]])
    warped, inside = backward_warp(image, constant_motion(0.5, 0.0, (1, 3)))
    assert warped.flatten().tolist() == [2.0, 5.0, 7.0]
    assert inside.flatten().tolist() == [1.0, 1.0, 0.0]


def test_bicubic_half_way_has_the_catmull_rom_weights():
    image = torch.tensor([[[[16.0, 0.0, 0.0, 0.0], [0.0, 16.0, 0.0, 0.0]]]])
    warped, _ = backward_warp(image, constant_motion(0.5, 0.0, (2, 4)), mode="bicubic")
    assert warped[0, 0, 0, 1].item() == -1.0
    assert warped[0, 0, 1, 1].item() == 9.0


def test_sharp_half_way_has_larger_outer_weights():
    image = torch.tensor([[[[32.0, 0.0, 0.0, 0.0], [0.0, 32.0, 0.0, 0.0]]]])
    warped, _ = backward_warp(image, constant_motion(0.5, 0.0, (2, 4)), mode="sharp")
    assert warped[0, 0, 0, 1].item() == -3.0
    assert warped[0, 0, 1, 1].item() == 19.0


def test_bicubic_reproduces_a_quadratic():
    y, x = torch.meshgrid(torch.arange(9.0), torch.arange(9.0), indexing="ij")
    image = (x * x - 2 * x * y + 0.5 * y * y).view(1, 1, 9, 9)
    warped, _ = backward_warp(image, constant_motion(0.3, -0.7, (9, 9)), mode="bicubic")
    moved_x, moved_y = x + 0.3, y - 0.7
    expected = moved_x * moved_x - 2 * moved_x * moved_y + 0.5 * moved_y * moved_y
    torch.testing.assert_close(warped[0, 0, 2:-2, 2:-2], expected[2:-2, 2:-2], atol=2e-4, rtol=1e-5)


def test_bilinear_agrees_with_grid_sample_away_from_the_border():
    image, motion = random_image(1, (13, 17)), random_image(2, (13, 17), channels=2)
    y, x = torch.meshgrid(torch.arange(13), torch.arange(17), indexing="ij")
    grid = torch.stack(
        ((x + motion[:, 0] + 0.5) * 2 / 17 - 1, (y + motion[:, 1] + 0.5) * 2 / 13 - 1), -1
    )
    expected = functional.grid_sample(image, grid, padding_mode="border", align_corners=False)
    warped, _ = backward_warp(image, motion)
    torch.testing.assert_close(warped, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf"), 3e38])
def test_motion_that_is_no_number_counts_as_outside(mode, bad):
    motion = torch.zeros(1, 2, 4, 5)
    motion[0, 0, 1, 2] = bad
    image = random_image(5, (4, 5), batch=1)
    warped, inside = backward_warp(image, motion, mode=mode)
    assert bool(warped.isfinite().all())
    assert inside.sum().item() == 19
    assert inside[0, 0, 1, 2].item() == 0


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_nonfinite_pixel_does_not_spread_through_zero_weights(mode, bad):
    image = torch.ones(1, 1, 5, 5)
    image[0, 0, 2, 2] = bad
    warped, _ = backward_warp(image, constant_motion(1.0, 0.0, (5, 5)), mode=mode)
    spoiled = ~warped.isfinite()
    assert spoiled.nonzero().tolist() == [[0, 0, 2, 1]]
    assert str(warped[0, 0, 2, 1].item()) == str(bad)


def test_a_nonfinite_pixel_reaches_exactly_the_pixels_that_blend_it():
    image = torch.ones(1, 1, 5, 5)
    image[0, 0, 2, 2] = float("nan")
    warped, _ = backward_warp(image, constant_motion(0.25, 0.0, (5, 5)))
    assert (~warped.isfinite()).nonzero()[:, 2:].tolist() == [[2, 1], [2, 2]]


def test_border_zero_blanks_what_lies_outside_and_clamp_repeats_the_border():
    image = torch.tensor([[[[2.0, 3.0]]]])
    motion = constant_motion(-1.0, 0.0, (1, 2))
    assert backward_warp(image, motion)[0].flatten().tolist() == [2.0, 2.0]
    assert backward_warp(image, motion, border="zero")[0].flatten().tolist() == [0.0, 2.0]


def test_object_ids_are_fetched_nearest_with_all_their_bits():
    ids = torch.tensor([[[[2**31 - 1, -5, 16777217]]]], dtype=torch.int32)
    warped, _ = backward_warp(ids, constant_motion(0.6, 0.0, (1, 3)), mode="nearest")
    assert warped.dtype == torch.int32
    assert warped.flatten().tolist() == [-5, 16777217, 16777217]


def test_interpolating_object_ids_is_refused():
    with pytest.raises(TypeError, match="use mode='nearest'"):
        backward_warp(torch.zeros(1, 1, 2, 2, dtype=torch.int32), torch.zeros(1, 2, 2, 2))


def test_sizes_that_differ_are_refused_by_name():
    with pytest.raises(
        ShapeMismatchError, match=r"image .*\(1, 3, 4, 5\).* motion_px .*\(1, 2, 4, 6\)"
    ):
        backward_warp(torch.zeros(1, 3, 4, 5), torch.zeros(1, 2, 4, 6))
    with pytest.raises(ShapeMismatchError, match="depth_m"):
        dilate_motion(torch.zeros(1, 2, 4, 5), torch.zeros(1, 1, 5, 4))


@pytest.mark.parametrize("mode", ["bilinear", "bicubic"])
def test_gradients_of_image_and_motion_are_right(mode):
    generator = torch.Generator().manual_seed(0)
    image = torch.randn(2, 2, 4, 5, generator=generator, dtype=torch.float64, requires_grad=True)
    motion = torch.randn(2, 2, 4, 5, generator=generator, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda i, m: backward_warp(i, m, mode=mode)[0], (image, motion))


def test_composition_of_constant_motion_is_the_sum():
    newer, older = constant_motion(1.0, -2.0, (6, 6)), constant_motion(0.5, 1.0, (6, 6))
    composed, inside = compose_motion(newer, older)
    assert torch.equal(composed, newer + older)
    assert inside[0, 0].sum().item() == 4 * 5


def test_composition_follows_a_known_path():
    """x' = A x + b twice (zoom and shift) is known in closed form."""
    y, x = torch.meshgrid(torch.arange(12.0) + 0.5, torch.arange(12.0) + 0.5, indexing="ij")

    def older_position(px, py):
        return 0.9 * px + 0.05 * py + 0.4, 0.95 * py + 0.3

    def newer_position(px, py):
        return 0.97 * px + 0.1, 0.93 * py + 0.02 * px + 0.25

    older_x, older_y = older_position(x, y)
    newer_x, newer_y = newer_position(x, y)
    older = torch.stack((older_x - x, older_y - y)).unsqueeze(0)
    newer = torch.stack((newer_x - x, newer_y - y)).unsqueeze(0)
    end_x, end_y = older_position(newer_x, newer_y)
    composed, _ = compose_motion(newer, older)
    expected = torch.stack((end_x - x, end_y - y)).unsqueeze(0)
    inner = (..., slice(1, -1), slice(1, -1))
    torch.testing.assert_close(composed[inner], expected[inner], atol=1e-5, rtol=0)
    assert not torch.allclose((newer + older)[inner], expected[inner], atol=1e-2)


@pytest.mark.parametrize("scale", [1, 2, 3, 4])
def test_upsampled_motion_is_torchs_bilinear_times_the_scale(scale):
    motion = random_image(7, (5, 6), channels=2)
    expected = functional.interpolate(
        motion, scale_factor=scale, mode="bilinear", align_corners=False
    )
    torch.testing.assert_close(upsample_motion(motion, scale), expected * scale)


def test_nearest_upsampling_follows_the_jitter():
    motion = torch.tensor([1.0, 2.0, 3.0]).expand(1, 2, 1, 3)
    centred = upsample_motion(motion, 2, mode="nearest")
    assert centred[0, 0, 0].tolist() == [2.0, 2.0, 4.0, 4.0, 6.0, 6.0]
    to_the_right = upsample_motion(motion, 4, mode="nearest", jitter_px=(0.375, 0.0))
    assert [v / 4 for v in to_the_right[0, 0, 0].tolist()] == [1, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3]


def test_dilation_takes_the_motion_of_the_nearest_neighbour_only():
    depth = torch.full((1, 1, 4, 4), 9.0)
    depth[0, 0, 0, 0] = 2.0
    motion = torch.arange(32.0).view(1, 2, 4, 4)
    dilated = dilate_motion(motion, depth)
    expected = motion.clone()
    expected[..., :2, :2] = motion[..., :1, :1]
    assert torch.equal(dilated, expected)


def test_dilation_ignores_depth_that_is_no_number():
    depth = torch.tensor([[[[float("nan"), 5.0, 6.0]]]])
    motion = torch.tensor([1.0, 2.0, 3.0]).expand(1, 2, 1, 3)
    assert dilate_motion(motion, depth)[0, 0, 0].tolist() == [2.0, 2.0, 2.0]


def test_history_of_the_same_frame_is_valid_everywhere_in_every_test():
    size = (6, 7)
    buffers = SurfaceBuffers(
        depth_m=random_image(0, size, channels=1).abs() + 1,
        normal=functional.normalize(random_image(1, size), dim=1),
        position_m=random_image(2, size),
        object_id=torch.arange(84, dtype=torch.int32).view(2, 1, 6, 7),
    )
    mask = disocclusion_mask(torch.zeros(2, 2, *size), current=buffers, previous=buffers)
    assert mask.sum().item() == 0


def test_positions_outside_the_frame_are_disoccluded_without_any_buffer():
    none = SurfaceBuffers()
    mask = disocclusion_mask(constant_motion(-2.0, 0.0, (2, 4)), current=none, previous=none)
    assert mask[0, 0].tolist() == [[1.0, 1.0, 0.0, 0.0]] * 2


def test_depth_that_differs_by_more_than_its_tolerance_is_disoccluded():
    current = SurfaceBuffers(depth_m=torch.full((1, 1, 1, 4), 10.0))
    previous = SurfaceBuffers(depth_m=torch.tensor([[[[10.4, 10.6, 9.6, 9.4]]]]))
    mask = disocclusion_mask(torch.zeros(1, 2, 1, 4), current=current, previous=previous)
    assert mask.flatten().tolist() == [0.0, 1.0, 0.0, 1.0]


def test_expected_depth_of_the_previous_camera_replaces_the_current_depth():
    current = SurfaceBuffers(depth_m=torch.full((1, 1, 1, 2), 10.0))
    previous = SurfaceBuffers(depth_m=torch.full((1, 1, 1, 2), 12.0))
    motion = torch.zeros(1, 2, 1, 2)
    assert disocclusion_mask(motion, current=current, previous=previous).sum().item() == 2
    mask = disocclusion_mask(
        motion, current=current, previous=previous, expected_depth_prev_m=previous.depth_m
    )
    assert mask.sum().item() == 0


def test_a_grazing_plane_gets_a_wider_depth_tolerance_but_a_thin_object_does_not():
    floor = torch.tensor([[[[10.0, 12.0, 14.0, 16.0, 18.0]]]])
    motion = constant_motion(0.45, 0.0, (1, 5))
    shifted = SurfaceBuffers(depth_m=floor + 1.1)
    mask = disocclusion_mask(motion, current=SurfaceBuffers(depth_m=floor), previous=shifted)
    assert mask.flatten().tolist()[1:4] == [0.0, 0.0, 0.0]
    wire = torch.tensor([[[[10.0, 10.0, 5.0, 10.0, 10.0]]]])
    wall = SurfaceBuffers(depth_m=torch.full_like(wire, 10.0))
    mask = disocclusion_mask(motion, current=SurfaceBuffers(depth_m=wire), previous=wall)
    assert mask.flatten().tolist() == [0.0, 0.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize("sky", [65504.0, 1e10, float("inf")])
def test_sky_agrees_with_sky_of_any_kind_and_with_nothing_else(sky):
    current = SurfaceBuffers(depth_m=torch.tensor([[[[sky, sky]]]]))
    previous = SurfaceBuffers(depth_m=torch.tensor([[[[65504.0, 500.0]]]]))
    mask = disocclusion_mask(torch.zeros(1, 2, 1, 2), current=current, previous=previous)
    assert mask.flatten().tolist() == [0.0, 1.0]


def test_normals_are_compared_by_their_angle():
    angles = torch.deg2rad(torch.tensor([0.0, 11.0, 12.0, 180.0]))
    turned = torch.stack((angles.sin(), torch.zeros(4), angles.cos())).view(1, 3, 1, 4)
    upright = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(1, 3, 1, 4)
    mask = disocclusion_mask(
        torch.zeros(1, 2, 1, 4),
        current=SurfaceBuffers(normal=upright),
        previous=SurfaceBuffers(normal=turned),
    )
    assert mask.flatten().tolist() == [0.0, 0.0, 1.0, 1.0]


def test_position_tolerance_follows_extranets_formula_in_metres():
    tolerance = position_tolerance_m(torch.tensor([[[[0.25]]]]), torch.tensor([[[[8.0]]]]))
    assert tolerance.item() == pytest.approx(0.075 * 0.25 + 0.45 * 0.75 + 0.005 * 8.0)


def test_positions_count_the_farthest_tap_that_is_blended():
    position = torch.zeros(1, 3, 1, 3)
    position_prev = position.clone()
    position_prev[0, 0, 0, 2] = 1.0
    current, previous = (
        SurfaceBuffers(position_m=position),
        SurfaceBuffers(position_m=position_prev),
    )
    still = disocclusion_mask(torch.zeros(1, 2, 1, 3), current=current, previous=previous)
    assert still.flatten().tolist() == [0.0, 0.0, 1.0]
    moved = disocclusion_mask(constant_motion(0.1, 0.0, (1, 3)), current=current, previous=previous)
    assert moved.flatten().tolist() == [0.0, 1.0, 1.0]


def test_ids_are_compared_at_the_nearest_tap_or_at_any():
    ids = torch.tensor([[[[7, 8, 9]]]], dtype=torch.int32)
    buffers, motion = SurfaceBuffers(object_id=ids), constant_motion(0.6, 0.0, (1, 3))
    nearest = disocclusion_mask(motion, current=buffers, previous=buffers)
    assert nearest.flatten().tolist() == [1.0, 1.0, 1.0]
    any_tap = DisocclusionThresholds(id_taps="any")
    mask = disocclusion_mask(motion, current=buffers, previous=buffers, thresholds=any_tap)
    assert mask.flatten().tolist() == [0.0, 0.0, 1.0]


def test_with_a_dynamic_mask_normals_judge_moving_and_positions_judge_static_pixels():
    up, side = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0])
    here, there = torch.zeros(1, 3, 1, 2), torch.full((1, 3, 1, 2), 5.0)

    def normal(vector):
        return vector.view(1, 3, 1, 1).expand(1, 3, 1, 2)

    def masks(current, previous):
        dynamic = torch.tensor([[[[1.0, 0.0]]]])
        motion = torch.zeros(1, 2, 1, 2)
        mask = disocclusion_mask(motion, current=current, previous=previous, dynamic_mask=dynamic)
        return mask.flatten().tolist()

    assert masks(SurfaceBuffers(normal=normal(up)), SurfaceBuffers(normal=normal(side))) == [1, 0]
    assert masks(SurfaceBuffers(position_m=here), SurfaceBuffers(position_m=there)) == [0, 1]


def test_buffers_of_another_size_are_refused_by_name():
    current = SurfaceBuffers(depth_m=torch.ones(1, 1, 4, 4))
    with pytest.raises(ShapeMismatchError, match="current depth_m"):
        disocclusion_mask(torch.zeros(1, 2, 4, 5), current=current, previous=current)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("mode", MODES)
def test_the_gpu_agrees_with_the_cpu(mode):
    image, motion = random_image(1, (13, 17)), random_image(2, (13, 17), channels=2)
    on_cpu, inside_cpu = backward_warp(image, motion, mode=mode)
    on_gpu, inside_gpu = backward_warp(image.cuda(), motion.cuda(), mode=mode)
    torch.testing.assert_close(on_gpu.cpu(), on_cpu, atol=1e-6, rtol=1e-5)
    assert torch.equal(inside_gpu.cpu(), inside_cpu)


@pytest.mark.parametrize("border", ["clamp", "zero"])
@pytest.mark.parametrize("mode", ["nearest", "bilinear"])
def test_channels_last_give_the_same_bits(mode, border):
    torch.manual_seed(7)
    image, motion = torch.rand(2, 5, 6, 7), 4.0 * torch.randn(2, 2, 6, 7)
    last = image.to(memory_format=torch.channels_last)
    expected, _ = backward_warp(image, motion, mode=mode, border=border)
    found, _ = backward_warp(last, motion, mode=mode, border=border)
    assert torch.equal(found, expected)
    assert found.is_contiguous(memory_format=torch.channels_last)


def test_gradients_through_channels_last_are_the_same():
    torch.manual_seed(8)
    image, motion = torch.rand(2, 5, 6, 7), 4.0 * torch.randn(2, 2, 6, 7)
    gradients = []
    for memory_format in (torch.contiguous_format, torch.channels_last):
        leaf = image.detach().to(memory_format=memory_format).requires_grad_()
        warped, _ = backward_warp(leaf, motion, mode="nearest", border="zero")
        (warped * torch.arange(7.0)).sum().backward()
        gradients.append(leaf.grad)
    assert torch.allclose(*gradients)


def test_outside_the_frame_is_zero_even_where_the_border_is_no_number():
    image = torch.full((1, 2, 3, 3), torch.nan)
    motion = torch.full((1, 2, 3, 3), 9.0)
    warped, _ = backward_warp(image, motion, mode="nearest", border="zero")
    assert torch.equal(warped, torch.zeros(1, 2, 3, 3))


@given(seed=seeds, size=sizes)
@settings(deadline=None, max_examples=25)
def test_some_pixels_alone_are_those_of_the_whole_warp(seed, size):
    image = random_image(seed, size, batch=1)
    motion = 4.0 * random_image(seed + 1, size, channels=2, batch=1)
    pixels = torch.arange(0, size[0] * size[1], 2)
    vectors = motion[0].flatten(1)[:, pixels]
    whole, inside = backward_warp(image, motion)
    torch.testing.assert_close(
        warp_pixels(image, vectors, pixels), whole[0].flatten(1)[:, pixels], rtol=0, atol=1e-6
    )
    place, within = find_nearest_pixels(vectors, pixels, size)
    assert torch.equal(within, inside.flatten()[pixels])
    nearest, _ = backward_warp(image, motion, mode="nearest")
    assert torch.equal(image[0].flatten(1)[:, place], nearest[0].flatten(1)[:, pixels])


def test_rows_alone_lie_inside_where_they_do_in_the_frame():
    motion = 4.0 * random_image(5, (9, 7), channels=2, batch=1)
    motion[0, 0, 4, 3] = torch.nan
    whole = inside_frame(motion)
    assert 0 < float(whole.mean()) < 1
    assert torch.equal(inside_frame(motion, range(3, 7)), whole[:, :, 3:7])
