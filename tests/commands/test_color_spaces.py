"""Which primaries frames are compared in: declared, tagged, or nothing said."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.captures.color_tags import CHROMATICITIES
from rtsr_cli.core.files.exr import read_header, write_exr
from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.imaging.primaries import rec709_matrix

Run = Callable[..., Any]

PICTURE = (2.0 * np.random.default_rng(5).random((32, 48, 3)) ** 2).astype(np.float32)
"""Linear radiance in AP1."""


def write(folder: Path, picture: np.ndarray = PICTURE, declared: str = "", **tags: Any) -> Path:
    planes = {c: np.ascontiguousarray(picture[..., i]) for i, c in enumerate("RGB")}
    write_exr(folder / "f.0001.exr", planes, attributes=tags)
    if declared:
        (folder / "capture.toml").write_text(f'colorspace = "{declared}"\n')
    return folder


def psnr(rtsr: Run, test: Path, ref: Path) -> float:
    report = test.parent / "report.json"
    result = rtsr("evaluate", test, ref, "--metric", "psnr", "--output", report, "--overwrite")
    assert result.exit_code == 0, result.output
    (entry,) = json.loads(report.read_text())["tests"].values()
    value = entry["mean"]["psnr"]
    return float("inf") if value in {"inf", "Infinity"} else float(value)


@pytest.mark.parametrize(
    ("test", "ref"),
    [
        ({"colorInteropID": "lin_ap1_scene"}, {"declared": "acescg"}),
        ({"declared": "lin_ap1"}, {"colorInteropID": "lin_ap1_scene"}),
        ({"declared": "lin_ap1", "colorInteropID": "lin_rec709_scene"}, {"declared": "acescg"}),
        ({}, {"colorInteropID": "lin_rec709_scene"}),
        ({"colorInteropID": "unknown"}, {}),
    ],
    ids=str,
)
def test_the_same_pixels_of_the_same_primaries_are_the_same_picture(
    rtsr: Run, tmp_path: Path, test: dict[str, str], ref: dict[str, str]
) -> None:
    assert psnr(rtsr, write(tmp_path / "t", **test), write(tmp_path / "r", **ref)) == float("inf")


def test_pictures_of_different_primaries_are_compared_in_one(rtsr: Run, tmp_path: Path) -> None:
    matrix = np.array(rec709_matrix(ColorSpace.AP1), np.float32)
    test = write(tmp_path / "t", PICTURE @ matrix.T, colorInteropID="lin_rec709_scene")
    assert psnr(rtsr, test, write(tmp_path / "r", declared="acescg")) > 100.0


def test_what_upscale_writes_is_judged_in_the_space_that_it_names(
    rtsr: Run, tmp_path: Path
) -> None:
    shot = write(tmp_path / "shot", declared="acescg")
    out = tmp_path / "out"
    arguments = ("--system", "bicubic", "--simulate-lr", "2")
    assert rtsr("upscale", shot, out, *arguments).exit_code == 0
    declared = psnr(rtsr, out, shot)
    write(shot, colorInteropID="lin_ap1_scene")
    (shot / "capture.toml").unlink()
    assert psnr(rtsr, out, shot) == pytest.approx(declared)
    tagged = tmp_path / "tagged"
    assert rtsr("upscale", shot, tagged, *arguments).exit_code == 0
    tag = read_header(tagged / "f.0001.exr").attributes["colorInteropID"]
    assert tag == "lin_ap1_scene"


def test_primaries_that_only_one_side_names_are_refused(rtsr: Run, tmp_path: Path) -> None:
    test, ref = write(tmp_path / "t"), write(tmp_path / "r", declared="acescg")
    result = rtsr("evaluate", test, ref, "--metric", "psnr")
    assert result.exit_code == 3
    assert 't/capture.toml: colorspace = "lin_ap1"' in result.output


def test_files_whose_tags_differ_are_refused_unless_declared(rtsr: Run, tmp_path: Path) -> None:
    shot = write(tmp_path / "shot", colorInteropID="lin_ap1_scene")
    planes = dict.fromkeys("RGB", PICTURE[..., 0].copy())
    write_exr(shot / "f.0002.exr", planes, attributes={"colorInteropID": "lin_rec2020_scene"})
    command = (
        "upscale",
        shot,
        tmp_path / "out",
        "--system",
        "bicubic",
        "--scale",
        "2",
        "--dry-run",
    )
    result = rtsr(*command)
    assert result.exit_code == 3
    assert "'lin_ap1_scene', 'lin_rec2020_scene'" in result.output
    (shot / "capture.toml").write_text('colorspace = "lin_ap1"\n')
    assert rtsr(*command).exit_code == 0


def test_inspect_knows_the_layout_of_files_whose_tags_differ(rtsr: Run, tmp_path: Path) -> None:
    shot = write(tmp_path / "shot", colorInteropID="lin_ap1_scene")
    planes = {c: PICTURE[..., i].copy() for i, c in enumerate("RGB")}
    write_exr(shot / "f.0002.exr", planes, attributes={"colorInteropID": "lin_rec2020_scene"})
    said = rtsr("inspect", shot).output
    assert "layout      rtsr (not read: see below)" in said
    assert "files disagree in their colorInteropID" in " ".join(said.split())
    assert "a known layout" not in said


def test_chromaticities_that_contradict_are_named_and_not_obeyed(rtsr: Run, tmp_path: Path) -> None:
    test = write(tmp_path / "t", chromaticities=CHROMATICITIES[ColorSpace.AP1])
    ref = write(tmp_path / "r", chromaticities=CHROMATICITIES[ColorSpace.REC709])
    text = "chromaticities are those of 'lin_ap1', radiance is read as 'lin_rec709'"
    result = rtsr("evaluate", test, ref, "--metric", "psnr")
    assert text in result.output
    assert "reference: chromaticities" not in result.output
    assert psnr(rtsr, test, ref) == float("inf")
    assert text in rtsr("inspect", test).output
    assert "PROBLEM" not in rtsr("inspect", ref).output


@pytest.mark.parametrize("tag", ["srgb_rec709_scene", "bogus", "data"])
def test_a_tag_that_is_no_linear_space_is_named_and_not_compared(
    rtsr: Run, tmp_path: Path, tag: str
) -> None:
    shot, plain = write(tmp_path / "shot", colorInteropID=tag), write(tmp_path / "plain")
    assert f"colorInteropID is '{tag}'" in rtsr("inspect", shot).output
    for pair in ((shot, plain), (plain, shot)):
        result = rtsr("evaluate", *pair, "--metric", "psnr")
        assert result.exit_code == 3
        assert f"colorInteropID is '{tag}'" in result.output
    (shot / "capture.toml").write_text('colorspace = "lin_rec709"\n')
    assert psnr(rtsr, shot, plain) == float("inf")


def test_nothing_is_printed_of_libraries_where_primaries_are_converted(tmp_path: Path) -> None:
    test = write(tmp_path / "t", colorInteropID="lin_ap1_scene")
    ref = write(tmp_path / "r", declared="acescg")
    command = [
        sys.executable,
        "-m",
        "rtsr_cli",
        "evaluate",
        str(test),
        str(ref),
        "--metric",
        "psnr",
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "inf" in result.stdout
    assert "nanobind" not in result.stderr + result.stdout
