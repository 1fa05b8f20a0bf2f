"""Frames with the passes that Blender 5 writes by itself, and no capture.toml."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, write_exr

Run = Callable[..., Result]
Array = NDArray[np.float64]

HEIGHT, WIDTH = 96, 128
SKY_ROWS, METAL, LAMP = 24, slice(48, 80), slice(4, 28)
MISSED = 1e10
"""Depth that Cycles writes where rays leave the scene."""


def render() -> dict[str, Array]:
    """Textured floor, textured metal, a lamp and sky: passes as h x w x channels."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    texture = 0.15 + 0.7 * np.random.default_rng(3).uniform(size=(HEIGHT, WIDTH, 3))
    light = (1.0 + 0.5 * np.sin(rows / 30.0) * np.cos(columns / 40.0))[..., None]
    inside = np.zeros((3, HEIGHT, WIDTH, 1))
    inside[0, :SKY_ROWS] = 1.0
    inside[1, METAL, METAL] = 1.0
    inside[2, METAL, LAMP] = 1.0
    sky, metal, lamp = inside
    surface = 1.0 - sky
    diffuse = texture * surface * (1.0 - metal)
    glossy = (0.04 * (1.0 - metal) + texture * metal) * surface
    emission, environment = 3.0 * texture * lamp, np.ones(3) * (0.2, 0.3, 0.4) * sky
    return {
        "Combined": light * (diffuse + glossy) + emission + environment,
        "Diffuse Color": diffuse,
        "Glossy Color": glossy,
        "Emission": emission,
        "Environment": environment,
        "Denoising Albedo": texture * 20.0,
        "Normal": np.ones(3) * (0.0, 0.0, 1.0) * surface,
        "Depth": 5.0 * surface + MISSED * sky,
        "Vector": np.zeros((HEIGHT, WIDTH, 4)),
        "Object Index": (1.0 + metal + 2.0 * lamp) * surface,
    }


LETTERS = {"Normal": "XYZ", "Depth": "Z", "Vector": "XYZW", "Object Index": "X"}


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("blender") / "in"
    planes = {
        f"ViewLayer.{name}.{letter}": image[..., i].astype(np.float32)
        for name, image in render().items()
        for i, letter in enumerate(LETTERS.get(name, "RGB"))
    }
    for number in (1, 2, 3):
        write_exr(folder / f"shot_{number:04d}.exr", planes)
    return folder


def test_what_the_renderer_writes_by_itself_is_understood(rtsr: Run, shot: Path) -> None:
    facts = json.loads(rtsr("inspect", shot, "--json").stdout)
    assert facts["layout"] == "blender"
    said = {b: f.get("expression") for b, f in facts["buffers"].items() if "expression" in f}
    assert said == {
        "material": "shot:ViewLayer.Diffuse Color.RGB + shot:ViewLayer.Glossy Color.RGB",
        "emission": "shot:ViewLayer.Emission.RGB + shot:ViewLayer.Environment.RGB",
        # Blender's vectors to the next frame point the other way
        "forward": "-1 * shot:ViewLayer.Vector.ZW",
    }
    assert facts["buffers"]["albedo"]["channels"][0] == "shot:ViewLayer.Diffuse Color.R"
    for system in ("demod-bicubic", "demod-guided", "fusesr", "nsrd"):
        assert facts["systems"][system]["ready"], system


def measure(folder: Path) -> tuple[float, Array]:
    """PSNR after x / (1 + x), and the picture."""
    planes = read_channels(folder / "shot_0002.exr", list("RGB"))
    image = np.stack([planes[c].astype(float) for c in "RGB"], axis=-1)
    truth = render()["Combined"]
    error = np.mean((image / (1.0 + image) - truth / (1.0 + truth)) ** 2)
    return float(-10.0 * np.log10(error)), image


def test_demodulation_is_above_bicubic_and_nothing_is_black(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    quality = {}
    for system in ("bicubic", "demod-bicubic", "demod-guided"):
        out = tmp_path / system
        result = rtsr("upscale", shot, out, "--system", system, "--simulate-lr", "4")
        assert result.exit_code == 0, result.output
        quality[system], image = measure(out)
        assert float(image[METAL, METAL].min()) > 0.05
        assert float(image[METAL, LAMP].min()) > 0.2
        assert np.allclose(image[: SKY_ROWS // 2], (0.2, 0.3, 0.4), atol=0.01)
    assert quality["demod-bicubic"] > quality["bicubic"] + 2.0
    assert quality["demod-guided"] > quality["bicubic"] + 2.0
