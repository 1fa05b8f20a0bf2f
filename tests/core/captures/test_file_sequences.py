"""Numbered files of a folder: which are frames, and of which sequence."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtsr_cli.core.captures.file_sequences import list_sequences
from rtsr_cli.core.errors import FrameFolderError


def names_of(folder: Path, *names: str) -> dict[str, dict[int, str]]:
    for name in names:
        (folder / name).touch()
    return {
        key: {number: path.name for number, path in sequence.files.items()}
        for key, sequence in list_sequences(folder).items()
    }


@pytest.mark.parametrize(
    ("name", "key", "number"),
    [
        ("beauty.0001.exr", "beauty", 1),
        ("0012.EXR", "", 12),
        ("beauty.v01.exr", "beauty.v", 1),
        ("shot_v2_0003.exr", "shot_v2", 3),
        ("a1.0004.exr", "a1", 4),
        ("pass2.exr", "pass", 2),
        ("color.0005.RGBA.exr", "color.RGBA", 5),
        ("beauty.-003.exr", "beauty", -3),
    ],
)
def test_the_number_before_the_suffix_counts_frames(
    tmp_path: Path, name: str, key: str, number: int
) -> None:
    assert names_of(tmp_path, name) == {key: {number: name}}


@pytest.mark.parametrize(
    "name",
    ["beauty.exr", "beauty.v1.exr", "a1.b2.exr", "f.0001.rgba.exr", "f.0001.png", ".f.0001.exr"],
)
def test_other_names_are_no_frames(tmp_path: Path, name: str) -> None:
    assert names_of(tmp_path, name) == {}


def test_files_are_sorted_by_number_and_keep_their_names(tmp_path: Path) -> None:
    names = ("f.10.exr", "f.9.exr", "f.0011.exr")
    assert list(names_of(tmp_path, *names)["f"].items()) == [
        (9, "f.9.exr"),
        (10, "f.10.exr"),
        (11, "f.0011.exr"),
    ]


def test_a_dash_behind_every_base_is_no_sign(tmp_path: Path) -> None:
    assert names_of(tmp_path, "shot-1.exr", "shot-2.exr") == {
        "shot": {1: "shot-1.exr", 2: "shot-2.exr"}
    }


def test_a_frame_that_is_there_twice_is_refused_with_both_names(tmp_path: Path) -> None:
    with pytest.raises(FrameFolderError, match=r"frame 1 is there twice \(f\.0001.* and f\.1\."):
        names_of(tmp_path, "f.1.exr", "f.0001.exr")


def test_folders_that_are_named_like_frames_are_none_and_dead_links_are(tmp_path: Path) -> None:
    (tmp_path / "f.0001.exr").mkdir()
    (tmp_path / "f.0002.exr").symlink_to(tmp_path / "gone.exr")
    assert names_of(tmp_path, "f.0003.exr") == {"f": {2: "f.0002.exr", 3: "f.0003.exr"}}
