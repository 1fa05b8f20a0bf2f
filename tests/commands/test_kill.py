"""Runs that are killed: no partial file, and what is left is completed to the same bytes."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import Result

from rtsr_cli.core.files.atomic_write import TEMPORARY_SUFFIX
from rtsr_cli.core.files.exr import read_channels, read_header

Run = Callable[..., Result]
Files = Callable[[Path], dict[str, bytes]]
KILLS, FRAMES, START_S = 20, 24, 120.0

SERVER = """
import json, os, sys
import rtsr_cli.core.upscale.call
from rtsr_cli.cli import group
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        group(json.loads(line), prog_name="rtsr")
    print(child, flush=True)
    print(os.waitpid(child, 0)[1], flush=True)
"""
"""Forks a run for each line of arguments, so that torch is imported once and not for every kill."""


@pytest.fixture(scope="module")
def long_shot(small_shot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Many frames, the four of the small shot over and over under other numbers."""
    shot = tmp_path_factory.mktemp("long")
    for folder in ("lr", "hr"):
        (shot / folder).mkdir()
        sources = sorted((small_shot / folder).iterdir())
        for number in range(FRAMES):
            os.link(sources[number % 4], shot / folder / f"frame.{number + 1:04d}.exr")
    shutil.copy(small_shot / "capture.toml", shot)
    return shot


def started(name: str, shot: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "rtsr_cli", name, str(shot), str(out), *options]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def wait_for_output(process: subprocess.Popen[bytes], out: Path, count: int = 1) -> None:
    """Return as soon as so many files are finished, or being written, or the process ended."""
    deadline = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < deadline:
        if out.is_dir() and len(list(out.iterdir())) >= count:
            return
        time.sleep(0.002)
    assert process.poll() is not None, "no output in time"


@pytest.fixture
def server() -> Iterator[subprocess.Popen[str]]:
    """A process that runs rtsr in forks of itself."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, "-c", SERVER],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


def killed_at(
    server: subprocess.Popen[str], out: Path, files: int, delay: float, arguments: list[str]
) -> bool:
    """Run rtsr, kill it some time after so many files are there; tell whether it still ran."""
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(json.dumps(arguments) + "\n")
    server.stdin.flush()
    child = int(server.stdout.readline())
    deadline = time.monotonic() + START_S
    while sum(1 for _ in out.iterdir()) < files and time.monotonic() < deadline:
        time.sleep(0.001)
    time.sleep(delay)
    # the server waits for it, so that the number is the child's as long as no status was sent
    with suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)
    status = int(server.stdout.readline())
    assert status in {0, signal.SIGKILL}
    return status == signal.SIGKILL


@pytest.mark.slow
@pytest.mark.parametrize("system", ["taau", "demod-bicubic"])
def test_a_run_that_is_killed_again_and_again_ends_in_the_bytes_of_one_that_was_not(
    rtsr: Run,
    long_shot: Path,
    tmp_path: Path,
    files_of: Files,
    server: subprocess.Popen[str],
    system: str,
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    result = rtsr("upscale", long_shot, whole, "--system", system)
    assert result.exit_code == 0, result.output
    expected = files_of(whole)
    rng = random.Random(system)
    arguments = ["upscale", str(long_shot), str(out), "--system", system]
    sizes = set()
    for _ in range(KILLS):
        out.mkdir(exist_ok=True)
        # from the planning of a run (no file yet) to the middle of any file's writing
        files = min(len(list(out.glob("*.exr"))) + rng.randint(0, 4), FRAMES)
        ended = not killed_at(server, out, files, rng.uniform(0.0, 0.02), arguments)
        for path in out.glob("*.exr"):
            assert path.read_bytes() == expected[path.name], "a file that is there is finished"
        sizes.add(len(list(out.glob("*.exr"))))
        if ended or len(list(out.glob("*.exr"))) == FRAMES:
            shutil.rmtree(out)
    assert len(sizes) > 2, "the kills have to come at different moments"
    result = rtsr("upscale", long_shot, out, "--system", system)
    assert result.exit_code == 0, result.output
    assert "0 failed" in result.output
    assert files_of(out) == expected


@pytest.mark.parametrize("system", ["extranet", "warp-guided"])
def test_an_extrapolation_that_is_killed_ends_in_the_bytes_of_one_that_was_not(
    rtsr: Run, long_shot: Path, tmp_path: Path, files_of: Files, system: str
) -> None:
    shot, out = long_shot / "lr", tmp_path / "out"
    result = rtsr("extrapolate", shot, tmp_path / "whole", "--system", system)
    assert result.exit_code == 0, result.output
    expected = files_of(tmp_path / "whole")
    assert len(expected) == FRAMES // 2
    process = started("extrapolate", shot, out, "--system", system)
    wait_for_output(process, out, 2)
    process.kill()
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert len(list(out.glob("*.exr"))) < len(expected)
    for path in out.glob("*.exr"):
        assert path.read_bytes() == expected[path.name]
    result = rtsr("extrapolate", shot, out, "--system", system)
    assert result.exit_code == 0, result.output
    assert files_of(out) == expected


def test_what_a_killed_run_left_half_written_is_removed(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    host = os.uname().nodename.partition(".")[0]
    part = out / f".frame.0002.exr.{host}-{ended.pid}{TEMPORARY_SUFFIX}"
    part.write_bytes(b"half a file")
    assert rtsr("upscale", small_shot, out, "--system", "bicubic").exit_code == 0
    assert not part.exists()
    assert len(list(out.iterdir())) == 4


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_run_in_one_line_with_finished_frames_only(
    long_shot: Path, tmp_path: Path, sent: signal.Signals, code: int
) -> None:
    out = tmp_path / "out"
    process = started("upscale", long_shot, out, "--system", "taau")
    wait_for_output(process, out, 3)
    process.send_signal(sent)
    signalled = time.monotonic()
    _, err = process.communicate(timeout=20)
    assert time.monotonic() - signalled < 5.0
    assert process.returncode == code
    lines = err.decode().splitlines()
    assert lines == ["Interrupted: what is finished is kept; run again for the rest"]
    names = [path.name for path in out.iterdir()]
    assert 2 <= len(names) < FRAMES
    assert not [name for name in names if name.endswith(TEMPORARY_SUFFIX)]
    for path in out.iterdir():
        assert read_channels(path, read_header(path).channels)
