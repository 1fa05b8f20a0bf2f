"""Trees that nobody tidied: links, pipes and stray files among the frames. The shots are done."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]
UPSCALE = ("--system", "bicubic", "--scale", 2)


def write_frame(path: Path) -> Path:
    rng = np.random.default_rng(1)
    write_exr(path, {name: rng.random((32, 48), np.float32) for name in "RGB"})
    return path


def written(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*.exr"))


def test_a_loop_of_links_is_named_once_and_the_shot_is_done(rtsr: Run, tmp_path: Path) -> None:
    write_frame(tmp_path / "in/shot/f.0001.exr")
    (tmp_path / "in/shot/up").symlink_to("..")
    result = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE)
    assert result.exit_code == 0, result.output
    assert written(tmp_path / "out") == ["shot/f.0001.exr"]
    assert result.stderr.count("not searched") == 1
    found = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert any("not searched" in text for text in found["problems"])


@pytest.mark.parametrize("kind", ["dangling", "loop", "fifo", "folder"])
def test_a_capture_toml_that_is_no_file_is_named_and_the_shot_is_done(
    rtsr: Run, tmp_path: Path, kind: str
) -> None:
    write_frame(tmp_path / "in/shot/f.0001.exr")
    path = tmp_path / "in/capture.toml"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("not there" if kind == "dangling" else "capture.toml")
    result = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE)
    assert result.exit_code == 0, result.output
    assert written(tmp_path / "out") == ["shot/f.0001.exr"]
    assert result.stderr.count(f"{path}: is ") == 1


NUMBERS = [20251128131500, 10**18, 10**27]


@pytest.mark.parametrize("number", NUMBERS)
def test_a_stray_number_is_a_short_gap(rtsr: Run, tmp_path: Path, number: int) -> None:
    for n in (1, 2, number):
        write_frame(tmp_path / f"in/f.{n:04d}.exr")
    gap = f"'f' lacks 3-{number - 1}"
    refused = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE)
    assert refused.exit_code == 3
    assert gap in refused.stderr
    held = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE, "--on-missing", "hold")
    assert held.exit_code == 3
    assert f"frames 3-{number - 1} are missing, more than can be held" in held.stderr
    found = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert found["missing"] == {"f": [f"3-{number - 1}"]}
    skipped = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE, "--on-missing", "skip")
    assert skipped.exit_code == 0, skipped.output
    assert len(written(tmp_path / "out")) == 3


def test_more_digits_than_frame_numbers_have_are_refused(rtsr: Run, tmp_path: Path) -> None:
    for n in (1, 10**100):
        write_frame(tmp_path / f"in/f.{n:04d}.exr")
    result = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE)
    assert result.exit_code == 3
    assert f"{tmp_path}/in/f.1{'0' * 100}.exr: is numbered with more digits" in result.stderr


def test_a_frame_that_is_a_link_to_itself_is_named_as_such(rtsr: Run, tmp_path: Path) -> None:
    write_frame(tmp_path / "in/f.0001.exr")
    (tmp_path / "in/f.0002.exr").symlink_to("g.0002.exr")
    (tmp_path / "in/g.0002.exr").symlink_to("f.0002.exr")
    said = rtsr("inspect", tmp_path / "in").output
    assert "f.0002.exr: is a link to g.0002.exr, which leads back to itself" in " ".join(
        said.split()
    )


@pytest.mark.parametrize(
    "frames", ["1-999999999999999999", "1-100000000", "9" * 5000, "1x0", "1-5x0"]
)
def test_ranges_of_frames_that_no_shot_has_are_usage_errors(
    rtsr: Run, tmp_path: Path, frames: str
) -> None:
    write_frame(tmp_path / "in/f.0001.exr")
    result = rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE, "--frames", frames)
    assert result.exit_code == 2, result.output
