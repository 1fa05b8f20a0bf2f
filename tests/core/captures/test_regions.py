"""Where pixels are placed: display windows, data windows, parts and origins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer

Open = Callable[..., FrameReader]
Run = Callable[..., Any]

PICTURE = np.random.default_rng(3).random((12, 16)).astype(np.float32)
PLANE = PixelWindow(left=0, top=0, width=16, height=12)
INNER = PixelWindow(left=4, top=2, width=8, height=6)


def cut(window: PixelWindow) -> np.ndarray:
    return PICTURE[
        window.top : window.top + window.height, window.left : window.left + window.width
    ]


def write_color(
    path: Path, data: PixelWindow = PLANE, display: PixelWindow = PLANE, pixels: Any = None
) -> None:
    plane = cut(data.seen_from(display)) if pixels is None else pixels
    write_exr(path, dict.fromkeys("RGB", plane), data_window=data, display_window=display)


def write_depth(path: Path, data: PixelWindow = PLANE, display: PixelWindow = PLANE) -> None:
    plane = np.full((data.height, data.width), 5.0, np.float32)
    write_exr(path, {"depth.Z": plane}, data_window=data, display_window=display)


def red(reader: FrameReader, number: int = 1) -> np.ndarray:
    picture: np.ndarray = reader.read(number, (Buffer.COLOR,)).gbuffer[Buffer.COLOR][0, 0].numpy()
    return picture


def test_files_of_a_frame_with_planes_at_other_origins_are_one_picture(
    tmp_path: Path, open_folder: Open
) -> None:
    write_color(tmp_path / "beauty.1.exr")
    write_depth(tmp_path / "aov.1.exr", PLANE.moved(100, 100), PLANE.moved(100, 100))
    reader = open_folder(tmp_path)
    np.testing.assert_array_equal(red(reader), PICTURE)
    assert bool((reader.read(1, (Buffer.DEPTH,)).gbuffer[Buffer.DEPTH] == 5.0).all())


def test_frames_with_planes_at_other_origins_are_the_same_picture(
    tmp_path: Path, open_folder: Open
) -> None:
    write_color(tmp_path / "f.1.exr")
    write_color(tmp_path / "f.2.exr", PLANE.moved(-7, 30), PLANE.moved(-7, 30))
    reader = open_folder(tmp_path)
    np.testing.assert_array_equal(red(reader, 2), red(reader, 1))


@pytest.mark.parametrize("name", ["f.2.exr", "aov.1.exr"])
def test_another_origin_and_another_place_are_refused_with_both_windows(
    tmp_path: Path, open_folder: Open, name: str
) -> None:
    write_color(tmp_path / "f.1.exr")
    write = write_depth if name.startswith("aov") else write_color
    write(tmp_path / name, INNER.moved(100, 0), PLANE.moved(100, 0))
    with pytest.raises(FrameFolderError, match=r"8 x 6 at \(104, 2\)") as refused:
        open_folder(tmp_path)
    assert "16 x 12 at (0, 0)" in str(refused.value)


def test_a_frame_is_read_alike_whatever_the_others_are(tmp_path: Path, open_folder: Open) -> None:
    write_color(tmp_path / "alone" / "f.1.exr", INNER)
    for number, window in ((1, INNER), (2, PLANE)):
        write_color(tmp_path / "both" / f"f.{number}.exr", window)
    alone, both = (red(open_folder(tmp_path / name)) for name in ("alone", "both"))
    np.testing.assert_array_equal(alone, both)
    np.testing.assert_array_equal(alone[2:8, 4:12], cut(INNER))
    assert float(alone.sum()) == pytest.approx(float(cut(INNER).sum()))


def test_overscan_is_read_and_must_not_vary(tmp_path: Path, open_folder: Open) -> None:
    wide = PixelWindow(left=-2, top=0, width=20, height=12)
    pixels = np.pad(PICTURE, ((0, 0), (2, 2)))
    write_color(tmp_path / "f.1.exr", wide, pixels=pixels)
    reader = open_folder(tmp_path)
    assert (reader.size, reader.view.left) == ((12, 20), -2)
    np.testing.assert_array_equal(red(reader), pixels)
    write_color(tmp_path / "f.2.exr")
    assert open_folder(tmp_path, capture={"region": "display"}).size == (12, 16)
    write_color(
        tmp_path / "f.3.exr",
        PixelWindow(left=-1, top=0, width=17, height=12),
        pixels=PICTURE[:, [0, *range(16)]],
    )
    with pytest.raises(FrameFolderError, match="overscan"):
        open_folder(tmp_path)
    with pytest.raises(FrameFolderError, match="different data windows"):
        open_folder(tmp_path, capture={"region": "data"})


def make_part(name: str, window: PixelWindow, channels: dict[str, np.ndarray]) -> OpenEXR.Part:
    def box(w: PixelWindow) -> tuple[np.ndarray, np.ndarray]:
        first = np.array([w.left, w.top], np.int32)
        return first, first + np.array([w.width - 1, w.height - 1], np.int32)

    header = {"dataWindow": box(window), "displayWindow": box(PLANE), "type": OpenEXR.scanlineimage}
    return OpenEXR.Part(header, channels, name)


def test_parts_with_windows_of_their_own_are_placed(tmp_path: Path, open_folder: Open) -> None:
    depth = np.full((INNER.height, INNER.width), 2.0, np.float32)
    parts = [
        make_part("rgba", PLANE, {c: PICTURE.copy() for c in "RGB"}),
        make_part("depth", INNER, {"Z": depth}),
    ]
    OpenEXR.File(parts).write(str(tmp_path / "f.1.exr"))
    frame = open_folder(tmp_path).read(1, (Buffer.COLOR, Buffer.DEPTH)).gbuffer
    np.testing.assert_array_equal(frame[Buffer.COLOR][0, 0].numpy(), PICTURE)
    expected = np.full((12, 16), SKY_DEPTH_M, np.float32)
    expected[2:8, 4:12] = 2.0
    np.testing.assert_array_equal(frame[Buffer.DEPTH][0, 0].numpy(), expected)


def test_pixels_that_no_file_has_are_nothing_whatever_is_stored(
    tmp_path: Path, open_folder: Open
) -> None:
    half = np.full((INNER.height, INNER.width), 0.5, np.float32)
    planes = {f"motion.{c}": half for c in "XY"} | {f"normal.{c}": half for c in "XYZ"}
    write_color(tmp_path / "f.1.exr")
    write_exr(tmp_path / "aov.1.exr", planes, data_window=INNER, display_window=PLANE)
    capture = {
        "motion": {
            "unit": "uv",
            "zero": 0.5,
            "direction": "previous-minus-current",
            "y_axis": "down",
        },
        "normal": {"packed": True, "space": "world"},
    }
    frame = open_folder(tmp_path, capture=capture).read(1, (Buffer.MOTION, Buffer.NORMAL)).gbuffer
    assert bool((frame[Buffer.MOTION] == 0).all())
    assert bool((frame[Buffer.NORMAL][..., :2, :] == 0).all())


def test_constants_and_sums_of_an_autocropped_frame_are_those_of_its_pixels(
    tmp_path: Path, open_folder: Callable[..., FrameReader]
) -> None:
    write_color(tmp_path / "f.0001.exr", INNER)
    declared = {"buffers": {"metallic": 0.25, "roughness": "1 - R"}}
    reader = open_folder(tmp_path, capture=declared)
    buffers = (Buffer.COLOR, Buffer.METALLIC, Buffer.ROUGHNESS)
    gbuffer = reader.read(1, buffers).gbuffer
    assert gbuffer.size == (PLANE.height, PLANE.width)
    assert bool((gbuffer[Buffer.METALLIC] == 0.25).all())
    rows = slice(INNER.top, INNER.top + INNER.height)
    columns = slice(INNER.left, INNER.left + INNER.width)
    expected = np.zeros((PLANE.height, PLANE.width), np.float32)
    expected[rows, columns] = 1.0 - red(reader)[rows, columns]
    assert np.array_equal(gbuffer[Buffer.ROUGHNESS][0, 0].numpy(), expected.clip(0.0, 1.0))
