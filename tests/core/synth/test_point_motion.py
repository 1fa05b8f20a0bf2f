"""Motion against poses and cameras, by another route than the renderer's."""

from __future__ import annotations

import numpy as np
import pytest

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.synth.render import render_frame

SIZE = (64, 96)
SEEDS = (0, 1, 2, 3, 4)
TOLERANCE_PX = 0.01


def moved_world(scene, frame, values, step):
    """Where each pixel's surface point is `step` frames later, by its body's poses in float64."""
    world, ids = values(frame, Buffer.POSITION), values(frame, Buffer.OBJECT_ID)[0]
    moved = world.copy()
    for body in scene.bodies:
        seen = ids == body.object_id
        now, then = (body.motion.pose(frame.number + s) for s in (0, step))
        points = np.concatenate([world[:, seen], np.ones((1, seen.sum()))])
        moved[:, seen] = (points.T @ np.linalg.inv(now) @ then)[:, :3].T
    return moved


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("buffer", "step"), [(Buffer.MOTION, -1), (Buffer.FORWARD, 1)])
def test_motion_leads_to_where_the_surface_point_was_or_will_be(
    scene_of, frame_of, project, values, centres, seed, buffer, step
):
    scene, frame = scene_of(seed), frame_of(seed, 5)
    surface = values(frame, Buffer.DEPTH)[0] < SKY_DEPTH_M
    other = scene.camera.metadata(5 + step, SIZE)
    expected = project(other, moved_world(scene, frame, values, step), SIZE)
    error = np.abs(centres + values(frame, buffer) - expected)[:, surface]
    assert error.max() < TOLERANCE_PX


def test_scenes_have_moving_and_turning_bodies_in_view(scene_of, frame_of, values):
    for seed in SEEDS:
        scene, seen = scene_of(seed), set(np.unique(values(frame_of(seed, 5), Buffer.OBJECT_ID)))
        moving = [b for b in scene.bodies if b.motion.moving and b.object_id in seen]
        if any(b.motion.spin != (0.0, 0.0, 0.0) for b in moving):
            return
    pytest.fail("no seed shows a body that turns")


@pytest.mark.parametrize("seed", SEEDS)
def test_the_previous_frame_shows_the_same_point_of_the_same_body(
    scene_of, frame_of, values, centres, seed
):
    scene, now, before = scene_of(seed), frame_of(seed, 5), frame_of(seed, 4)
    ids, ids_before = (values(f, Buffer.OBJECT_ID)[0] for f in (now, before))
    expected = moved_world(scene, now, values, -1)
    there = np.floor(centres + values(now, Buffer.MOTION)).astype(int)
    column, row = there
    inside = (column >= 0) & (column < SIZE[1]) & (row >= 0) & (row < SIZE[0]) & (ids > 0)
    column, row = column.clip(0, SIZE[1] - 1), row.clip(0, SIZE[0] - 1)
    same = inside & (ids_before[row, column] == ids)
    assert same.sum() > 0.9 * inside.sum()
    found = values(before, Buffer.POSITION)[:, row, column]
    # half a pixel diagonal, seen at an angle of up to 75 degrees
    focal = float(now.camera.projection[0, 0])
    footprint = values(before, Buffer.DEPTH)[0][row, column] * 2 / (focal * SIZE[1])
    distance = np.linalg.norm(found - expected, axis=0)
    assert np.mean(distance[same] < 0.71 * footprint[same] / np.cos(np.radians(75))) > 0.95


@pytest.mark.parametrize("seed", SEEDS)
def test_forward_and_backward_vectors_are_each_others_inverse(frame_of, values, centres, seed):
    now, after = frame_of(seed, 5), frame_of(seed, 6)
    forward, backward = values(now, Buffer.FORWARD), values(after, Buffer.MOTION)
    column, row = np.floor(centres + forward).astype(int)
    inside = (column >= 0) & (column < SIZE[1]) & (row >= 0) & (row < SIZE[0])
    column, row = column.clip(0, SIZE[1] - 1), row.clip(0, SIZE[0] - 1)
    ids, ids_after = values(now, Buffer.OBJECT_ID)[0], values(after, Buffer.OBJECT_ID)[0]
    same = inside & (ids == ids_after[row, column])
    difference = np.abs(forward + backward[:, row, column]).max(0)[same]
    # the vector is read up to half a pixel beside the point
    assert np.median(difference) < 0.05


def test_what_does_not_move_has_motion_zero_exactly(scene_of, values):
    scene = scene_of(0).still()
    frame = render_frame(scene, 5, SIZE, buffers=(Buffer.MOTION, Buffer.FORWARD, Buffer.OBJECT_ID))
    moving = [b.object_id for b in scene.bodies if b.motion.moving]
    static = ~np.isin(values(frame, Buffer.OBJECT_ID)[0], moving)
    for buffer in (Buffer.MOTION, Buffer.FORWARD):
        assert not values(frame, buffer)[:, static].any()
        assert values(frame, buffer)[:, ~static].any()


def test_sky_moves_with_the_rotation_of_the_camera_only(scene_of, frame_of, values, centres):
    scene, frame = scene_of(4), frame_of(4, 5)
    sky = values(frame, Buffer.DEPTH)[0] == SKY_DEPTH_M
    assert sky.sum() > 100
    now, then = (scene.camera.metadata(n, SIZE) for n in (5, 4))
    focal = now.projection.numpy()
    x = (2 * centres[0] / SIZE[1] - 1) / focal[0, 0]
    y = (1 - 2 * centres[1] / SIZE[0]) / focal[1, 1]
    ray = np.stack([x, y, -np.ones_like(x)])
    turn = now.world_to_camera.numpy()[:3, :3].T @ then.world_to_camera.numpy()[:3, :3]
    seen = np.einsum("ihw,ij->jhw", ray, turn)
    expected = np.stack(
        [
            (seen[0] / -seen[2] * focal[0, 0] * 0.5 + 0.5) * SIZE[1],
            (0.5 - 0.5 * seen[1] / -seen[2] * focal[1, 1]) * SIZE[0],
        ]
    )
    error = np.abs(centres + values(frame, Buffer.MOTION) - expected)[:, sky]
    assert error.max() < TOLERANCE_PX


def test_motion_does_not_contain_jitter(scene_of, frame_of, values):
    plain = frame_of(3, 5)
    jittered = render_frame(scene_of(3), 5, SIZE, jitter_px=(0.3, -0.4))
    same = values(plain, Buffer.OBJECT_ID) == values(jittered, Buffer.OBJECT_ID)
    difference = np.abs(values(plain, Buffer.MOTION) - values(jittered, Buffer.MOTION))
    assert np.median(difference.max(0)[same[0]]) < 0.02
