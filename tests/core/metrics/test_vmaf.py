"""VMAF against the values of the same libvmaf, and programs that fail."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.errors import MetricUnavailableError, RtsrError
from rtsr_cli.core.metrics.vmaf import Vmaf, VmafScores, default_model, luma, program

LIBVMAF = "libvmaf as in imageio-ffmpeg 0.8.1 (FFmpeg 9.0.2)"
TOLERANCE = 1e-3


@pytest.fixture(scope="module", autouse=True)
def installed() -> None:
    try:
        program()
    except MetricUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture
def values(oracle: Callable[[str], dict[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = oracle("vmaf")["results"][LIBVMAF]
    return found


def compared(test: NDArray[np.uint8], reference: NDArray[np.uint8], model: str) -> VmafScores:
    with Vmaf(reference.shape[1:], model) as vmaf:
        for one, other in zip(test, reference, strict=True):
            vmaf.add_luma(one, other)
        return vmaf.finish()


@pytest.mark.parametrize("model", ["vmaf_v0.6.1", "vmaf_v0.6.1neg"])
def test_the_same_libvmaf(recipe: SimpleNamespace, values: dict[str, Any], model: str) -> None:
    reference, test = recipe.luma_sequence(), recipe.luma_sequence(distort=True)
    found, expected = compared(test, reference, model), values[f"{model} reference vs test"]
    assert found.frames == pytest.approx(expected["frames"], abs=TOLERANCE)
    assert found.mean == pytest.approx(expected["mean"], abs=TOLERANCE)
    assert found.harmonic_mean == pytest.approx(expected["harmonic_mean"], abs=TOLERANCE)
    assert found.model == model
    assert found.build.startswith("libvmaf ")


def test_identical_frames_score_100_but_for_the_first(
    recipe: SimpleNamespace, values: dict[str, Any]
) -> None:
    frames = recipe.luma_sequence()
    found = compared(frames, frames, "vmaf_v0.6.1")
    assert found.frames == pytest.approx(values["vmaf_v0.6.1 identical"]["frames"], abs=TOLERANCE)


def test_luma_of_greys_and_primaries() -> None:
    colors = np.array([[[0] * 3, [255] * 3, [128] * 3, [255, 0, 0], [0, 0, 255]]], np.uint8)
    """16 for black, 219 more for white, the primaries in the proportions of their luminance."""
    assert luma(colors)[0].tolist() == [16, 235, 126, 63, 32]


def test_an_odd_last_row_and_column_are_left_out(recipe: SimpleNamespace) -> None:
    reference, test = recipe.luma_sequence(2), recipe.luma_sequence(2, distort=True)
    even = compared(test, reference, "vmaf_v0.6.1")
    wider = [np.pad(f, ((0, 0), (0, 1), (0, 1)), mode="edge") for f in (test, reference)]
    assert compared(wider[0], wider[1], "vmaf_v0.6.1").frames == even.frames


def test_a_frame_of_another_size_is_refused() -> None:
    small = np.zeros((64, 64), np.uint8)
    with (
        Vmaf((64, 96)) as vmaf,
        pytest.raises(RtsrError, match="a frame is 64 x 64, expected 96 x 64"),
    ):
        vmaf.add_luma(small, small)


def test_a_program_that_dies_is_an_error_and_no_deadlock(tmp_path: Path) -> None:
    fake = tmp_path / "ffmpeg"
    fake.write_text("#!/bin/sh\necho 'out of luck' >&2\nexit 5\n", encoding="utf-8")
    fake.chmod(0o755)
    frame = np.zeros((720, 1280), np.uint8)
    with (
        Vmaf(frame.shape, executable=str(fake)) as vmaf,
        pytest.raises(RtsrError, match=r"the program ended \(out of luck\)"),
    ):
        for _ in range(20):
            vmaf.add_luma(frame, frame)
        vmaf.finish()


def test_leaving_early_ends_the_program(recipe: SimpleNamespace) -> None:
    frames = recipe.luma_sequence(1)
    with Vmaf(frames.shape[1:]) as vmaf:
        vmaf.add_luma(frames[0], frames[0])
    assert vmaf.returncode is not None


def test_the_model_follows_the_picture() -> None:
    assert default_model(1080) == "vmaf_v0.6.1"
    assert default_model(2160) == "vmaf_4k_v0.6.1"
