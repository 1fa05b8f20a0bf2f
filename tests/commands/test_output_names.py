"""Outputs are called as the inputs are; what a shot declares holds for its folders, too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]

SIZE = (16, 24)


def write_frames(folder: Path, pattern: str, *, prefix: str = "") -> Path:
    for number in (1, 2):
        planes = {f"{prefix}{c}": np.full(SIZE, 0.5, np.float32) for c in "RGB"}
        planes |= {f"albedo.{c}": np.full(SIZE, 0.5, np.float32) for c in "RGB"}
        write_exr(folder / pattern.format(number), planes)
    return folder


def list_names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.exr"))


@pytest.mark.parametrize(
    "pattern", ["shot_{:04d}.exr", "frame.{:04d}.exr", "frame-{:04d}.exr", "{:04d}.exr"]
)
@pytest.mark.parametrize(
    "command", [("upscale", "--scale", "2"), ("demodulate", "--mode", "albedo")]
)
def test_outputs_have_the_names_of_their_inputs(
    rtsr: Run, tmp_path: Path, pattern: str, command: tuple[str, ...]
) -> None:
    shot, out = write_frames(tmp_path / "in", pattern), tmp_path / "out"
    for _ in range(2):
        result = rtsr(command[0], shot, out, *command[1:])
        assert result.exit_code == 0, result.output
        assert list_names(out) == list_names(shot)


def test_outputs_of_another_separator_are_kept_and_not_doubled(rtsr: Run, tmp_path: Path) -> None:
    shot, out = write_frames(tmp_path / "in", "shot_{:04d}.exr"), tmp_path / "out"
    run = ("upscale", shot, out, "--scale", "2")
    assert rtsr(*run).exit_code == 0
    older = out / "shot.0001.exr"
    (out / "shot_0001.exr").rename(older)
    before = older.read_bytes()
    assert rtsr(*run).exit_code == 0
    assert list_names(out) == ["shot.0001.exr", "shot_0002.exr"]
    assert older.read_bytes() == before
    stale = ("upscale", shot, out, "--scale", "4")
    assert rtsr(*stale).exit_code == 3
    assert older.read_bytes() == before
    assert rtsr(*stale, "--overwrite").exit_code == 0
    assert list_names(out) == ["shot.0001.exr", "shot_0002.exr"]
    assert older.read_bytes() != before


@pytest.mark.parametrize("part", ["", "hr"])
def test_a_folder_of_a_shot_is_read_as_the_shot_declares(
    rtsr: Run, tmp_path: Path, part: str
) -> None:
    shot = tmp_path / "shot"
    write_frames(shot / "hr", "f.{:04d}.exr", prefix="lit_")
    (shot / "capture.toml").write_text('[buffers]\ncolor = ["lit_R", "lit_G", "lit_B"]\n')
    test = write_frames(tmp_path / "test", "f.{:04d}.exr")
    result = rtsr("evaluate", test, "--ref", shot / part, "--fail-under", "psnr>100")
    assert result.exit_code == 0, result.output
