"""Buffers of a frame against its camera and against each other."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import view_cosine_from_camera
from rtsr_cli.core.imaging.color import luminance
from rtsr_cli.core.imaging.resampling import box_mean, decimate, sample_jitter
from rtsr_cli.core.synth import render
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.render import ALL_BUFFERS, render_frame, render_reference

SIZE = (64, 96)
SEEDS = (0, 1, 2, 3, 4)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.31, -0.22)])
def test_positions_project_to_the_samples(scene_of, project, values, centres, seed, jitter):
    frame = render_frame(
        scene_of(seed), 3, SIZE, jitter_px=jitter, buffers=(Buffer.POSITION, Buffer.DEPTH)
    )
    surface = values(frame, Buffer.DEPTH)[0] < SKY_DEPTH_M
    found = project(frame.camera, values(frame, Buffer.POSITION), SIZE)
    expected = centres + np.array(jitter)[:, None, None]
    assert np.abs(found - expected)[:, surface].max() < 0.005


@pytest.mark.parametrize("seed", SEEDS)
def test_depth_is_the_distance_along_the_view_axis(frame_of, values, seed):
    frame = frame_of(seed, 5)
    depth, world = values(frame, Buffer.DEPTH)[0], values(frame, Buffer.POSITION)
    surface = depth < SKY_DEPTH_M
    matrix = frame.camera.world_to_camera.numpy()
    z = np.einsum("ihw,i->hw", world, matrix[:3, 2]) + matrix[3, 2]
    np.testing.assert_allclose(-z[surface], depth[surface], rtol=2e-6)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("buffer", [Buffer.NORMAL, Buffer.GEONORMAL])
def test_normals_have_unit_length_and_face_the_camera(frame_of, values, seed, buffer):
    frame = frame_of(seed, 5)
    surface = values(frame, Buffer.DEPTH)[0] < SKY_DEPTH_M
    length = np.linalg.norm(values(frame, buffer), axis=0)
    np.testing.assert_allclose(length[surface], 1.0, atol=1e-5)
    cosine = view_cosine_from_camera(frame.gbuffer[buffer], frame.camera, frame.view)
    assert cosine is not None
    assert cosine[0, 0].numpy()[surface].min() > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_geometry_normals_stand_on_the_surface(frame_of, values, seed):
    frame = frame_of(seed, 5)
    world, normal = values(frame, Buffer.POSITION), values(frame, Buffer.GEONORMAL)
    ids = values(frame, Buffer.OBJECT_ID)[0]
    step = world[:, :, 1:] - world[:, :, :-1]
    flat = (ids[:, 1:] == ids[:, :-1]) & (ids[:, 1:] > 0)
    flat &= np.abs(normal[:, :, 1:] - normal[:, :, :-1]).max(0) == 0
    # two parallel faces of one body can lie beside each other; hence not all
    step, normal = step[:, flat], normal[:, :, 1:][:, flat]
    leaning = np.abs((step * normal).sum(0)) / np.linalg.norm(step, axis=0)
    assert flat.sum() > 500
    assert np.mean(leaning < 1e-3) > 0.97


def test_normal_maps_change_the_shading_normal_only(frame_of, values):
    frame = frame_of(0, 5)
    difference = np.abs(values(frame, Buffer.NORMAL) - values(frame, Buffer.GEONORMAL)).max(0)
    ground = values(frame, Buffer.OBJECT_ID)[0] == 1
    assert np.mean(difference[ground] > 0.01) > 0.3
    up = values(frame, Buffer.GEONORMAL)[:, ground]
    np.testing.assert_allclose(up, np.array([[0.0], [0.0], [1.0]]) * np.ones_like(up), atol=1e-6)


def test_sky_holds_the_values_that_stand_for_nothing(frame_of, values):
    frame = frame_of(4, 5)
    sky = values(frame, Buffer.OBJECT_ID)[0] == 0
    assert 0 < sky.sum() < sky.size
    np.testing.assert_array_equal(sky, values(frame, Buffer.DEPTH)[0] == SKY_DEPTH_M)
    for buffer in (
        Buffer.ALBEDO,
        Buffer.NORMAL,
        Buffer.GEONORMAL,
        Buffer.ROUGHNESS,
        Buffer.METALLIC,
        Buffer.EMISSION,
        Buffer.POSITION,
    ):
        assert not values(frame, buffer)[:, sky].any(), buffer
    assert values(frame, Buffer.COLOR)[:, sky].min() > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_every_buffer_is_finite_and_in_its_range(frame_of, values, seed):
    frame = frame_of(seed, 5)
    for buffer in ALL_BUFFERS:
        assert np.isfinite(values(frame, buffer)).all(), buffer
    for buffer in (Buffer.ALBEDO, Buffer.ROUGHNESS, Buffer.METALLIC):
        assert values(frame, buffer).min() >= 0
        assert values(frame, buffer).max() <= 1
    emission = values(frame, Buffer.EMISSION)
    assert (values(frame, Buffer.COLOR) >= emission - 1e-6).all()


def test_seeds_give_different_scenes_of_plausible_brightness(frame_of):
    medians = [float(luminance(frame_of(s, 5).gbuffer[Buffer.COLOR]).median()) for s in SEEDS]
    assert all(0.1 < median < 0.6 for median in medians)
    brightest = max(float(frame_of(s, 5).gbuffer[Buffer.COLOR].max()) for s in SEEDS)
    assert brightest > 2.0
    assert len({round(m, 3) for m in medians}) == len(SEEDS)


@pytest.mark.parametrize("offset", [(0, 0), (3, 1)])
def test_a_decimated_capture_is_the_small_frame_with_that_jitter(scene_of, offset):
    scene, block, small = scene_of(1), 4, (16, 24)
    dense = render_frame(scene, 2, (small[0] * block, small[1] * block))
    jitter = (sample_jitter(offset[0], block), sample_jitter(offset[1], block))
    direct = render_frame(scene, 2, small, jitter_px=jitter)
    for buffer in ALL_BUFFERS:
        expected = decimate(dense.gbuffer[buffer], block, offset)
        if buffer in {Buffer.MOTION, Buffer.FORWARD}:
            expected = expected / block
        torch.testing.assert_close(direct.gbuffer[buffer], expected, rtol=1e-4, atol=1e-5)


def test_the_reference_is_the_mean_of_the_samples_of_a_pixel(scene_of):
    scene, small = scene_of(2), (20, 30)
    dense = render_frame(scene, 1, (60, 90), buffers=(Buffer.COLOR,)).gbuffer[Buffer.COLOR]
    reference = render_reference(scene, 1, small, samples=3)
    torch.testing.assert_close(reference, box_mean(dense, 3), rtol=1e-4, atol=1e-5)


def test_the_same_seed_gives_the_same_bytes_whatever_the_threads(scene_of, monkeypatch):
    monkeypatch.setattr(render, "STRIP_PIXELS", 2000)
    first = render_frame(scene_of(3), 2, SIZE, threads=1).gbuffer
    again = render_frame(draw_scene(3), 2, SIZE, threads=3).gbuffer
    for buffer in ALL_BUFFERS:
        assert torch.equal(first[buffer], again[buffer]), buffer


def test_strips_leave_no_trace(frame_of, scene_of, monkeypatch):
    whole = frame_of(3, 5).gbuffer
    monkeypatch.setattr(render, "STRIP_PIXELS", 1500)
    parts = render_frame(scene_of(3), 5, SIZE).gbuffer
    for buffer in ALL_BUFFERS:
        torch.testing.assert_close(parts[buffer], whole[buffer], rtol=1e-4, atol=1e-5)


def test_sizes_need_not_fill_tiles(scene_of):
    frame = render_frame(scene_of(0), 1, (17, 33))
    assert frame.size == (17, 33)
    assert torch.isfinite(frame.gbuffer[Buffer.COLOR]).all()
