"""Trees with links, loops, folders that cannot be read: each folder once, all shots there."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from rtsr_cli.core.captures.shots import Shot, find_shots
from rtsr_cli.core.errors import FrameFolderError


def touch(folder: Path, *names: str) -> Path:
    """Shots are found by names alone, so that empty files will do."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).touch()
    return folder


def names(shots: list[Shot]) -> list[str]:
    return [shot.name for shot in shots]


@pytest.fixture
def locked(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Make a folder unreadable for anybody, root as well."""
    real = os.scandir

    def lock(folder: Path) -> None:
        def scan(path: Any = ".") -> Any:
            if Path(path) == folder:
                raise PermissionError(13, "Permission denied", str(path))
            return real(path)

        monkeypatch.setattr(os, "scandir", scan)

    return lock


@pytest.mark.parametrize("target", ["..", ".", "../.."])
def test_a_link_to_a_folder_that_holds_it_is_named_and_not_followed(
    tmp_path: Path, target: str
) -> None:
    touch(tmp_path / "beside", "f.0001.exr")
    shot = touch(tmp_path / "in" / "shot", "f.0001.exr")
    (shot / "up").symlink_to(target)
    shots = find_shots(tmp_path / "in")
    assert names(shots) == ["shot"]
    (remark,) = shots[0].remarks
    assert remark.startswith(f"not searched: {shot / 'up'} (leads to ")


def test_two_folders_that_link_to_each_other_are_two_shots(tmp_path: Path) -> None:
    for name, other in (("a", "b"), ("b", "a")):
        touch(tmp_path / name, "f.0001.exr")
        (tmp_path / name / "other").symlink_to(tmp_path / other)
    assert names(find_shots(tmp_path)) == ["a", "b"]


def test_a_folder_that_a_link_leads_to_as_well_is_read_by_its_own_path(tmp_path: Path) -> None:
    touch(tmp_path / "take 7", "f.0001.exr")
    (tmp_path / "best").symlink_to("take 7")
    shots = find_shots(tmp_path)
    assert names(shots) == ["take 7"]
    assert (
        f"{tmp_path / 'best'} (leads to {tmp_path / 'take 7'}, which is read" in shots[0].remarks[0]
    )


def test_links_out_of_the_tree_are_followed_in_the_order_of_their_names(tmp_path: Path) -> None:
    touch(tmp_path / "store" / "x", "f.0001.exr")
    touch(tmp_path / "in" / "b", "f.0001.exr")
    (tmp_path / "in" / "a").symlink_to(tmp_path / "store" / "x")
    shots = find_shots(tmp_path / "in")
    assert names(shots) == ["a", "b"]
    assert shots[0].remarks == ()


def test_two_links_to_one_folder_outside_are_two_shots_and_its_loops_end(tmp_path: Path) -> None:
    touch(tmp_path / "x", "f.0001.exr")
    touch(tmp_path / "y", "f.0001.exr")
    (tmp_path / "x" / "l").symlink_to(tmp_path / "y")
    (tmp_path / "y" / "l").symlink_to(tmp_path / "x")
    (tmp_path / "in").mkdir()
    for name in ("a", "b"):
        (tmp_path / "in" / name).symlink_to(tmp_path / "x")
    found = names(find_shots(tmp_path / "in"))
    assert {"a", "b"} <= set(found)
    assert len(found) <= 4


def test_links_that_lead_nowhere_are_no_folders(tmp_path: Path) -> None:
    touch(tmp_path / "shot", "f.0001.exr")
    (tmp_path / "self").symlink_to("self")
    (tmp_path / "gone").symlink_to("not there")
    assert names(find_shots(tmp_path)) == ["shot"]
    with pytest.raises(FrameFolderError, match="no such folder"):
        find_shots(tmp_path / "self")


def test_lr_and_hr_may_be_links(tmp_path: Path) -> None:
    touch(tmp_path / "store" / "l", "f.0001.exr")
    touch(tmp_path / "store" / "h", "f.0001.exr")
    (tmp_path / "in" / "shot").mkdir(parents=True)
    for name in ("lr", "hr"):
        (tmp_path / "in" / "shot" / name).symlink_to(tmp_path / "store" / name[0])
    (shot,) = find_shots(tmp_path / "in")
    assert shot.name == "shot"
    assert shot.hr is not None
    assert shot.remarks == ()


def test_a_folder_that_cannot_be_read_is_named_and_the_shots_are_found(
    tmp_path: Path, locked: Any
) -> None:
    touch(tmp_path / "shot", "f.0001.exr")
    lost = touch(tmp_path / "lost+found")
    locked(lost)
    (shot,) = find_shots(tmp_path)
    assert shot.remarks == (f"not searched: {lost}: cannot be read (Permission denied)",)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("mode", [0o000, 0o400, 0o100])
def test_modes_that_keep_a_folder_from_being_read(tmp_path: Path, mode: int) -> None:
    touch(tmp_path / "shot", "f.0001.exr")
    lost = touch(tmp_path / "lost", "f.0001.exr")
    lost.chmod(mode)
    try:
        (shot,) = find_shots(tmp_path)
    finally:
        lost.chmod(0o700)
    assert str(lost) in shot.remarks[0]


def test_the_folder_that_is_named_itself_is_refused_where_it_cannot_be_read(
    tmp_path: Path, locked: Any
) -> None:
    locked(touch(tmp_path / "in", "f.0001.exr"))
    with pytest.raises(FrameFolderError, match=r"in: cannot be read \(Permission denied\)"):
        find_shots(tmp_path / "in")


def test_a_name_longer_than_any_is_no_folder() -> None:
    with pytest.raises(FrameFolderError, match="no such folder"):
        find_shots(Path("x" * 5000))


def test_many_folders_that_are_left_out_are_one_short_line(tmp_path: Path) -> None:
    shot = touch(tmp_path / "shot", "f.0001.exr")
    for i in range(40):
        (shot / f"up{i:02d}").symlink_to("..")
    (remark,) = find_shots(tmp_path)[0].remarks
    assert remark.endswith(" and 35 more")
    assert "\n" not in remark
