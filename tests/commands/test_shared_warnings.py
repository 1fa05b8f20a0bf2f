"""What is wrong at both sizes is said once, by every command."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from click.testing import Result

Run = Callable[..., Result]


def test_a_warning_of_both_sizes_is_said_once_and_names_both(
    rtsr: Run, small_shot: Path, changed: Callable[..., Path], tmp_path: Path
) -> None:
    def empty(planes: dict[str, Any], number: int) -> None:
        planes["roughness"] = planes["roughness"] * 0

    shot = tmp_path / "shot"
    shot.mkdir()
    shutil.copy(small_shot / "capture.toml", shot)
    for size in ("lr", "hr"):
        changed(small_shot / size, empty).rename(shot / size)
    said = rtsr("inspect", shot).output
    assert said.count("'roughness' is 0") == 1
    assert "lr and hr: 'roughness' is 0" in said
    said = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run").output
    assert said.count("'roughness' is 0") == 1
    assert f"Warning: {shot / 'lr'} and hr: 'roughness' is 0" in said
    # of one size alone, that one is named
    shutil.rmtree(shot / "lr")
    shutil.copytree(small_shot / "lr", shot / "lr")
    said = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run").output
    assert f"Warning: {shot / 'hr'}: 'roughness' is 0" in said
