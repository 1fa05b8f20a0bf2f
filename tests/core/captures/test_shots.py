from __future__ import annotations

from pathlib import Path

import pytest

from rtsr_cli.core.captures.header_files import HeaderFiles, read_headers
from rtsr_cli.core.captures.misnamed_frames import list_misnamed
from rtsr_cli.core.captures.shots import Shot, collect_frame_set, find_shots
from rtsr_cli.core.errors import FrameFolderError


def touch(folder: Path, *names: str) -> Path:
    """Shots are found by names alone, so that empty files will do."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).touch()
    return folder


def only(folder: Path) -> Shot:
    (shot,) = find_shots(folder)
    return shot


def numbers(folder: Path) -> dict[str, list[int]]:
    return {key: list(stream.files) for key, stream in only(folder).frames.streams.items()}


def test_frames_of_the_folder_itself_are_a_shot_called_dot(tmp_path: Path) -> None:
    touch(tmp_path, "frame.0001.exr", "frame.0002.exr")
    shot = only(tmp_path)
    assert shot.name == "."
    assert shot.hr is None
    assert shot.frames.streams["frame"].files[2] == tmp_path / "frame.0002.exr"


def test_lr_and_hr_beside_each_other_are_one_shot(tmp_path: Path) -> None:
    touch(tmp_path / "lr", "0001.exr")
    touch(tmp_path / "hr", "0001.exr", "0002.exr")
    shot = only(tmp_path)
    assert shot.root == tmp_path
    assert shot.frames.root == tmp_path / "lr"
    assert shot.hr is not None
    assert shot.hr.numbers == (1, 2)


def test_lr_without_hr_is_a_shot_too(tmp_path: Path) -> None:
    touch(tmp_path / "lr", "0001.exr")
    assert only(tmp_path).hr is None


def test_a_tree_gives_its_shots_in_the_order_of_their_paths(tmp_path: Path) -> None:
    touch(tmp_path / "b" / "lr", "0001.exr")
    touch(tmp_path / "b" / "hr", "0001.exr")
    touch(tmp_path / "a" / "day 2" / "take", "f.1.exr")
    touch(tmp_path / "a" / "day 1", "f.1.exr")
    touch(tmp_path / "empty")
    assert [s.name for s in find_shots(tmp_path)] == ["a/day 1", "a/day 2/take", "b"]


def test_shots_below_a_folder_with_frames_are_found_as_well(tmp_path: Path) -> None:
    touch(tmp_path, "f.1.exr")
    touch(tmp_path / "inner", "f.1.exr")
    assert [s.name for s in find_shots(tmp_path)] == [".", "inner"]


def test_hidden_folders_and_hidden_files_hold_no_frames(tmp_path: Path) -> None:
    touch(tmp_path, "f.1.exr", ".f.2.exr")
    touch(tmp_path / ".trash", "f.1.exr")
    assert numbers(tmp_path) == {"f": [1]}


def test_one_number_written_in_two_ways_is_refused_with_both_names(tmp_path: Path) -> None:
    touch(tmp_path, "f.1.exr", "f.0001.exr", "f.0002.exr")
    with pytest.raises(FrameFolderError, match="frame 1 is there twice") as caught:
        find_shots(tmp_path)
    assert "f.1.exr" in str(caught.value)
    assert "f.0001.exr" in str(caught.value)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("0001.exr", "0002.exr"), {"": [1, 2]}),
        (("img0001.exr", "img0002.exr"), {"img": [1, 2]}),
        (("a_0001.exr", "a_0002.exr"), {"a": [1, 2]}),
        (("a.-002.exr", "a.-001.exr", "a.0000.exr", "a.0001.exr"), {"a": [-2, -1, 0, 1]}),
        (("a_-0002.exr", "a_-0001.exr"), {"a": [-2, -1]}),
        (("-0002.exr", "-0001.exr"), {"": [-2, -1]}),
        (("f.9999999.exr", "f.10000000.exr"), {"f": [9999999, 10000000]}),
        (("f.1234567.exr", "f.1234568.exr"), {"f": [1234567, 1234568]}),
        (("szene é 8.1.exr", "szene é 8.2.exr"), {"szene é 8": [1, 2]}),
        (("v002.0101.exr", "v002.0102.exr"), {"v002": [101, 102]}),
        (("UP.0001.EXR",), {"UP": [1]}),
        (("b.0001.exr", "a.0001.exr"), {"a": [1], "b": [1]}),
        (("a.1.RGBA.exr", "a.2.RGBA.exr", "a.1.exr"), {"a": [1], "a.RGBA": [1, 2]}),
        (("a.1.exr", "a.1.proxy.exr"), {"a": [1]}),
    ],
)
def test_names_and_numbers_of_files(
    tmp_path: Path, names: tuple[str, ...], expected: dict[str, list[int]]
) -> None:
    assert numbers(touch(tmp_path, *names)) == expected


@pytest.mark.parametrize(
    "names",
    [("shot-0001.exr", "shot-0002.exr", "shot-0003.exr"), ("shot-0000.exr", "shot-0001.exr")],
)
def test_a_dash_after_a_name_separates_it_from_a_positive_number(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    touch(tmp_path, *names)
    files = only(tmp_path).frames.streams["shot"].files
    assert [path.name for path in files.values()] == list(names)
    assert list(files) == [int(name[5:9]) for name in names]


def test_a_dash_is_a_sign_where_other_frames_of_that_name_have_none(tmp_path: Path) -> None:
    touch(tmp_path, "img-0002.exr", "img-0001.exr", "img0000.exr", "img0001.exr")
    assert numbers(tmp_path) == {"img": [-2, -1, 0, 1]}


def test_folders_and_dead_links_that_are_named_like_frames_are_told(tmp_path: Path) -> None:
    touch(tmp_path, "f.0001.exr", "f.0002.exr")
    (tmp_path / "f.0003.exr").mkdir()
    (tmp_path / "f.0004.exr").symlink_to(tmp_path / "gone" / "f.0004.exr")
    (tmp_path / "notes").mkdir()
    (shot,) = find_shots(tmp_path)
    folder, link = list_misnamed(shot.frames).values()
    assert folder.startswith(f"{tmp_path}/f.0003.exr: is a folder that is named like a frame")
    assert f"is a link to {tmp_path}/gone/f.0004.exr, which is not there; mount or copy" in link
    with pytest.raises(FrameFolderError, match=r"f\.0003\.exr: is a folder .* rename"):
        read_headers(shot.frames, HeaderFiles())


def test_an_empty_lr_folder_beside_hr_frames_is_what_the_refusal_speaks_of(tmp_path: Path) -> None:
    touch(tmp_path / "lr")
    touch(tmp_path / "hr", "0001.exr")
    with pytest.raises(FrameFolderError, match=r"/lr: no numbered EXR frames .* LR frames"):
        find_shots(tmp_path)


def test_shots_below_lr_and_hr_are_found_as_before(tmp_path: Path) -> None:
    touch(tmp_path / "lr" / "a", "0001.exr")
    touch(tmp_path / "hr" / "a", "0001.exr")
    assert [s.name for s in find_shots(tmp_path)] == ["hr/a", "lr/a"]


def test_files_without_a_number_and_other_types_are_left_aside(tmp_path: Path) -> None:
    touch(tmp_path, "f.0001.exr", "thumb.exr", "f.0001.png", "f.0002.tif", "notes.txt")
    assert numbers(tmp_path) == {"f": [1]}


def test_folders_of_one_buffer_each_are_one_shot(tmp_path: Path) -> None:
    for name in ("BaseColor", "SceneDepth"):
        touch(tmp_path / name, "0001.exr")
    (shot,) = find_shots(tmp_path, buffer_folders=("BaseColor", "SceneDepth", "Metallic"))
    assert set(shot.frames.streams) == {"BaseColor/", "SceneDepth/"}


def test_frames_beside_folders_of_one_buffer_each_belong_to_them(tmp_path: Path) -> None:
    touch(tmp_path, "beauty.0001.exr")
    for name in ("SceneDepth", "BunkerMetallic"):
        touch(tmp_path / name, "0001.exr")
    (shot,) = find_shots(tmp_path, buffer_folders=("*SceneDepth", "*Metallic"))
    assert set(shot.frames.streams) == {"beauty", "SceneDepth/", "BunkerMetallic/"}


def test_one_folder_with_a_buffers_name_is_a_shot_of_its_own(tmp_path: Path) -> None:
    touch(tmp_path / "BaseColor", "0001.exr")
    (shot,) = find_shots(tmp_path, buffer_folders=("BaseColor", "SceneDepth"))
    assert shot.name == "BaseColor"


def test_a_folder_without_frames_has_no_frame_set(tmp_path: Path) -> None:
    assert collect_frame_set(touch(tmp_path, "notes.txt")) is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "no such folder"),
        (lambda path: path.touch(), "is a file"),
        (lambda path: path.mkdir(), "no numbered EXR frames"),
        (lambda path: touch(path / "lr", "a.png"), "no numbered EXR frames"),
    ],
)
def test_a_folder_that_cannot_hold_shots_is_refused_by_name(
    tmp_path: Path, make: object, message: str
) -> None:
    path = tmp_path / "in"
    make(path)  # type: ignore[operator]
    with pytest.raises(FrameFolderError, match=rf"in: {message}"):
        find_shots(path)
