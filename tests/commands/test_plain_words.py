"""Messages that a reader understands who was not there: what is read, by what, and why."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

Run = Callable[..., Result]
Copy = Callable[..., Path]


@pytest.mark.parametrize("command", ["predict-vrs", "extrapolate"])
def test_of_a_pair_the_size_that_is_read_is_named(
    rtsr: Run, small_shot: Path, tmp_path: Path, command: str
) -> None:
    said = rtsr(command, small_shot, tmp_path / "out", "--dry-run")
    assert said.exit_code == 0, said.output
    assert f"here those of {small_shot / 'lr'}; to take those of {small_shot / 'hr'}, give" in (
        said.output
    )
    alone = rtsr(command, small_shot / "lr", tmp_path / "out", "--dry-run")
    assert "in place of IN" not in alone.output


def test_the_reading_of_motion_in_use_stands_first_with_what_decides_it(
    rtsr: Run, small_shot: Path
) -> None:
    report = rtsr("inspect", small_shot).output.splitlines()
    measured = next(i for i, line in enumerate(report) if "measured on" in line)
    assert "previous-minus-current" in report[measured + 1]
    assert report[measured + 1].endswith("used: it is declared")
    assert "as it is read" not in "".join(report)


def brighten(stem: str) -> Callable[[dict[str, Any], int], None]:
    def change(planes: dict[str, Any], number: int) -> None:
        del number
        for c in "RGB":
            planes[f"{stem}albedo.{c}"] = 3.0 * planes.pop(f"albedo.{c}")
            if stem:
                planes[f"{stem}Combined.{c}"] = planes.pop(c)
        if stem:
            planes[f"{stem}Depth.Z"] = planes.pop("depth.Z")
            for name in [name for name in planes if not name.startswith(stem)]:
                del planes[name]

    return change


@pytest.mark.parametrize(
    ("stem", "cause", "other"),
    [("", "was multiplied", "Mitsuba"), ("ViewLayer.", "Denoising Albedo", "Mitsuba")],
)
def test_base_colours_above_1_are_explained_as_the_layout_has_it(
    rtsr: Run, small_capture: Path, changed: Copy, stem: str, cause: str, other: str
) -> None:
    report = rtsr("inspect", changed(small_capture, brighten(stem))).output
    (warning,) = (line for line in report.splitlines() if "of 'albedo' are above 1" in line)
    assert cause in warning
    assert other not in warning


@pytest.mark.parametrize(("most", "said"), [(8.0, True), (1.8, False)])
def test_materials_above_2_are_said_with_what_they_count_as(
    rtsr: Run, small_capture: Path, changed: Copy, most: float, said: bool
) -> None:
    def brighten_material(planes: dict[str, Any], number: int) -> None:
        del number
        for c in "RGB":
            planes[f"material.{c}"] = planes[f"albedo.{c}"].copy()
            planes[f"material.{c}"][8:16] = most

    report = rtsr("inspect", changed(small_capture, brighten_material)).output
    assert (f"of 'material' are above 1 (up to {most:g})" in report) == said
    assert ("(above 2 counts as 2)" in report) == said


def test_motion_is_measured_in_radiance_of_any_unit(
    rtsr: Run, small_capture: Path, changed: Copy
) -> None:
    """Candelas a square metre of a sunlit scene are thousands."""

    def expose(planes: dict[str, Any], number: int) -> None:
        del number
        for c in "RGB":
            planes[c] = planes[c].astype("float32") * 3000.0

    usual, bright = (
        rtsr("inspect", capture).output
        for capture in (small_capture, changed(small_capture, expose))
    )
    for said in ("do not follow them", "do not show that it is right"):
        assert said not in usual
        assert said not in bright


def test_the_line_against_a_tint_can_be_pasted(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    def tint(planes: dict[str, Any], number: int) -> None:
        del number
        for c in "GB":
            planes[f"albedo.{c}"] = 2.0 * planes[f"albedo.{c}"]

    shot = tmp_path / "shot"
    shot.mkdir()
    changed(small_shot / "hr", tint).rename(shot / "hr")
    (shot / "lr").symlink_to(small_shot / "lr")
    capture = (small_shot / "capture.toml").read_text()
    (shot / "capture.toml").write_text(capture)
    line = ("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    refused = rtsr(*line)
    assert refused.exit_code == 3
    assert "HR looks to be about 1, 2, 2 x LR in the R, G, B of albedo" in refused.output
    pasted = refused.output.partition("capture.toml: [buffers] ")[2].partition(", or choose")[0]
    assert len(tomllib.loads(pasted)["albedo"]) == 3
    for path in (shot / "hr").iterdir():
        path.rename(path.with_name(path.name.replace("frame", "hr")))
    (shot / "capture.toml").write_text(f"{capture}\n[buffers]\n{pasted}\n")
    mended = rtsr(*line)
    assert mended.exit_code == 0, mended.output
