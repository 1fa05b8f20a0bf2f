from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.motion import (
    MotionConvention,
    MotionDirection,
    MotionUnit,
    YAxis,
    motion_to_pixels,
)

HEIGHT, WIDTH = 4, 10

TO_PREVIOUS = MotionDirection.PREVIOUS_MINUS_CURRENT
FROM_PREVIOUS = MotionDirection.CURRENT_MINUS_PREVIOUS


def vectors(x: float, y: float) -> torch.Tensor:
    return torch.tensor([x, y]).view(1, 2, 1, 1).expand(1, 2, HEIGHT, WIDTH)


@pytest.mark.parametrize(
    ("unit", "direction", "y_axis", "stored"),
    [
        (MotionUnit.PIXELS, TO_PREVIOUS, YAxis.DOWN, (3.0, -1.0)),
        (MotionUnit.PIXELS, TO_PREVIOUS, YAxis.UP, (3.0, 1.0)),
        (MotionUnit.PIXELS, FROM_PREVIOUS, YAxis.DOWN, (-3.0, 1.0)),
        (MotionUnit.PIXELS, FROM_PREVIOUS, YAxis.UP, (-3.0, -1.0)),
        (MotionUnit.UV, TO_PREVIOUS, YAxis.DOWN, (0.3, -0.25)),
        (MotionUnit.UV, FROM_PREVIOUS, YAxis.UP, (-0.3, -0.25)),
        (MotionUnit.NDC, TO_PREVIOUS, YAxis.UP, (0.6, 0.5)),
        (MotionUnit.NDC, FROM_PREVIOUS, YAxis.DOWN, (-0.6, 0.5)),
    ],
)
def test_three_pixels_right_and_one_up_in_every_way_of_storing_it(
    unit: MotionUnit, direction: MotionDirection, y_axis: YAxis, stored: tuple[float, float]
) -> None:
    convention = MotionConvention(unit=unit, direction=direction, y_axis=y_axis)
    motion_px = motion_to_pixels(vectors(*stored), convention)
    assert torch.allclose(motion_px, vectors(3.0, -1.0), atol=1e-6)


def test_the_declared_scale_multiplies_both_components() -> None:
    convention = MotionConvention(scale=0.5)
    assert torch.equal(motion_to_pixels(vectors(4.0, 6.0), convention), vectors(2.0, 3.0))


def test_the_default_convention_is_that_of_memory() -> None:
    stored = torch.randn(1, 2, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    assert torch.equal(motion_to_pixels(stored, MotionConvention()), stored)


def test_jitter_changes_nothing_where_vectors_do_not_contain_it() -> None:
    stored = vectors(2.0, 1.0)
    converted = motion_to_pixels(
        stored, MotionConvention(), jitter_px=(0.4, -0.3), jitter_px_prev=(-0.1, 0.2)
    )
    assert torch.equal(converted, stored)


def screen_position(
    point: np.ndarray, camera: CameraMetadata, jitter_px: tuple[float, float]
) -> np.ndarray:
    """Where a renderer whose samples lie at centre + jitter shows a world point, in pixels."""
    assert camera.world_to_ndc is not None
    clip = np.append(point, 1.0) @ camera.world_to_ndc.numpy()
    x, y = clip[:2] / clip[3]
    x -= 2.0 * jitter_px[0] / WIDTH
    y += 2.0 * jitter_px[1] / HEIGHT
    return np.array([(x * 0.5 + 0.5) * WIDTH, (0.5 - 0.5 * y) * HEIGHT])


@pytest.mark.parametrize("direction", [TO_PREVIOUS, FROM_PREVIOUS])
@pytest.mark.parametrize("y_axis", [YAxis.DOWN, YAxis.UP])
def test_vectors_of_two_jittered_projections_give_the_motion_without_jitter(
    make_camera: Callable[..., CameraMetadata], direction: MotionDirection, y_axis: YAxis
) -> None:
    now, before = make_camera(), make_camera(position=(1.1, -2.2, 1.4), yaw=0.45)
    jitter_px, jitter_px_prev = (0.31, -0.22), (-0.4, 0.17)
    point, point_prev = np.array([-1.0, 3.0, 2.0]), np.array([-1.2, 3.1, 2.0])
    true = screen_position(point_prev, before, (0, 0)) - screen_position(point, now, (0, 0))
    jittered = screen_position(point_prev, before, jitter_px_prev) - screen_position(
        point, now, jitter_px
    )
    stored = jittered / [WIDTH, HEIGHT]
    if direction is FROM_PREVIOUS:
        stored = -stored
    if y_axis is YAxis.UP:
        stored[1] = -stored[1]
    assert np.abs(true - jittered).max() > 0.3
    convention = MotionConvention(
        unit=MotionUnit.UV, direction=direction, y_axis=y_axis, jittered=True
    )
    recovered = motion_to_pixels(
        vectors(*stored), convention, jitter_px=jitter_px, jitter_px_prev=jitter_px_prev
    )
    assert np.allclose(recovered[0, :, 0, 0].numpy(), true, atol=1e-5)


def test_a_still_image_seen_by_two_jittered_frames_has_no_motion() -> None:
    jitter_px, jitter_px_prev = 0.375, -0.25
    centres = np.arange(WIDTH) + 0.5
    ramp_now, ramp_prev = centres + jitter_px, centres + jitter_px_prev
    # where the value that pixel 4 shows now lies in the previous image, minus pixel 4's centre
    stored_x = np.interp(ramp_now[4], ramp_prev, centres) - centres[4]
    recovered = motion_to_pixels(
        vectors(float(stored_x), 0.0),
        MotionConvention(jittered=True),
        jitter_px=(jitter_px, 0.0),
        jitter_px_prev=(jitter_px_prev, 0.0),
    )
    assert abs(float(recovered[0, 0, 0, 0])) < 1e-6


@settings(max_examples=40, deadline=None)
@given(
    size=st.tuples(st.integers(1, 4000), st.integers(1, 4000)),
    unit=st.sampled_from(MotionUnit),
    direction=st.sampled_from(MotionDirection),
)
def test_turning_y_round_changes_the_sign_of_y_only(
    size: tuple[int, int], unit: MotionUnit, direction: MotionDirection
) -> None:
    down = MotionConvention(unit=unit, direction=direction, y_axis=YAxis.DOWN).factors(size)
    up = MotionConvention(unit=unit, direction=direction, y_axis=YAxis.UP).factors(size)
    assert (up[0], up[1]) == (down[0], -down[1])
