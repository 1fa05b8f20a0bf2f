from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import fmean
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.errors import MetricError, MetricUnavailableError, ShapeMismatchError
from rtsr_cli.core.evaluation.score_summary import harmonic_mean
from rtsr_cli.core.metrics import vmaf as module
from rtsr_cli.core.metrics.vmaf import (
    INSTALL_COMMAND,
    Vmaf,
    VmafScores,
    choose_model,
    limited_range_luma,
)

TOLERANCE = 0.001
BUILD = "libvmaf as in imageio-ffmpeg 0.8.1 (FFmpeg 9.0.2)"
SIZE = (192, 320)
Oracle = Callable[[str], dict[str, Any]]


@pytest.fixture(scope="session")
def ffmpeg_version() -> str:
    if sys.platform == "win32":
        pytest.skip("VMAF does not run on Windows")
    imageio_ffmpeg = pytest.importorskip(
        "imageio_ffmpeg", reason=f"no FFmpeg with libvmaf; get it with `{INSTALL_COMMAND}`"
    )
    return str(imageio_ffmpeg.get_ffmpeg_version())


@pytest.fixture
def fake_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Puts a shell script in FFmpeg's place."""

    def replace(script: str) -> None:
        program = tmp_path / "ffmpeg"
        program.write_text(f"#!/bin/sh\n{script}\n", encoding="ascii")
        program.chmod(0o755)
        monkeypatch.setattr(module, "find_ffmpeg", lambda: (str(program), "fake"))

    return replace


def vmaf_of_luma(test: np.ndarray, ref: np.ndarray, model: str = "vmaf_v0.6.1") -> VmafScores:
    with Vmaf(ref.shape[1:], model) as vmaf:
        for planes in zip(test, ref, strict=True):
            vmaf.add_luma(*planes)
        return vmaf.finish()


def noise(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def add_until_it_fails(vmaf: Vmaf) -> None:
    plane = np.zeros(SIZE, dtype=np.uint8)
    for _ in range(1000):
        vmaf.add_luma(plane, plane)


@pytest.mark.parametrize("model", ["vmaf_v0.6.1", "vmaf_v0.6.1neg"])
@pytest.mark.parametrize("pair", ["reference vs test", "identical"])
def test_scores_are_those_of_the_oracle(
    pair: str, model: str, recipe: SimpleNamespace, oracle: Oracle, ffmpeg_version: str
) -> None:
    if "9.0.2" not in ffmpeg_version:
        pytest.skip(f"the oracle is of FFmpeg 9.0.2, not of {ffmpeg_version}")
    expected = oracle("vmaf")["results"][BUILD][f"{model} {pair}"]
    ref = recipe.luma_sequence()
    test = ref if pair == "identical" else recipe.luma_sequence(distort=True)
    scores = vmaf_of_luma(test, ref, model)
    assert scores.frames == pytest.approx(expected["frames"], abs=TOLERANCE)
    assert fmean(scores.frames) == pytest.approx(expected["mean"], abs=TOLERANCE)
    assert harmonic_mean(scores.frames) == pytest.approx(expected["harmonic_mean"], abs=TOLERANCE)
    assert scores.model == model


def test_the_build_names_libvmaf_and_ffmpeg(recipe: SimpleNamespace, ffmpeg_version: str) -> None:
    ref = recipe.luma_sequence(2)
    build = vmaf_of_luma(ref, ref).build
    assert build.startswith("libvmaf ")
    assert build.endswith(f" in FFmpeg {ffmpeg_version}")


@pytest.mark.parametrize("model", module.MODELS)
def test_every_model_is_built_in(model: str, recipe: SimpleNamespace, ffmpeg_version: str) -> None:
    scores = vmaf_of_luma(recipe.luma_sequence(3, distort=True), recipe.luma_sequence(3), model)
    assert all(50.0 < score < 100.0 for score in scores.frames)


def test_test_and_reference_are_not_swapped(recipe: SimpleNamespace, ffmpeg_version: str) -> None:
    ref, test = recipe.luma_sequence(3), recipe.luma_sequence(3, distort=True)
    forward, backward = vmaf_of_luma(test, ref), vmaf_of_luma(ref, test)
    assert abs(fmean(forward.frames) - fmean(backward.frames)) > 1.0


def test_colours_are_compared_by_their_luma(ffmpeg_version: str) -> None:
    test, ref = noise(1, 3, 64, 96, 3), noise(2, 3, 64, 96, 3) // 4 + noise(1, 3, 64, 96, 3) // 2
    with Vmaf((64, 96)) as vmaf:
        for pictures in zip(test, ref, strict=True):
            vmaf.add(*pictures)
        scores = vmaf.finish()
    planes = [np.stack([limited_range_luma(picture) for picture in of]) for of in (test, ref)]
    assert scores == vmaf_of_luma(*planes)


def test_luma_is_bt709_of_limited_range() -> None:
    colours = [(0, 0, 0), (255, 255, 255), (255, 0, 0), (0, 255, 0), (0, 0, 255), (128, 128, 128)]
    picture = np.array([colours], dtype=np.uint8)
    # 16 + 219 * 0.2126 = 62.56, 16 + 219 * 0.7152 = 172.63, 16 + 219 * 0.0722 = 31.81
    assert limited_range_luma(picture).tolist() == [[16, 235, 63, 173, 32, 126]]


def test_of_odd_sizes_the_last_row_and_column_are_left_out(ffmpeg_version: str) -> None:
    test, ref = noise(1, 3, 65, 97), noise(2, 3, 65, 97) // 2 + noise(1, 3, 65, 97) // 2
    odd = vmaf_of_luma(test, ref)
    assert odd == vmaf_of_luma(test[:, :64, :96], ref[:, :64, :96])


def test_long_sequences_neither_block_nor_lose_frames(ffmpeg_version: str) -> None:
    plane = noise(3, 64, 64)
    with Vmaf((64, 64)) as vmaf:
        for _ in range(400):
            vmaf.add_luma(plane, plane)
        scores = vmaf.finish()
    assert len(scores.frames) == 400


def test_sequences_run_side_by_side(recipe: SimpleNamespace, ffmpeg_version: str) -> None:
    ref, test = recipe.luma_sequence(), recipe.luma_sequence(distort=True)
    expected = vmaf_of_luma(test, ref)
    with ThreadPoolExecutor(3) as threads:
        assert list(threads.map(lambda _: vmaf_of_luma(test, ref), range(3))) == [expected] * 3


def test_a_picture_may_be_overwritten_once_it_was_added(
    recipe: SimpleNamespace, ffmpeg_version: str
) -> None:
    ref, test = recipe.luma_sequence(), recipe.luma_sequence(distort=True)
    expected = vmaf_of_luma(test, ref)
    one, other = np.empty_like(test[0]), np.empty_like(ref[0])
    with Vmaf(SIZE) as vmaf:
        for planes in zip(test, ref, strict=True):
            one[:], other[:] = planes
            vmaf.add_luma(one, other)
        one[:] = other[:] = 0
        assert vmaf.finish() == expected


def test_a_child_that_is_killed_ends_the_adding(ffmpeg_version: str) -> None:
    with Vmaf(SIZE) as vmaf:
        vmaf._child.kill()
        with pytest.raises(MetricError, match=r"FFmpeg ended .* with status -9"):
            add_until_it_fails(vmaf)


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script stands in for FFmpeg")
class TestFakeProgram:
    def test_what_a_dying_child_said_is_in_the_error(
        self, fake_ffmpeg: Callable[[str], None]
    ) -> None:
        fake_ffmpeg("echo 'No such filter: libvmaf' >&2; exit 3")
        with Vmaf(SIZE) as vmaf, pytest.raises(MetricError, match=r"status 3: No such filter"):
            add_until_it_fails(vmaf)

    def test_a_child_that_dies_before_the_scores_is_an_error(
        self, fake_ffmpeg: Callable[[str], None]
    ) -> None:
        fake_ffmpeg("exit 3")
        plane = np.zeros(SIZE, dtype=np.uint8)
        with Vmaf(SIZE) as vmaf, pytest.raises(MetricError, match="status 3: it said nothing"):
            vmaf.add_luma(plane, plane)
            vmaf.finish()

    def test_scores_that_are_none_are_an_error(self, fake_ffmpeg: Callable[[str], None]) -> None:
        fake_ffmpeg("exit 0")
        plane = np.zeros(SIZE, dtype=np.uint8)
        with Vmaf(SIZE) as vmaf, pytest.raises(MetricError, match="cannot be read"):
            vmaf.add_luma(plane, plane)
            vmaf.finish()

    def test_leaving_the_context_ends_a_child_that_hangs(
        self, fake_ffmpeg: Callable[[str], None]
    ) -> None:
        fake_ffmpeg("exec sleep 600")
        plane = np.zeros(SIZE, dtype=np.uint8)
        threads = threading.active_count()
        with pytest.raises(KeyboardInterrupt), Vmaf(SIZE) as vmaf:
            vmaf.add_luma(plane, plane)
            raise KeyboardInterrupt
        assert vmaf._child.returncode == -9
        assert threading.active_count() == threads

    def test_a_program_that_does_not_start_is_unavailable(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(module, "find_ffmpeg", lambda: (str(tmp_path / "absent"), "fake"))
        with pytest.raises(MetricUnavailableError, match="does not start"), Vmaf(SIZE):
            pass


def test_without_imageio_ffmpeg_the_error_names_the_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MetricUnavailableError, match=INSTALL_COMMAND), Vmaf(SIZE):
        pass


def test_pictures_of_another_size_or_depth_are_refused(ffmpeg_version: str) -> None:
    right = np.zeros((*SIZE, 3), dtype=np.uint8)
    with Vmaf(SIZE) as vmaf:
        for wrong in (right[:-2], right[..., 0], right.astype(np.float32)):
            with pytest.raises(ShapeMismatchError, match=r"\(192, 320, 3\) uint8"):
                vmaf.add(right, wrong)
        with pytest.raises(ShapeMismatchError, match=r"\(192, 320\) uint8"):
            vmaf.add_luma(right, right)


def test_no_frames_have_no_score(ffmpeg_version: str) -> None:
    with Vmaf(SIZE) as vmaf, pytest.raises(MetricError, match="no frame"):
        vmaf.finish()


def test_small_pictures_and_unknown_models_are_refused() -> None:
    with pytest.raises(MetricError, match="64 x 31 pixels are too few"):
        Vmaf((31, 64))
    with pytest.raises(MetricError, match=r"did you mean 'vmaf_v0\.6\.1'"):
        Vmaf(SIZE, "vmaf_v0.6.2")


def test_the_model_follows_the_height() -> None:
    assert choose_model(1080) == "vmaf_v0.6.1"
    assert choose_model(2159) == "vmaf_v0.6.1"
    assert choose_model(2160) == "vmaf_4k_v0.6.1"
