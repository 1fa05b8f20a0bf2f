"""A buffer that one frame of a shot lacks: what does without runs, and the frame is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

Run = Callable[..., Result]
Copy = Callable[..., Path]

CHANNELS = {
    "depth": ("depth.Z",),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
}


def drop(buffer: str, bad: int) -> Callable[[dict[str, Any], int], None]:
    def change(planes: dict[str, Any], number: int) -> None:
        if number == bad:
            for channel in CHANNELS[buffer]:
                del planes[channel]

    return change


@pytest.mark.parametrize(("buffer", "bad"), [("depth", 2), ("albedo", 1), ("normal", 4)])
def test_the_best_system_that_all_frames_allow_runs(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path, buffer: str, bad: int
) -> None:
    folder = changed(small_capture, drop(buffer, bad))
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4)
    planned = rtsr(*line, "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert f"need {buffer} of frame {bad}: render those frames again, or leave" in planned.output
    assert f"frame {bad}: buffer '{buffer}' is missing" in planned.output
    assert "--on-missing skip|hold" in planned.output
    refused = rtsr(*line, "--system", "demod-guided")
    assert refused.exit_code == 3
    assert f"cannot run, missing: {buffer} of frame {bad}" in refused.output
    assert not (tmp_path / "out").exists()


def test_a_frame_that_lacks_it_is_done_by_what_needs_it_not(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("albedo", 3))
    done = rtsr("upscale", folder, tmp_path / "out", "--simulate-lr", 4)
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "out").rglob("*.exr"))) == 4


@pytest.mark.parametrize("bad", [1, 3])
def test_inspect_names_the_frame_and_offers_no_line_for_it(
    rtsr: Run, small_capture: Path, changed: Copy, bad: int
) -> None:
    folder = changed(small_capture, drop("depth", bad))
    report = rtsr("inspect", folder).output
    assert f"frame {bad}: buffer 'depth' is missing" in report
    (guided,) = (line for line in report.splitlines() if " demod-guided " in line)
    assert f"missing: depth of frame {bad}" in guided
    assert "depth = " not in report


def test_at_one_size_that_size_is_named(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    changed(small_shot / "hr", drop("normal", 2)).rename(shot / "hr")
    (shot / "lr").symlink_to(small_shot / "lr")
    planned = rtsr("upscale", shot, tmp_path / "out", "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert "need hr normal of frame 2: render those frames again" in planned.output


@pytest.mark.parametrize("size", ["lr", "hr"])
def test_with_skip_a_frame_that_lacks_what_the_system_needs_is_left_out(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, size: str
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    (other,) = {"lr", "hr"} - {size}
    changed(small_shot / size, drop("normal", 2)).rename(shot / size)
    (shot / other).symlink_to(small_shot / other)
    (shot / "capture.toml").write_bytes((small_shot / "capture.toml").read_bytes())
    done = rtsr(
        "upscale", shot, tmp_path / "out", "--system", "demod-guided", "--on-missing", "skip"
    )
    assert done.exit_code == 0, done.output
    said = f"{shot / size}: frame 2 left out (--on-missing skip): buffer 'normal' is missing there"
    assert said in done.output
    made = sorted(path.name for path in (tmp_path / "out").rglob("*.exr"))
    assert made == [f"frame.{number:04d}.exr" for number in (1, 3, 4)]
    # the default is what runs on the other frames
    chosen = rtsr("upscale", shot, tmp_path / "best", "--on-missing", "skip", "--dry-run")
    assert "frames 1, 3-4" in chosen.output
    assert "bicubic" not in chosen.output


def test_with_skip_what_needs_it_not_does_every_frame(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("albedo", 1))
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4, "--on-missing", "skip")
    done = rtsr(*line, "--system", "bicubic", "--dry-run")
    assert done.exit_code == 0, done.output
    assert "frames 1-4" in done.output
    assert "left out (" not in done.output
    part = rtsr(*line, "--system", "demod-guided", "--dry-run")
    assert "frames 2-4" in part.output


def test_radiance_is_missed_in_every_command(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    def dark(planes: dict[str, Any], number: int) -> None:
        if number == 2:
            del planes["G"]

    refused = rtsr("upscale", changed(small_capture, dark), tmp_path / "out", "--simulate-lr", 4)
    assert refused.exit_code == 3
    assert "frames 2: buffer 'color' is missing" in refused.output


def test_where_a_network_runs_the_others_are_named_one_by_one(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    changed(small_shot / "hr", drop("depth", 2)).rename(shot / "hr")
    (shot / "lr").symlink_to(small_shot / "lr")
    planned = rtsr("upscale", shot, tmp_path / "out", "--dry-run").output
    assert "system fusesr-fast" in planned
    assert "networks" not in planned
    assert "gather" in planned
