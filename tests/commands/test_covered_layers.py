"""`rtsr upscale` of premultiplied frames: a layer is its own colour up to its edge."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, write_exr
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.models import load_system

Run = Callable[..., Result]
Array = NDArray[np.float32]

SCALE = 4
SIZE = (32, 48)
SYSTEMS = [
    name
    for name in (
        "bicubic", "demod-bicubic", "demod-guided", "taau", "fusesr", "fusesr-fast", "nsrd",
    )
    if has_weights(load_system(name), SCALE)
]  # fmt: skip


def disc(height: int, width: int, number: int, samples: int) -> Array:
    """Coverage of a disc that moves a pixel to the right a frame."""
    y, x = (
        (np.arange(side * samples) + 0.5) * SIZE[0] / (height * samples) for side in (height, width)
    )
    inside = (x[None, :] - 20 - number) ** 2 + (y[:, None] - 16) ** 2 < 81
    blocks = inside.reshape(height, samples, width, samples)
    return np.asarray(blocks.mean((1, 3)), np.float32)


def surfaces(scale: int, number: int, *, sky: bool) -> dict[str, Array]:
    """A G-buffer of one material, on the disc alone or everywhere."""
    height, width = SIZE[0] * scale, SIZE[1] * scale
    one = np.ones((height, width), np.float32)
    on = disc(height, width, number, 1) if sky else one
    return {
        **{f"albedo.{c}": 0.5 * one for c in "RGB"},
        "normal.X": 0 * one, "normal.Y": 0 * one, "normal.Z": on,
        "depth.Z": np.where(on > 0, 5.0, 65504.0).astype(np.float32),
        "roughness": 0.5 * one, "metallic": 0 * one, "nov": one,
        "motion.X": -scale * one, "motion.Y": 0 * one,
    }  # fmt: skip


@pytest.fixture
def layer(tmp_path: Path) -> Callable[..., Path]:
    """A shot of two frames of a disc of one premultiplied colour; `change` edits LR channels."""

    def make(
        value: float, *, sky: bool = True, change: Callable[[dict[str, Any]], None] | None = None
    ) -> Path:
        shot = tmp_path / f"shot-{value}-{sky}"
        for number in (1, 2):
            alpha = disc(*SIZE, number, 8)
            planes: dict[str, Any] = {c: value * alpha for c in "RGB"} | {"A": alpha}
            planes |= surfaces(1, number, sky=sky)
            if change is not None:
                change(planes)
            write_exr(shot / "lr" / f"f.{number:04d}.exr", planes)
            write_exr(shot / "hr" / f"f.{number:04d}.exr", surfaces(SCALE, number, sky=sky))
        return shot

    return make


def read(path: Path, names: str = "RGBA") -> dict[str, Array]:
    return {c: p.astype(np.float32) for c, p in read_channels(path, names).items()}


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize(("value", "sky"), [(0.8, True), (8.0, True), (8.0, False)])
def test_a_layer_over_its_own_colour_stays_that_colour(
    rtsr: Run, layer: Callable[..., Path], tmp_path: Path, system: str, value: float, sky: bool
) -> None:
    result = rtsr("upscale", layer(value, sky=sky), tmp_path / "out", "--system", system)
    assert result.exit_code == 0, result.output
    for number in (1, 2):
        made = read(tmp_path / "out" / f"f.{number:04d}.exr")
        assert 0.05 < ((made["A"] > 0.01) & (made["A"] < 0.99)).mean() < 0.2
        for channel in "RGB":
            over = made[channel] + (1.0 - made["A"]) * value
            np.testing.assert_allclose(over, value, rtol=0.03)


@pytest.mark.parametrize("system", ["bicubic", "demod-bicubic", "taau"])
def test_alpha_that_is_1_everywhere_changes_no_byte_of_the_colour(
    rtsr: Run, layer: Callable[..., Path], tmp_path: Path, system: str
) -> None:
    def cover(planes: dict[str, Any]) -> None:
        planes["A"] = np.ones(SIZE, np.float32)

    def drop(planes: dict[str, Any]) -> None:
        del planes["A"]

    for name, change in (("with", cover), ("without", drop)):
        shot = layer(0.8, change=change)
        assert rtsr("upscale", shot, tmp_path / name, "--system", system).exit_code == 0
    one, other = (
        read_channels(tmp_path / name / "f.0002.exr", "RGB") for name in ("with", "without")
    )
    for channel in "RGB":
        assert one[channel].tobytes() == other[channel].tobytes()


@pytest.mark.parametrize("alpha", [0.0, -0.25])
def test_sky_of_a_colour_and_no_coverage_is_as_it_was_without_alpha(
    rtsr: Run, layer: Callable[..., Path], tmp_path: Path, alpha: float
) -> None:
    def light_sky(planes: dict[str, Any], *, drop: bool = False) -> None:
        sky = planes["depth.Z"] > 100
        for channel in "RGB":
            planes[channel] = np.where(sky, 1.7, 0.8).astype(np.float32)
        planes["A"] = np.where(sky, alpha, 1.0).astype(np.float32)
        if drop:
            del planes["A"]

    for name, drop in (("with", False), ("without", True)):
        shot = layer(0.8, change=lambda planes, drop=drop: light_sky(planes, drop=drop))
        run = rtsr("upscale", shot, tmp_path / name, "--system", "demod-bicubic")
        assert run.exit_code == 0, run.output
    one, other = (read(tmp_path / name / "f.0001.exr", "RGB") for name in ("with", "without"))
    for channel in "RGB":
        np.testing.assert_array_equal(one[channel], other[channel])


@pytest.mark.parametrize("system", SYSTEMS)
def test_light_that_is_added_survives_beside_a_layer(
    rtsr: Run, layer: Callable[..., Path], tmp_path: Path, system: str
) -> None:
    def add_fire(planes: dict[str, Any]) -> None:
        for channel in "RGB":
            planes[channel][4:12, 36:46] = 6.0

    shot = layer(0.8, change=add_fire)
    assert rtsr("upscale", shot, tmp_path / "out", "--system", system).exit_code == 0
    made = read(tmp_path / "out" / "f.0001.exr")
    assert not made["A"][24:40, 152:176].any()
    for channel in "RGB":
        np.testing.assert_allclose(made[channel][24:40, 152:176], 6.0, rtol=0.03)


def test_filtered_lr_frames_have_filtered_coverage(
    rtsr: Run, layer: Callable[..., Path], tmp_path: Path
) -> None:
    shot = layer(8.0)
    options = ("--simulate-lr", 2, "--lr-filter", "blackman-harris", "--system", "bicubic")
    assert rtsr("upscale", shot / "lr", tmp_path / "out", *options).exit_code == 0
    made = read(tmp_path / "out" / "f.0001.exr")
    np.testing.assert_allclose(made["R"] + (1 - made["A"]) * 8.0, 8.0, rtol=0.03)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_coverage_that_is_no_number_is_bad_as_any_buffer_is(
    rtsr: Run, layer: Callable[..., Path], tmp_path: Path, bad: float
) -> None:
    def spoil(planes: dict[str, Any]) -> None:
        planes["A"][16, 20] = bad

    shot = layer(8.0, change=spoil)
    refused = rtsr("upscale", shot, tmp_path / "out", "--system", "bicubic")
    assert refused.exit_code == 1
    assert "1 value of 'alpha' is NaN or Inf" in refused.output
    choice = ("--system", "bicubic", "--on-nonfinite", "inpaint")
    assert rtsr("upscale", shot, tmp_path / "out", *choice).exit_code == 0
    made = read(tmp_path / "out" / "f.0001.exr")
    np.testing.assert_allclose(made["R"] + (1 - made["A"]) * 8.0, 8.0, rtol=0.03)
