"""What a result says of how it was made."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.evaluation.comparisons import CompareOptions, Comparison, open_comparisons
from rtsr_cli.core.evaluation.judgement import JudgedShot, Judgement, assemble_result, judge_shot
from rtsr_cli.core.evaluation.metric_table import MetricRules
from rtsr_cli.core.evaluation.protocols import PROTOCOLS
from rtsr_cli.core.evaluation.shot_scores import ScoringOptions
from rtsr_cli.core.files.exr import write_exr

DECLARED = '[motion]\nunit = "pixels"\ndirection = "previous-minus-current"\ny_axis = "down"\n'


def write(folder: Path, numbers: tuple[int, ...]) -> Path:
    plane = np.full((64, 64), 0.5, np.float32)
    names = (*"RGB", "motion.X", "motion.Y", "depth.Z")
    for number in numbers:
        write_exr(folder / f"frame.{number:04d}.exr", dict.fromkeys(names, plane))
    (folder / "capture.toml").write_text(DECLARED, encoding="utf-8")
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


def judged(tmp_path: Path, numbers: tuple[int, ...], rules: MetricRules) -> dict[str, object]:
    test, truth = write(tmp_path / "test", numbers), write(tmp_path / "ref", numbers)
    comparison = open_comparisons({"test": test}, truth, CompareOptions())[0]
    judgement = Judgement(run=ScoringOptions(rules=rules), options={}, inputs={})
    shot = judged_shot(comparison, judgement)
    return assemble_result([shot], judgement)


def rules(*metrics: str, source: str = "") -> MetricRules:
    return MetricRules(
        protocol=PROTOCOLS["rtsr"], metrics=metrics, ssim=SsimConvention.WANG, lpips_source=source
    )


def test_versions_name_what_figures_depend_on(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    found = judged(tmp_path, (1, 2), rules("vmaf", source="a.ckpt, SHA-256 0123456789ab"))
    versions = found["versions"]
    assert isinstance(versions, dict)
    assert versions["numpy"] == np.__version__
    assert versions["imageio-ffmpeg"] == metadata.version("imageio-ffmpeg")
    assert versions["vmaf"].startswith("vmaf_v0.6.1, libvmaf ")
    assert versions["lpips weights"] == "a.ckpt, SHA-256 0123456789ab"


def test_what_was_not_asked_for_has_no_version(tmp_path: Path) -> None:
    assert list(judged(tmp_path, (1, 2), rules("psnr"))["versions"]) == [  # type: ignore[call-overload]
        "rtsr", "torch", "numpy",
    ]  # fmt: skip


def test_frames_without_the_frame_before_say_why_nothing_temporal_is_there(tmp_path: Path) -> None:
    (test,) = judged(tmp_path, (1,), rules("temporal"))["tests"].values()  # type: ignore[attr-defined]
    assert test["frames"]["1"]["temporal"] is None
    assert any("no judged frame has history" in note for note in test["notes"])
