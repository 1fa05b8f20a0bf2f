from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from rtsr_cli.core.errors import OutputBlockedError, OutputError
from rtsr_cli.core.files import atomic_write


def part_of(folder: Path, host: str, process: int) -> Path:
    part = folder / f".f.0001.exr.{host}-{process}{atomic_write.TEMPORARY_SUFFIX}"
    part.touch()
    return part


def ended_process() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


def own_host(folder: Path) -> str:
    return atomic_write.name_temporary(folder / "f.exr").name.split(".")[3].rpartition("-")[0]


def test_parts_of_a_run_that_died_are_removed_and_nothing_else(tmp_path: Path) -> None:
    dead = part_of(tmp_path, own_host(tmp_path), ended_process())
    (tmp_path / "f.0001.exr").touch()
    (tmp_path / ".keep").touch()
    atomic_write.remove_leftovers(tmp_path)
    atomic_write.remove_leftovers(tmp_path / "not there")
    assert not dead.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == [".keep", "f.0001.exr"]


def test_parts_that_a_living_process_is_writing_stay(tmp_path: Path) -> None:
    living = part_of(tmp_path, own_host(tmp_path), os.getppid())
    atomic_write.remove_leftovers(tmp_path)
    assert living.exists()


def test_parts_of_another_machine_stay_for_a_day(tmp_path: Path) -> None:
    fresh, old = (part_of(tmp_path, "elsewhere", number) for number in (1, 2))
    os.utime(old, (0, 0))
    atomic_write.remove_leftovers(tmp_path)
    assert fresh.exists()
    assert not old.exists()


@pytest.mark.parametrize(
    ("code", "blocks"),
    [
        (errno.ENOSPC, True),
        (errno.EDQUOT, True),
        (errno.EROFS, True),
        (errno.EFBIG, True),
        (errno.ENAMETOOLONG, False),
    ],
)
def test_what_hits_every_file_is_told_from_what_hits_one(
    tmp_path: Path, code: int, blocks: bool
) -> None:
    def write(part: Path) -> None:
        part.write_bytes(b"half")
        raise OSError(code, os.strerror(code))

    with pytest.raises(OutputError) as refusal:
        atomic_write.write_atomically(tmp_path / "a", write)
    assert isinstance(refusal.value, OutputBlockedError) == blocks
    assert os.strerror(code) in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


def test_a_thread_that_is_interrupted_leaves_no_part(tmp_path: Path) -> None:
    def write(part: Path) -> None:
        part.write_bytes(b"half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        atomic_write.write_atomically(tmp_path / "a", write)
    assert list(tmp_path.iterdir()) == []


def test_a_private_writer_leaves_a_file_with_ordinary_permissions(tmp_path: Path) -> None:
    def write(part: Path) -> None:
        part.unlink()
        os.close(os.open(part, os.O_CREAT | os.O_WRONLY, 0o600))

    before = os.umask(0o027)
    try:
        atomic_write.write_atomically(tmp_path / "weights.safetensors", write)
    finally:
        os.umask(before)
    assert (tmp_path / "weights.safetensors").stat().st_mode & 0o777 == 0o640


def test_a_text_replaces_what_was_there_whole(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "a.toml"
    for text in ("größer\n", ""):
        atomic_write.write_text_atomically(path, text)
        assert path.read_bytes() == text.encode()
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("name", ["a.exr", "f" * 249 + ".0001", "é" * 124 + ".exr", ".hidden"])
def test_a_temporary_name_fits_where_the_final_one_does_and_cannot_be_guessed(
    tmp_path: Path, name: str
) -> None:
    names = {atomic_write.name_temporary(tmp_path / name).name for _ in range(100)}
    assert len(names) == 100
    assert all(len(os.fsencode(temporary)) < 128 for temporary in names)
    atomic_write.write_text_atomically(tmp_path / name, "whole")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("taken", ["file", "link"])
def test_nothing_that_lies_in_wait_is_written_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taken: str
) -> None:
    victim, part = tmp_path / "victim", tmp_path / "part"
    victim.write_text("mine")
    part.symlink_to(victim) if taken == "link" else part.write_text("other")
    monkeypatch.setattr(atomic_write, "name_temporary", lambda path: part)
    with pytest.raises(OutputError):
        atomic_write.write_text_atomically(tmp_path / "out", "bytes")
    assert victim.read_text() == "mine"
    assert not (tmp_path / "out").exists()


def test_a_link_in_the_targets_place_is_replaced_and_not_followed(tmp_path: Path) -> None:
    victim, target = tmp_path / "victim", tmp_path / "out"
    victim.write_text("mine")
    target.symlink_to(victim)
    atomic_write.write_text_atomically(target, "bytes")
    assert victim.read_text() == "mine"
    assert not target.is_symlink()


def test_content_reaches_the_disk_before_its_name_and_the_name_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    happened: list[str] = []
    sync, replace = os.fsync, Path.replace

    def synced(number: int) -> None:
        kind = "folder" if stat.S_ISDIR(os.fstat(number).st_mode) else "content"
        happened.append(f"{kind} {os.fstat(number).st_size if kind == 'content' else ''}".strip())
        sync(number)

    def replaced(self: Path, target: Path) -> Path:
        happened.append("name")
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", replaced)
    atomic_write.write_text_atomically(tmp_path / "out", "bytes")
    assert happened == ["content 5", "name", "folder"]


@pytest.mark.parametrize(("code", "fails"), [(errno.EIO, True), (errno.EINVAL, False)])
def test_a_disk_that_loses_content_is_told_from_one_that_cannot_be_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, fails: bool
) -> None:
    def sync(number: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", sync)
    if fails:
        with pytest.raises(OutputBlockedError):
            atomic_write.write_text_atomically(tmp_path / "out", "bytes")
    else:
        atomic_write.write_text_atomically(tmp_path / "out", "bytes")
    assert [path.name for path in tmp_path.iterdir()] == ([] if fails else ["out"])


def test_what_killed_runs_left_is_removed_wherever_something_is_written(tmp_path: Path) -> None:
    folders = [tmp_path / "checked", tmp_path / "written"]
    for folder in folders:
        folder.mkdir()
        part_of(folder, own_host(folder), ended_process())
    atomic_write.check_writable(folders[0])
    atomic_write.write_text_atomically(folders[1] / "out", "")
    assert [list(folder.iterdir()) for folder in folders] == [[], [folders[1] / "out"]]


def test_a_part_of_a_number_that_is_anothers_by_now_goes_after_a_day(tmp_path: Path) -> None:
    part = part_of(tmp_path, own_host(tmp_path), os.getppid())
    os.utime(part, (0, 0))
    atomic_write.remove_leftovers(tmp_path)
    assert not part.exists()


def test_a_name_that_is_not_utf8_is_named_where_a_text_would_hold_it(tmp_path: Path) -> None:
    name = os.fsdecode(b"/in/n\xff\xe9")
    with pytest.raises(OutputError, match=r"j\.json: is not written: .*/in/n\\xff\\xe9', which"):
        atomic_write.write_text_atomically(tmp_path / "j.json", f'["upscale", "{name}", "zz"]')
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["file", "loop", "dangling"])
def test_what_stands_where_a_folder_would_be_is_named(tmp_path: Path, kind: str) -> None:
    there = tmp_path / "there"
    if kind == "file":
        there.touch()
    else:
        there.symlink_to("there" if kind == "loop" else "nowhere")
    with pytest.raises(OutputError, match=f"{there} is a"):
        atomic_write.check_writable(there / "below")


def test_a_name_that_no_folder_takes_is_refused(tmp_path: Path) -> None:
    atomic_write.check_names([tmp_path / "none" / ("n" * 255)])
    with pytest.raises(OutputError, match="256 bytes long"):
        atomic_write.check_names([tmp_path / "a", tmp_path / ("n" * 256)])
