"""Only the library's lines are swallowed; everyone else's arrive, whoever reads at the time."""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import read_channels, write_exr
from rtsr_cli.core.files.library_output import silence_library


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    path = tmp_path / "a.exr"
    waves = np.sin(np.arange(128 * 128, dtype=np.float32)).round(2).reshape(128, 128)
    write_exr(path, {"R": waves})
    content = bytearray(path.read_bytes())
    content[-600:-500] = bytes(100)
    path.write_bytes(content)
    return path


def test_a_c_level_line_of_the_library_is_dropped_and_others_pass(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with silence_library():
        os.write(2, b"a.exr: (EXR_ERR_CORRUPT_CHUNK) no good\nsomething else\n")
        sys.stdout.write("Warning: of the silenced thread\n")
    sys.stdout.write("afterwards\n")
    assert capfd.readouterr() == ("afterwards\n", "something else\n")


def test_lines_of_other_threads_arrive_while_damaged_files_are_read(
    damaged: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stdout = sys.stdout

    def read() -> None:
        for _ in range(20):
            with pytest.raises(FrameFolderError):
                read_channels(damaged, ["R"])

    threads = [threading.Thread(target=read) for _ in range(3)]
    for thread in threads:
        thread.start()
    for i in range(50):
        sys.stdout.write(f"out {i}\n")
        sys.stderr.write(f"err {i}\n")
        time.sleep(0.001)
    for thread in threads:
        thread.join()
    assert sys.stdout is stdout
    out, err = capfd.readouterr()
    assert out.splitlines() == [f"out {i}" for i in range(50)]
    assert err.splitlines() == [f"err {i}" for i in range(50)]
