"""Scoring of small shots: perfect and spoilt results, threads, damaged frames, the border."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.evaluation.comparisons import CompareOptions, Comparison, open_comparisons
from rtsr_cli.core.evaluation.judged_frames import check_border
from rtsr_cli.core.evaluation.metric_table import MetricRules
from rtsr_cli.core.evaluation.protocols import PROTOCOLS
from rtsr_cli.core.evaluation.shot_scores import ScoredFrame, ScoringOptions, score_shot
from rtsr_cli.core.files.exr import write_exr

HEIGHT, WIDTH = 48, 64
PAN_PX = 2
METRICS = ("psnr", "ssim", "flip", "tpsnr", "temporal", "warped")
Image = NDArray[np.float32]


def texture() -> Image:
    random = np.random.default_rng(5)
    return random.uniform(0.05, 2.0, (HEIGHT, WIDTH + 8 * PAN_PX, 3)).astype(np.float16)


def reference(number: int) -> Image:
    """A texture that pans to the left, by whole pixels: backward motion is +2 in x."""
    start = number * PAN_PX
    return texture()[:, start : start + WIDTH]


def write(
    folder: Path, images: dict[int, Image], *, buffers: bool = False, predicted: int = 0
) -> Path:
    """Every `predicted`-th frame is stamped so."""
    for number, image in images.items():
        planes = {c: image[..., i] for i, c in enumerate("RGB")}
        if buffers:
            planes["motion.X"] = np.full((HEIGHT, WIDTH), PAN_PX, np.float32)
            planes["motion.Y"] = np.zeros((HEIGHT, WIDTH), np.float32)
            planes["depth.Z"] = np.full((HEIGHT, WIDTH), 5.0, np.float32)
        stamped = {"rtsr:predicted": 1} if predicted and number % predicted == 0 else {}
        write_exr(folder / f"frame.{number:04d}.exr", planes, attributes=stamped)
    return folder


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    folder = write(tmp_path / "ref", {n: reference(n) for n in range(1, 6)}, buffers=True)
    declared = '[motion]\nunit = "pixels"\ndirection = "previous-minus-current"\ny_axis = "down"\n'
    (folder / "capture.toml").write_text(declared, encoding="utf-8")
    return folder


def compared(truth: Path, **tests: Path) -> Comparison:
    return open_comparisons(tests, truth, CompareOptions())[0]


def options(**changes: object) -> ScoringOptions:
    rules = MetricRules(protocol=PROTOCOLS["rtsr"], metrics=METRICS, ssim=SsimConvention.WANG)
    return replace(ScoringOptions(rules=rules), **changes)  # type: ignore[arg-type]


def scored(comparison: Comparison, **changes: object) -> list[ScoredFrame]:
    return list(score_shot(comparison, options(**changes)))


def test_a_perfect_result_scores_perfectly(truth: Path, tmp_path: Path) -> None:
    test = write(tmp_path / "test", {n: reference(n) for n in range(1, 6)})
    frames = scored(compared(truth, test=test))
    first, later = frames[0].scores["test"].scores, frames[3].scores["test"].scores
    assert first["psnr"] == math.inf
    assert (first["ssim"], first["flip"]) == (pytest.approx(1.0), 0.0)
    assert first["temporal"] is None, "the first frame has no history"
    assert later["temporal"] == 0.0
    assert later["warped"] == later["warped-reference"] == pytest.approx(0.0, abs=1e-6)


def test_an_error_that_sticks_to_its_surface_does_not_flicker(truth: Path, tmp_path: Path) -> None:
    """A dark stripe of the texture moves with it; one that is fixed to the screen flickers."""

    def striped(number: int, left: int) -> Image:
        image = reference(number).copy()
        image[:, left : left + 8] *= 0.5
        return image

    sticking = {n: striped(n, 40 - n * PAN_PX) for n in range(1, 6)}
    fixed = {n: striped(n, 30) for n in range(1, 6)}
    comparison = compared(
        truth, stick=write(tmp_path / "stick", sticking), fixed=write(tmp_path / "fixed", fixed)
    )
    scores = scored(comparison)[3].scores
    assert scores["stick"].scores["temporal"] == pytest.approx(0.0, abs=1e-6)
    assert float(scores["fixed"].scores["temporal"] or 0.0) > 1e-3
    assert scores["stick"].scores["psnr"] == pytest.approx(scores["fixed"].scores["psnr"], abs=1.0)


def test_predicted_frames_alone_are_judged_but_their_neighbours_are_their_history(
    truth: Path, tmp_path: Path
) -> None:
    images = {n: reference(n) for n in range(1, 6)}
    test = write(tmp_path / "test", images, predicted=2)
    only = open_comparisons({"test": test}, truth, CompareOptions(predicted_only=True))[0]
    assert only.numbers == (2, 4)
    frames = {f.number: f.scores["test"] for f in scored(only)}
    assert [n for n, f in frames.items() if "psnr" in f.scores] == [2, 4]
    # change is that of the whole sequence: rendered, predicted, rendered, ...
    assert {n: f.scores["temporal"] for n, f in frames.items()} == dict.fromkeys(range(2, 6), 0.0)
    assert [n for n, f in frames.items() if f.between] == [3, 5]


def test_buffers_tell_regions_where_the_frame_before_was_not_kept(
    truth: Path, tmp_path: Path
) -> None:
    test = write(tmp_path / "test", {n: reference(n) for n in (2, 4)}, predicted=2)
    frames = scored(open_comparisons({"test": test}, truth, CompareOptions())[0])
    assert [f.number for f in frames] == [2, 4]
    scores = frames[1].scores["test"]
    assert scores.scores["temporal"] is None
    off_screen, hidden = (scores.regions[r] for r in ("off-screen", "disoccluded"))
    assert off_screen is not None
    assert hidden is not None
    # the picture pans: what entered it lay outside before, and nothing uncovers anything
    assert off_screen["share"] == pytest.approx(PAN_PX / WIDTH)
    assert hidden["share"] == 0.0


def test_any_number_of_threads_gives_the_same(truth: Path, tmp_path: Path) -> None:
    noise = np.random.default_rng(1)
    noisy = {n: reference(n) * noise.uniform(0.9, 1.1, (HEIGHT, WIDTH, 3)) for n in range(1, 6)}
    test = write(tmp_path / "test", {n: i.astype(np.float16) for n, i in noisy.items()})
    comparison = compared(truth, test=test)
    one, four = scored(comparison, jobs=1), scored(comparison, jobs=4)
    assert one == four
    assert [f.number for f in one] == [1, 2, 3, 4, 5]


def test_pixels_that_are_not_finite_are_counted_and_left_out(truth: Path, tmp_path: Path) -> None:
    images = {n: reference(n).copy() for n in range(1, 6)}
    images[3][10:12, 20:25, 1] = np.nan
    images[3][0, 0] = np.inf
    scores = scored(compared(truth, test=write(tmp_path / "test", images)))[2].scores["test"]
    assert scores.nonfinite == 11
    assert scores.scores["psnr"] == math.inf
    everything = scores.regions["all"]
    assert everything is not None
    assert everything["share"] == pytest.approx(1 - 11 / (HEIGHT * WIDTH))


def test_skipped_frames_do_not_count_in_a_part_that_begins_later(
    truth: Path, tmp_path: Path
) -> None:
    test = write(tmp_path / "test", {n: reference(n) for n in range(1, 6)})
    part = replace(compared(truth, test=test), numbers=(2, 3, 4))
    counted = [f.scores["test"].counted for f in scored(part, skip_first=2)]
    assert counted == [False, True, True]


def test_a_border_is_cut_before_anything_is_measured(truth: Path, tmp_path: Path) -> None:
    images = {n: reference(n).copy() for n in range(1, 6)}
    for image in images.values():
        image[:4] = 0.0
    comparison = compared(truth, test=write(tmp_path / "test", images))
    assert float(scored(comparison)[1].scores["test"].scores["psnr"] or 0.0) < 30.0
    assert scored(comparison, border=4)[1].scores["test"].scores["psnr"] == math.inf
    with pytest.raises(FrameFolderError, match="a border of 24 pixels leaves nothing of 64 x 48"):
        check_border(comparison, 24)
    check_border(comparison, 23)


def test_a_damaged_frame_fails_alone(truth: Path, tmp_path: Path) -> None:
    test = write(tmp_path / "test", {n: reference(n) for n in range(1, 6)})
    comparison = compared(truth, test=test)
    damaged = test / "frame.0003.exr"
    content = bytearray(damaged.read_bytes())
    content[-400:] = bytes(400)
    damaged.write_bytes(content)
    frames = scored(comparison)
    assert str(damaged) in frames[2].failed
    assert [bool(f.failed) for f in frames] == [False, False, True, False, False]
    assert frames[3].scores["test"].scores["temporal"] is None
    assert frames[4].scores["test"].scores["temporal"] == 0.0
