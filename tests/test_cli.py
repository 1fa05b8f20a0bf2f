"""Signals, at moments that a run rarely meets."""

from __future__ import annotations

import signal
import subprocess
import sys

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
