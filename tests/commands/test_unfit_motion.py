"""Motion vectors that the frames do not follow: what reads them is refused, the rest runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]
HEIGHT, WIDTH, STEP = 48, 64, 5


def write_frame(path: Path, picture: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    planes = {c: picture[..., i].astype(np.float32) for i, c in enumerate("RGB")}
    depth = np.full((HEIGHT, WIDTH), 5, np.float32)
    write_exr(path, {**planes, "motion.X": x, "motion.Y": y, "depth.Z": depth})


def write_noise(folder: Path) -> None:
    """The same picture twice, and vectors of nothing."""
    chooser = np.random.default_rng(0)
    picture = chooser.random((HEIGHT, WIDTH, 3))
    for number in (1, 2):
        x, y = chooser.normal(0, 3, (2, HEIGHT, WIDTH)).astype(np.float32)
        write_frame(folder / f"f.{number:04d}.exr", picture, x, y)


def cut_picture(position: int) -> np.ndarray:
    """Part of a wide picture, smooth enough that a fraction of a pixel is a small difference."""
    wide = np.random.default_rng(0).random((HEIGHT, 4 * WIDTH, 3))
    wide = np.mean([np.roll(wide, i, 1) for i in range(9)], axis=0)
    left = 2 * WIDTH - STEP * position
    return wide[:, left : left + WIDTH]


def write_vectors_of_another_sequence(folder: Path) -> None:
    """A picture that travels, and vectors of nothing."""
    chooser = np.random.default_rng(0)
    for number in range(1, 5):
        x, y = chooser.normal(0, 9, (2, HEIGHT, WIDTH)).astype(np.float32)
        write_frame(folder / f"f.{number:04d}.exr", cut_picture(number), x, y)


def write_on_twos(folder: Path, *, rests: bool = False) -> None:
    """A picture that travels, each position twice, and vectors that rest there or never."""
    for number in range(1, 9):
        x = np.full((HEIGHT, WIDTH), 0 if rests and number % 2 == 0 else -STEP, np.float32)
        picture = cut_picture((number - 1) // 2)
        write_frame(folder / f"f.{number:04d}.exr", picture, x, np.zeros_like(x))


def write_resting_on_twos(folder: Path) -> None:
    """As a renderer writes it that knows of its repeats."""
    write_on_twos(folder, rests=True)


CASES = [write_noise, write_vectors_of_another_sequence, write_on_twos, write_resting_on_twos]


@pytest.mark.parametrize("make", CASES)
def test_what_reads_motion_is_refused_and_the_rest_runs(
    rtsr: Run, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "in")
    choice = (tmp_path / "in", tmp_path / "out", "--scale", 2, "--system")
    refused = rtsr("upscale", *choice, "taau")
    assert refused.exit_code == 3
    assert "system 'taau' reads motion, but" in refused.output
    assert "motion = {" in refused.output
    done = rtsr("upscale", *choice, "bicubic")
    assert done.exit_code == 0, done.output
    assert "motion is not read" in done.output


@pytest.mark.parametrize("make", CASES)
def test_inspect_says_what_can_run(rtsr: Run, tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "in")
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert facts["systems"]["bicubic"]["ready"]
    assert facts["systems"]["taau"]["missing"] == ["a declared motion convention"]
    assert facts["motion"]["undecided"]
    said = rtsr("inspect", tmp_path / "in").output
    assert "a named layout" not in said
    assert "not read; presumed as" in said


@pytest.mark.parametrize("make", [write_noise, write_on_twos, write_resting_on_twos])
def test_frames_that_repeat_are_named(
    rtsr: Run, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "in")
    choice = (tmp_path / "in", tmp_path / "out", "--scale", 2, "--system", "bicubic")
    result = rtsr("upscale", *choice)
    assert result.exit_code == 0
    assert "show the picture of the frame before them" in result.output
