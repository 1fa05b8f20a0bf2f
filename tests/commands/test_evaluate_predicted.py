"""`rtsr evaluate` of what `rtsr extrapolate` wrote: stamped frames alone, and change of all."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def sequence(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames with radiance and G-buffer, of one size."""
    shot = tmp_path_factory.mktemp("sequence") / "shot"
    shutil.copytree(sample_root / "lr", shot)
    return shot


@pytest.fixture
def judged(rtsr: Run, sequence: Path, tmp_path: Path) -> Callable[..., tuple[str, dict[str, Any]]]:
    """Extrapolate, judge, and return what is said and the JSON file."""

    def run(extrapolate: tuple[object, ...], *options: object) -> tuple[str, dict[str, Any]]:
        made = rtsr("extrapolate", sequence, tmp_path / "out", *extrapolate)
        assert made.exit_code == 0, made.output
        report = tmp_path / "report.json"
        result = rtsr("evaluate", tmp_path / "out", "--ref", sequence, "--output", report, *options)
        assert result.exit_code == 0, result.output
        return result.output, json.loads(report.read_text(encoding="utf-8"))

    return run


def test_predicted_frames_alone_are_judged_without_further_options(
    judged: Callable[..., tuple[str, dict[str, Any]]],
) -> None:
    said, result = judged(("--system", "warp"), "--metric", "psnr,temporal")
    assert "frames 2, 4, 6 (stamped rtsr:predicted)" in said
    assert "frames 2, 4, 6 alone are judged, stamped rtsr:predicted" in said
    test = result["tests"]["out"]
    assert list(test["frames"]) == ["2", "4", "6"]
    assert test["predicted"] == [2, 4, 6]
    assert test["mean"]["temporal"] is None
    for region in ("disoccluded", "off-screen"):
        assert test["regions"][region]["share"] > 0
        assert test["regions"][region]["psnr"] < test["mean"]["psnr"]


def test_rendered_frames_beside_them_count_for_the_change_alone(
    judged: Callable[..., tuple[str, dict[str, Any]]],
) -> None:
    said, result = judged(("--keep-rendered", "--system", "warp"), "--metric", "psnr,temporal,flip")
    assert "temporal metrics are of the frames between them, too" in said
    frames = result["tests"]["out"]["frames"]
    assert [n for n, f in frames.items() if "psnr" in f] == ["2", "4", "6"]
    assert [n for n, f in frames.items() if f.get("between")] == ["3", "5"]
    values = [f["temporal"] for f in frames.values()]
    assert result["tests"]["out"]["mean"]["temporal"] == pytest.approx(sum(values) / 5)
    psnr = [f["psnr"] for f in frames.values() if "psnr" in f]
    assert result["tests"]["out"]["mean"]["psnr"] == pytest.approx(sum(psnr) / 3)


def test_frames_with_full_history_are_said_apart(
    judged: Callable[..., tuple[str, dict[str, Any]]],
) -> None:
    said, result = judged(("--system", "warp"))
    history = result["tests"]["out"]["history"]
    assert history["less"]["frames"] == [2, 4]
    assert history["full"]["frames"] == [6]
    assert "out, full history (frames 6): PSNR" in said


def test_every_report_and_merged_parts_hold_it(
    rtsr: Run, sequence: Path, tmp_path: Path, judged: Callable[..., tuple[str, dict[str, Any]]]
) -> None:
    options = ("--metric", "psnr,temporal", "--output", tmp_path / "report.html")
    _, whole = judged(
        ("--keep-rendered", "--system", "warp"), *options, "--output", tmp_path / "r.csv"
    )
    assert "rtsr:predicted" in (tmp_path / "report.html").read_text(encoding="utf-8")
    parts = [tmp_path / f"part{i}.json" for i in (1, 2)]
    for i, part in enumerate(parts, 1):
        run = ("evaluate", tmp_path / "out", "--ref", sequence, "--metric", "psnr,temporal")
        result = rtsr(*run, "--shard", f"{i}/2", "--output", part)
        assert result.exit_code == 0, result.output
    merged = tmp_path / "merged.json"
    assert rtsr("evaluate", "--merge", *parts, "--output", merged).exit_code == 0
    joined = json.loads(merged.read_text(encoding="utf-8"))["tests"]["out"]
    assert joined["frames"] == whole["tests"]["out"]["frames"]
    assert joined["history"] == whole["tests"]["out"]["history"]


def test_a_folder_without_stamps_beside_one_with_is_judged_on_the_same_frames(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    rtsr("extrapolate", sequence, tmp_path / "out", "--system", "warp")
    shutil.copytree(sequence, tmp_path / "other")
    report = tmp_path / "r.json"
    result = rtsr(
        "evaluate", tmp_path / "out", tmp_path / "other", "--ref", sequence, "--output", report
    )
    assert result.exit_code == 0, result.output
    tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    assert {tuple(test["frames"]) for test in tests.values()} == {("2", "4", "6")}


def test_a_hole_among_kept_frames_is_refused(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    rtsr("extrapolate", sequence, tmp_path / "out", "--keep-rendered", "--system", "warp")
    (tmp_path / "out" / "frame.0003.exr").unlink()
    result = rtsr("evaluate", tmp_path / "out", "--ref", sequence)
    assert result.exit_code == 3
    assert "lacks 3" in result.output
