"""Damaged files: a message or pixels, never a crash, a hang, a bomb, or a line of the library's."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import COMPRESSIONS, read_channels, read_header, write_exr

READER = Path(__file__).with_name("fuzz_reader.py")
CASES, MIB = 300, 1 << 20


@pytest.fixture
def channels() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    smooth = np.cumsum(rng.normal(size=(40, 48)), axis=1)
    return {
        "R": smooth.astype(np.float16),
        "depth.Z": smooth.astype(np.float32),
        "objectid": rng.integers(0, 2**32, (40, 48), dtype=np.uint32),
    }


@pytest.fixture
def intact(tmp_path: Path, channels: dict[str, np.ndarray]) -> Path:
    """Small files of every compression, tiled, and in two parts."""
    folder = tmp_path / "intact files"
    folder.mkdir()
    for name in COMPRESSIONS:
        write_exr(folder / f"{name}.exr", channels, compression=name)
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 16
    header = {"type": OpenEXR.tiledimage, "tiles": tiles}
    OpenEXR.File(header, channels).write(str(folder / "tiles.exr"))
    parts = [OpenEXR.Part({}, {name: plane}, name) for name, plane in channels.items()]
    OpenEXR.File(parts).write(str(folder / "parts.exr"))
    return folder


def fuzzed(folder: Path, seed: int) -> dict[str, Any]:
    command = [sys.executable, str(READER), str(folder), str(seed), str(CASES)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr}"
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert len(lines) == 1, done.stdout
    found: dict[str, Any] = json.loads(lines[0])
    return found


def test_no_damage_crashes_hangs_prints_or_takes_a_gibibyte(intact: Path) -> None:
    found = fuzzed(intact, seed=20)
    assert sum(found["ends"].values()) == CASES
    assert found["ends"]["refused"] > CASES / 3, "most cuts and broken headers have to show"
    assert found["slowest_s"] < 2.0
    assert found["peak_bytes"] < 1024 * MIB


def with_window(content: bytes, *corners: int) -> bytes:
    """Replace xMin, yMin, xMax, yMax of the data window."""
    start = content.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    box = np.array(corners, "<i4").tobytes()
    return content[:start] + box + content[start + len(box) :]


@pytest.mark.parametrize(
    ("corners", "why"),
    [
        ((0, 0, -1, -1), "its header is damaged"),
        ((5, 5, 2, 9), "its header is damaged"),
        ((0, 0, 2**31 - 2, 2**31 - 2), "its header is damaged"),
        ((0, 0, 19999, 19999), "its header promises 2288 MiB of pixels in"),
        ((-(2**31), 0, 2**31 - 1, 3), "its header is damaged"),
    ],
    ids=["empty", "reversed", "absurd", "bomb", "overflow"],
)
def test_a_window_that_cannot_be_is_refused_before_pixels_are_allocated(
    tmp_path: Path, channels: dict[str, np.ndarray], corners: tuple[int, ...], why: str
) -> None:
    path = tmp_path / "frame.0001.exr"
    write_exr(path, channels)
    path.write_bytes(with_window(path.read_bytes(), *corners))
    for read in (lambda: read_header(path), lambda: read_channels(path, ["R"])):
        with pytest.raises(FrameFolderError) as refusal:
            read()
        message = str(refusal.value)
        assert message.startswith(f"{path}: cannot be read as OpenEXR (")
        assert why in message


def test_a_flat_picture_that_compresses_a_thousandfold_is_read(tmp_path: Path) -> None:
    path = tmp_path / "black.exr"
    planes = {name: np.zeros((2000, 3000), np.float16) for name in "RGB"}
    write_exr(path, planes)
    assert sum(p.nbytes for p in planes.values()) > 200 * path.stat().st_size
    assert not any(plane.any() for plane in read_channels(path, "RGB").values())


def test_pixels_that_are_damaged_are_one_exception_and_no_line_of_the_librarys(
    tmp_path: Path, channels: dict[str, np.ndarray], capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "frame.0001.exr"
    write_exr(path, channels)
    content = bytearray(path.read_bytes())
    content[-900:-800] = bytes(100)
    path.write_bytes(content)
    with pytest.raises(FrameFolderError, match="its pixels are damaged"):
        read_channels(path, channels)
    assert capfd.readouterr() == ("", "")


def test_a_tile_far_larger_than_the_window_is_refused(intact: Path) -> None:
    path = intact / "tiles.exr"
    content = path.read_bytes()
    start = content.index(b"tiles\0tiledesc\0") + len(b"tiles\0tiledesc\0") + 4
    huge = np.array([1 << 14, 1 << 14], "<u4").tobytes()
    path.write_bytes(content[:start] + huge + content[start + 8 :])
    with pytest.raises(FrameFolderError, match=r"tiles\.exr.*promises 1536 MiB of pixels"):
        read_header(path)
