"""Passes that were not rendered: what commands say of them, and what they make without them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Load = Callable[[Path], NDArray[np.float32]]
NORMAL = ("normal.X", "normal.Y", "normal.Z")
FRAMES = (2, 3)
LOSS_DB = 0.1
"""What a system may lose against `bicubic` where a pass that guides it is empty."""


def spoil(folder: Path, names: tuple[str, ...], value: float = 0.0, *, sky: bool = False) -> None:
    """Give channels one value on the surfaces of all frames of a folder, or everywhere."""
    for path in folder.glob("*.exr"):
        header = read_header(path)
        planes = {k: v.copy() for k, v in read_channels(path, header.channels).items()}
        where = (planes["depth.Z"] < 65504.0) | sky
        for channel in names:
            planes[channel][where] = value
        write_exr(path, planes, attributes=header.attributes)


@pytest.fixture
def shot(sample_root: Path, tmp_path: Path) -> Path:
    """Some frames of the sample, free to be changed."""
    for size in ("lr", "hr", "reference"):
        (tmp_path / "shot" / size).mkdir(parents=True)
        for number in FRAMES:
            name = f"frame.{number:04d}.exr"
            shutil.copy(sample_root / size / name, tmp_path / "shot" / size / name)
    shutil.copy(sample_root / "capture.toml", tmp_path / "shot" / "capture.toml")
    return tmp_path / "shot"


@pytest.mark.parametrize("sizes", [("lr",), ("hr",), ("lr", "hr")])
def test_normals_of_0_are_said_and_lose_nothing_against_bicubic(
    rtsr: Run, shot: Path, tmp_path: Path, load_rgb: Load, sizes: tuple[str, ...]
) -> None:
    for size in sizes:
        spoil(shot / size, NORMAL)
    text = " ".join(rtsr("inspect", shot).output.split())
    said = "'normal' is 0 on 100.0% of the surfaces of frames 2-3"
    # once, whether at one size or at both
    assert text.count(said) == 1
    both = len(sizes) == 2
    assert (f"warning lr and hr: {said}" in text) == both

    def measure(system: str) -> float:
        result = rtsr("upscale", shot, tmp_path / system, "--system", system)
        assert result.exit_code == 0, result.output
        where = f"{shot / 'lr'} and hr" if both else str(shot / sizes[0])
        assert result.output.count(said) == 1
        assert f"{where}: {said}" in result.output
        errors = []
        for number in FRAMES:
            name = f"frame.{number:04d}.exr"
            images = load_rgb(tmp_path / system / name), load_rgb(shot / "reference" / name)
            mapped, wanted = (image / (1.0 + image) for image in images)
            errors.append(-10.0 * np.log10(np.mean((mapped - wanted) ** 2)))
        return float(np.mean(errors))

    least = measure("bicubic") - LOSS_DB
    assert measure("demod-guided") > least
    assert measure("demod-temporal") > least


@pytest.mark.parametrize("size", ["lr", "hr"])
@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("albedo.R", "albedo.G", "albedo.B"), "'albedo' is 0 on 100.0% of the surfaces"),
        (("roughness",), "'roughness' is 0 on 100.0% of the surfaces"),
        (("motion.X", "motion.Y"), "'motion' is zero in every pixel of frame 3, though the camera"),
        (("depth.Z",), "of the depth values are 0, negative or no number"),
        (("objectid",), ""),
    ],
)
def test_an_empty_pass_is_said_by_inspect_and_by_upscale(
    rtsr: Run, shot: Path, tmp_path: Path, size: str, names: tuple[str, ...], said: str
) -> None:
    # the sky moves as well
    spoil(shot / size, names, sky="motion.X" in names)
    result = rtsr("inspect", shot)
    inspected = " ".join(result.output.split())
    planned = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    # a warning: the frames are upscaled, and the exit code is that of a run
    assert result.exit_code == planned.exit_code == 0, planned.output
    assert "PROBLEM" not in inspected
    if not said:
        assert "warning" not in inspected
        assert "Warning" not in planned.output
        return
    assert said in inspected.partition("warning ")[2]
    assert f"{shot / size}: " in planned.output
    assert said in planned.output


def test_depth_that_is_no_number_is_a_problem_of_pixels(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    """`inspect` exits with what `upscale` would: every frame fails."""
    spoil(shot / "hr", ("depth.Z",), np.nan)
    result = rtsr("inspect", shot)
    assert result.exit_code == 1
    said = " ".join(result.output.split())
    assert "values of 'depth' are NaN or Inf in frames 2-3" in said.partition("PROBLEM ")[2]
    assert rtsr("upscale", shot, tmp_path / "o", "--system", "demod-guided").exit_code == 1
