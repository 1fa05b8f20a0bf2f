"""HR frames that are turned beside LR's: `upscale` and `inspect` say so."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

Run = Callable[..., Any]


@pytest.fixture
def turned(small_shot: Path, changed: Callable[..., Path], tmp_path: Path) -> Path:
    """The small shot, with HR frames whose first row is the bottom one."""

    def flip(planes: dict[str, Any], number: int) -> None:
        planes.update({name: np.ascontiguousarray(p[::-1]) for name, p in planes.items()})

    shot = tmp_path / "turned"
    shutil.copytree(small_shot / "lr", shot / "lr")
    shutil.copy(small_shot / "capture.toml", shot)
    changed(small_shot / "hr", flip).rename(shot / "hr")
    return shot


def test_upscale_reads_no_turned_gbuffer(rtsr: Run, turned: Path, tmp_path: Path) -> None:
    refused = rtsr("upscale", turned, tmp_path / "no", "--system", "demod-guided")
    assert refused.exit_code == 3
    assert f"{turned / 'hr'}: all frames looked at (1, 3-4): " in refused.output
    assert "HR looks upside down" in refused.output
    assert "choose another --system (system 'demod-guided'" in refused.output
    assert "camera matrices of" not in refused.output
    assert not (tmp_path / "no").exists()
    chosen = rtsr("upscale", turned, tmp_path / "out", "--frames", 1)
    assert chosen.exit_code == 0, chosen.output
    assert "system bicubic" in chosen.output
    assert "HR looks upside down" in chosen.output
    named = rtsr("upscale", turned, tmp_path / "named", "--frames", 1, "--system", "bicubic")
    assert named.exit_code == 0
    assert "upside down" not in named.output


def test_inspect_names_a_turned_gbuffer(rtsr: Run, turned: Path, small_shot: Path) -> None:
    said = rtsr("inspect", turned).output
    assert f"{turned / 'hr'}: all frames looked at (1, 3-4): " in said
    assert "HR looks upside down" in said
    assert "camera matrices of" not in said
    (guided,) = (line for line in said.splitlines() if "demod-guided" in line)
    assert "missing" in guided
    assert guided.endswith("frames of hr that fit lr")
    assert "HR looks" not in rtsr("inspect", small_shot).output


def test_train_records_no_turned_gbuffer(rtsr: Run, turned: Path, tmp_path: Path) -> None:
    shutil.copytree(turned / "hr", turned / "reference")
    few = ("--set", "training.steps=2", "--set", "training.crop=8", "--set", "training.batch=1")
    run = ("--out", tmp_path / "run", "--cache", tmp_path / "cache", *few)
    refused = rtsr("train", "fusesr", turned, *run)
    assert refused.exit_code == 3, refused.output
    assert f"{turned / 'hr'}: all frames looked at (1, 3-4): " in refused.output
    assert "HR looks upside down" in refused.output
    assert "leave the shot out (data.exclude)" in refused.output
    assert not list((tmp_path / "cache").rglob("*.json"))
    assert not list((tmp_path / "run").rglob("*.safetensors"))


def test_lr_files_that_are_exchanged_are_refused(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    files = sorted((shot / "lr").glob("*.exr"))
    files[0].rename(tmp_path / "first")
    files[-1].rename(files[0])
    (tmp_path / "first").rename(files[-1])
    last = len(files)
    refused = rtsr("upscale", shot, tmp_path / "no", "--system", "demod-guided")
    assert refused.exit_code == 3, refused.output
    assert f"of another moment (HR frame {last} fits LR frame 1)" in refused.output
    assert "number the files of both sizes alike" in refused.output
    chosen = rtsr("upscale", shot, tmp_path / "out", "--dry-run")
    assert chosen.exit_code == 0, chosen.output
    assert "system bicubic" in chosen.output


def test_a_file_of_another_frame_that_costs_all_frames_their_cameras_is_what_is_named(
    rtsr: Run, sample_root: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shutil.copytree(sample_root, shot)
    files = sorted((shot / "hr").glob("*.exr"))
    shutil.copy(files[-1], files[0])
    refused = rtsr("upscale", shot, tmp_path / "no", "--system", "demod-guided")
    assert refused.exit_code == 3, refused.output
    said = " ".join(refused.output.split())
    assert "frame 1 (of frames 1, 4, 6, which were looked at)" in said
    assert f"of another moment (HR frame 1 fits LR frame {len(files)})" in said
    assert "matrices of another frame" not in said


def test_a_frame_whose_hr_file_is_another_frames_fails_alone(
    rtsr: Run, small_shot: Path, changed: Callable[..., Path], tmp_path: Path
) -> None:
    kept: dict[int, dict[str, Any]] = {}

    def show_third(planes: dict[str, Any], number: int) -> None:
        kept[number] = dict(planes)
        if number == 2 and 3 in kept:
            planes.update(kept[3])

    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    shutil.rmtree(shot / "hr")
    changed(small_shot / "hr", show_third)
    # frame 2 is not among those that are looked at before the run, and keeps its camera
    changed(small_shot / "hr", show_third).rename(shot / "hr")
    files = sorted((shot / "hr").glob("*.exr"))
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided")
    assert result.exit_code == 1, result.output
    said = " ".join(result.output.split())
    assert "frame 2: beside" in said
    assert "of another moment (HR frame 2 fits LR frame 3)" in said
    assert sorted(p.name for p in (tmp_path / "out").glob("*.exr")) == [
        files[n].name for n in (0, 2, 3)
    ]


def test_base_colours_of_bits_at_lr_alone_are_lrs_to_divide(
    rtsr: Run, small_shot: Path, changed: Callable[..., Path], tmp_path: Path
) -> None:
    def store_bits(planes: dict[str, Any], number: int) -> None:
        planes.update({c: p * 255.0 for c, p in planes.items() if c.startswith("albedo.")})

    shot = tmp_path / "shot"
    shutil.copytree(small_shot / "hr", shot / "hr")
    shutil.copy(small_shot / "capture.toml", shot)
    changed(small_shot / "lr", store_bits).rename(shot / "lr")
    said = rtsr("upscale", shot, tmp_path / "no", "--system", "demod-guided").output
    line = re.search(
        r'or, if HR is right, .*\[buffers\] (albedo = "[0-9.]+ \* lr:albedo.RGB")', said
    )
    assert line is not None, said
    assert "rename LR's files to lr.####.exr" in said
    for path in (shot / "lr").glob("*.exr"):
        path.rename(path.with_name(f"lr.{path.name.split('.')[1]}.exr"))
    with (shot / "capture.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n[buffers]\n{line[1]}\n")
    mended = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided")
    assert mended.exit_code == 0, mended.output
    assert "Warning" not in mended.output


@pytest.mark.parametrize("name", ["frame", "target"])
def test_a_factor_of_one_size_is_named_with_the_line_that_mends_it(
    rtsr: Run, small_shot: Path, changed: Callable[..., Path], tmp_path: Path, name: str
) -> None:
    def double(planes: dict[str, Any], number: int) -> None:
        planes.update({c: p * 2 for c, p in planes.items() if c.startswith("albedo.")})

    shot = tmp_path / "shot"
    shutil.copytree(small_shot / "lr", shot / "lr")
    shutil.copy(small_shot / "capture.toml", shot)
    changed(small_shot / "hr", double).rename(shot / "hr")

    def rename(stem: str) -> None:
        for path in (shot / "hr").glob("*.exr"):
            path.rename(path.with_name(f"{stem}.{path.name.split('.')[1]}.exr"))

    rename(name)
    said = rtsr("inspect", shot).output
    stream = name if name == "target" else "hr"
    line = f'albedo = "0.5 * {stream}:albedo.RGB"'
    assert "HR looks to be about 2 x LR in albedo" in said
    assert f"capture.toml: [buffers] {line}" in said
    assert ("rename HR's files to hr.####.exr" in said) == (name == "frame")
    rename(stream)
    with (shot / "capture.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n[buffers]\n{line}\n")
    assert "HR looks" not in rtsr("inspect", shot).output
