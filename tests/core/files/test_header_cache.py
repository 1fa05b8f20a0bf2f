"""Headers that are read by comparison, against the library's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files import header_cache
from rtsr_cli.core.files.exr import read_header, write_exr
from rtsr_cli.core.files.exr_chunks import FIXED_BYTES, FileBytes, list_attributes
from rtsr_cli.core.files.header_cache import HeaderCache
from rtsr_cli.core.files.pixel_window import PixelWindow

PLANE = np.random.default_rng(1).normal(size=(40, 24)).astype(np.float32)
ATTRIBUTES: dict[str, Any] = {
    "frame": 1,
    "fov": 0.75,
    "note": "first",
    "shift": np.array([0.5, -0.25], np.float32),
    "up": np.array([0, 1, 0], np.float32),
    "turn": np.arange(9, dtype=np.float32).reshape(3, 3),
    "worldToCamera": np.arange(16, dtype=np.float32).reshape(4, 4),
}
OTHERS: dict[str, Any] = {
    "frame": -7,
    "fov": 1.25,
    "note": "\u0141\u00f3x",
    "shift": np.array([8, 9], np.float32),
    "up": np.array([1, 2, 3], np.float32),
    "turn": np.arange(9, 18, dtype=np.float32).reshape(3, 3),
    "worldToCamera": np.arange(16, 32, dtype=np.float32).reshape(4, 4),
}


@pytest.fixture
def library_reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that the library was asked for."""
    names: list[str] = []

    def read(path: Path) -> header_cache.ExrHeader:
        names.append(path.name)
        return read_header(path)

    monkeypatch.setattr(header_cache, "read_header", read)
    return names


def write(path: Path, attributes: Mapping[str, Any] = ATTRIBUTES, **options: Any) -> Path:
    write_exr(path, {"R": PLANE, "depth.Z": PLANE}, attributes=attributes, **options)
    return path


def check_equal(cache: HeaderCache, path: Path) -> None:
    ours, library = cache.read(path), read_header(path)
    assert ours.attributes.keys() == library.attributes.keys()
    for name, value in library.attributes.items():
        assert type(ours.attributes[name]) is type(value), name
        np.testing.assert_array_equal(ours.attributes[name], value, err_msg=name)
        assert getattr(ours.attributes[name], "dtype", None) == getattr(value, "dtype", None)
    for field in ("channels", "data_window", "display_window", "subsampled", "chunks", "views"):
        assert getattr(ours, field) == getattr(library, field)
    assert len(ours.later) == len(library.later)
    for one, other in zip(ours.later, library.later, strict=True):
        assert one.channels == other.channels
        assert one.attributes.keys() == other.attributes.keys()


def test_frames_of_a_sequence_are_read_without_the_library(
    tmp_path: Path, library_reads: list[str]
) -> None:
    cache = HeaderCache()
    cache.read(write(tmp_path / "1.exr"))
    for name, value in OTHERS.items():
        check_equal(cache, write(tmp_path / f"{name}.exr", {**ATTRIBUTES, name: value}))
    check_equal(cache, write(tmp_path / "all.exr", OTHERS))
    assert library_reads == ["1.exr"]


@pytest.mark.parametrize(
    "options",
    [
        {"compression": "none"},
        {"data_window": PixelWindow(left=1, top=0, width=24, height=40)},
        {"attributes": {**ATTRIBUTES, "note": "another length"}},
        {"attributes": {**ATTRIBUTES, "more": 1}},
        {"attributes": {"frame": 1}},
        {"attributes": {**ATTRIBUTES, "frame": 1.5}},
    ],
    ids=str,
)
def test_what_differs_in_structure_is_the_librarys(
    tmp_path: Path, library_reads: list[str], options: dict[str, Any]
) -> None:
    cache = HeaderCache()
    cache.read(write(tmp_path / "1.exr"))
    check_equal(cache, write(tmp_path / "2.exr", **options))
    assert library_reads == ["1.exr", "2.exr"]


def test_other_channels_are_seen(tmp_path: Path) -> None:
    cache = HeaderCache()
    cache.read(write(tmp_path / "1.exr"))
    write_exr(tmp_path / "2.exr", {"G": PLANE, "depth.Z": PLANE}, attributes=ATTRIBUTES)
    assert cache.read(tmp_path / "2.exr").channels == {"G", "depth.Z"}
    write_exr(tmp_path / "3.exr", {"G": PLANE.astype(np.float16), "depth.Z": PLANE})
    check_equal(cache, tmp_path / "3.exr")


def test_a_cut_file_is_refused_after_a_whole_one(tmp_path: Path) -> None:
    cache = HeaderCache()
    cache.read(write(tmp_path / "1.exr"))
    whole = write(tmp_path / "2.exr", OTHERS).read_bytes()
    for length in (0, 100, len(whole) // 3, len(whole) // 2):
        (tmp_path / "2.exr").write_bytes(whole[:length])
        with pytest.raises(FrameFolderError, match=r"2\.exr"):
            cache.read(tmp_path / "2.exr")


def test_a_table_that_points_behind_the_end_is_refused(tmp_path: Path) -> None:
    cache = HeaderCache()
    content = bytearray(write(tmp_path / "1.exr").read_bytes())
    cache.read(tmp_path / "1.exr")
    with (tmp_path / "1.exr").open("rb", buffering=0) as file:
        _, table = list_attributes(FileBytes(file), FIXED_BYTES)
    assert table is not None
    content[table : table + 8] = (len(content) + 1).to_bytes(8, "little")
    (tmp_path / "2.exr").write_bytes(content)
    with pytest.raises(FrameFolderError, match="ends too early"):
        cache.read(tmp_path / "2.exr")


def test_parts_are_the_librarys(tmp_path: Path, library_reads: list[str]) -> None:
    cache = HeaderCache()
    for name in ("1.exr", "2.exr"):
        parts = [OpenEXR.Part({}, {"R": PLANE}, part) for part in ("a", "b")]
        OpenEXR.File(parts).write(str(tmp_path / name))
        check_equal(cache, tmp_path / name)
    assert library_reads == ["1.exr", "2.exr"]


def test_views_are_the_librarys(tmp_path: Path, library_reads: list[str]) -> None:
    cache = HeaderCache()
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for name, views in {"1.exr": "ab", "2.exr": "ab", "3.exr": "ba", "4.exr": ""}.items():
        many = {"multiView": list(views)} if views else {}
        OpenEXR.File(head | many, {"R": PLANE, "b.R": PLANE}).write(str(tmp_path / name))
        check_equal(cache, tmp_path / name)
    assert library_reads == ["1.exr", "3.exr", "4.exr"]


def test_a_string_that_is_no_text_is_the_librarys(tmp_path: Path, library_reads: list[str]) -> None:
    cache = HeaderCache()
    content = write(tmp_path / "1.exr").read_bytes()
    cache.read(tmp_path / "1.exr")
    (tmp_path / "2.exr").write_bytes(content.replace(b"first", b"fi\xff\xfet"))
    try:
        expected = read_header(tmp_path / "2.exr").attributes["note"]
    except (FrameFolderError, UnicodeDecodeError) as error:
        with pytest.raises(type(error)):
            cache.read(tmp_path / "2.exr")
    else:
        assert cache.read(tmp_path / "2.exr").attributes["note"] == expected
    assert library_reads == ["1.exr", "2.exr"]


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(FrameFolderError, match=r"none\.exr: no such file"):
        HeaderCache().read(tmp_path / "none.exr")
