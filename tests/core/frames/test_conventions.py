from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.conventions import (
    Conventions,
    DepthConvention,
    DepthKind,
    NormalConvention,
    NormalSpace,
    RoughnessKind,
    StoredFrame,
    depth_to_metres,
    normal_to_world,
    roughness_to_perceptual,
    to_memory,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, YAxis

SIZE = (5, 7)
VIEW = View(display=SIZE)
WHERE = "shots/a, frame 3"

MakeCamera = Callable[..., CameraMetadata]


def plane(*values: float) -> torch.Tensor:
    return torch.tensor(values).view(1, 1, 1, -1)


def metres(stored: torch.Tensor, convention: DepthConvention) -> list[float]:
    view = View(display=(stored.shape[-2], stored.shape[-1]))
    converted = depth_to_metres(stored, convention, CameraMetadata(), view, where=WHERE)
    return converted.flatten().tolist()


@pytest.mark.parametrize("jitter_px", [(0.0, 0.0), (0.45, -0.45)])
def test_ray_distances_become_planar_depth(
    make_camera: MakeCamera,
    unproject: Callable[[CameraMetadata, tuple[int, int], np.ndarray], np.ndarray],
    jitter_px: tuple[float, float],
) -> None:
    camera = make_camera(shift=(0.1, 0.3), jitter_px=jitter_px, focal=(0.9, 1.1))
    depth = np.random.default_rng(5).uniform(1.0, 9.0, SIZE)
    positions = unproject(camera, SIZE, depth)
    distance = np.linalg.norm(positions - camera.position.numpy(), axis=-1)
    assert (distance > depth * 1.01).mean() > 0.5
    found = depth_to_metres(
        torch.from_numpy(distance)[None, None].float(),
        DepthConvention(kind=DepthKind.RAY),
        camera,
        VIEW,
        where=WHERE,
    )
    assert np.allclose(found[0, 0].numpy(), depth, rtol=1e-5)


@pytest.mark.parametrize(
    ("kind", "what"), [(DepthKind.RAY, "ray distance"), (DepthKind.DEVICE, "device depth")]
)
def test_depth_that_needs_a_camera_says_so_with_the_frame_and_the_remedy(
    kind: DepthKind, what: str
) -> None:
    with pytest.raises(MissingBufferError) as caught:
        depth_to_metres(
            torch.ones(1, 1, *SIZE), DepthConvention(kind=kind), CameraMetadata(), VIEW, where=WHERE
        )
    message = str(caught.value)
    assert message.startswith(WHERE)
    assert what in message
    assert "capture.toml" in message


def test_centimetres_are_a_hundredth_of_a_metre() -> None:
    assert metres(plane(100.0, 250.0), DepthConvention(unit_m=0.01)) == pytest.approx([1.0, 2.5])


def test_stored_sky_is_the_same_value_in_memory_whatever_the_unit() -> None:
    stored = plane(1e10, 9.9e9, float("inf"))
    convention = DepthConvention(unit_m=0.01, sky=1e10)
    assert metres(stored, convention) == [SKY_DEPTH_M, SKY_DEPTH_M, SKY_DEPTH_M]
    assert metres(plane(5e5), convention) == pytest.approx([5e3])


def test_centimetres_beyond_the_largest_half_are_not_sky_by_default() -> None:
    assert metres(plane(90_000.0), DepthConvention(unit_m=0.01)) == pytest.approx([900.0])


def test_depth_beyond_the_largest_half_is_sky_by_default() -> None:
    assert metres(plane(65504.0, 1e10, 100.0), DepthConvention()) == [
        SKY_DEPTH_M,
        SKY_DEPTH_M,
        100.0,
    ]


def test_packed_normals_are_unpacked_to_unit_length(make_camera: MakeCamera) -> None:
    unit = torch.tensor([2.0, -3.0, 6.0]).view(1, 3, 1, 1) / 7.0
    found = normal_to_world(
        (unit + 1.0) / 2.0, NormalConvention(packed=True), make_camera(), where=WHERE
    )
    assert torch.allclose(found, unit, atol=1e-6)


def test_view_space_normals_are_turned_by_the_camera(make_camera: MakeCamera) -> None:
    camera = make_camera(yaw=0.0, pitch=0.0)
    # this camera looks along +y with z up: its x, y, back axes are +x, +z, -y of the world
    view_space = torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]).T.reshape(1, 3, 1, 3)
    found = normal_to_world(
        view_space, NormalConvention(space=NormalSpace.VIEW), camera, where=WHERE
    )
    assert torch.allclose(
        found[0, :, 0].T,
        torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
        atol=1e-6,
    )


def test_view_space_normals_go_back_through_the_inverse_matrix(make_camera: MakeCamera) -> None:
    camera = make_camera(yaw=0.8, pitch=-0.5)
    assert camera.world_to_camera is not None
    world = torch.nn.functional.normalize(torch.randn(1, 3, 2, 2), dim=1)
    rows = world[0].flatten(1).T.double() @ camera.world_to_camera[:3, :3]
    view_space = rows.T.reshape(1, 3, 2, 2).float()
    packed = NormalConvention(space=NormalSpace.VIEW, packed=True)
    found = normal_to_world((view_space + 1) / 2, packed, camera, where=WHERE)
    assert torch.allclose(found, world, atol=1e-5)


def test_a_zero_normal_stays_zero() -> None:
    found = normal_to_world(
        torch.zeros(1, 3, 1, 1), NormalConvention(), CameraMetadata(), where=WHERE
    )
    assert found.flatten().tolist() == [0.0, 0.0, 0.0]


def test_view_space_normals_without_a_matrix_are_refused() -> None:
    with pytest.raises(MissingBufferError, match=f"{WHERE}: view-space normals"):
        normal_to_world(
            torch.ones(1, 3, 1, 1),
            NormalConvention(space=NormalSpace.VIEW),
            CameraMetadata(),
            where=WHERE,
        )


@pytest.mark.parametrize(
    ("kind", "stored"),
    [
        (RoughnessKind.PERCEPTUAL, (0.3, 0.9)),
        (RoughnessKind.ALPHA, (0.09, 0.81)),
        (RoughnessKind.SMOOTHNESS, (0.7, 0.1)),
    ],
)
def test_every_kind_of_roughness_is_the_same_perceptual_one(
    kind: RoughnessKind, stored: tuple[float, float]
) -> None:
    found = roughness_to_perceptual(plane(*stored), kind)
    assert found.flatten().tolist() == pytest.approx([0.3, 0.9], abs=1e-6)


def converted(buffer: Buffer, stored: torch.Tensor, conventions: Conventions) -> torch.Tensor:
    frame = StoredFrame(
        conventions=conventions,
        camera=CameraMetadata(jitter_px=(0.25, 0.5)),
        view=View(display=(stored.shape[-2], stored.shape[-1])),
        jitter_px_prev=(-0.25, 0.0),
        where=WHERE,
    )
    return to_memory(buffer, stored, frame)


def test_motion_is_converted_with_the_jitter_of_both_frames() -> None:
    conventions = Conventions(motion=MotionConvention(jittered=True))
    stored = torch.tensor([2.0, 3.0]).view(1, 2, 1, 1)
    assert converted(Buffer.MOTION, stored, conventions).flatten().tolist() == [1.5, 2.5]


def test_forward_vectors_turn_with_the_axis_but_not_with_the_direction() -> None:
    conventions = Conventions(
        motion=MotionConvention(
            y_axis=YAxis.UP, direction=MotionDirection.CURRENT_MINUS_PREVIOUS, jittered=True
        )
    )
    stored = torch.tensor([2.0, 3.0]).view(1, 2, 1, 1)
    assert converted(Buffer.FORWARD, stored, conventions).flatten().tolist() == [2.0, -3.0]


def test_float_object_ids_are_rounded_to_whole_numbers() -> None:
    ids = converted(Buffer.OBJECT_ID, plane(2.0, 2.9999, 7.0), Conventions())
    assert ids.dtype == torch.int32
    assert ids.flatten().tolist() == [2, 3, 7]


def test_roughness_beyond_its_range_is_clipped_before_it_is_converted() -> None:
    conventions = Conventions(roughness=RoughnessKind.SMOOTHNESS)
    found = converted(Buffer.ROUGHNESS, plane(-0.2, 1.3, 0.25), conventions)
    assert found.flatten().tolist() == [1.0, 0.0, 0.75]


def test_positions_take_the_unit_of_depth() -> None:
    conventions = Conventions(depth=DepthConvention(unit_m=0.01))
    stored = torch.tensor([100.0, -200.0, 50.0]).view(1, 3, 1, 1)
    found = converted(Buffer.POSITION, stored, conventions).flatten().tolist()
    assert found == pytest.approx([1.0, -2.0, 0.5])


def test_radiance_is_left_alone_and_albedo_loses_its_negative_rounding() -> None:
    stored = torch.tensor([-0.001, 0.5, math.pi]).view(1, 3, 1, 1)
    assert torch.equal(converted(Buffer.COLOR, stored, Conventions()), stored)
    assert converted(Buffer.ALBEDO, stored, Conventions()).flatten().tolist()[0] == 0.0
