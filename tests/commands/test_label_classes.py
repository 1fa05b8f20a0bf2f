"""`rtsr label --kind cgts` as a user runs it."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]

CGTS = ("--kind", "cgts", "--samples-per-pixel", "2")
SIZE = (24, 32)
"""Height and width of the labels."""


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three frames of 2 x 2 samples a pixel."""
    out = tmp_path_factory.mktemp("capture") / "shot"
    size = f"{SIZE[1]}x{SIZE[0]}"
    rendered = ["synth", str(out), "--samples", "2", "--size", size, "--frames", "1-3"]
    result = CliRunner().invoke(group, rendered)
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="module")
def labelled(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labels of every frame, with pictures."""
    out = tmp_path_factory.mktemp("labels") / "out"
    result = CliRunner().invoke(group, ["label", str(capture), str(out), *CGTS, "--preview"])
    assert result.exit_code == 0, result.output
    told = ", 2 x 2 samples a pixel, geometry by depth beyond a plane's and normals without"
    assert told in result.output
    assert "ghosting: visibility " in result.output
    assert "aliasing: geometry " in result.output
    return out


def frames_of(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.exr"))


def test_classes_are_two_channels_at_the_pixels_size(labelled: Path, capture: Path) -> None:
    assert [p.name for p in frames_of(labelled)] == [p.name for p in frames_of(capture)]
    for path in frames_of(labelled):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        assert set(planes) == {"ghosting", "aliasing"}
        for plane in planes.values():
            assert plane.shape == SIZE
            assert set(np.unique(plane)) <= {0.0, 1.0, 2.0}
        shares = json.loads(header.attributes["rtsr:classes"])
        assert shares["geometry"] == pytest.approx((planes["aliasing"] == 1).mean(), abs=1e-6)
        assert shares["visibility"] == pytest.approx((planes["ghosting"] == 1).mean(), abs=1e-6)
        assert shares["shading"] == pytest.approx((planes["ghosting"] == 2).mean(), abs=1e-6)
    picture = next(labelled.glob("*.png")).read_bytes()
    assert struct.unpack(">II", picture[16:24]) == (2 * SIZE[1], SIZE[0])


def test_the_summary_tells_ghosting_of_frames_with_history_only(labelled: Path) -> None:
    first, *later = frames_of(labelled)
    shares = [json.loads(read_header(p).attributes["rtsr:classes"]) for p in (first, *later)]
    assert [frame["history"] for frame in shares] == [False, True, True]
    assert shares[0]["visibility"] == 1.0
    summary = json.loads((labelled / "summary.json").read_text(encoding="utf-8"))
    total = summary["total"]
    assert (total["frames"], total["ghosting"]["frames"]) == (3, 2)
    mean = np.mean([frame["visibility"] for frame in shares[1:]])
    assert total["ghosting"]["visibility"] == pytest.approx(mean, abs=1e-6)
    assert summary["options"]["samples_per_pixel"] == 2
    assert summary["options"]["ghosting"]["overlap"] == 0.1


def test_a_cut_makes_all_of_a_frame_visibility_ghosting(
    rtsr: Run, capture: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shutil.copytree(capture, shot)
    (shot / "capture.toml").write_text("camera_cuts = [3]\n")
    assert rtsr("label", shot, tmp_path / "out", *CGTS).exit_code == 0
    last = frames_of(tmp_path / "out")[-1]
    assert (read_channels(last, ("ghosting",))["ghosting"] == 1.0).all()


def test_parts_make_the_whole_and_other_thresholds_are_other_labels(
    rtsr: Run, capture: Path, labelled: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    for part in ("1/2", "2/2"):
        result = rtsr("label", capture, out, *CGTS, "--preview", "--shard", part)
        assert result.exit_code == 0, result.output
    for path in (*frames_of(labelled), labelled / "summary.json"):
        assert (out / path.name).read_bytes() == path.read_bytes()
    assert "0 written, 3 kept" in rtsr("label", capture, out, *CGTS, "--preview").output
    for option in (("--paper",), ("--depth-only",), ("--least-change", "0.2")):
        assert rtsr("label", capture, out, *CGTS, *option).exit_code == 3


def test_what_is_missing_is_said(rtsr: Run, capture: Path, tmp_path: Path) -> None:
    for path in frames_of(capture):
        planes = read_channels(path, read_header(path).channels)
        kept = {n: p for n, p in planes.items() if "normal" not in n and "position" not in n}
        write_exr(tmp_path / "in" / path.name, kept)
    result = rtsr("label", tmp_path / "in", tmp_path / "out", *CGTS)
    assert result.exit_code == 0, result.output
    assert "no normals: colour alone tells texture aliasing" in result.output
    assert "no camera: surfaces are taken to keep their depth" in result.output
    assert "depth beyond a plane's and object ids" in result.output


@pytest.mark.parametrize("buffer", ["depth", "motion"])
def test_without_depth_or_motion_nothing_is_labelled(
    rtsr: Run, capture: Path, tmp_path: Path, buffer: str
) -> None:
    for path in frames_of(capture):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        kept = {n: p for n, p in planes.items() if n.partition(".")[0] != buffer}
        write_exr(tmp_path / "in" / path.name, kept, attributes=header.attributes)
    result = rtsr("label", tmp_path / "in", tmp_path / "out", *CGTS)
    assert result.exit_code == 3
    assert "label --kind cgts cannot run, missing:" in result.output
    assert buffer in result.output


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--kind", "cgts"), 2, "--kind cgts needs --samples-per-pixel K"),
        (("--kind", "cgts", "--samples-per-pixel", "1"), 2, "2<=x<=16"),
        (("--samples-per-pixel", "2"), 2, "is of --kind cgts, not of --kind vrs"),
        (("--paper",), 2, "--paper is of --kind holes and cgts, not of --kind vrs"),
        ((*CGTS, "--every", "2"), 2, "--every is of --kind holes, not of --kind cgts"),
        (("--kind", "cgts", "--samples-per-pixel", "5"), 3, "are no whole pixels of 5 x 5"),
    ],
)
def test_what_does_not_go_together_is_refused(
    rtsr: Run, capture: Path, tmp_path: Path, options: tuple[str, ...], code: int, said: str
) -> None:
    result = rtsr("label", capture, tmp_path / "out", *options)
    assert result.exit_code == code, result.output
    assert said in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()
