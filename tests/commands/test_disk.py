"""Disks that are full, folders that take nothing, inputs that vanish or change during the run."""

from __future__ import annotations

import errno
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import InputChangedError
from rtsr_cli.core.files.atomic_write import TEMPORARY_SUFFIX
from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.files.provenance import FileDigests

Run = Callable[..., Result]
Files = Callable[[Path], dict[str, bytes]]
COMMANDS = ["upscale", "demodulate"]


@pytest.fixture
def captures(small_capture: Path, tmp_path: Path) -> Path:
    """A copy of four HR captures, to spoil; both commands can run on it."""
    return Path(shutil.copytree(small_capture, tmp_path / "captures"))


def arguments(command: str, captures: Path, out: Path) -> list[object]:
    simulated = ["--simulate-lr", 4, "--system", "taau"] if command == "upscale" else []
    return [command, captures, out, *simulated]


def assert_whole(out: Path, names: list[str]) -> None:
    """The folder holds these finished frames and nothing else."""
    assert sorted(path.name for path in out.iterdir()) == names
    for name in names:
        assert read_channels(out / name, read_header(out / name).channels)


FRAMES = [f"frame.{number:04d}.exr" for number in range(1, 5)]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_ends_the_run_after_one_message_and_running_again_finishes_it(
    rtsr: Run,
    captures: Path,
    tmp_path: Path,
    files_of: Files,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert rtsr(*arguments(command, captures, whole)).exit_code == 0
    write = Path.write_bytes

    def full(self: Path, content: Any) -> int:
        if "frame.0001" in self.name:
            return write(self, content)
        write(self, bytes(content)[:100])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    result = rtsr(*arguments(command, captures, out))
    assert result.exit_code == 3
    assert re.fullmatch(
        rf"Error: {out}/frame\.000[234]\.exr: cannot be written \(No space left on device\); free "
        r"some space, or choose another output folder\. 1 of 4 frames are done; the same command "
        r"writes the rest then\n",
        result.stderr,
    )
    assert_whole(out, FRAMES[:1])
    monkeypatch.undo()
    assert rtsr(*arguments(command, captures, out)).exit_code == 0
    assert files_of(out) == files_of(whole)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 KiB, where this process may mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("options", [[], ["--preview", "--debug-buffers"]], ids=["plain", "sides"])
@pytest.mark.parametrize("ballast", [8, 60])
def test_a_disk_that_is_really_full(
    rtsr: Run, captures: Path, small_disk: Path, command: str, options: list[str], ballast: int
) -> None:
    if command == "demodulate":
        options = []
    # leaves room for less than the whole run, and hardly for the first file
    (small_disk / "ballast").write_bytes(bytes(ballast << 10))
    result = rtsr(*arguments(command, captures, small_disk), *options)
    assert result.exit_code == 3, result.output
    assert result.stderr.count("\n") == 1
    assert "No space left on device" in result.stderr
    assert "of 4 frames are done" in result.stderr
    assert not [p for p in small_disk.rglob("*") if p.name.endswith(TEMPORARY_SUFFIX)]
    for path in small_disk.glob("*.exr"):
        assert read_channels(path, read_header(path).channels)
    for path in small_disk.glob("*.png"):
        assert path.read_bytes().endswith(b"IEND\xae\x42\x60\x82")


@pytest.mark.parametrize("command", [*COMMANDS, "synth"])
def test_a_limit_on_the_size_of_files_ends_the_run_in_one_message(
    captures: Path, tmp_path: Path, command: str
) -> None:
    out = tmp_path / "out"
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))"
    run = f"{limit}; import sys; from rtsr_cli.cli import main; main()"
    asked = arguments(command, captures, out)
    asked = ["synth", out, "--size", "64x48", "--frames", "1-4"] if command == "synth" else asked
    line = [sys.executable, "-c", run, *map(str, asked)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 3, done.stderr
    assert re.match(rf"Error: {out}/\S+: cannot be written \(File too large\)", done.stderr)
    assert "ulimit -f" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in out.iterdir() if path.suffix != ".toml"] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_that_is_read_only_is_refused_before_any_frame_is_read(
    rtsr: Run, captures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    def refuse(self: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    def unread(*_: object) -> None:
        raise AssertionError("a frame was read")

    monkeypatch.setattr(Path, "touch", refuse)
    monkeypatch.setattr(FrameReader, "read", unread)
    result = rtsr(*arguments(command, captures, tmp_path / "out"))
    assert result.exit_code == 3
    assert f"Error: {tmp_path}/out: cannot write here (Read-only file system)" in result.stderr
    assert "choose another output folder" in result.stderr


@pytest.fixture
def when_read(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[], object]], None]:
    """Do something right before a frame is read for the first time."""

    def arrange(number: int, action: Callable[[], object]) -> None:
        read, done = FrameReader.read, []

        def spoiled(self: FrameReader, asked: int, buffers: Any) -> Any:
            if asked == number and not done:
                done.append(action())
            return read(self, asked, buffers)

        monkeypatch.setattr(FrameReader, "read", spoiled)

    return arrange


When = Callable[[int, Callable[[], object]], None]


@pytest.mark.parametrize("command", COMMANDS)
def test_an_input_that_vanishes_fails_its_frame_and_the_rest_is_done(
    rtsr: Run, captures: Path, tmp_path: Path, when_read: When, command: str
) -> None:
    source, out = captures / FRAMES[2], tmp_path / "out"
    when_read(2, source.unlink)
    # frame 3 is planned, then gone before it is read
    result = rtsr(*arguments(command, captures, out), "--jobs", 1)
    assert result.exit_code == 1
    assert result.stderr.count("Failed: ") == 1
    assert f"Failed: {source}: vanished since the run was planned" in result.stderr
    assert_whole(out, [FRAMES[0], FRAMES[1], FRAMES[3]])


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("moment", ["before", "while"])
def test_an_input_that_changes_fails_its_frame_whenever_it_does(
    rtsr: Run, captures: Path, tmp_path: Path, when_read: When, command: str, moment: str
) -> None:
    source, other, out = captures / FRAMES[2], captures / FRAMES[0], tmp_path / "out"
    when_read(2 if moment == "before" else 3, lambda: shutil.copyfile(other, source))
    result = rtsr(*arguments(command, captures, out), "--jobs", 1)
    assert result.exit_code == 1
    assert f"Failed: {source}: changed since the run was planned" in result.stderr
    assert_whole(out, [FRAMES[0], FRAMES[1], FRAMES[3]])


def test_no_stamp_covers_history_that_was_lost_to_a_change(
    rtsr: Run, captures: Path, tmp_path: Path, when_read: When
) -> None:
    """Frame 4 was made without frame 3: with frame 3 back as it was, it does not count as done."""
    source, out = captures / FRAMES[2], tmp_path / "out"
    before, times = source.read_bytes(), source.stat()
    when_read(3, lambda: source.write_bytes(before[:-1] + b"x"))
    assert rtsr(*arguments("upscale", captures, out), "--jobs", 1).exit_code == 1
    source.write_bytes(before)
    os.utime(source, ns=(times.st_atime_ns, times.st_mtime_ns))
    again = rtsr(*arguments("upscale", captures, out))
    assert again.exit_code == 3
    assert f"{out}/{FRAMES[3]}: rtsr upscale did not write this from these inputs" in again.stderr
    assert rtsr(*arguments("upscale", captures, out), "--overwrite").exit_code == 0


def test_a_file_is_hashed_once_and_checked_by_size_and_time(tmp_path: Path) -> None:
    path, digests = tmp_path / "a", FileDigests()
    path.write_bytes(b"one")
    first = digests.of(path)
    digests.check([path])
    assert digests.bytes_of([path, path]) == 3
    path.write_bytes(b"three")
    assert digests.of(path) == first
    with pytest.raises(InputChangedError, match="changed since the run was planned"):
        digests.check([path])
