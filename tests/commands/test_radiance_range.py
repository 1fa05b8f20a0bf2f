"""Radiance that half cannot hold is written float, that below 0 is counted; both are said."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, write_exr
from rtsr_cli.core.frames.storage import MAX_HALF

Run = Callable[..., Result]
Array = NDArray[np.float32]
SIZE = (32, 48)


def one(value: float, size: tuple[int, int] = SIZE) -> Array:
    return np.full(size, value, np.float32)


def surface(scale: int = 1) -> dict[str, Array]:
    size = (SIZE[0] * scale, SIZE[1] * scale)
    return {
        **{f"albedo.{c}": one(0.5, size) for c in "RGB"},
        **{f"normal.{c}": one(float(c == "Z"), size) for c in "XYZ"},
        "depth.Z": one(5, size), "roughness": one(0.5, size), "metallic": one(0, size),
        "nov": one(1, size), "motion.X": one(0, size), "motion.Y": one(0, size),
    }  # fmt: skip


def write_shot(shot: Path, *frames: dict[str, Any] | float) -> Path:
    """LR frames of one radiance, or of the channels given; G-buffers at 2x."""
    for number, frame in enumerate(frames, start=1):
        radiance = frame if isinstance(frame, dict) else {c: one(frame) for c in "RGB"}
        write_exr(shot / "lr" / f"f.{number:04d}.exr", surface() | radiance)
        write_exr(shot / "hr" / f"f.{number:04d}.exr", surface(2))
    return shot


def events_of(result: Result) -> list[dict[str, Any]]:
    return [json.loads(line) for line in result.stdout.splitlines()]


@pytest.mark.parametrize("value", [7e4, 2e5, 1e7])
@pytest.mark.parametrize("system", ["bicubic", "demod-bicubic", "demod-guided", "taau"])
def test_upscale_keeps_radiance_that_half_cannot_hold(
    rtsr: Run, tmp_path: Path, system: str, value: float
) -> None:
    shot = write_shot(tmp_path / "shot", 3.0, value, value, 2.0)
    result = rtsr("upscale", shot, tmp_path / "out", "--system", system, "--json")
    assert result.exit_code == 0, result.output
    for number, wide in ((1, False), (2, True), (3, True), (4, False)):
        made = read_channels(tmp_path / "out" / f"f.{number:04d}.exr", "RGB")
        assert {p.dtype for p in made.values()} == {np.dtype(np.float32 if wide else np.float16)}
        if system != "taau" or number == 3:
            expected = {1: 3.0, 2: value, 3: value, 4: 2.0}[number]
            np.testing.assert_allclose(made["G"].astype(np.float32), expected, rtol=1e-2)
    *frames, done = events_of(result)[-5:]
    told = {f["number"]: f["as_float"] for f in frames}
    assert told == {1: False, 2: True, 3: True, 4: False}
    assert done["as_float"] == 2


@pytest.mark.parametrize("system", ["bicubic", "demod-bicubic", "taau"])
def test_upscale_keeps_radiance_that_half_would_round_to_0(
    rtsr: Run, tmp_path: Path, system: str
) -> None:
    shot = write_shot(tmp_path / "shot", 9e-10, 1e-7, 1e-4, 0.0)
    result = rtsr("upscale", shot, tmp_path / "out", "--system", system, "--json")
    assert result.exit_code == 0, result.output
    for number, wide in ((1, True), (2, True), (3, False), (4, False)):
        made = read_channels(tmp_path / "out" / f"f.{number:04d}.exr", "RGB")["G"]
        if system != "taau" or number == 1:
            assert made.dtype == np.dtype(np.float32 if wide else np.float16)
            expected = {1: 9e-10, 2: 1e-7, 3: 1e-4, 4: 0.0}[number]
            np.testing.assert_allclose(made.astype(np.float32), expected, rtol=1e-2)
    assert events_of(result)[-1]["as_float"] == 2


def test_demodulate_keeps_radiance_that_half_would_round_to_0(rtsr: Run, tmp_path: Path) -> None:
    frame = surface() | {c: one(9e-10) for c in "RGB"}
    write_exr(tmp_path / "in" / "f.0001.exr", frame)
    result = rtsr("demodulate", tmp_path / "in", tmp_path / "out")
    assert result.exit_code == 0, result.output
    parts = read_channels(tmp_path / "out" / "f.0001.exr", ("lighting.R", "material.R"))
    whole = parts["lighting.R"].astype(np.float64) * parts["material.R"]
    np.testing.assert_allclose(whole, 9e-10, rtol=1e-2)
    assert "written as float" in result.stderr


@pytest.mark.parametrize("value", [7e4, 2e5, 1e7])
def test_accumulated_radiance_is_what_it_was(rtsr: Run, tmp_path: Path, value: float) -> None:
    shot = write_shot(tmp_path / "shot", value, value, value)
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "cgts", "--json")
    assert result.exit_code == 0, result.output
    for number in (1, 2, 3):
        made = read_channels(tmp_path / "out" / f"f.{number:04d}.exr", "RGB")
        assert made["G"].dtype == np.float32
        np.testing.assert_allclose(made["G"], value, rtol=1e-2)


def test_one_bright_pixel_makes_the_frame_float_and_stays(rtsr: Run, tmp_path: Path) -> None:
    color = one(0.25)
    color[10, 20] = 3e5
    shot = write_shot(tmp_path / "shot", {c: color for c in "RGB"})
    choice = ("--system", "bicubic", "--scale", 1)
    result = rtsr("upscale", shot / "lr", tmp_path / "out", *choice)
    made = read_channels(tmp_path / "out" / "f.0001.exr", "R")["R"]
    assert made[10, 20] == pytest.approx(3e5)
    assert made[20, 20] == pytest.approx(0.25)
    assert "which half cannot hold: written as float: f.0001.exr" in result.output


def test_the_largest_half_stays_half(rtsr: Run, tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", MAX_HALF)
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "bicubic")
    made = read_channels(tmp_path / "out" / "f.0001.exr", "R")["R"]
    assert made.dtype == np.float16
    assert float(made.max()) == MAX_HALF
    assert "float" not in result.output


@pytest.mark.parametrize("value", [7e4, 2e5, 1e9])
def test_demodulate_writes_what_it_divides_and_measures_what_it_writes(
    rtsr: Run, tmp_path: Path, value: float
) -> None:
    shot = write_shot(tmp_path / "shot", value, 2.0)
    result = rtsr("demodulate", shot / "lr", tmp_path / "parts", "--json")
    assert result.exit_code == 0, result.output
    first, second, done = events_of(result)[-3:]
    assert (first["as_float"], second["as_float"], done["as_float"]) == (True, False, 1)
    parts = read_channels(tmp_path / "parts" / "f.0001.exr", ["lighting.R", "material.R"])
    product = parts["lighting.R"].astype(np.float64) * parts["material.R"]
    error = np.abs(product - value).max() / value
    assert error < 1e-6
    assert first["error"] == pytest.approx(error, abs=2e-7)
    back = rtsr("demodulate", tmp_path / "parts", tmp_path / "back", "--inverse")
    assert "written as float: f.0001.exr" in back.output
    for number, expected in ((1, value), (2, 2.0)):
        made = read_channels(tmp_path / "back" / f"f.{number:04d}.exr", "B")["B"]
        np.testing.assert_allclose(made.astype(np.float64), expected, rtol=1e-3)


def test_demodulate_keeps_emission_that_half_cannot_hold(rtsr: Run, tmp_path: Path) -> None:
    frame = {c: one(9e4) for c in "RGB"} | {f"emission.{c}": one(8e4) for c in "RGB"}
    shot = write_shot(tmp_path / "shot", frame)
    assert rtsr("demodulate", shot / "lr", tmp_path / "parts").exit_code == 0
    names = ["lighting.R", "material.R", "emission.R"]
    parts = read_channels(tmp_path / "parts" / "f.0001.exr", names)
    lighting, material, emission = (parts[name].astype(np.float64) for name in names)
    np.testing.assert_allclose(emission, 8e4)
    np.testing.assert_allclose(lighting * material + emission, 9e4, rtol=1e-6)


@pytest.fixture
def dark(tmp_path: Path) -> Path:
    """A frame of three values below 0, and one without."""
    color = one(0.5)
    color[3, 4:7] = -0.25
    return write_shot(tmp_path / "dark", {"R": color, "G": one(0.5), "B": one(0.5)}, 0.5) / "lr"


@pytest.mark.parametrize(
    "command",
    [
        ("upscale", "--system", "bicubic", "--scale", 1),
        ("upscale", "--system", "bicubic", "--scale", 2),
        ("demodulate",),
        ("label", "--kind", "vrs"),
    ],
)
def test_radiance_below_0_is_counted_and_said(
    rtsr: Run, dark: Path, tmp_path: Path, command: tuple[object, ...]
) -> None:
    name, *options = command
    said = rtsr(name, dark, tmp_path / "a", *options)
    assert said.exit_code == 0, said.output
    assert "3 values of radiance are below 0" in said.output
    assert "(f.0001.exr: 3)" in said.output
    told = events_of(rtsr(name, dark, tmp_path / "b", *options, "--json"))
    assert [e["negative"] for e in told if e["event"] == "frame"] == [3, 0]
    assert told[-1]["negative"] == 3


def test_inspect_names_radiance_below_0(rtsr: Run, dark: Path) -> None:
    said = rtsr("inspect", dark)
    assert "3 values of 'color' are below 0 in frame 1" in said.output
    assert json.loads(rtsr("inspect", dark, "--json").stdout)["negative"] == {"color": {"1": 3}}


@pytest.mark.parametrize("protocol", ["rtsr", "nsrd", "fusesr"])
def test_evaluate_tells_radiance_below_0_apart(rtsr: Run, tmp_path: Path, protocol: str) -> None:
    """-5 beside -1 is (5/6 - 1/2)^2 = 1/9: 9.54 dB."""
    for name, value in (("a", -5.0), ("b", -1.0)):
        write_exr(tmp_path / name / "f.0001.exr", {c: one(value) for c in "RGB"})
    choice = ("--metric", "psnr", "--protocol", protocol)
    result = rtsr("evaluate", tmp_path / "a", tmp_path / "b", *choice, "--json")
    assert result.exit_code == 0, result.output
    test = events_of(result)[-1]["tests"]["a"]
    assert test["mean"]["psnr"] == pytest.approx(10 * np.log10(9), abs=1e-3)
    values = 3 * SIZE[0] * SIZE[1]
    assert (test["negative"], test["negative_reference"]) == (values, values)
    said = rtsr("evaluate", tmp_path / "a", tmp_path / "b", *choice)
    assert f"Note: a: radiance is below 0 in {values} values of frame 1" in said.output
    assert f"Note: a: the reference is below 0 in {values} values of frame 1" in said.output


def test_evaluate_finds_equal_frames_equal_below_0(rtsr: Run, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_exr(tmp_path / name / "f.0001.exr", {c: one(-2.0) for c in "RGB"})
    result = rtsr("evaluate", tmp_path / "a", tmp_path / "b", "--metric", "psnr", "--json")
    assert events_of(result)[-1]["tests"]["a"]["mean"]["psnr"] == "inf"
