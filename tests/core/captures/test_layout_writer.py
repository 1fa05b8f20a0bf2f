"""What `write_frame` writes is found, understood and read back, with no option."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.layout_writer import (
    FrameRole,
    write_frame,
    write_side_car,
)
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, NORMAL_BUFFERS, SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.conventions import DepthConvention, DepthKind
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.frames.storage import FLOAT_BUFFERS
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of, measure_set, open_shot

MakeCamera = Callable[..., CameraMetadata]
SIZE = (6, 8)
HALF_STEP = 2.0**-10
DEPTH_STEP = 1e-4
"""Relative: a device depth of 20 m behind a near plane of 5 cm, in float32."""
PLAIN = [layout for layout in LAYOUTS.values() if layout.tree is None]


def random_frame(number: int, camera: CameraMetadata, size: tuple[int, int] = SIZE) -> Frame:
    """Every buffer with random values; the upper row is sky."""
    generator = torch.Generator().manual_seed(number)
    buffers = {
        buffer: torch.rand(1, spec.channels, *size, generator=generator)
        for buffer, spec in BUFFER_SPECS.items()
        if buffer is not Buffer.SKY
    }
    for buffer in NORMAL_BUFFERS:
        buffers[buffer] = torch.nn.functional.normalize(buffers[buffer] - 0.5, dim=1)
        buffers[buffer][:, :, 0] = 0.0
    buffers[Buffer.DEPTH] = 1.0 + 20.0 * buffers[Buffer.DEPTH]
    buffers[Buffer.DEPTH][:, :, 0] = SKY_DEPTH_M
    for buffer in (Buffer.MOTION, Buffer.FORWARD, Buffer.POSITION):
        buffers[buffer] = 6.0 * buffers[buffer] - 3.0
    buffers[Buffer.OBJECT_ID] = (40 * buffers[Buffer.OBJECT_ID]).to(torch.int32)
    return Frame(
        number=number,
        gbuffer=GBuffer(buffers, f"made, frame {number}"),
        camera=camera,
        view=View(display=size),
    )


def only_reader(folder: Path, layout: str | None = None) -> FrameReader:
    options = ReadOptions(layout=layout)
    (shot,) = find_shots_of(folder, options)
    return measure_set(shot.frames, open_shot(shot, folder, options), jittered=True).reader


def assert_same(found: Frame, written: Frame) -> None:
    for buffer, image in found.gbuffer.items():
        expected = written.gbuffer[buffer]
        if buffer is Buffer.OBJECT_ID:
            assert torch.equal(image, expected)
            continue
        step = 1e-5 if buffer in FLOAT_BUFFERS else HALF_STEP
        step = DEPTH_STEP if buffer is Buffer.DEPTH else step
        assert torch.allclose(image, expected, atol=step, rtol=step), buffer


def declare(folder: Path, layout: Layout) -> None:
    """What an unverified layout asks for: the sense of its vectors, or its name if it has none."""
    motion = layout.conventions.motion
    text = f'[motion]\nunit = "{motion.unit}"\ndirection = "{motion.direction}"\n'
    text += f'y_axis = "{motion.y_axis}"\n'
    if Buffer.MOTION not in layout.buffers:
        text = f'layout = "{layout.name}"\n'
    (folder / "capture.toml").write_text(text)


def matrices(camera: CameraMetadata) -> dict[str, np.ndarray]:
    assert camera.world_to_camera is not None
    assert camera.world_to_ndc is not None
    return {
        "worldToCamera": camera.world_to_camera.numpy().astype(np.float32),
        "worldToNDC": camera.world_to_ndc.numpy().astype(np.float32),
    }


@pytest.mark.parametrize("layout", PLAIN, ids=lambda layout: layout.name)
@pytest.mark.parametrize("base", ["", "Scene", "szene é 8"])
def test_a_written_frame_is_detected_and_read_back(
    layout: Layout, base: str, tmp_path: Path, make_camera: MakeCamera
) -> None:
    if layout.name == "falcor" and not base:
        base = "Mogwai"
    frames = {n: random_frame(n, make_camera(yaw=0.1 * n)) for n in (0, 1)}
    for number, frame in frames.items():
        write_frame(
            tmp_path,
            frame,
            layout,
            number=number,
            base=base,
            attributes=matrices(frame.camera),
        )
    if not layout.verified:
        declare(tmp_path, layout)
    reader = only_reader(tmp_path)
    assert reader.layout.name == layout.name
    # what stands in for a buffer is not read beside it
    assert reader.stored == frozenset(layout.buffers) - layout.spare.keys()
    for number, frame in frames.items():
        assert_same(reader.read(number, reader.stored), frame)


def write_data_set(
    root: Path, layout: Layout, camera: MakeCamera, *, shot: str, scale: int = 2
) -> dict[FrameRole, dict[int, Frame]]:
    """Three frames of a shot at both resolutions, and the side-car."""
    cameras = {n: camera(yaw=0.1 * n, jitter_px=(0.25, -0.125 * n)) for n in range(3)}
    lr = {n: random_frame(n, replace(c, cut=n == 2)) for n, c in cameras.items()}
    big = (SIZE[0] * scale, SIZE[1] * scale)
    hr = {n: random_frame(n + 50, c, big) for n, c in cameras.items()}
    for role, frames in ((FrameRole.LR, lr), (FrameRole.HR, hr)):
        for number, frame in frames.items():
            write_frame(root, frame, layout, number=number, base=shot, role=role, scale=scale)
    write_side_car(root, lr.values(), layout, shot=shot, scale=scale)
    return {FrameRole.LR: lr, FrameRole.HR: hr}


@pytest.mark.parametrize("numbers", [(-2, -1), (0, 1), (1234567, 1234568)])
def test_every_frame_number_is_read_back(
    numbers: tuple[int, ...], tmp_path: Path, make_camera: MakeCamera
) -> None:
    for layout in ("rtsr", "extranet"):
        frames = {n: random_frame(abs(n), make_camera()) for n in numbers}
        for n, frame in frames.items():
            write_frame(tmp_path / layout, frame, LAYOUTS[layout], number=n, base="Scene")
        reader = only_reader(tmp_path / layout)
        assert reader.numbers == numbers
        for n, frame in frames.items():
            assert_same(reader.read(n, (Buffer.COLOR,)), frame)


@pytest.mark.parametrize("name", ["nss", "nsrd"])
def test_a_written_data_set_is_found_and_read_back(
    name: str, tmp_path: Path, make_camera: MakeCamera
) -> None:
    layout = LAYOUTS[name]
    root = tmp_path / "train"
    written = {s: write_data_set(root, layout, make_camera, shot=s) for s in ("0", "12")}
    shots = find_shots_of(tmp_path, ReadOptions())
    assert [s.name for s in shots] == ["train/0", "train/12"]
    for shot in shots:
        frames = written[shot.name.removeprefix("train/")]
        assert shot.hr is not None
        for role, files in ((FrameRole.LR, shot.frames), (FrameRole.HR, shot.hr)):
            reader = measure_set(
                files, open_shot(shot, tmp_path, ReadOptions()), jittered=role is FrameRole.LR
            ).reader
            assert reader.layout.name == name
            assert reader.numbers == (0, 1, 2)
            for number, frame in frames[role].items():
                assert_same(reader.read(number, reader.stored), frame)


def test_the_files_of_a_data_set_are_where_its_specification_has_them(
    tmp_path: Path, make_camera: MakeCamera
) -> None:
    write_data_set(tmp_path, LAYOUTS["nss"], make_camera, shot="0000")
    write_data_set(tmp_path, LAYOUTS["nsrd"], make_camera, shot="0", scale=4)
    found = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*0.exr")}
    assert found == {
        *(f"x2/{b}/0000/0000.exr" for b in ("color", "depth", "motion")),
        *(f"{b}/0000/0000.exr" for b in ("ground_truth", "motion_gt")),
        *(f"X4/0/{b}/0.exr" for b in ("Irradiance", "Normal", "Depth", "MV")),
        *(f"GT/0/{b}/0.exr" for b in ("Irradiance", "BRDF", "Emission_Sky")),
    }
    assert (tmp_path / "0000.json").is_file()


def test_cameras_of_a_data_set_come_back_from_its_side_car(
    tmp_path: Path, make_camera: MakeCamera
) -> None:
    written = write_data_set(tmp_path, LAYOUTS["nss"], make_camera, shot="0000")[FrameRole.LR]
    (shot,) = find_shots_of(tmp_path, ReadOptions())
    rows = open_shot(shot, tmp_path, ReadOptions()).declarations.side_car
    for number, frame in written.items():
        camera = rows[number].metadata()
        assert camera.world_to_camera is not None
        assert camera.world_to_ndc is not None
        assert torch.allclose(camera.world_to_camera, frame.camera.world_to_camera, atol=1e-9)
        assert torch.allclose(camera.world_to_ndc, frame.camera.world_to_ndc, atol=1e-9)
        assert camera.jitter_px == frame.camera.jitter_px
        assert camera.cut == (number == 2)
        assert camera.pre_exposure == 1.0


def test_reversed_device_depth_is_told_by_the_side_car(
    tmp_path: Path, make_camera: MakeCamera
) -> None:
    nss = LAYOUTS["nss"]
    depth = DepthConvention(kind=DepthKind.DEVICE, reversed=True)
    layout = replace(nss, conventions=replace(nss.conventions, depth=depth))
    written = write_data_set(tmp_path, layout, make_camera, shot="0000")[FrameRole.LR]
    stored = read_channels(tmp_path / "x2" / "depth" / "0000" / "0000.exr", ["R"])["R"]
    assert stored[0].max() == 0.0
    assert json.loads((tmp_path / "0000.json").read_text())["ReverseZ"] is True
    (shot,) = find_shots_of(tmp_path, ReadOptions())
    reader = measure_set(
        shot.frames, open_shot(shot, tmp_path, ReadOptions()), jittered=True
    ).reader
    assert_same(reader.read(0, (Buffer.DEPTH,)), written[0])


def test_a_side_car_needs_cameras(tmp_path: Path) -> None:
    frame = random_frame(3, CameraMetadata())
    with pytest.raises(ConfigError, match=r"clip\.json: .*frame 3 has no camera matrices"):
        write_side_car(tmp_path, [frame], LAYOUTS["nss"], shot="clip")


def test_layouts_without_a_side_car_write_none(tmp_path: Path) -> None:
    assert write_side_car(tmp_path, [], LAYOUTS["nsrd"], shot="0") is None


def test_only_buffers_that_frame_and_layout_both_have_are_written(
    tmp_path: Path, make_camera: MakeCamera
) -> None:
    frame = random_frame(1, make_camera())
    small = replace(frame, gbuffer=frame.gbuffer.only((Buffer.DEPTH, Buffer.REACTIVE)))
    files = write_frame(tmp_path, small, LAYOUTS["extranet"], number=7, base="Bunker")
    assert [f.name for f in files] == ["BunkerSceneDepth.0007.exr"]


def test_colours_are_half_positions_float_and_object_ids_whole(
    tmp_path: Path, make_camera: MakeCamera
) -> None:
    frame = random_frame(1, make_camera())
    (path,) = write_frame(tmp_path, frame, LAYOUTS["rtsr"], number=1, base="f")
    planes = read_channels(path, read_header(path).channels)
    assert {planes[c].dtype.name for c in ("R", "albedo.R", "normal.X", "nov")} == {"float16"}
    assert {planes[c].dtype.name for c in ("depth.Z", "motion.X", "position.Z")} == {"float32"}
    assert planes["objectid"].dtype == np.uint32


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_the_first_place_of_every_component_is_a_name_that_can_be_written(layout: Layout) -> None:
    for components in layout.buffers.values():
        for component in components:
            place = next(component.channels).place
            assert not set("*?[") & set(place.channel)
            # `?*` begins a name that no other buffer shares, and is written as the base name
            assert place.file == "*" or not set("*?[") & set(place.file.removeprefix("?*"))
