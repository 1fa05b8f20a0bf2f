"""Signals, at moments that a run rarely meets."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

AFTER = """
import atexit, os, signal
from rtsr_cli.__main__ import main
atexit.register(lambda: os.kill(os.getpid(), signal.{name}))
main()
"""
BEFORE = """
import os, signal, sys
class Finder:
    def find_spec(self, name, *_):
        if name == "{module}":
            os.kill(os.getpid(), signal.{name})
sys.meta_path.insert(0, Finder())
from rtsr_cli.__main__ import main
main()
"""


@pytest.mark.parametrize(
    ("moment", "module"),
    [(AFTER, ""), (BEFORE, "click"), (BEFORE, "torch")],
    ids=["after", "before", "while torch is imported"],
)
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_outside_of_a_command_is_one_line_too(
    moment: str, module: str, sent: signal.Signals, code: int
) -> None:
    line = [sys.executable, "-c", moment.format(name=sent.name, module=module), "systems"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert done.stderr.startswith("Interrupted: ")
    assert done.stderr.count("\n") == 1
    assert ("bicubic" in done.stdout) == (moment is AFTER)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("options", [[], ["--json"]])
def test_a_full_disk_behind_standard_output_is_one_line(options: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "rtsr_cli", "systems", *options]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.startswith("Error: standard output: cannot be written")
    assert len(done.stderr.splitlines()) == 1
