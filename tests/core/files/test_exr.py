from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.errors import FrameFolderError, OutputError
from rtsr_cli.core.files.atomic_write import write_atomically
from rtsr_cli.core.files.exr import (
    COMPRESSIONS,
    STRUCTURAL_ATTRIBUTES,
    read_channels,
    read_header,
    write_exr,
)
from rtsr_cli.core.files.pixel_window import PixelWindow

SHAPE = (3, 5)


def ramp(dtype: type) -> np.ndarray:
    return np.arange(15).reshape(SHAPE).astype(dtype)


def test_every_channel_keeps_its_own_type_and_bits(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    channels = {
        "R": np.array([[0.1, -0.0, 65504.0, np.inf, 6e-8]], np.float16),
        "depth.Z": np.array([[1 / 3, 1e-38, 1e38, -5.0, 0.0]], np.float32),
        "objectid": np.array([[0, 1, 2**31, 2**32 - 1, 7]], np.uint32),
    }
    write_exr(path, channels)
    found = read_channels(path, channels)
    for name, plane in channels.items():
        assert found[name].dtype == plane.dtype
        assert found[name].tobytes() == plane.tobytes()


@pytest.mark.parametrize("compression", sorted(set(COMPRESSIONS) - {"dwaa"}))
def test_lossless_compressions_return_every_bit(tmp_path: Path, compression: str) -> None:
    plane = np.random.default_rng(1).normal(size=(19, 23)).astype(np.float32)
    write_exr(tmp_path / "a.exr", {"Y": plane}, compression=compression)
    assert np.array_equal(read_channels(tmp_path / "a.exr", ["Y"])["Y"], plane)


def test_arrays_that_are_not_contiguous_are_written_as_they_look(tmp_path: Path) -> None:
    plane = np.arange(24, dtype=np.float32).reshape(4, 6).T[::2]
    write_exr(tmp_path / "a.exr", {"Y": plane})
    assert np.array_equal(read_channels(tmp_path / "a.exr", ["Y"])["Y"], plane)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_matrices_that_are_not_contiguous_are_written_as_they_look(
    tmp_path: Path, kind: type
) -> None:
    counted = np.arange(16).reshape(4, 4).astype(kind)
    views = {"turned": counted.T, "flipped": counted[::-1, ::-1], "plain": counted}
    path = tmp_path / "a.exr"
    write_exr(path, {"Y": ramp(np.float32)}, attributes=views)
    found = read_header(path).attributes
    for name, matrix in views.items():
        assert np.array_equal(found[name], matrix), name


def test_only_wanted_channels_are_returned(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"R": ramp(np.float16), "G": ramp(np.float16)})
    assert list(read_channels(tmp_path / "a.exr", ["G"])) == ["G"]


def test_a_channel_that_is_not_there_is_named_with_the_file(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"R": ramp(np.float16)})
    with pytest.raises(FrameFolderError, match=r"a\.exr: channel 'nov' is missing"):
        read_channels(tmp_path / "a.exr", ["R", "nov"])


def write_parts(path: Path, *parts: tuple[str, dict[str, np.ndarray]]) -> None:
    display = (np.array([0, 0], np.int32), np.array([9, 9], np.int32))
    header = {"displayWindow": display}
    written = [OpenEXR.Part(dict(header), channels, name) for name, channels in parts]
    OpenEXR.File(written).write(str(path))


def test_parts_after_the_first_lead_their_channels_names(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_parts(
        path,
        ("beauty", {"R": ramp(np.float16)}),
        ("normal", {c: ramp(np.float16) + i for i, c in enumerate("XYZ")}),
        ("objectid", {"objectid": ramp(np.uint32)}),
        ("depth", {"depth.Z": ramp(np.float32)}),
    )
    expected = {"R", "normal.X", "normal.Y", "normal.Z", "objectid", "depth.Z"}
    assert read_header(path).channels == expected
    found = read_channels(path, ["R", "objectid", "normal.Z"])
    assert (found["R"].dtype, found["objectid"].dtype) == (np.float16, np.uint32)
    assert float(found["normal.Z"][0, 1]) == 3.0


@pytest.mark.parametrize(
    ("bases", "names"),
    [
        (
            ("ViewLayer.Combined", "ViewLayer.Depth"),
            {"ViewLayer.Combined.R", "ViewLayer.Depth.R"},
        ),
        (("A.Combined", "B.Combined"), {"A.Combined.R", "B.Combined.R"}),
        (("rgba.main", "depth"), {"R", "depth.R"}),
        (("rgba", "ViewLayer.Depth"), {"R", "ViewLayer.Depth.R"}),
    ],
)
def test_a_first_part_that_is_called_as_a_pass_of_a_layer_leads_its_names(
    tmp_path: Path, bases: tuple[str, str], names: set[str]
) -> None:
    planes = {"R": np.zeros((4, 6), np.float16)}
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, planes, name) for name in bases]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    assert read_header(tmp_path / "a.exr").channels == names


def test_a_name_that_is_then_there_twice_takes_the_name_of_its_part(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_parts(
        path,
        ("main", {"normal.X": ramp(np.float16), "Z": ramp(np.float32)}),
        ("normal", {"X": ramp(np.float16) + 100}),
    )
    assert read_header(path).channels == {"main.normal.X", "normal.X", "Z"}
    found = read_channels(path, ["main.normal.X", "normal.X"])
    assert (float(found["main.normal.X"][0, 1]), float(found["normal.X"][0, 1])) == (1.0, 101.0)


def test_parts_of_two_views_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    parts = [
        OpenEXR.Part({"view": view}, {channel: ramp(np.float16) + offset}, f"{part}.{view}")
        for offset, view in enumerate(("left", "right"))
        for part, channel in (("rgba", "R"), ("depth", "Z"))
    ]
    OpenEXR.File(parts).write(str(path))
    header = read_header(path)
    assert header.views == {
        "left.R": "left", "right.R": "right", "depth.left.Z": "left", "depth.right.Z": "right"
    }  # fmt: skip
    found = read_channels(path, ["left.R", "right.R", "depth.right.Z"])
    assert [float(plane[0, 0]) for plane in found.values()] == [0.0, 1.0, 1.0]
    assert "view" not in header.attributes


@pytest.mark.parametrize("name", ["{}.main", "{}_main", "main.{}", "{}-main", "{}"])
def test_a_single_view_is_no_part_of_names(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.exr"
    parts = [
        OpenEXR.Part({"view": "main"}, {channel: ramp(np.float16)}, name.format(part))
        for part, channel in (("rgba", "R"), ("depth", "Z"))
    ]
    OpenEXR.File(parts).write(str(path))
    assert read_header(path).channels == {"R", "depth.Z"}


def test_views_of_one_part_are_those_that_its_names_tell(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    names = ("R", "left.R", "right.R", "depth.left.Z", "depth.Z")
    attributes = {"multiView": ["right", "left"], "owner": "me"}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header | attributes, {n: ramp(np.float16) for n in names}).write(str(path))
    found = read_header(path)
    assert found.views == {
        "R": "right", "left.R": "left", "right.R": "right", "depth.left.Z": "left"
    }  # fmt: skip
    # a copy has one view, which these would not describe
    assert "multiView" not in found.attributes
    write_exr(tmp_path / "b.exr", {"R": ramp(np.float16)}, attributes=attributes)
    assert read_header(tmp_path / "b.exr").attributes["owner"] == "me"
    assert "multiView" not in OpenEXR.File(str(tmp_path / "b.exr")).header()


def test_attributes_of_channels_are_those_of_their_part(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    parts = [
        OpenEXR.Part({"note": "first", "whole": "file"}, {"R": ramp(np.float16)}, "rgba"),
        OpenEXR.Part({"note": "second"}, {"X": ramp(np.float16)}, "ids"),
    ]
    OpenEXR.File(parts).write(str(path))
    header = read_header(path)
    assert header.attributes_of(["R"])["note"] == "first"
    assert header.attributes_of(["ids.X"])["note"] == "second"
    assert header.attributes_of(["ids.X"])["whole"] == "file"


def test_parts_have_data_windows_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_parts(path, ("a", {"R": ramp(np.float16)}), ("b", {"Z": ramp(np.float32)[:2]}))
    header = read_header(path)
    assert (
        header.place_of("R") == header.data_window == PixelWindow(left=0, top=0, width=5, height=3)
    )
    assert header.place_of("b.Z") == PixelWindow(left=0, top=0, width=5, height=2)
    assert read_channels(path, ["b.Z"])["b.Z"].shape == (2, 5)


def test_a_data_window_inside_the_display_window_survives(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    data = PixelWindow(left=2, top=-1, width=5, height=3)
    display = PixelWindow(left=0, top=-4, width=10, height=8)
    write_exr(path, {"R": ramp(np.float16)}, data_window=data, display_window=display)
    header = read_header(path)
    assert header.data_window == data
    assert header.display_window == display
    assert np.array_equal(read_channels(path, ["R"])["R"], ramp(np.float16))


def test_windows_scale_to_all_pixels_that_they_touch() -> None:
    window = PixelWindow(left=-1, top=2, width=4, height=3)
    assert window.at_ratio(Fraction(2)) == PixelWindow(left=-2, top=4, width=8, height=6)
    assert window.at_ratio(Fraction(1, 2)) == PixelWindow(left=-1, top=1, width=3, height=2)


def test_windows_are_joined_and_cut() -> None:
    one, other = (
        PixelWindow(left=0, top=0, width=4, height=3),
        PixelWindow(left=2, top=-1, width=9, height=3),
    )
    assert one.common(other) == PixelWindow(left=2, top=0, width=2, height=2)
    assert one.joined(other) == PixelWindow(left=0, top=-1, width=11, height=4)
    assert one.common(other.moved(2, 0)) is None
    assert one.joined(other).holds(other)
    assert not one.holds(other)
    assert str(other) == "9 x 3 at (2, -1)"


ATTRIBUTES = {
    "owner": "Zoë",
    "exposure": 1.5,
    "takes": 3,
    "worldToCamera": np.arange(16, dtype=np.float32).reshape(4, 4),
    "precise": np.eye(3, dtype=np.float64) / 3,
    "offset": np.array([1, -2], np.int32),
    "direction": np.array([0.5, 1.5, -2.0], np.float32),
    "views": ["left", "right"],
    "curve": [0.0, 0.25, 1.0],
    "framesPerSecond": Fraction(24000, 1001),
    "pixelAspectRatio": 2.0,
}


@pytest.mark.parametrize("name", sorted(ATTRIBUTES))
def test_an_attribute_survives_reading_and_writing_with_its_type(tmp_path: Path, name: str) -> None:
    first, second = tmp_path / "a.exr", tmp_path / "b.exr"
    write_exr(first, {"R": ramp(np.float16)}, attributes={name: ATTRIBUTES[name]})
    once = read_header(first).attributes
    write_exr(second, {"G": ramp(np.float32)}, attributes=once)
    twice = read_header(second).attributes
    assert type(twice[name]) is type(once[name])
    assert np.array_equal(np.asarray(twice[name]), np.asarray(ATTRIBUTES[name]))
    assert getattr(twice[name], "dtype", None) == getattr(once[name], "dtype", None)


def test_how_pixels_are_stored_is_not_copied_with_the_attributes(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"R": ramp(np.float16)}, compression="piz")
    assert not set(read_header(path).attributes) & STRUCTURAL_ATTRIBUTES
    attributes = {"compression": OpenEXR.NO_COMPRESSION, "channels": "none"}
    write_exr(path, {"R": ramp(np.float16)}, attributes=attributes)
    assert OpenEXR.File(str(path)).header()["compression"] == OpenEXR.ZIP_COMPRESSION


def failing_write(part: Path) -> None:
    part.write_bytes(b"half a file")
    raise OSError(28, "No space left on device")


def test_a_write_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"new\.exr: cannot be written \(No space left"):
        write_atomically(tmp_path / "new.exr", failing_write)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_keeps_the_file_that_was_there(tmp_path: Path) -> None:
    path = tmp_path / "old.exr"
    write_exr(path, {"R": ramp(np.float16)})
    before = path.read_bytes()
    with pytest.raises(OutputError):
        write_atomically(path, failing_write)
    with pytest.raises(OutputError, match=r"old\.exr"):
        write_exr(path, {"R": ramp(np.float64)})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_goes_beside_the_target_under_a_hidden_name(tmp_path: Path) -> None:
    seen: list[Path] = []

    def write(part: Path) -> None:
        seen.append(part)
        part.write_bytes(b"x")

    write_atomically(tmp_path / "sub" / "a.exr", write)
    assert seen[0].parent == tmp_path / "sub"
    assert seen[0].name.startswith(".")
    assert seen[0].suffix != ".exr"
    assert (tmp_path / "sub" / "a.exr").read_bytes() == b"x"


def test_a_folder_that_is_a_file_is_refused_with_the_target_named(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError, match=r"a\.exr: cannot be written"):
        write_exr(tmp_path / "out" / "a.exr", {"R": ramp(np.float16)})


@pytest.fixture
def intact(tmp_path: Path) -> bytes:
    plane = np.random.default_rng(1).normal(size=(64, 64)).astype(np.float32)
    write_exr(tmp_path / "intact.exr", {"R": plane, "G": plane})
    return (tmp_path / "intact.exr").read_bytes()


@pytest.mark.parametrize(
    "content", [b"", b"\x89PNG\r\n\x1a\n" + b"\0" * 64, b"\x76\x2f\x31\x01", b"text\n" * 40]
)
def test_a_file_that_is_no_exr_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.0001.exr"
    path.write_bytes(content)
    with pytest.raises(FrameFolderError, match=r"bad\.0001\.exr"):
        read_header(path)
    with pytest.raises(FrameFolderError, match=r"bad\.0001\.exr"):
        read_channels(path, ["R"])


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.98])
def test_a_file_cut_short_is_refused_by_name(tmp_path: Path, intact: bytes, share: float) -> None:
    path = tmp_path / "cut.0001.exr"
    path.write_bytes(intact[: int(len(intact) * share)])
    with pytest.raises(FrameFolderError, match=r"cut\.0001\.exr"):
        read_channels(path, ["R", "G"])


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FrameFolderError, match=r"none\.exr: no such file"):
        read_header(tmp_path / "none.exr")


def test_a_channel_whose_name_is_not_utf_8_is_refused_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"fl?che": ramp(np.float16)})
    path.write_bytes(path.read_bytes().replace(b"fl?che", b"fl\xe8che"))
    with pytest.raises(FrameFolderError, match=r"a\.exr.*not UTF-8"):
        read_header(path)


@settings(max_examples=40, deadline=None)
@given(position=st.integers(8, 400), value=st.integers(0, 255))
def test_a_damaged_header_gives_a_message_or_a_header_but_no_crash(
    tmp_path_factory: pytest.TempPathFactory, position: int, value: int
) -> None:
    path = tmp_path_factory.mktemp("damaged") / "a.exr"
    write_exr(path, {"R": np.zeros((4, 4), np.float16)}, compression="none")
    content = bytearray(path.read_bytes())
    content[position % len(content)] = value
    path.write_bytes(content)
    try:
        header = read_header(path)
    except FrameFolderError as error:
        assert path.name in str(error)
    else:
        assert header.data_window.width > 0
