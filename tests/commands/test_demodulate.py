"""`rtsr demodulate` and its inverse."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header

Run = Callable[..., Result]
Load = Callable[[Path], NDArray[np.float32]]
MODES = ["brdf", "softplus", "albedo", "glossy-albedo"]


def relative_error(test: NDArray[np.float32], reference: NDArray[np.float32]) -> float:
    return float((np.abs(test - reference) / np.maximum(np.abs(reference), 1e-3)).max())


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("precision", "bound"), [((), 2e-3), (("--float",), 1e-5)])
def test_multiplying_back_returns_the_radiance(
    rtsr: Run,
    small_capture: Path,
    tmp_path: Path,
    load_rgb: Load,
    mode: str,
    precision: tuple[str, ...],
    bound: float,
) -> None:
    forward = rtsr("demodulate", small_capture, tmp_path / "parts", "--mode", mode, *precision)
    assert forward.exit_code == 0, forward.output
    back = rtsr("demodulate", tmp_path / "parts", tmp_path / "back", "--inverse", *precision)
    assert back.exit_code == 0, back.output
    for path in sorted(small_capture.glob("*.exr")):
        error = relative_error(load_rgb(tmp_path / "back" / path.name), load_rgb(path))
        assert error <= bound


def test_the_parts_recompose_by_hand_and_the_report_is_true(
    rtsr: Run, small_capture: Path, tmp_path: Path, load_rgb: Load
) -> None:
    result = rtsr("demodulate", small_capture, tmp_path / "out")
    path = tmp_path / "out" / "frame.0001.exr"
    header = read_header(path)
    parts = {k: v.astype(np.float32) for k, v in read_channels(path, header.channels).items()}
    assert set(parts) == {
        *(f"{layer}.{c}" for layer in ("lighting", "material", "emission") for c in "RGB"), "mask",
    }  # fmt: skip
    recomposed = np.stack(
        [parts[f"lighting.{c}"] * parts[f"material.{c}"] + parts[f"emission.{c}"] for c in "RGB"]
    )
    assert relative_error(recomposed, load_rgb(small_capture / "frame.0001.exr")) < 1e-3
    assert "is the radiance to within" in result.output
    assert "% of the pixels, which are sky" in result.output
    assert set(np.unique(parts["mask"])) <= {0.0, 1.0}


def test_sky_is_left_undivided(rtsr: Run, small_capture: Path, tmp_path: Path) -> None:
    rtsr("demodulate", small_capture, tmp_path / "out", "--frames", 1)
    path = tmp_path / "out" / "frame.0001.exr"
    mask = read_channels(path, ["mask"])["mask"]
    depth = read_channels(small_capture / "frame.0001.exr", ["depth.Z"])["depth.Z"]
    sky = depth >= 65504
    assert sky.any()
    assert (mask[sky] == 0).all()
    material = read_channels(path, ["material.R"])["material.R"]
    assert (material[sky] == 1).all()


def test_both_table_conventions_recompose_but_divide_differently(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    lighting: dict[str, Any] = {}
    for convention in ("karis", "seed"):
        out = tmp_path / convention
        run = rtsr("demodulate", small_capture, out, "--convention", convention, "--frames", 1)
        assert run.exit_code == 0
        lighting[convention] = read_channels(out / "frame.0001.exr", ["lighting.G"])["lighting.G"]
    assert (lighting["karis"] != lighting["seed"]).any()


def test_a_second_run_keeps_what_is_there(rtsr: Run, small_capture: Path, tmp_path: Path) -> None:
    rtsr("demodulate", small_capture, tmp_path / "out")
    assert "0 written, 4 kept" in rtsr("demodulate", small_capture, tmp_path / "out").output
    other = rtsr("demodulate", small_capture, tmp_path / "out", "--mode", "albedo")
    assert other.exit_code == 3


def test_missing_radiance_is_named(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    result = rtsr("demodulate", small_shot / "hr", tmp_path / "out")
    assert result.exit_code == 3
    assert "buffer 'color' is missing" in result.output
