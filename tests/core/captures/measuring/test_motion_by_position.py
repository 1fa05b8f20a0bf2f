"""World positions decide how vectors are stored, where colour cannot tell as well."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.decision import measure_and_decide
from rtsr_cli.core.captures.measuring.motion_by_position import prove_motion
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Axes, MotionConvention, MotionDirection, MotionUnit, YAxis

Array = NDArray[np.float64]
SIZE = (48, 64)
FRAMES = (1, 2, 3, 4)
LENS = np.array([[1.2, 0, 0, 0], [0, 1.6, 0, 0], [0, 0, -1, -1], [0, 0, -0.1, 0]], dtype=float)
C = MotionDirection.CURRENT_MINUS_PREVIOUS
UNREAL = MotionConvention(unit=MotionUnit.UV, direction=C, y_axis=YAxis.UP)


def look(number: int, *, moves: bool) -> tuple[Array, Array]:
    """A camera that goes sideways, forth and up, ever faster, and turns."""
    t = 0.02 * number + 0.015 * number * number if moves else 0.0
    view = np.eye(4)
    c, s = math.cos(0.4 * t), math.sin(0.4 * t)
    view[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    view[3, :3] = -np.array([0.6 * t, 0.3 * t * t, -0.5 * t]) @ view[:3, :3]
    return view, view @ LENS


def see(matrices: tuple[Array, Array]) -> Array:
    """World positions, h x w x 3, of a wavy wall of ten metres' distance."""
    height, width = SIZE
    y, x = np.mgrid[0:height, 0:width] + 0.5
    depth = 10.0 + 2.0 * np.sin(x / 9.0) + np.cos(y / 7.0)
    rays = np.stack([(2 * x / width - 1) / 1.2, (1 - 2 * y / height) / 1.6, -np.ones(SIZE)], -1)
    points = np.concatenate([rays * depth[..., None], np.ones((*SIZE, 1))], -1)
    return (points @ np.linalg.inv(matrices[0]))[..., :3]


def project(world: Array, matrices: tuple[Array, Array]) -> Array:
    clip = np.concatenate([world, np.ones((*SIZE, 1))], -1) @ matrices[1]
    x = (clip[..., 0] / clip[..., 3] * 0.5 + 0.5) * SIZE[1]
    y = (0.5 - 0.5 * clip[..., 1] / clip[..., 3]) * SIZE[0]
    return np.stack([x, y])


def store(motion_px: Array, convention: MotionConvention) -> Array:
    """Invert `MotionConvention.pixels`."""
    stored = motion_px / np.array(convention.factors(SIZE))[:, None, None]
    stored = stored if convention.axes is Axes.XY else stored[::-1]
    return stored + convention.zero


def write_shot(
    folder: Path, convention: MotionConvention, *, moves: bool = True, mover: bool = False
) -> FrameReader:
    """Frames whose colour is the same everywhere, so that no picture tells."""
    cameras = {n: look(n, moves=moves) for n in (0, *FRAMES, 5)}
    for number in FRAMES:
        world = see(cameras[number])
        there = number + (1 if convention.direction.to_next else -1)
        motion = project(world, cameras[there]) - project(world, cameras[number])
        if mover:
            motion[:, :, : SIZE[1] // 4] += 7.0
        stored = store(motion, convention)
        planes = {c: np.full(SIZE, 0.5) for c in "RGB"}
        planes |= {f"position.{c}": world[..., i] for i, c in enumerate("XYZ")}
        planes |= {f"motion.{c}": stored[i] for i, c in enumerate("XY")}
        matrices = dict(zip(("worldToCamera", "worldToNDC"), cameras[number], strict=True))
        write_exr(
            folder / f"f.{number:04d}.exr",
            {name: plane.astype(np.float32) for name, plane in planes.items()},
            attributes={n: m.astype(np.float32) for n, m in matrices.items()},
        )
    frames = collect_frame_set(folder)
    assert frames is not None
    return open_frames(frames, layout=None, capture=CaptureDeclaration(), side_car={})


def read(reader: FrameReader) -> Mapping[int, Mapping[Buffer, Tensor]]:
    buffers = (Buffer.POSITION, Buffer.MOTION)
    return {n: reader.read_raw(n, buffers) for n in FRAMES}


@pytest.mark.parametrize(
    "convention",
    [
        MotionConvention(),
        MotionConvention(direction=C),
        MotionConvention(y_axis=YAxis.UP),
        MotionConvention(axes=Axes.YX),
        UNREAL,
        MotionConvention(unit=MotionUnit.NDC),
        MotionConvention(scale=0.25),
        MotionConvention(direction=MotionDirection.NEXT_MINUS_CURRENT),
    ],
    ids=str,
)
def test_positions_leave_the_reading_that_files_have(
    tmp_path: Path, convention: MotionConvention
) -> None:
    reader = write_shot(tmp_path, convention)
    assert prove_motion(reader, read(reader), 1.0, MotionConvention()) == convention


def test_things_that_move_by_themselves_do_not_count(tmp_path: Path) -> None:
    reader = write_shot(tmp_path, UNREAL, mover=True)
    assert prove_motion(reader, read(reader), 1.0, MotionConvention()) == UNREAL


def test_a_camera_that_stands_still_proves_nothing(tmp_path: Path) -> None:
    reader = write_shot(tmp_path, UNREAL, moves=False)
    assert prove_motion(reader, read(reader), 1.0, MotionConvention()) is None


def test_vectors_of_something_else_are_proven_by_nothing(tmp_path: Path) -> None:
    reader = write_shot(tmp_path, UNREAL)
    chooser = torch.Generator().manual_seed(1)
    stored = {
        n: {**b, Buffer.MOTION: torch.rand(1, 2, *SIZE, generator=chooser)}
        for n, b in read(reader).items()
    }
    assert prove_motion(reader, stored, 1.0, MotionConvention()) is None


@pytest.mark.parametrize("convention", [UNREAL, MotionConvention(direction=C)], ids=str)
def test_where_colour_ties_positions_decide_what_is_read(
    tmp_path: Path, convention: MotionConvention
) -> None:
    reader = write_shot(tmp_path, convention)
    # positions tell where things are, and stick to them as pictures: colour alone is left
    settled = measure_and_decide(reader, CaptureDeclaration(), named=False)
    assert settled.measured.geometry == "world positions"
    assert settled.reader.conventions.motion == convention
    assert not settled.motion_undecided
    bare = {b: c for b, c in reader.binding.items() if b is not Buffer.POSITION}
    blind = measure_and_decide(replace(reader, binding=bare), CaptureDeclaration(), named=False)
    assert blind.measured.best is None
