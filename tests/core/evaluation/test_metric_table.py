"""What the metrics say of themselves."""

from __future__ import annotations

import numpy as np
import pytest

from rtsr_cli.core.evaluation.metric_table import METRICS
from rtsr_cli.core.metrics.vmaf import Vmaf, choose_model


def test_vmaf_names_its_models_and_what_they_are_shown() -> None:
    meaning = METRICS["vmaf"].meaning
    assert f"by model {choose_model(1080)} ({choose_model(2160)} from 2160 rows)" in meaning
    assert "8-bit BT.709 luma" in meaning


def test_what_identical_pictures_score_by_vmaf_is_as_described() -> None:
    pytest.importorskip("imageio_ffmpeg")
    random = np.random.default_rng(0)
    pictures = random.integers(0, 256, (2, 64, 96, 3), dtype=np.uint8)
    with Vmaf((64, 96)) as vmaf:
        for index in (0, 0, 1):
            vmaf.add(pictures[index], pictures[index])
        found = vmaf.finish().frames
    assert [f"{score:.2f}" for score in found] == ["97.43", "97.43", "100.00"]
    assert "97.43 and not 100 where nothing moves" in METRICS["vmaf"].meaning
