"""`rtsr evaluate` and files: parts, strict JSON, outputs in the way, folders that do not fit."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]
REFUSED, USAGE, FAILED = 3, 2, 1
FRAMES, SIDE = 6, 48


def write(folder: Path, numbers: range, noise: float) -> Path:
    """Frames of a pattern that moves by three pixels a frame, and noise."""
    random = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    for number in numbers:
        picture = 0.5 + 0.4 * np.sin((x + 3 * number) / 4.0) * np.cos(y / 7.0)
        grainy = (picture + noise * random.random((SIDE, SIDE))).astype(np.float16)
        write_exr(folder / f"frame.{number:04d}.exr", dict.fromkeys("RGB", grainy))
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Two tests and their reference."""
    root = tmp_path_factory.mktemp("plain")
    numbers = range(1, FRAMES + 1)
    noises = {"low": 0.05, "high": 0.3, "ref": 0.0}
    low, high, ref = (write(root / name, numbers, noise) for name, noise in noises.items())
    return low, high, ref


def load(path: Path) -> dict[str, Any]:
    """Strictly: constants that JSON does not have are refused."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    return found


def refusal(result: Result, code: int = REFUSED) -> str:
    assert result.exit_code == code, result.output
    assert not isinstance(result.exception, Exception), result.exception
    assert "Traceback" not in result.output
    return " ".join(result.stderr.split())


def part(rtsr: Run, output: Path, shard: str, *arguments: object) -> Path:
    done = rtsr("evaluate", *arguments, "--shard", shard, "--output", output)
    assert done.exit_code == 0, done.output
    return output


def test_parts_of_different_tests_are_refused(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, high, ref = folders
    first = part(rtsr, tmp_path / "1.json", "1/2", low, high, "--ref", ref)
    second = part(rtsr, tmp_path / "2.json", "2/2", low, "--ref", ref)
    message = refusal(rtsr("evaluate", "--merge", first, second))
    assert f"{second}: lacks 'high', which {first} has" in message


def test_a_missing_part_is_told_and_noted(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    first, third = (part(rtsr, tmp_path / f"{i}.json", f"{i}/3", low, ref) for i in (1, 3))
    assert load(third)["shard"] == {"parts": [3], "of": 3, "frames": None}
    output = tmp_path / "all.json"
    result = rtsr("evaluate", "--merge", first, third, "--output", output)
    assert result.exit_code == 0
    assert "parts missing: 2 of 3" in result.stderr
    assert "parts missing: 2 of 3" in load(output)["tests"]["low"]["notes"][-1]
    assert "part 1/3 is in" in refusal(rtsr("evaluate", "--merge", first, third, first))


@pytest.mark.parametrize("frames", [(), ("--frames", "1-6x2")])
def test_vmaf_of_merged_parts_is_that_of_one_run(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path, frames: tuple[str, ...]
) -> None:
    pytest.importorskip("imageio_ffmpeg")
    low, high, ref = folders
    options = (low, high, "--ref", ref, "--metric", "psnr,vmaf", "--skip-first", 1, *frames)
    whole, joined = tmp_path / "whole.json", tmp_path / "joined.json"
    assert rtsr("evaluate", *options, "--output", whole).exit_code == 0
    parts = [part(rtsr, tmp_path / f"{i}.json", f"{i}/3", *options) for i in (1, 2, 3)]
    assert rtsr("evaluate", "--merge", *parts, "--output", joined).exit_code == 0
    assert load(joined)["tests"] == load(whole)["tests"]
    assert 0.0 < load(whole)["tests"]["high"]["mean"]["vmaf-harmonic"] < 100.0


@pytest.mark.parametrize(
    "content",
    [
        '{"a": 1}',
        '{"tests": {}}',
        "[]",
        "5",
        pytest.param("[" * 100_000, id="deep"),
        '{"protocol": "rtsr", "options": {}, "metrics": {}, "rules": "", "tests": {}}',
        '{"protocol": "rtsr", "options": {}, "metrics": {}, "rules": "", "tests": {"a": {}}}',
    ],
)
def test_what_is_no_part_is_refused_in_one_message(rtsr: Run, tmp_path: Path, content: str) -> None:
    path = tmp_path / "part.json"
    path.write_text(content, encoding="utf-8")
    assert f"{path}: is no result of" in refusal(rtsr("evaluate", "--merge", path))


def damaged(found: Any, *place: str, value: Any) -> str:
    """A result with another value somewhere; without it where the value is None."""
    held = found
    for key in place[:-1]:
        held = held[key]
    held[place[-1]] = value
    if value is None:
        del held[place[-1]]
    return json.dumps(found)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("tests", "low", "frames"), None),
        (("tests", "low", "frames", "2"), 7),
        (("tests", "low", "frames", "two"), {}),
        (("tests", "low", "frames", "2", "counted"), None),
        (("tests", "low", "frames", "2", "psnr"), "high"),
        pytest.param(("tests", "low", "frames", "2", "psnr"), 10**400, id="beyond-floats"),
        (("tests", "low", "frames", "2", "regions", "all"), 1),
        (("tests", "low", "notes"), [1]),
        (("metrics", "psnr"), {}),
        (("options",), None),
        (("shard",), {"parts": [3], "of": 2, "frames": None}),
    ],
)
def test_a_part_that_was_tampered_with_is_refused(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path, place: tuple[str, ...], value: Any
) -> None:
    low, _, ref = folders
    path = part(rtsr, tmp_path / "1.json", "1/2", low, ref, "--metric", "psnr")
    path.write_text(damaged(load(path), *place, value=value), encoding="utf-8")
    assert f"{path}: is no result of" in refusal(rtsr("evaluate", "--merge", path))


def test_infinite_values_are_strict_json_and_come_back(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    # the second half of the frames is the reference's own
    mixed = write(low.parent / "mixed", range(1, 4), 0.1)
    for number in range(4, FRAMES + 1):
        name = f"frame.{number:04d}.exr"
        (mixed / name).write_bytes((ref / name).read_bytes())
    options = (mixed, low, "--ref", ref)
    whole, table, joined = (tmp_path / name for name in ("w.json", "w.csv", "j.json"))
    assert rtsr("evaluate", *options, "--output", whole, "--output", table).exit_code == 0
    assert load(whole)["tests"]["mixed"]["frames"]["4"]["psnr"] == "inf"
    assert 'JSON holds them as "inf"' in load(whole)["rules"]
    rows = csv.DictReader(io.StringIO(table.read_text(encoding="utf-8")))
    fourth = next(r for r in rows if r["test"] == "mixed" and r["frame"] == "4")
    assert fourth["psnr"] == "inf"
    parts = [part(rtsr, tmp_path / f"{i}.json", f"{i}/2", *options) for i in (1, 2)]
    assert load(parts[1])["tests"]["mixed"]["mean"]["psnr"] == "inf"
    assert rtsr("evaluate", "--merge", *parts, "--output", joined).exit_code == 0
    assert load(joined)["tests"] == load(whole)["tests"]
    events = rtsr("evaluate", "--merge", parts[1], "--json").stdout.splitlines()
    assert "Infinity" not in events[-1]


def test_an_output_that_cannot_be_is_refused_before_work(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    taken, file = tmp_path / "taken.json", tmp_path / "file"
    taken.mkdir()
    file.touch()
    result = rtsr("evaluate", low, ref, "--output", taken)
    assert f"{taken}: is a folder" in refusal(result)
    assert result.stdout == ""
    for below in (file / "r.json", file / "deep" / "r.html"):
        result = rtsr("evaluate", low, ref, "--output", below)
        assert f"{file} is a file, no folder" in refusal(result)
        assert result.stdout == ""


@pytest.mark.parametrize("suffix", ["json", "csv", "html"])
def test_a_file_of_something_else_is_replaced_only_when_asked(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path, suffix: str
) -> None:
    low, _, ref = folders
    output = tmp_path / f"r.{suffix}"
    foreign = {"json": '{"tests": 1}', "csv": "a,b\n1,2\n", "html": "<html>mine</html>"}[suffix]
    output.write_text(foreign, encoding="utf-8")
    command = ("evaluate", low, ref, "--metric", "psnr", "--output", output)
    assert f"{output}: 'rtsr evaluate' did not write this file" in refusal(rtsr(*command))
    assert output.read_text(encoding="utf-8") == foreign
    assert rtsr(*command, "--overwrite").exit_code == 0
    first = output.read_text(encoding="utf-8")
    assert first != foreign
    # its own is replaced without asking
    assert rtsr(*command, "--border", 2).exit_code == 0
    assert output.read_text(encoding="utf-8") != first


@pytest.mark.parametrize("demand", ["", " ", "psnr", "psnr>30,", "lpips<1", "flop<1"])
def test_a_demand_that_is_none_is_a_usage_error(
    rtsr: Run, folders: tuple[Path, Path, Path], demand: str
) -> None:
    low, _, ref = folders
    message = refusal(rtsr("evaluate", low, ref, "--fail-under", demand), USAGE)
    assert "--fail-under" in message


def test_a_demand_on_merged_parts_is_about_their_metrics(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    whole = part(rtsr, tmp_path / "1.json", "1/1", low, ref, "--metric", "tpsnr")
    merge = ("evaluate", "--merge", whole, "--fail-under")
    assert rtsr(*merge, "tpsnr>1").exit_code == 0
    assert rtsr(*merge, "tpsnr>999").exit_code == FAILED
    assert "the parts hold no metric 'psnr'" in refusal(rtsr(*merge, "psnr>1"))


def test_a_run_that_is_interrupted_does_not_say_that_it_kept_anything(tmp_path: Path) -> None:
    # a pipe that nobody writes to: the run waits in its work for as long as it takes
    pipe, output = tmp_path / "part.json", tmp_path / "out" / "r.json"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "rtsr_cli", "evaluate", "--merge", str(pipe)]
    process = subprocess.Popen(
        [*command, "--output", str(output)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL,
        text=True,
    )  # fmt: skip
    while process.poll() is None and not output.parent.is_dir():
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    said = process.communicate()[1]
    assert process.returncode == 128 + signal.SIGINT
    assert "Interrupted: nothing was written" in said
    assert "is kept" not in said


def test_advice_about_missing_frames_is_what_evaluate_takes(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    write(tmp_path / "holes", range(1, FRAMES + 1, 2), 0.1)
    message = refusal(rtsr("evaluate", tmp_path / "holes", folders[2]))
    assert "use --on-missing skip;" in message
    assert "hold" not in message


def test_folders_that_are_not_there_are_named(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    gone, file = tmp_path / "gone", tmp_path / "file"
    file.touch()
    assert f"{gone}: no such folder (REF)" in refusal(rtsr("evaluate", low, "--ref", gone))
    message = refusal(rtsr("evaluate", low, ref, "--gbuffer", gone))
    assert f"{gone}: no such folder (--gbuffer)" in message
    assert f"{gone}: no such folder (TEST)" in refusal(rtsr("evaluate", gone, ref))
    assert f"{file}: is a file (REF)" in refusal(rtsr("evaluate", low, "--ref", file))


def test_folders_of_other_pictures_are_told_what_is_read(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    (tmp_path / "shot").mkdir()
    for name in ("a.0001.png", "a.0002.PNG", "b.0001.jpg"):
        (tmp_path / "shot" / name).touch()
    message = refusal(rtsr("evaluate", tmp_path, folders[2]))
    assert f"{tmp_path}: holds .jpg and .png files, no EXR (TEST)" in message
    assert "reads linear radiance from EXR" in message


def test_help_speaks_of_judging(rtsr: Run) -> None:
    text = " ".join(rtsr("evaluate", "--help").stdout.split())
    assert "Judge these frames only" in text
    assert "Judge part I of N" in text
    assert "Write these frames" not in text


def test_metrics_are_named_in_any_case(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    output = tmp_path / "r.json"
    done = rtsr("evaluate", low, ref, "--metric", "PSNR,Flip", "--output", output)
    assert done.exit_code == 0, done.output
    assert list(load(output)["tests"]["low"]["mean"]) == ["psnr", "flip"]


def test_skipping_every_frame_is_refused_but_a_part_may_have_none(
    rtsr: Run, folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    low, _, ref = folders
    message = refusal(rtsr("evaluate", low, ref, "--skip-first", FRAMES))
    assert f"--skip-first {FRAMES} leaves no frame of any test for means" in message
    first = part(rtsr, tmp_path / "1.json", "1/3", low, ref, "--skip-first", 2)
    assert load(first)["tests"]["low"]["mean"] == {}
