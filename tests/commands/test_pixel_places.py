"""Outputs and comparisons of frames whose data and display windows differ."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow

Run = Callable[..., Any]

PICTURE = np.random.default_rng(3).random((12, 16)).astype(np.float32)
PLANE = PixelWindow(left=0, top=0, width=16, height=12)
INNER = PixelWindow(left=4, top=2, width=8, height=6)
LARGE = PixelWindow(left=0, top=0, width=32, height=24)


def cut(window: PixelWindow) -> np.ndarray:
    rows = slice(window.top, window.top + window.height)
    return PICTURE[rows, window.left : window.left + window.width]


def write_color(
    path: Path, data: PixelWindow = PLANE, display: PixelWindow = PLANE, pixels: Any = None
) -> None:
    plane = cut(data.seen_from(display)) if pixels is None else pixels
    write_exr(path, dict.fromkeys("RGB", plane), data_window=data, display_window=display)


def write_depth(path: Path, data: PixelWindow, display: PixelWindow) -> None:
    plane = np.full((data.height, data.width), 5.0, np.float32)
    write_exr(path, {"depth.Z": plane}, data_window=data, display_window=display)


def test_an_output_holds_what_its_input_holds(rtsr: Run, tmp_path: Path) -> None:
    write_color(tmp_path / "in" / "f.1.exr", INNER.moved(3, 0), PLANE.moved(3, 0))
    write_color(tmp_path / "in" / "f.2.exr", PLANE.moved(3, 0), PLANE.moved(3, 0))
    result = rtsr(
        "upscale", tmp_path / "in", tmp_path / "out", "--system", "bicubic", "--scale", "2"
    )
    assert result.exit_code == 0, result.output
    first, second = (read_header(tmp_path / "out" / f"f.{n}.exr") for n in (1, 2))
    assert first.display_window == PixelWindow(left=6, top=0, width=32, height=24)
    assert first.data_window == PixelWindow(left=14, top=4, width=16, height=12)
    assert second.data_window == second.display_window == first.display_window
    assert "what an enlargement spreads beyond them is cut off" in " ".join(result.output.split())


@pytest.mark.parametrize("system", ["bicubic", "demod-guided"])
def test_a_preview_shows_nothing_that_the_output_does_not_hold(
    rtsr: Run, small_shot: Path, tmp_path: Path, system: str
) -> None:
    shot = tmp_path / "in"
    shutil.copytree(small_shot, shot)
    for path in (shot / "lr").iterdir():
        header = read_header(path)
        planes = {
            name: plane[8:24, 12:40].copy()
            for name, plane in read_channels(path, header.channels).items()
        }
        place = header.data_window.moved(12, 8)
        write_exr(
            path, planes, attributes=header.attributes, display_window=header.display_window,
            data_window=replace(place, width=28, height=16),
        )  # fmt: skip
    result = rtsr("upscale", shot, tmp_path / "out", "--system", system, "--preview")
    assert result.exit_code == 0, result.output
    path = next(iter(sorted((tmp_path / "out").glob("*.exr"))))
    header = read_header(path)
    held = header.data_window.seen_from(header.display_window)
    picture = oiio.ImageBuf(str(path.with_suffix(".png"))).get_pixels(oiio.UINT8)
    inside = np.zeros(picture.shape, bool)
    inside[held.top : held.top + held.height, held.left : held.left + held.width] = True
    assert picture[inside].mean() > 20
    assert not picture[~inside].any()


def test_pairs_of_crops_run_if_their_planes_have_one_ratio(rtsr: Run, tmp_path: Path) -> None:
    write_color(tmp_path / "shot" / "lr" / "f.1.exr", INNER)
    write_depth(tmp_path / "shot" / "hr" / "f.1.exr", INNER, LARGE)
    result = rtsr("upscale", tmp_path / "shot", tmp_path / "out", "--system", "bicubic")
    assert result.exit_code == 0, result.output
    header = read_header(tmp_path / "out" / "f.1.exr")
    assert header.display_window == LARGE
    assert header.data_window == PixelWindow(left=8, top=4, width=16, height=12)


def test_resolutions_with_planes_at_other_origins_are_one_picture_or_refused(
    rtsr: Run, tmp_path: Path
) -> None:
    write_color(tmp_path / "shot" / "lr" / "f.1.exr")
    large = LARGE.moved(100, 0)
    write_depth(tmp_path / "shot" / "hr" / "f.1.exr", large, large)
    command = ("upscale", tmp_path / "shot", tmp_path / "out", "--system", "bicubic")
    result = rtsr(*command)
    assert result.exit_code == 0, result.output
    red = read_channels(tmp_path / "out" / "f.1.exr", ["R"])["R"].astype(float)
    assert red.mean() == pytest.approx(PICTURE.mean(), abs=0.03)
    write_depth(tmp_path / "shot" / "hr" / "f.1.exr", INNER.moved(100, 0), large)
    result = rtsr(*command, "--overwrite")
    assert result.exit_code == 3
    assert "8 x 6 at (104, 2)" in result.output


def test_an_autocropped_frame_is_the_frame_uncropped(rtsr: Run, tmp_path: Path) -> None:
    write_color(tmp_path / "cut" / "f.1.exr", INNER)
    whole = np.zeros_like(PICTURE)
    whole[2:8, 4:12] = cut(INNER)
    write_color(tmp_path / "whole" / "f.1.exr", pixels=whole)
    result = rtsr("evaluate", tmp_path / "cut", tmp_path / "whole", "--metric", "psnr")
    assert result.exit_code == 0, result.output
    assert "inf" in result.output
    assert "pixels that no file holds are black" in result.output
