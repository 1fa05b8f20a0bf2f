from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.cameras import CameraRow
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.header_files import HeaderFiles, read_headers
from rtsr_cli.core.captures.layout_files import load_layout
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.selection import format_ranges

Write = Callable[..., Path]
Open = Callable[..., FrameReader]


def write_split(write_frames: Write, folder: Path, color: list[int], depth: list[int]) -> Path:
    """Two file sequences: `beauty` with radiance, `z` with depth."""
    write_frames(folder, color, name="beauty.{:04d}.exr", only=("R", "G", "B"))
    return write_frames(folder, depth, name="z.{:04d}.exr", only=("depth",))


def test_missing_frames_are_listed_for_each_sequence_that_lacks_them(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_split(write_frames, tmp_path, [1, 2, 3, 7, 8], [1, 3, 4, 5, 6, 7, 8])
    with pytest.raises(FrameFolderError) as caught:
        open_folder(tmp_path)
    message = str(caught.value)
    assert message.startswith(str(tmp_path))
    assert "'beauty' lacks 4-6" in message
    assert "'z' lacks 2" in message
    assert "--on-missing" in message


def test_skipping_keeps_the_frames_that_every_sequence_has(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_split(write_frames, tmp_path, [1, 2, 3, 5], [1, 3, 4, 5])
    reader = open_folder(tmp_path, on_missing=MissingPolicy.SKIP)
    assert reader.numbers == (1, 3, 5)
    assert reader.held == {}


def test_holding_lets_the_last_complete_frame_stand_in_and_resets_history(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [2, 3, 6])
    reader = open_folder(tmp_path, on_missing=MissingPolicy.HOLD)
    assert reader.numbers == (2, 3, 4, 5, 6)
    assert reader.held == {4: 3, 5: 3}
    assert reader.resets == {4, 5, 6}
    held, source = reader.read(5, (Buffer.COLOR,)), reader.read(3, (Buffer.COLOR,))
    assert held.number == 5
    assert torch.equal(held.gbuffer[Buffer.COLOR], source.gbuffer[Buffer.COLOR])


def test_holding_has_nothing_to_hold_before_the_first_complete_frame(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_split(write_frames, tmp_path, [1, 2, 3], [2, 3])
    assert open_folder(tmp_path, on_missing=MissingPolicy.HOLD).numbers == (2, 3)


def test_numbers_in_tens_are_complete_where_that_is_declared(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [10, 20, 30])
    reader = open_folder(tmp_path, capture={"frame_step": 10})
    assert reader.numbers == (10, 20, 30)
    assert reader.step == 10
    with pytest.raises(FrameFolderError, match="lacks 11-19, 21-29"):
        open_folder(tmp_path)


def test_a_hole_in_numbers_in_tens_is_found(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [10, 20, 40])
    with pytest.raises(FrameFolderError, match="'frame' lacks 30"):
        open_folder(tmp_path, capture={"frame_step": 10})


def test_a_number_beside_the_declared_step_is_missed_where_one_sequence_lacks_it(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [10, 20, 25], name="a.{:04d}.exr", only=["R", "G", "B"])
    write_frames(tmp_path, [10, 20], name="b.{:04d}.exr", only=["albedo"])
    with pytest.raises(FrameFolderError, match="'b' lacks 25"):
        open_folder(tmp_path, capture={"frame_step": 10})


def test_a_channel_that_is_missing_in_the_middle_is_named_with_buffer_and_frames(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    def drop(number: int, channels: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in channels.items() if number not in (2, 3) or k != "normal.Y"}

    write_frames(tmp_path, [1, 2, 3, 4], change=drop)
    reader = open_folder(tmp_path)
    assert Buffer.NORMAL not in reader.binding
    assert Buffer.DEPTH in reader.binding
    (warning,) = reader.warnings
    assert "'normal'" in warning
    assert "frames 2-3" in warning
    assert "'normal.Y'" in warning


def test_frames_of_different_sizes_are_refused_with_both_sizes(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1, 2], size=(6, 8))
    write_frames(tmp_path, [3], size=(6, 10))
    with pytest.raises(FrameFolderError) as caught:
        open_folder(tmp_path)
    assert "frame 1 is 8 x 6" in str(caught.value)
    assert "frame 3 is 10 x 6" in str(caught.value)


def test_sequences_of_different_sizes_are_refused(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1], size=(6, 8), name="beauty.{}.exr", only=("R", "G", "B"))
    write_frames(tmp_path, [1], size=(12, 16), name="z.{}.exr", only=("depth",))
    with pytest.raises(FrameFolderError, match="'beauty' frame 1 is 8 x 6, 'z' frame 1 is 16 x 12"):
        open_folder(tmp_path)


def test_data_windows_that_change_are_read_into_the_display_window(
    tmp_path: Path, open_folder: Open
) -> None:
    display = PixelWindow(left=0, top=0, width=4, height=3)
    for number, left in ((1, 0), (2, 2)):
        planes: dict[str, Any] = {c: np.full((2, 2), number, np.float16) for c in "RGB"}
        planes["depth.Z"] = np.full((2, 2), 7.0, np.float32)
        data = PixelWindow(left=left, top=1, width=2, height=2)
        path = tmp_path / f"f.{number}.exr"
        write_exr(path, planes, data_window=data, display_window=display)
    reader = open_folder(tmp_path)
    assert reader.size == (3, 4)
    gbuffer = reader.read(2, (Buffer.COLOR, Buffer.DEPTH)).gbuffer
    assert gbuffer[Buffer.COLOR][0, 0].tolist() == [[0, 0, 0, 0], [0, 0, 2, 2], [0, 0, 2, 2]]
    sky = SKY_DEPTH_M
    assert gbuffer[Buffer.DEPTH][0, 0].tolist() == [[sky] * 4, [sky, sky, 7, 7], [sky, sky, 7, 7]]


@pytest.mark.parametrize(
    ("rule", "size", "corner"), [(None, (10, 20), (0, 0)), ("data", (6, 8), (2, 4))]
)
def test_a_crop_is_read_in_its_image_plane_or_alone_where_that_is_declared(
    tmp_path: Path,
    write_frames: Write,
    open_folder: Open,
    rule: str | None,
    size: tuple[int, int],
    corner: tuple[int, int],
) -> None:
    data = PixelWindow(left=3, top=2, width=8, height=6)
    display = PixelWindow(left=-1, top=0, width=20, height=10)
    write_frames(tmp_path, [1, 2], size=(6, 8), data_window=data, display_window=display)
    reader = open_folder(tmp_path, capture={} if rule is None else {"region": rule})
    assert reader.size == size
    assert (reader.view.display, reader.view.top, reader.view.left) == ((10, 20), *corner)


def test_header_matrices_jitter_and_cuts_make_the_camera(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    matrix = (np.arange(16) + 50 * np.eye(4).ravel()).reshape(4, 4).astype(np.float32)
    write_frames(tmp_path, [1, 2], attributes={"worldToCamera": matrix, "worldToNDC": 2 * matrix})
    declared = {"jitter_px": [0.25, -0.5], "camera_cuts": [2]}
    reader = open_folder(tmp_path, capture=declared)
    camera = reader.cameras[2]
    assert reader.has_camera
    assert camera.world_to_ndc is not None
    assert camera.world_to_ndc[1].tolist() == [8.0, 110.0, 12.0, 14.0]
    assert camera.jitter_px == (0.25, -0.5)
    assert camera.cut
    assert not reader.cameras[1].cut
    assert reader.resets == {2}


def test_declared_jitter_is_that_of_rendered_frames_and_not_of_high_resolution_ones(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1])
    declared = {"jitter_px": [0.25, -0.5]}
    assert open_folder(tmp_path, capture=declared, jittered=False).cameras[1].jitter_px == (0, 0)


def test_a_side_car_row_takes_the_place_of_what_the_header_says(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    header = {"worldToCamera": np.eye(4, dtype=np.float32)}
    write_frames(tmp_path, [1, 2], attributes=header)
    shifted = [*np.eye(4).ravel().tolist()[:12], 3.0, 4.0, 5.0, 1.0]
    row = CameraRow(frame=1, worldToCamera=shifted, jitter_px=(0.1, 0.2))
    reader = open_folder(tmp_path, side_car={1: row})
    first, second = reader.cameras[1], reader.cameras[2]
    assert first.world_to_camera is not None
    assert first.world_to_camera[3].tolist() == [3.0, 4.0, 5.0, 1.0]
    assert first.jitter_px == (0.1, 0.2)
    assert second.world_to_camera is not None
    assert torch.equal(second.world_to_camera, torch.eye(4, dtype=torch.float64))


def test_a_side_car_without_matrices_leaves_those_of_the_header(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    matrix = np.diag([1.0, 2.0, 3.0, 15.0]).astype(np.float32)
    write_frames(tmp_path, [1], attributes={"worldToCamera": matrix, "worldToNDC": 2 * matrix})
    row = CameraRow(frame=1, jitter_px=(0.1, 0.2), pre_exposure=4.0)
    camera = open_folder(tmp_path, side_car={1: row}).cameras[1]
    assert camera.jitter_px == (0.1, 0.2)
    assert camera.pre_exposure == 4.0
    assert camera.world_to_camera is not None
    assert camera.world_to_camera[3, 3] == 15.0


def test_the_jitter_of_the_frame_before_is_that_one_step_back(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [10, 20])
    declared = {
        "frame_step": 10,
        "jitter_px": {10: [0.5, 0.0], 20: [0.0, 0.25]},
        "motion": {"jittered": True},
    }
    reader = open_folder(tmp_path, capture=declared)
    stored = open_folder(tmp_path, capture={"frame_step": 10}).read(20, (Buffer.MOTION,))
    motion = reader.read(20, (Buffer.MOTION,)).gbuffer[Buffer.MOTION]
    shift = (motion - stored.gbuffer[Buffer.MOTION])[0].flatten(1)
    assert torch.allclose(shift[0], torch.tensor(0.5))
    assert torch.allclose(shift[1], torch.tensor(-0.25))


def test_buffers_are_read_in_the_convention_of_memory(
    tmp_path: Path, write_frames: Write, open_folder: Open, analytic_channels: Any
) -> None:
    write_frames(tmp_path, [5])
    channels = analytic_channels(5)
    frame = open_folder(tmp_path).read(5, (Buffer.COLOR, Buffer.OBJECT_ID, Buffer.DEPTH))
    assert frame.number == 5
    color = frame.gbuffer[Buffer.COLOR]
    assert color.dtype == torch.float32
    for i, name in enumerate("RGB"):
        assert np.array_equal(color[0, i].numpy(), channels[name].astype(np.float32))
    ids = frame.gbuffer[Buffer.OBJECT_ID]
    assert ids.dtype == torch.int32
    assert np.array_equal(ids[0, 0].numpy(), channels["objectid"].astype(np.int32))


def test_a_damaged_frame_in_the_middle_is_found_before_any_work(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1, 2, 3])
    (tmp_path / "frame.0002.exr").write_bytes(b"")
    with pytest.raises(FrameFolderError, match=r"frame\.0002\.exr"):
        open_folder(tmp_path)


def test_a_layout_that_does_not_exist_gets_a_suggestion() -> None:
    with pytest.raises(FrameFolderError, match="no layout is called 'blendr', did you mean"):
        load_layout("blendr")


def test_a_layout_that_matches_nothing_is_refused_with_the_folder(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1])
    with pytest.raises(FrameFolderError, match="layout 'blender' matches no channel") as caught:
        open_folder(tmp_path, layout="blender")
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ([], ""),
        ([4], "4"),
        ([3, 1, 2], "1-3"),
        ([1, 2, 4, 6, 7], "1-2, 4, 6-7"),
        ([-2, -1], "-2..-1"),
    ],
)
def test_ranges_are_written_compactly(numbers: list[int], text: str) -> None:
    assert format_ranges(numbers) == text


def test_a_table_that_leaves_frames_out_is_refused(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1, 2])
    with pytest.raises(FrameFolderError, match="jitter_px has no entry for frames 2"):
        open_folder(tmp_path, capture={"jitter_px": {1: [0.1, 0.1]}})


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_matrices_that_are_none_are_unknown_and_the_frame_and_the_matrix_are_named(
    tmp_path: Path, write_frames: Write, open_folder: Open, value: float
) -> None:
    matrix = np.full((4, 4), value, np.float32)
    write_frames(tmp_path, [1], attributes={"worldToCamera": matrix})
    write_frames(tmp_path, [2], attributes={"worldToCamera": np.eye(4, dtype=np.float32)})
    reader = open_folder(tmp_path)
    assert reader.cameras[1].world_to_camera is None
    assert reader.cameras[2].world_to_camera is not None
    assert reader.camera_faults.startswith("frame 1: ")
    assert "worldToCamera is" in reader.camera_faults


def test_a_frame_that_stands_in_brings_its_jitter_along(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1, 2, 4])
    table = {1: [0.0, 0.0], 2: [0.1, 0.2], 4: [0.3, 0.4]}
    reader = open_folder(tmp_path, capture={"jitter_px": table}, on_missing=MissingPolicy.HOLD)
    assert reader.cameras[3].jitter_px == (0.1, 0.2)


def test_the_f0_workflow_has_no_metal(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path, [1])
    assert Buffer.METALLIC in open_folder(tmp_path).stored
    assert Buffer.METALLIC not in open_folder(tmp_path, capture={"specular": "f0"}).stored


def test_files_of_luminance_and_chroma_only_are_refused_in_words_that_help(
    tmp_path: Path, write_frames: Write
) -> None:
    frames = collect_frame_set(write_frames(tmp_path, [1], only=("R", "G", "B")))
    assert frames is not None
    headers = {
        key: {n: replace(h, subsampled=h.channels) for n, h in by_number.items()}
        for key, by_number in read_headers(frames, HeaderFiles()).items()
    }
    with pytest.raises(FrameFolderError, match=r"every channel \(B, G, R\) is subsampled"):
        open_frames(frames, headers=headers, layout=None, capture=CaptureDeclaration(), side_car={})


@pytest.mark.parametrize("subsampled", [True, False])
@pytest.mark.parametrize("layer", ["", "main."])
def test_luminance_and_chroma_are_refused_in_one_message(
    tmp_path: Path, layer: str, *, subsampled: bool
) -> None:
    planes = {f"{layer}{c}": np.ones((4, 4), np.float32) for c in ("Y", "RY", "BY", "A")}
    write_exr(tmp_path / "f.0001.exr", planes)
    frames = collect_frame_set(tmp_path)
    assert frames is not None
    chroma = frozenset({f"{layer}RY", f"{layer}BY"} if subsampled else ())
    headers = {
        key: {n: replace(h, subsampled=chroma) for n, h in by_number.items()}
        for key, by_number in read_headers(frames, HeaderFiles()).items()
    }
    with pytest.raises(FrameFolderError, match=r"luminance and chroma .*write them as R, G, B"):
        open_frames(frames, headers=headers, layout=None, capture=CaptureDeclaration(), side_car={})


def test_buffers_that_share_no_frame_are_refused_even_where_frames_may_be_skipped(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_split(write_frames, tmp_path, [1, 2], [3, 4])
    with pytest.raises(
        FrameFolderError, match=r"no frame has all of its files: .* has 1-2; .* 3-4"
    ):
        open_folder(tmp_path, on_missing=MissingPolicy.SKIP)
