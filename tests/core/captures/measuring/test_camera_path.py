"""Matrices of every frame: one that is no camera like the others, or lies off their path."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.captures.measuring.camera_path import CameraRun, find_form_fault, find_strays

Array = NDArray[np.float64]
LENS = np.array([[1.2, 0, 0, 0], [0, 1.9, 0, 0], [0, 0, -1, -1], [0, 0, -0.1, 0]], dtype=float)
ODD = 57


def look(eye: Array, yaw: float) -> Array:
    """World to camera of a camera that stands upright."""
    view = np.eye(4)
    c, s = np.cos(yaw), np.sin(yaw)
    view[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    view[3, :3] = -eye @ view[:3, :3]
    return view


def bent(t: Array) -> Array:
    return np.stack([0.1 * t, 1.6 + 0.1 * np.sin(0.2 * t), 3.0 * np.cos(0.03 * t)], 1)


def make_run(eyes: Array, yaws: Array) -> CameraRun:
    # as float32 matrices of a header
    views = np.stack([look(e, y) for e, y in zip(eyes, yaws, strict=True)]).astype(np.float32)
    ndcs = (views.astype(float) @ LENS).astype(np.float32)
    return CameraRun(
        numbers=np.arange(1, len(eyes) + 1), views=views.astype(float), ndcs=ndcs.astype(float)
    )


@pytest.fixture
def run() -> CameraRun:
    t = np.arange(200.0)
    return make_run(bent(t), 0.01 * t)


def alter(run: CameraRun, change: Callable[[Array], Array]) -> CameraRun:
    """The same with the matrices of one frame changed: both, by what changes the view."""
    views, ndcs = run.views.copy(), run.ndcs.copy()
    views[ODD - 1] = change(views[ODD - 1])
    ndcs[ODD - 1] = views[ODD - 1] @ LENS
    return replace(run, views=views, ndcs=ndcs)


def find_stray_frames(run: CameraRun, *runs: range) -> str:
    return find_strays(run, runs or [run.numbers.tolist()])


def test_right_matrices_of_any_path_have_no_fault(run: CameraRun) -> None:
    assert find_form_fault(run, mirrored=False) == ""
    assert find_stray_frames(run) == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda v: v.T, "last column"),
        (lambda v: v @ np.diag([1.0, 2.0, 1.0, 1.0]), "shears"),
        (lambda v: v @ np.diag([-1.0, 1.0, 1.0, 1.0]), "handedness"),
        (lambda v: np.diag([1.0, -1.0, 1.0, 1.0]) @ v, "handedness"),
        (lambda v: v[:, [1, 0, 2, 3]], "handedness"),
    ],
)
def test_one_frame_of_another_form_is_named(
    run: CameraRun, change: Callable[[Array], Array], said: str
) -> None:
    text = find_form_fault(alter(run, change), mirrored=False)
    assert f"of frame {ODD}," in text
    assert said in text


def test_a_view_that_its_clip_space_does_not_belong_to_is_named(run: CameraRun) -> None:
    views = run.views.copy()
    views[ODD - 1] = views[ODD]
    text = find_form_fault(replace(run, views=views), mirrored=False)
    assert f"of frame {ODD}, worldToNDC is not worldToCamera times" in text


def test_worlds_that_mirror_everywhere_are_alike(run: CameraRun) -> None:
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored = replace(run, views=flip @ run.views, ndcs=flip @ run.ndcs)
    assert find_form_fault(mirrored, mirrored=True) == ""


@pytest.mark.parametrize("other", [1, 55, 56, 58, 59, 199])
def test_the_view_of_another_frame_lies_off_the_path(run: CameraRun, other: int) -> None:
    text = find_stray_frames(alter(run, lambda _: run.views[other - 1]))
    assert f"of frame {ODD} lies off" in text


@pytest.mark.parametrize(
    "change", [np.linalg.inv, lambda v: v @ np.diag([-1.0, 1.0, -1.0, 1.0])], ids=["inverse", "+z"]
)
def test_an_inverse_or_turned_view_lies_off_the_path(
    run: CameraRun, change: Callable[[Array], Array]
) -> None:
    assert f"of frame {ODD} lies off" in find_stray_frames(alter(run, change))


@pytest.mark.parametrize(
    "x",
    [
        lambda t: np.zeros_like(t),
        lambda t: np.abs(t - 100.0),
        lambda t: np.where(t < 100.0, 0.0, 50.0),
        lambda t: np.maximum(t - 100.0, 0.0) ** 2,
        lambda t: t // 2,
        lambda t: t % 2,
        lambda t: np.random.default_rng(3).normal(size=t.shape),
    ],
    ids=["still", "turns back", "cut", "starts", "on twos", "to and fro", "shakes"],
)
def test_cameras_that_start_stop_cut_or_shake_lie_on_their_paths(
    x: Callable[[Array], Array],
) -> None:
    t = np.arange(400.0)
    moved = x(t)
    run = make_run(np.stack([moved, 0.5 * moved, np.ones_like(t)], 1), 0.05 * moved)
    assert find_stray_frames(run) == ""


def test_frames_of_another_shot_are_no_neighbours(run: CameraRun) -> None:
    cut = alter(run, lambda _: run.views[0])
    assert find_stray_frames(cut, range(1, ODD), range(ODD, ODD + 1), range(ODD + 1, 201)) == ""


def test_ten_thousand_frames_take_no_time() -> None:
    t = np.arange(10_000.0)
    run = make_run(bent(t), 0.01 * t)
    start = time.perf_counter()
    assert find_form_fault(run, mirrored=False) == ""
    assert find_stray_frames(run) == ""
    assert time.perf_counter() - start < 2.0
