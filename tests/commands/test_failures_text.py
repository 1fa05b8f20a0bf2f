"""What is said of frames that fail for one reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rtsr_cli.commands.failures_text import Failures


def test_a_cause_is_said_once_and_then_the_frames_that_it_is_of_as_well() -> None:
    failures = Failures()
    said = [failures.add(".", n, f"in, frame {n}: {n + 5} values are NaN") for n in (1, 2, 3, 5)]
    said.append(failures.add(".", 4, "in/f.0004.exr: cannot be read"))
    assert said == [True, False, False, False, True]
    assert list(failures.list_repeats()) == ["frames 2-3, 5 fail for the same reason as frame 1"]


def test_shots_are_told_apart() -> None:
    failures = Failures()
    assert failures.add("a", 1, "NaN")
    assert failures.add("b", 1, "NaN")
    assert not failures.add("b", 2, "NaN")
    assert list(failures.list_repeats()) == ["b: frame 2 fails for the same reason as frame 1"]


def spoil(planes: dict[str, Any], number: int) -> None:
    planes["albedo.R"][0, : number + 1] = np.nan


def test_a_run_gathers_what_fails_alike_and_json_keeps_each(
    rtsr: Any, small_capture: Path, changed: Any, tmp_path: Path
) -> None:
    shot = changed(small_capture, spoil)
    command = ("demodulate", shot, tmp_path / "out")
    run = rtsr(*command)
    assert run.exit_code == 1
    first, again = [line for line in run.output.splitlines() if line.startswith("Failed: ")]
    assert "frame 1: 2 values of 'albedo' are NaN or Inf" in first
    assert again == "Failed: frames 2-4 fail for the same reason as frame 1"
    events = rtsr(*command, "--json").stdout.splitlines()
    assert sum("are NaN or Inf" in line for line in events) == 4
