from __future__ import annotations

import errno
import os
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
