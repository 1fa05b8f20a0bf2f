"""Motion vectors that the frames do not follow: what reads them is refused, the rest runs."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, write_exr

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


def write_noise_of_its_own(folder: Path) -> None:
    """A picture of noise each frame, and vectors of nothing."""
    chooser = np.random.default_rng(0)
    for number in (1, 2, 3):
        x, y = chooser.normal(0, 3, (2, HEIGHT, WIDTH)).astype(np.float32)
        write_frame(folder / f"f.{number:04d}.exr", chooser.random((HEIGHT, WIDTH, 3)), x, y)


def write_noise_over_a_still(folder: Path) -> None:
    """A picture that rests but for a little noise, and vectors of nothing."""
    chooser = np.random.default_rng(0)
    for number in (1, 2, 3):
        x, y = chooser.normal(0, 9, (2, HEIGHT, WIDTH)).astype(np.float32)
        picture = cut_picture(1) + chooser.normal(0, 1e-3, (HEIGHT, WIDTH, 3))
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


CASES = [
    write_noise,
    write_noise_of_its_own,
    write_noise_over_a_still,
    write_vectors_of_another_sequence,
    write_on_twos,
    write_resting_on_twos,
]


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


@pytest.mark.parametrize(
    ("contrast", "noise"),
    [
        pytest.param(1.0, 0.0, id="clean"),
        pytest.param(1e-6, 0.0, id="dark"),
        pytest.param(0.0, 0.0, id="black"),
        pytest.param(1.0, 0.5, id="noisy"),
        pytest.param(1e-6, 0.5, id="dark and noisy"),
    ],
)
def test_vectors_that_frames_follow_are_read(
    rtsr: Run, tmp_path: Path, contrast: float, noise: float
) -> None:
    """Radiance alone, each value with noise of its own of that share."""
    assert rtsr("synth", tmp_path / "made", "--size", "64x48", "--frames", "1-4").exit_code == 0
    chooser = np.random.default_rng(0)
    for path in sorted((tmp_path / "made").glob("*.exr")):
        planes = read_channels(path, ("R", "G", "B", "motion.X", "motion.Y"))
        picture = np.stack([planes[c] for c in "RGB"], axis=-1) * contrast
        picture = picture * (1.0 + noise * chooser.normal(size=picture.shape))
        write_frame(tmp_path / "in" / path.name, picture, planes["motion.X"], planes["motion.Y"])
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert not facts["motion"]["undecided"]
    assert facts["systems"]["taau"]["ready"]


def test_declared_vectors_are_read_whatever_the_frames_say(rtsr: Run, tmp_path: Path) -> None:
    write_noise_of_its_own(tmp_path / "in")
    declared = 'motion = {unit = "pixels", direction = "previous-minus-current", y_axis = "down"}'
    (tmp_path / "in" / "capture.toml").write_text(declared)
    choice = (tmp_path / "in", tmp_path / "out", "--scale", 2, "--system", "taau")
    result = rtsr("upscale", *choice)
    assert result.exit_code == 0, result.output
    assert "the frames do not follow them" in result.stderr


@pytest.mark.parametrize("make", [write_noise, write_on_twos, write_resting_on_twos])
def test_frames_that_repeat_are_named(
    rtsr: Run, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "in")
    choice = (tmp_path / "in", tmp_path / "out", "--scale", 2, "--system", "bicubic")
    result = rtsr("upscale", *choice)
    assert result.exit_code == 0
    assert re.search("show(s)? the picture of the frame before (?(1)it|them)", result.output)
