"""Conventions of files can be written as well as read: there and back is the identity."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

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
    to_memory,
)
from rtsr_cli.core.frames.motion import Axes, MotionConvention, MotionDirection, MotionUnit, YAxis
from rtsr_cli.core.frames.storage import from_memory, split_buffer, to_half

SIZE = (4, 6)
MakeCamera = Callable[..., CameraMetadata]
Frames = Callable[[Conventions], StoredFrame]


@pytest.fixture
def stored_with(make_camera: MakeCamera) -> Frames:
    """What is known of a frame with an off-centre, jittered camera."""

    def make(conventions: Conventions) -> StoredFrame:
        return StoredFrame(
            conventions=conventions,
            camera=make_camera(shift=(0.1, -0.2), jitter_px=(0.25, -0.4)),
            view=View(display=SIZE),
            jitter_px_prev=(-0.3, 0.1),
            where="shot, frame 3",
        )

    return make


def random(buffer_channels: int, *, low: float = 0.0, high: float = 1.0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(buffer_channels)
    return low + (high - low) * torch.rand(1, buffer_channels, *SIZE, generator=generator)


def assert_identity(buffer: Buffer, image: torch.Tensor, frame: StoredFrame) -> None:
    there_and_back = to_memory(buffer, from_memory(buffer, image, frame), frame)
    assert torch.allclose(there_and_back, image, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("buffer", [Buffer.MOTION, Buffer.FORWARD])
@pytest.mark.parametrize(
    ("unit", "direction", "y_axis", "jittered"),
    list(product(MotionUnit, MotionDirection, YAxis, (False, True))),
)
def test_motion_comes_back_from_every_convention(
    stored_with: Frames,
    buffer: Buffer,
    unit: MotionUnit,
    direction: MotionDirection,
    y_axis: YAxis,
    jittered: bool,
) -> None:
    convention = MotionConvention(
        unit=unit, direction=direction, y_axis=y_axis, jittered=jittered, scale=0.5
    )
    frame = stored_with(Conventions(motion=convention))
    assert_identity(buffer, random(2, low=-3.0, high=3.0), frame)


@pytest.mark.parametrize("axes", Axes)
@pytest.mark.parametrize("inverted", [False, True])
def test_motion_comes_back_from_swapped_centred_and_inverted_ones(
    stored_with: Frames, axes: Axes, inverted: bool
) -> None:
    convention = MotionConvention(axes=axes, zero=0.5, jittered=True, jitter_inverted=inverted)
    frame = stored_with(Conventions(motion=convention))
    assert_identity(Buffer.MOTION, random(2, low=-3.0, high=3.0), frame)


@pytest.mark.parametrize("kind", DepthKind)
@pytest.mark.parametrize("reversed_depth", [False, True])
@pytest.mark.parametrize("sky", [None, 1e10])
def test_depth_comes_back_from_every_convention(
    stored_with: Frames, kind: DepthKind, reversed_depth: bool, sky: float | None
) -> None:
    convention = DepthConvention(kind=kind, reversed=reversed_depth, unit_m=0.01, sky=sky)
    depth = random(1, low=0.5, high=30.0)
    depth[..., 0, :3] = SKY_DEPTH_M
    frame = stored_with(Conventions(depth=convention))
    assert_identity(Buffer.DEPTH, depth, frame)


def test_device_depth_of_a_known_camera_is_stored_as_its_equation_has_it(
    stored_with: Frames,
) -> None:
    frame = stored_with(Conventions(depth=DepthConvention(kind=DepthKind.DEVICE)))
    depth = torch.tensor([0.05, 1.0, SKY_DEPTH_M]).view(1, 1, 1, 3)
    # near plane 0.05 m, no far plane: d = 1 - near / depth
    found = from_memory(Buffer.DEPTH, depth, frame).flatten().tolist()
    assert found == pytest.approx([0.0, 0.95, 1.0], abs=1e-6)


@pytest.mark.parametrize("space", NormalSpace)
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("sky", [None, (-1.0, -1.0, -1.0), (0.0, 0.0, 0.0)])
def test_normals_come_back_from_every_convention(
    stored_with: Frames,
    space: NormalSpace,
    packed: bool,
    sky: tuple[float, float, float] | None,
) -> None:
    normal = torch.nn.functional.normalize(random(3, low=-1.0), dim=1)
    normal[..., 0, :3] = 0.0
    convention = NormalConvention(space=space, packed=packed, sky=sky)
    assert_identity(Buffer.NORMAL, normal, stored_with(Conventions(normal=convention)))


def test_a_zero_normal_is_stored_as_the_marker_of_sky(stored_with: Frames) -> None:
    frame = stored_with(Conventions(normal=NormalConvention(sky=(-1.0, -1.0, -1.0))))
    found = from_memory(Buffer.NORMAL, torch.zeros(1, 3, 1, 1), frame)
    assert found.flatten().tolist() == [-1.0, -1.0, -1.0]


def test_a_normal_near_the_marker_of_sky_is_no_sky(stored_with: Frames) -> None:
    frame = stored_with(Conventions(normal=NormalConvention(sky=(-1.0, -1.0, -1.0))))
    unit = torch.full((1, 3, 1, 1), -(3.0**-0.5))
    assert torch.allclose(to_memory(Buffer.NORMAL, unit, frame), unit)


@pytest.mark.parametrize("kind", RoughnessKind)
def test_roughness_comes_back_from_every_kind(stored_with: Frames, kind: RoughnessKind) -> None:
    assert_identity(Buffer.ROUGHNESS, random(1), stored_with(Conventions(roughness=kind)))


@pytest.mark.parametrize("unit", [None, 0.01, 1.0])
def test_positions_come_back_from_every_unit(stored_with: Frames, unit: float | None) -> None:
    conventions = Conventions(depth=DepthConvention(unit_m=100.0), position_unit_m=unit)
    assert_identity(Buffer.POSITION, random(3, low=-50.0, high=50.0), stored_with(conventions))


def test_positions_have_a_unit_of_their_own(stored_with: Frames) -> None:
    conventions = Conventions(depth=DepthConvention(unit_m=100.0), position_unit_m=0.01)
    found = to_memory(Buffer.POSITION, torch.full((1, 3, 1, 1), 250.0), stored_with(conventions))
    assert found.flatten().tolist() == [2.5, 2.5, 2.5]


@pytest.mark.parametrize(
    ("buffer", "conventions"),
    [
        (Buffer.DEPTH, Conventions(depth=DepthConvention(kind=DepthKind.RAY))),
        (Buffer.DEPTH, Conventions(depth=DepthConvention(kind=DepthKind.DEVICE))),
        (Buffer.NORMAL, Conventions(normal=NormalConvention(space=NormalSpace.VIEW))),
    ],
)
def test_what_needs_a_camera_says_so_when_it_is_written(
    buffer: Buffer, conventions: Conventions
) -> None:
    frame = StoredFrame(
        conventions=conventions,
        camera=CameraMetadata(),
        view=View(display=SIZE),
        jitter_px_prev=(0.0, 0.0),
        where="shot, frame 3",
    )
    channels = 3 if buffer is Buffer.NORMAL else 1
    with pytest.raises(MissingBufferError, match=r"shot, frame 3: .* needs the camera matrices"):
        from_memory(buffer, random(channels), frame)


def test_values_beyond_half_become_its_largest_value_and_nan_stays() -> None:
    stored = to_half(torch.tensor([1e9, -1e9, 65519.0, 0.5, float("nan")]))
    assert stored[:4].tolist() == [65504.0, -65504.0, 65504.0, 0.5]
    assert np.isnan(stored[4])


def test_doubles_are_rounded_to_half_once() -> None:
    # just above the middle of 1 and the next half, closer to it than a float tells
    above = 1.0 + 2.0**-11 + 2.0**-40
    stored = to_half(torch.tensor([above, -above], dtype=torch.float64))
    assert stored.tolist() == [1.0 + 2.0**-10, -1.0 - 2.0**-10]


def test_buffers_are_named_as_the_canonical_layout_has_them() -> None:
    assert set(split_buffer(Buffer.NORMAL, torch.zeros(1, 3, 2, 2))) == {
        "normal.X",
        "normal.Y",
        "normal.Z",
    }
    roughness = split_buffer(Buffer.ROUGHNESS, torch.zeros(1, 1, 2, 2), full=True)
    assert {name: plane.dtype for name, plane in roughness.items()} == {
        "roughness": np.dtype(np.float32)
    }
