"""Folders as users have them: gaps, damage, odd names, odd pixels. Nothing spreads or is silent."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Files = Callable[[Path], dict[str, bytes]]
Changed = Callable[[Path, Callable[[dict[str, Any], int], None]], Path]
FRAMES = [f"frame.{number:04d}.exr" for number in range(1, 5)]


@pytest.fixture
def shot(small_shot: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(small_shot, tmp_path / "shot"))


@pytest.fixture
def captures(small_capture: Path, tmp_path: Path) -> Path:
    """A copy of HR captures, to spoil."""
    return Path(shutil.copytree(small_capture, tmp_path / "captures"))


def events(text: str) -> list[dict[str, Any]]:
    """Every line has to be an event."""
    return [json.loads(line) for line in text.splitlines()]


@pytest.mark.parametrize("policy", ["skip", "hold"])
def test_history_restarts_behind_a_missing_frame(
    rtsr: Run, shot: Path, tmp_path: Path, files_of: Files, policy: str
) -> None:
    """Frame 4 comes out as if the sequence began with it."""
    for folder in ("lr", "hr"):
        (shot / folder / FRAMES[2]).unlink()
    choice = ("--system", "taau", "--on-missing", policy)
    assert rtsr("upscale", shot, tmp_path / "gap", *choice).exit_code == 0
    for folder in ("lr", "hr"):
        for name in FRAMES[:2]:
            (shot / folder / name).unlink()
    assert rtsr("upscale", shot, tmp_path / "alone", "--system", "taau").exit_code == 0
    gap, alone = (read_channels(tmp_path / out / FRAMES[3], "RGB") for out in ("gap", "alone"))
    assert all(np.array_equal(gap[c], alone[c]) for c in "RGB")


def test_where_an_hr_frame_is_missing_the_pair_before_stands_in(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    """LR radiance of one frame is never multiplied by the material of another."""
    (shot / "hr" / FRAMES[2]).unlink()
    choice = ("--system", "demod-guided", "--on-missing", "hold")
    plan = rtsr("upscale", shot, tmp_path / "out", *choice, "--dry-run", "--json")
    assert any(event.get("skipped", {}).get("held") == "3" for event in events(plan.stdout))
    run = rtsr("upscale", shot, tmp_path / "out", *choice)
    assert run.exit_code == 0
    assert "frame 3: missing, the frame before stands in" in run.output
    assert "not those of the LR frames" not in run.output
    second, third = (read_channels(tmp_path / "out" / FRAMES[i], "RGB") for i in (1, 2))
    assert all(np.array_equal(second[c], third[c]) for c in "RGB")


def split(shot: Path) -> None:
    """Move each LR buffer into files of its own, beside each other."""
    for path in sorted((shot / "lr").glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        motion = {c: planes.pop(c) for c in ("motion.X", "motion.Y")}
        write_exr(path, planes, attributes=header.attributes)
        write_exr(path.with_name(path.name.replace("frame", "motion")), motion)


def test_the_gap_of_every_buffer_is_listed(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    split(shot)
    (shot / "lr" / "frame.0002.exr").unlink()
    (shot / "lr" / "motion.0003.exr").unlink()
    result = rtsr("upscale", shot, tmp_path / "out")
    assert result.exit_code == 3
    assert "'frame' lacks 2; 'motion' lacks 3" in result.stderr


def in_a_process(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command as users do, so that lines of C libraries are seen as well."""
    command = [sys.executable, "-m", "rtsr_cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_damaged_pixels_are_one_message_and_leave_the_events_pure(
    captures: Path, tmp_path: Path
) -> None:
    path = captures / FRAMES[1]
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 400] = bytes(400)
    path.write_bytes(content)
    done = in_a_process("demodulate", captures, tmp_path / "a")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"Failed: {path}: cannot be read as OpenEXR (its pixels are damaged, or the file ends too "
        "early); copy or render this frame again"
    ]
    pure = in_a_process("demodulate", captures, tmp_path / "b", "--json")
    assert pure.returncode == 1
    assert pure.stderr == ""
    listed = events(pure.stdout)
    assert [e["event"] for e in listed] == ["plan", *["frame"] * 4, "done"]
    assert [e["number"] for e in listed if e.get("failed") and e["event"] == "frame"] == [2]


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_frame_that_is_still_being_copied_is_refused_before_the_first_output(
    rtsr: Run, captures: Path, tmp_path: Path, share: float
) -> None:
    path = captures / FRAMES[3]
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    result = rtsr("demodulate", captures, tmp_path / "out")
    assert result.exit_code == 3
    assert f"{path}: cannot be read as OpenEXR (the file ends too early)" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_picture_of_another_kind_that_is_named_exr(
    rtsr: Run, captures: Path, tmp_path: Path
) -> None:
    (captures / FRAMES[1]).write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    result = rtsr("demodulate", captures, tmp_path / "out")
    assert result.exit_code == 3
    assert f"{captures / FRAMES[1]}: cannot be read as OpenEXR (it is another kind" in result.stderr


def test_a_folder_named_like_a_frame_is_refused(rtsr: Run, captures: Path, tmp_path: Path) -> None:
    (captures / "frame.0005.exr").mkdir()
    result = rtsr("demodulate", captures, tmp_path / "out")
    assert result.exit_code == 3
    assert "frame.0005.exr: is a folder that is named like a frame" in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name", ["Zoë's shot, 東京 %04d.exr", "a b.%07d.exr", "x_%d.exr", "shot-%03d.exr"]
)
@pytest.mark.parametrize("first", [1, 1_000_000, -2])
def test_names_and_numbers_of_any_kind_come_back_as_they_went_in(
    rtsr: Run, captures: Path, tmp_path: Path, name: str, first: int
) -> None:
    if first < 0 and "-" in name:
        pytest.skip("a dash before the number separates")
    folder = tmp_path / "Ein Ordner mit Ümlaut"
    folder.mkdir()
    for i, source in enumerate(sorted(captures.iterdir())):
        shutil.copy(source, folder / (name % (first + i)))
    result = rtsr("demodulate", folder, tmp_path / "out")
    assert result.exit_code == 0, result.output
    numbers = sorted(
        int(re.search(r"(-?\d+)\.exr$", p.name.replace("shot-", "shot "))[1])  # type: ignore[index]
        for p in (tmp_path / "out").iterdir()
    )
    assert numbers == [first + i for i in range(4)]


def test_two_layouts_in_one_folder_are_refused(rtsr: Run, captures: Path, tmp_path: Path) -> None:
    for source in sorted(captures.iterdir()):
        shutil.copy(source, captures / source.name.replace("frame", "other"))
    result = rtsr("demodulate", captures, tmp_path / "out")
    assert result.exit_code == 3
    assert "is in 2 file sequences of one folder ('frame', 'other')" in result.stderr


def test_no_motion_anywhere_is_a_static_shot(
    rtsr: Run, shot: Path, tmp_path: Path, changed: Changed
) -> None:
    def still(planes: dict[str, Any], _: int) -> None:
        for channel in ("motion.X", "motion.Y"):
            planes[channel][:] = 0

    for folder in ("lr", "hr"):
        moved = changed(shot / folder, still)
        shutil.rmtree(shot / folder)
        shutil.move(moved, shot / folder)
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "taau")
    assert result.exit_code == 0, result.output
    for name in FRAMES:
        assert all(
            np.isfinite(p).all() for p in read_channels(tmp_path / "out" / name, "RGB").values()
        )


@pytest.mark.parametrize("command", ["upscale", "demodulate"])
def test_repairs_are_counted_by_frame_on_the_console_and_in_the_events(
    rtsr: Run, tmp_path: Path, captures: Path, command: str
) -> None:
    # sample (2, 2) of a 4 x 4 block is the one that --simulate-lr keeps
    for name, bad in ((FRAMES[0], [(2, 2)]), (FRAMES[2], [(2, 6), (6, 2)])):
        header = read_header(captures / name)
        planes = {k: v.copy() for k, v in read_channels(captures / name, header.channels).items()}
        for row, column in bad:
            planes["G"][row, column] = np.nan
        write_exr(captures / name, planes, attributes=header.attributes)
    choice = ["--on-nonfinite", "zero"]
    choice += ["--simulate-lr", "4", "--system", "bicubic"] if command == "upscale" else []
    result = rtsr(command, captures, tmp_path / "a", *choice)
    assert result.exit_code == 0, result.output
    assert f"repaired 3 NaN or Inf in 2 frames ({FRAMES[0]}: 1, {FRAMES[2]}: 2)" in result.output
    listed = events(rtsr(command, captures, tmp_path / "b", *choice, "--json").stdout)
    counts = {e["number"]: e["nonfinite"] for e in listed if e["event"] == "frame"}
    assert counts == {1: 1, 2: 0, 3: 2, 4: 0}
    assert listed[-1]["nonfinite"] == 3
    assert read_header(tmp_path / "a" / FRAMES[2]).attributes["rtsr:nonfinite"] == 2


@pytest.mark.parametrize("side", ["1", "15"])
def test_tiles_that_are_mostly_rim_are_a_usage_error(
    rtsr: Run, shot: Path, tmp_path: Path, side: str
) -> None:
    result = rtsr("upscale", shot, tmp_path / "out", "--tile", side)
    assert result.exit_code == 2
    assert f"{side} is too small; write 16 or more, or 0" in result.stderr
    assert rtsr("upscale", shot, tmp_path / "out", "--tile", 16).exit_code == 0


def test_a_dry_run_says_what_it_would_read_write_and_leave_out(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    for folder in ("lr", "hr"):
        (shot / folder / FRAMES[1]).unlink()
    choice = ("--system", "bicubic", "--on-missing", "skip")
    assert rtsr("upscale", shot, out, *choice, "--frames", 1).exit_code == 0
    dry = (*choice, "--frames", "1-3", "--dry-run")
    said = rtsr("upscale", shot, out, *dry).output
    (plan,) = events(rtsr("upscale", shot, out, *dry, "--json").stdout)
    assert plan["skipped"] == {"done": "1", "missing": "2", "not_selected": "4"}
    # bicubic reads the LR frame only; 192 x 128 pixels of three halves, and the header
    assert plan["read_bytes"] == (shot / "lr" / FRAMES[2]).stat().st_size
    assert plan["write_bytes_at_most"] == 192 * 128 * 3 * 2 + (1 << 14)
    for line in (
        "frame 1: done already",
        "frame 2: missing",
        "frame 4: not to be written",
        "writes at most 0.2 MiB (without compression)",
    ):
        assert line in said
    assert len(list(out.iterdir())) == 1
    assert rtsr("upscale", shot, out, *choice, "--frames", "1-3").exit_code == 0
    assert (out / FRAMES[2]).stat().st_size <= plan["write_bytes_at_most"]


def test_a_held_frame_is_named_by_a_dry_run(rtsr: Run, captures: Path, tmp_path: Path) -> None:
    (captures / FRAMES[1]).unlink()
    result = rtsr("demodulate", captures, tmp_path / "out", "--on-missing", "hold", "--dry-run")
    assert result.exit_code == 0
    assert "frame 2: missing, the frame before stands in" in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("system", ["taau", "bicubic"])
def test_side_files_that_are_asked_for_later_are_made(
    rtsr: Run, shot: Path, tmp_path: Path, files_of: Files, system: str
) -> None:
    late, at_once = tmp_path / "late", tmp_path / "at once"
    choice = ("--system", system)
    sides = ("--debug-buffers", "--preview")
    assert rtsr("upscale", shot, late, *choice).exit_code == 0
    for _ in range(2):
        assert rtsr("upscale", shot, late, *choice, *sides).exit_code == 0
    assert rtsr("upscale", shot, at_once, *choice, *sides).exit_code == 0
    assert files_of(late) == files_of(at_once)
    again = rtsr("upscale", shot, late, *choice, *sides)
    assert "0 written, 4 kept" in again.output
    (late / "debug" / FRAMES[1]).unlink()
    assert "1 written, 3 kept" in rtsr("upscale", shot, late, *choice, *sides).output


def test_a_number_that_is_none_counts_as_bad_however_it_is_stored(
    rtsr: Run, shot: Path, tmp_path: Path, changed: Changed
) -> None:
    def spoil(planes: dict[str, Any], number: int) -> None:
        planes["objectid"] = planes["objectid"].astype(np.float32)
        if number == 2:
            planes["objectid"][3, 4] = np.nan

    lr = changed(shot / "lr", spoil)
    shutil.rmtree(shot / "lr")
    shutil.move(lr, shot / "lr")
    choice = ("upscale", shot, tmp_path / "out", "--system", "taau")
    result = rtsr(*choice)
    assert result.exit_code == 1
    assert "frame 2: 1 value of 'object_id' is NaN or Inf" in result.stderr
    fixed = rtsr(*choice[:2], tmp_path / "fixed", *choice[3:], "--on-nonfinite", "inpaint")
    assert fixed.exit_code == 0
    assert "repaired 1 NaN or Inf in 1 frame" in fixed.output
