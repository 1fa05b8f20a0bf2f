"""Outputs that were cut or damaged after they were written do not count as done."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from rtsr_cli.core.files.atomic_write import TEMPORARY_SUFFIX

Run = Callable[..., Result]
Files = Callable[[Path], dict[str, bytes]]
NAMES = ["frame.0003.exr", "frame.0003.png", "debug/frame.0003.exr"]


def command(small_shot: Path, out: Path) -> tuple[object, ...]:
    pictures = ("--preview", "--debug-buffers")
    return ("upscale", small_shot, out, "--system", "demod-bicubic", *pictures)


def flip(content: bytes) -> bytes:
    place = len(content) * 2 // 3
    return content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :]


CUTS = (60, 700)
"""Bytes that are left: up to the mark, of the header."""


@pytest.mark.parametrize(
    "damage",
    [flip, lambda c: c[:-1], lambda c: c[: len(c) // 2], *(lambda c, n=n: c[:n] for n in CUTS)],
)
@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_is_named_and_made_again_to_the_same_bytes(
    rtsr: Run,
    small_shot: Path,
    tmp_path: Path,
    files_of: Files,
    damage: Callable[[bytes], bytes],
    name: str,
) -> None:
    out = tmp_path / "out"
    assert rtsr(*command(small_shot, out)).exit_code == 0
    whole = files_of(out)
    (out / name).write_bytes(damage(whole[name]))
    result = rtsr(*command(small_shot, out))
    assert result.exit_code == 0, result.output
    assert f"Warning: {out / name}: cut or damaged after writing; made again" in result.stderr
    assert "1 written, 3 kept" in result.stdout
    assert files_of(out) == whole


@pytest.mark.parametrize("length", [1, 3, 20])
@pytest.mark.parametrize("name", NAMES)
def test_what_was_cut_before_its_mark_is_no_longer_rtsrs(
    rtsr: Run, small_shot: Path, tmp_path: Path, length: int, name: str
) -> None:
    out = tmp_path / "out"
    assert rtsr(*command(small_shot, out)).exit_code == 0
    cut = (out / name).read_bytes()[:length]
    (out / name).write_bytes(cut)
    result = rtsr(*command(small_shot, out))
    assert result.exit_code == 3
    assert f"{out / name}: rtsr upscale did not write this" in result.stderr
    assert "or its mark is cut off" in result.stderr
    assert "--overwrite" in result.stderr
    assert (out / name).read_bytes() == cut


def test_an_emptied_file_is_said_to_be_empty(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert rtsr(*command(small_shot, out)).exit_code == 0
    whole = {name: (out / name).read_bytes() for name in NAMES}
    for name in NAMES:
        (out / name).write_bytes(b"")
    plan = rtsr(*command(small_shot, out), "--dry-run", "--json").stdout.splitlines()[0]
    assert sorted(json.loads(plan)["empty"]) == sorted(str(out / name) for name in NAMES)
    assert json.loads(plan)["damaged"] == []
    assert rtsr(*command(small_shot, out)).exit_code == 0
    assert {name: (out / name).read_bytes() for name in NAMES} == whole


def test_damage_is_told_in_the_plan(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert rtsr(*command(small_shot, out)).exit_code == 0
    (out / NAMES[0]).write_bytes((out / NAMES[0]).read_bytes()[:-1])
    plan = rtsr(*command(small_shot, out), "--dry-run", "--json").stdout.splitlines()[0]
    assert json.loads(plan)["damaged"] == [str(out / NAMES[0])]
    assert json.loads(plan)["pending"] == 1


def test_a_synthetic_frame_that_was_cut_is_rendered_again(rtsr: Run, tmp_path: Path) -> None:
    asked = ("synth", tmp_path / "out", "--size", "32x32", "--frames", "1-2")
    assert rtsr(*asked).exit_code == 0
    frame = tmp_path / "out" / "frame.0002.exr"
    whole = frame.read_bytes()
    frame.write_bytes(whole[:-9])
    assert rtsr(*asked).exit_code == 0
    assert frame.read_bytes() == whole


@pytest.mark.parametrize("folder", ["", "debug"])
def test_what_killed_runs_left_is_removed_even_if_nothing_else_is_to_do(
    rtsr: Run, small_shot: Path, tmp_path: Path, folder: str
) -> None:
    out = tmp_path / "out"
    assert rtsr(*command(small_shot, out)).exit_code == 0
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    host = os.uname().nodename.partition(".")[0][:24]
    part = out / folder / f".a1b2-frame.0002.exr.{host}-{ended.pid}{TEMPORARY_SUFFIX}"
    part.write_bytes(b"half a file")
    assert "4 kept" in rtsr(*command(small_shot, out)).stdout
    assert not part.exists()
