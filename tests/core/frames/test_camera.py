from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.frames.camera import (
    CameraMetadata,
    View,
    camera_from_positions,
    device_to_planar_depth,
    ray_axes,
    view_cosine,
    view_cosine_from_camera,
)

SIZE = (6, 9)

MakeCamera = Callable[..., CameraMetadata]
Unproject = Callable[[CameraMetadata, tuple[int, int], np.ndarray], np.ndarray]


@pytest.fixture
def depth() -> np.ndarray:
    return np.random.default_rng(1).uniform(0.5, 20.0, SIZE)


@pytest.fixture
def normal() -> torch.Tensor:
    values = np.random.default_rng(2).normal(size=(1, 3, *SIZE))
    return torch.from_numpy(values / np.linalg.norm(values, axis=1, keepdims=True)).float()


def brute_force_cosine(camera: CameraMetadata, positions: np.ndarray, normal: torch.Tensor) -> list:
    assert camera.world_to_camera is not None
    eye = np.linalg.inv(camera.world_to_camera.numpy())[3, :3]
    cosines = []
    for row in range(SIZE[0]):
        for column in range(SIZE[1]):
            to_eye = eye - positions[row, column]
            to_eye /= np.linalg.norm(to_eye)
            cosines.append(np.clip(normal[0, :, row, column].numpy() @ to_eye, 0.0, 1.0))
    return cosines


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.35, -0.2)])
@pytest.mark.parametrize("jitter_px", [(0.0, 0.0), (0.4, -0.3)])
def test_the_view_cosine_is_that_of_world_positions_found_by_inverting_the_matrices(
    make_camera: MakeCamera,
    unproject: Unproject,
    depth: np.ndarray,
    normal: torch.Tensor,
    shift: tuple[float, float],
    jitter_px: tuple[float, float],
) -> None:
    camera = make_camera(shift=shift, jitter_px=jitter_px)
    expected = brute_force_cosine(camera, unproject(camera, SIZE, depth), normal)
    nov = view_cosine_from_camera(normal, camera, View(display=SIZE), jitter_px=jitter_px)
    assert nov is not None
    assert nov.shape == (1, 1, *SIZE)
    assert np.allclose(nov.flatten().numpy(), expected, atol=1e-5)
    assert 0.2 < np.mean(np.array(expected) > 0) < 0.8


def test_rays_times_depth_are_the_camera_space_positions_of_the_data_readme(
    make_camera: MakeCamera,
) -> None:
    camera = make_camera(focal=(1.25, 2.5))
    axes = ray_axes(camera, View(display=(4, 8)), (4, 8))
    assert axes is not None
    # pixel (x, y) = (6, 1): px = 6.5, py = 1.5
    assert float(axes[0][0, 0, 0, 6]) == pytest.approx((2 * 6.5 / 8 - 1) / 1.25, abs=1e-6)
    assert float(axes[1][0, 0, 1, 0]) == pytest.approx((1 - 2 * 1.5 / 4) / 2.5, abs=1e-6)


def test_a_crop_has_the_view_cosine_of_the_full_frame_cropped(
    make_camera: MakeCamera, normal: torch.Tensor
) -> None:
    camera = make_camera(shift=(0.1, 0.2))
    whole = view_cosine_from_camera(normal, camera, View(display=SIZE))
    part = view_cosine_from_camera(normal[..., 2:5, 3:8], camera, View(display=SIZE, top=2, left=3))
    assert whole is not None
    assert part is not None
    assert torch.allclose(part, whole[..., 2:5, 3:8], atol=1e-6)


def test_decimated_pixels_seen_through_their_jitter_have_the_cosines_of_the_samples(
    make_camera: MakeCamera,
) -> None:
    camera = make_camera()
    normal = torch.nn.functional.normalize(
        torch.randn(1, 3, 8, 12, generator=torch.Generator().manual_seed(3)), dim=1
    )
    full = view_cosine_from_camera(normal, camera, View(display=(8, 12)))
    small = view_cosine_from_camera(
        normal[..., 3::4, 1::4],
        camera,
        View(display=(2, 3)),
        jitter_px=((1 + 0.5) / 4 - 0.5, (3 + 0.5) / 4 - 0.5),
    )
    assert full is not None
    assert small is not None
    assert torch.allclose(small, full[..., 3::4, 1::4], atol=1e-6)


def test_a_view_at_another_scale_shows_the_same_part(make_camera: MakeCamera) -> None:
    camera = make_camera()
    view = View(display=(4, 6), top=1, left=2)
    assert view.at_scale(3) == View(display=(12, 18), top=3, left=6)
    small = ray_axes(camera, view, (2, 2))
    large = ray_axes(camera, view.at_scale(3), (6, 6))
    assert small is not None
    assert large is not None
    # the middle one of 3 x 3 pixels has the centre of the large pixel
    assert torch.allclose(large[0][..., 1::3], small[0], atol=1e-6)
    assert torch.allclose(large[1][..., 1::3, :], small[1], atol=1e-6)


def test_without_matrices_there_are_no_rays_and_no_cosine(normal: torch.Tensor) -> None:
    camera = CameraMetadata()
    assert ray_axes(camera, View(display=SIZE), SIZE) is None
    assert view_cosine_from_camera(normal, camera, View(display=SIZE)) is None
    assert camera.position is None


def test_a_camera_with_one_matrix_only_has_no_projection(make_camera: MakeCamera) -> None:
    assert replace(make_camera(), world_to_ndc=None).projection is None
    assert replace(make_camera(), world_to_camera=None).projection is None


def test_the_position_is_where_the_camera_was_put(make_camera: MakeCamera) -> None:
    position = make_camera(position=(4.0, -5.0, 6.0), yaw=1.1, pitch=-0.7).position
    assert position is not None
    assert position.tolist() == pytest.approx([4.0, -5.0, 6.0], abs=1e-12)


def test_a_surface_seen_from_behind_has_cosine_zero() -> None:
    normal = torch.tensor([0.0, 0.0, 2.0]).view(1, 3, 1, 1)
    to_camera = torch.tensor([0.0, 3.0, -4.0]).view(1, 3, 1, 1)
    assert float(view_cosine(normal, to_camera)) == 0.0
    assert float(view_cosine(normal, -to_camera)) == pytest.approx(0.8)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.35, -0.2)])
def test_the_camera_is_recovered_from_world_positions_and_depth(
    make_camera: MakeCamera, unproject: Unproject, shift: tuple[float, float]
) -> None:
    size = (12, 14)
    camera = make_camera(position=(3.0, 7.0, -2.0), shift=shift)
    depth = np.random.default_rng(4).uniform(1.0, 30.0, size)
    positions = torch.from_numpy(unproject(camera, size, depth)).permute(2, 0, 1)[None].float()
    depth_m = torch.from_numpy(depth)[None, None].float()
    depth_m[..., :2, :] = SKY_DEPTH_M
    positions[..., :2, :] = float("nan")
    found = camera_from_positions(positions, depth_m)
    assert found is not None
    assert found.tolist() == pytest.approx([3.0, 7.0, -2.0], abs=1e-3)


def test_a_frame_of_sky_does_not_give_a_camera() -> None:
    depth_m = torch.full((1, 1, 12, 14), SKY_DEPTH_M)
    assert camera_from_positions(torch.zeros(1, 3, 12, 14), depth_m) is None


NEAR, FAR = 0.1, 400.0


def projection(kind: str) -> torch.Tensor:
    """Row-vector matrices whose clip z is 0..1 between the planes, w = depth."""
    z_scale, z_offset = {
        "forward": (-FAR / (FAR - NEAR), -FAR * NEAR / (FAR - NEAR)),
        "reversed": (NEAR / (FAR - NEAR), FAR * NEAR / (FAR - NEAR)),
        "infinite": (-1.0, -NEAR),
        "infinite-reversed": (0.0, NEAR),
    }[kind]
    matrix = torch.zeros(4, 4, dtype=torch.float64)
    matrix[0, 0] = matrix[1, 1] = 1.0
    matrix[2, 2], matrix[3, 2], matrix[2, 3] = z_scale, z_offset, -1.0
    return matrix


@pytest.mark.parametrize("kind", ["forward", "reversed", "infinite", "infinite-reversed"])
def test_device_depth_comes_back_through_its_own_matrix(kind: str) -> None:
    depth = torch.tensor([NEAR, 0.5, 3.0, 40.0, 399.0], dtype=torch.float64)
    clip = torch.stack([0 * depth, 0 * depth, -depth, 1 + 0 * depth], dim=1) @ projection(kind)
    device = (clip[:, 2] / clip[:, 3]).view(1, 1, 1, -1)
    assert float(device.min()) >= -1e-12
    assert float(device.max()) <= 1 + 1e-12
    found = device_to_planar_depth(device, projection(kind), reversed_depth="reversed" in kind)
    assert found.flatten().tolist() == pytest.approx(depth.tolist(), rel=1e-5)


@pytest.mark.parametrize("kind", ["forward", "reversed", "infinite", "infinite-reversed"])
def test_device_depth_stored_the_other_way_round_is_turned(kind: str) -> None:
    depth = torch.tensor([0.2, 3.0, 40.0], dtype=torch.float64)
    clip = torch.stack([0 * depth, 0 * depth, -depth, 1 + 0 * depth], dim=1) @ projection(kind)
    device = (1.0 - clip[:, 2] / clip[:, 3]).view(1, 1, 1, -1)
    found = device_to_planar_depth(device, projection(kind), reversed_depth="reversed" not in kind)
    assert found.flatten().tolist() == pytest.approx(depth.tolist(), rel=1e-5)


@pytest.mark.parametrize(("kind", "cleared"), [("infinite", 1.0), ("infinite-reversed", 0.0)])
def test_the_cleared_value_of_an_infinite_depth_buffer_is_sky(kind: str, cleared: float) -> None:
    device = torch.full((1, 1, 1, 1), cleared)
    found = device_to_planar_depth(device, projection(kind), reversed_depth="reversed" in kind)
    assert float(found) == SKY_DEPTH_M
