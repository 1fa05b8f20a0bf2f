"""Which frames get pictures, why, and how pixels that are not finite are shown."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.evaluation.comparisons import CompareOptions, Comparison, open_comparisons
from rtsr_cli.core.evaluation.illustrations import draw_moments
from rtsr_cli.core.evaluation.judgement import JudgedShot, Judgement, judge_shot
from rtsr_cli.core.evaluation.metric_table import MetricRules
from rtsr_cli.core.evaluation.protocols import PROTOCOLS
from rtsr_cli.core.evaluation.shot_scores import ScoringOptions
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.reporting.report import Moment, Picture

HEIGHT, WIDTH = 176, 216
MAGENTA = (255, 0, 255)

Image = NDArray[np.float32]


def grey(level: float = 0.5) -> Image:
    return np.full((HEIGHT, WIDTH, 3), level, np.float32)


def write(folder: Path, images: list[Image]) -> Path:
    for number, image in enumerate(images, start=1):
        write_exr(
            folder / f"frame.{number:04d}.exr", {c: image[..., i] for i, c in enumerate("RGB")}
        )
    return folder


def judged_shot(comparison: Comparison, judgement: Judgement) -> JudgedShot:
    """Go through the events of a shot."""
    events = judge_shot(comparison, judgement)
    while True:
        try:
            next(events)
        except StopIteration as end:
            shot: JudgedShot = end.value
            return shot


def shown(truth: Path, **tests: Path) -> list[Moment]:
    comparison = open_comparisons(tests, truth, CompareOptions())[0]
    rules = MetricRules(protocol=PROTOCOLS["rtsr"], metrics=("flip",), ssim=SsimConvention.WANG)
    judgement = Judgement(run=ScoringOptions(rules=rules), options={}, inputs={})
    return list(draw_moments([judged_shot(comparison, judgement)], judgement))


def pixels(picture: Picture, tmp_path: Path) -> NDArray[np.uint8]:
    path = tmp_path / f"picture.{picture.mime.partition('/')[2]}"
    path.write_bytes(picture.data)
    found: NDArray[np.uint8] = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    return found


@pytest.mark.parametrize("count", [2, 6, 12])
def test_no_frame_is_shown_twice_and_the_worst_comes_first(tmp_path: Path, count: int) -> None:
    truth = write(tmp_path / "ref", [grey()] * count)
    levels = [0.5 + 0.02 * (1 + 5 * n % (count + 1)) for n in range(count)]
    found = shown(truth, a=write(tmp_path / "a", [grey(level) for level in levels]))
    assert max(Counter(moment.frame for moment in found).values()) == 1
    assert found[0].frame == levels.index(max(levels)) + 1
    assert found[0].why.startswith("worst by FLIP of a, 0.")


def test_it_is_told_whose_flip_is_meant(tmp_path: Path) -> None:
    truth = write(tmp_path / "ref", [grey()])
    tests = {"a": write(tmp_path / "a", [grey(0.52)]), "b": write(tmp_path / "b", [grey(0.8)])}
    why = shown(truth, **tests)[0].why
    assert why.startswith("worst by FLIP, the mean of 2 tests; b has the worst, 0.")


def test_a_single_pixel_that_is_not_finite_is_seen_in_the_frame_and_in_its_cut_out(
    tmp_path: Path,
) -> None:
    truth = write(tmp_path / "ref", [grey()] * 12)
    images = [grey(0.9) for _ in range(11)] + [grey(0.51)]
    images[11][HEIGHT - 1, WIDTH - 1, 1] = np.nan
    found = shown(truth, a=write(tmp_path / "a", images))
    spoilt = [m for m in found if m.frame == 12]
    assert [m.why for m in spoilt] == ["pixels of a that are not finite: 1"]
    whole = pixels(spoilt[0].tests["a"], tmp_path).astype(int)
    assert np.abs(whole[HEIGHT - 1, WIDTH - 1] - MAGENTA).max() < 60
    crop = spoilt[0].crop
    assert crop is not None
    assert crop.box == (WIDTH - 160, HEIGHT - 160, 160, 160)
    cut = pixels(crop.tests["a"], tmp_path)
    marked = (cut == MAGENTA).all(-1)
    assert marked[-1, -1]
    assert marked.sum() == 1
    assert not (pixels(crop.reference, tmp_path) == MAGENTA).all(-1).any()


def test_what_is_not_finite_in_the_reference_is_marked_there_and_is_no_worst_part(
    tmp_path: Path,
) -> None:
    truth = [grey() for _ in range(2)]
    truth[0][:8, :8] = np.inf
    found = shown(write(tmp_path / "ref", truth), a=write(tmp_path / "a", [grey(), grey(0.6)]))
    assert [m.frame for m in found] == [2, 1]
    assert found[1].why.endswith("pixels of the reference that are not finite: 64")
    crop = found[1].crop
    assert crop is not None
    for part in (crop.reference, crop.tests["a"], crop.heat["a"]):
        assert (pixels(part, tmp_path) == MAGENTA).all(-1).sum() == 64
