"""Pairing folders: shots by path, frames by number, sizes checked before any pixel is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.evaluation.comparisons import CompareOptions, name_methods, open_comparisons
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.selection import Selection, Shard
from rtsr_cli.core.pairs.opening import ReadOptions

HEIGHT, WIDTH = 16, 24


def write(folder: Path, numbers: range | list[int], scale: int = 1, **attributes: int) -> Path:
    plane = np.full((HEIGHT * scale, WIDTH * scale), 0.5, np.float16)
    named = {f"rtsr:{name}": value for name, value in attributes.items()}
    for number in numbers:
        path = folder / f"frame.{number:04d}.exr"
        write_exr(path, dict.fromkeys("RGB", plane), attributes=named)
    return folder


def test_methods_are_named_by_what_tells_their_folders_apart(tmp_path: Path) -> None:
    folders = [tmp_path / "out" / name for name in ("a", "b/4x")]
    assert name_methods(folders) == {"a": folders[0], "b/4x": folders[1]}
    assert list(name_methods([tmp_path / "out"])) == ["out"]


def test_the_same_folder_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameFolderError, match="the same folder is given twice"):
        name_methods([tmp_path, tmp_path / "x" / ".."])


def test_frames_go_by_number_and_shots_by_path(tmp_path: Path) -> None:
    for shot in ("one", "deep/two"):
        write(tmp_path / "test" / shot, range(1, 4))
        write(tmp_path / "ref" / shot / "reference", range(1, 4))
    found = open_comparisons({"test": tmp_path / "test"}, tmp_path / "ref", CompareOptions())
    assert [c.shot for c in found] == ["deep/two", "one"]
    assert found[0].reference.frames.root == tmp_path / "ref/deep/two/reference"
    assert found[0].numbers == (1, 2, 3)


def test_pictures_of_debug_folders_are_no_shot(tmp_path: Path) -> None:
    write(tmp_path / "test", range(1, 3))
    write(tmp_path / "test/debug", range(1, 3))
    write(tmp_path / "ref", range(1, 3))
    found = open_comparisons({"test": tmp_path / "test"}, tmp_path / "ref", CompareOptions())
    assert [c.shot for c in found] == [""]


def test_a_frame_that_one_folder_lacks_is_named(tmp_path: Path) -> None:
    test, ref = write(tmp_path / "test", [1, 2, 4]), write(tmp_path / "ref", range(1, 5))
    skip = CompareOptions(read=ReadOptions(on_missing=MissingPolicy.SKIP))
    with pytest.raises(FrameFolderError, match=r"test: frames are missing: 'frame' lacks 3"):
        open_comparisons({"test": test}, ref, CompareOptions())
    assert open_comparisons({"test": test}, ref, skip)[0].numbers == (1, 2, 4)
    write(tmp_path / "short", range(1, 4))
    with pytest.raises(FrameFolderError, match=r"short: frame 4 is missing, which others have"):
        open_comparisons({"test": tmp_path / "short"}, ref, CompareOptions())
    few = CompareOptions(selection=Selection(frames=frozenset({1, 2})))
    assert open_comparisons({"test": tmp_path / "short"}, ref, few)[0].numbers == (1, 2)


def test_history_reaches_over_the_start_of_a_part(tmp_path: Path) -> None:
    test, ref = write(tmp_path / "test", range(1, 7)), write(tmp_path / "ref", range(1, 7))
    part = CompareOptions(selection=Selection(shard=Shard(index=2, count=2)))
    found = open_comparisons({"test": test}, ref, part)[0]
    assert found.numbers == (4, 5, 6)
    assert found.previous(4) == 3
    assert found.previous(1) is None


def test_sizes_that_differ_are_told_with_what_may_help(tmp_path: Path) -> None:
    test, ref = write(tmp_path / "test", [1]), write(tmp_path / "ref", [1], scale=2)
    with pytest.raises(FrameFolderError, match=r"are 24 x 16, .* 48 x 32; .*samples-per-pixel 2"):
        open_comparisons({"test": test}, ref, CompareOptions())
    assert open_comparisons({"test": test}, ref, CompareOptions(samples=2))[0].size == (16, 24)
    with pytest.raises(FrameFolderError, match=r"compare frames of one size$"):
        open_comparisons({"test": ref}, test, CompareOptions())


PLANE = PixelWindow(left=0, top=0, width=WIDTH, height=HEIGHT)


def write_part(folder: Path, data: PixelWindow, display: PixelWindow = PLANE) -> Path:
    plane = np.full((data.height, data.width), 0.5, np.float16)
    write_exr(
        folder / "frame.0001.exr", dict.fromkeys("RGB", plane), data_window=data,
        display_window=display,
    )  # fmt: skip
    return folder


def test_a_crop_is_compared_in_its_image_plane(tmp_path: Path) -> None:
    cut = write_part(tmp_path / "cut", PixelWindow(left=2, top=1, width=20, height=14))
    ref = write(tmp_path / "ref", [1])
    assert open_comparisons({"cut": cut}, ref, CompareOptions())[0].size == (HEIGHT, WIDTH)


def test_overscan_that_makes_sizes_differ_is_named(tmp_path: Path) -> None:
    wide = write_part(tmp_path / "wide", PixelWindow(left=-2, top=0, width=28, height=16))
    with pytest.raises(FrameFolderError, match=r"28 x 16 .*data window 28 x 16 at \(-2, 0\)"):
        open_comparisons({"wide": wide}, write(tmp_path / "ref", [1]), CompareOptions())


def test_planes_of_other_origins_are_compared_only_where_pixels_lie_alike(tmp_path: Path) -> None:
    moved = PLANE.moved(100, 50)
    ref = write_part(tmp_path / "ref", PLANE)
    same = write_part(tmp_path / "same", moved, moved)
    assert open_comparisons({"same": same}, ref, CompareOptions())[0].size == (HEIGHT, WIDTH)
    inner = PixelWindow(left=100, top=50, width=20, height=14)
    cut = write_part(tmp_path / "cut", inner, moved)
    with pytest.raises(FrameFolderError, match=r"20 x 14 at \(100, 50\).*24 x 16 at \(0, 0\)"):
        open_comparisons({"cut": cut}, ref, CompareOptions())


def test_pictures_of_one_channel_are_refused(tmp_path: Path) -> None:
    write_exr(tmp_path / "grey/frame.0001.exr", {"Y": np.zeros((4, 4), np.float16)})
    ref = write(tmp_path / "ref", [1])
    with pytest.raises(FrameFolderError, match="has the single channel 'Y'"):
        open_comparisons({"grey": tmp_path / "grey"}, ref, CompareOptions())


def test_predicted_frames_are_found_by_their_stamp(tmp_path: Path) -> None:
    write(tmp_path / "test", [1, 3])
    write(tmp_path / "test", [2, 4], predicted=1)
    ref = write(tmp_path / "ref", range(1, 5))
    found = open_comparisons({"test": tmp_path / "test"}, ref, CompareOptions(predicted_only=True))
    assert found[0].numbers == found[0].available == (2, 4)
    assert found[0].previous(2) == 1, "history is what was there, stamped or not"
    write(tmp_path / "plain", range(1, 5))
    with pytest.raises(FrameFolderError, match=r"no frame stamped rtsr:predicted to judge"):
        open_comparisons({"p": tmp_path / "plain"}, ref, CompareOptions(predicted_only=True))


def test_a_reference_without_the_shot_says_where_it_was_looked_for(tmp_path: Path) -> None:
    write(tmp_path / "test/one", [1])
    write(tmp_path / "ref/two", [1])
    with pytest.raises(FrameFolderError, match=r"ref/one: .*'reference', 'hr' below.*shot 'one'"):
        open_comparisons({"test": tmp_path / "test"}, tmp_path / "ref", CompareOptions())
