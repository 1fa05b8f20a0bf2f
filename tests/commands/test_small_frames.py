"""`rtsr evaluate` of frames that a metric's window does not fit, or just fits."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]


def noise(height: int, width: int) -> NDArray[np.float32]:
    return np.random.default_rng(0).random((height, width, 3)).astype(np.float32)


@pytest.fixture
def write_pair(tmp_path: Path) -> Callable[[int, int], tuple[Path, Path]]:
    """Two folders of a frame of noise, the second a tenth darker."""

    def write(height: int, width: int) -> tuple[Path, Path]:
        for name, gain in (("a", 1.0), ("b", 0.9)):
            planes = {c: gain * noise(height, width)[..., i] for i, c in enumerate("RGB")}
            write_exr(tmp_path / name / "f.0001.exr", planes)
        return tmp_path / "a", tmp_path / "b"

    return write


def ssim_by_hand(test: NDArray[Any], ref: NDArray[Any]) -> float:
    """Wang et al. 2004 over whole 11 x 11 windows of c / (1 + c), then sRGB; window by window."""

    def show(color: NDArray[Any]) -> NDArray[Any]:
        t = color.astype(float) / (1.0 + color)
        return np.where(t <= 0.0031308, 12.92 * t, 1.055 * t ** (1 / 2.4) - 0.055)

    gauss = np.exp(-(np.arange(-5, 6) ** 2) / 4.5)
    window = np.outer(gauss, gauss) / gauss.sum() ** 2
    values = []
    rows, columns, _ = test.shape
    for channel in range(3):
        x, y = show(test[..., channel]), show(ref[..., channel])
        for i in range(rows - 10):
            for j in range(columns - 10):
                p, q = (v[i : i + 11, j : j + 11] for v in (x, y))
                m, n = (p * window).sum(), (q * window).sum()
                sxx, syy = (p * p * window).sum() - m * m, (q * q * window).sum() - n * n
                sxy = (p * q * window).sum() - m * n
                values.append(
                    (2 * m * n + 1e-4) * (2 * sxy + 9e-4)
                    / ((m * m + n * n + 1e-4) * (sxx + syy + 9e-4))
                )  # fmt: skip
    return float(np.mean(values))


@pytest.mark.parametrize("size", [(11, 11), (16, 16), (12, 40)])
def test_ssim_is_a_number_where_a_window_fits(
    rtsr: Run, write_pair: Callable[[int, int], tuple[Path, Path]], size: tuple[int, int]
) -> None:
    result = rtsr("evaluate", *write_pair(*size), "--metric", "ssim", "--json")
    assert result.exit_code == 0, result.output
    expected = ssim_by_hand(noise(*size), np.float32(0.9) * noise(*size))
    test = json.loads(result.stdout.splitlines()[-1])["tests"]["a"]
    assert test["mean"]["ssim"] == pytest.approx(expected, abs=2e-5)
    assert "reasons" not in test["frames"]["1"]


@pytest.mark.parametrize("size", [(1, 1), (10, 40), (1, 64)])
def test_ssim_is_null_with_the_reason_where_none_fits(
    rtsr: Run,
    write_pair: Callable[[int, int], tuple[Path, Path]],
    tmp_path: Path,
    size: tuple[int, int],
) -> None:
    files = [tmp_path / f"r.{suffix}" for suffix in ("json", "csv", "html")]
    outputs = [word for path in files for word in ("--output", path)]
    result = rtsr("evaluate", *write_pair(*size), "--metric", "psnr,ssim,flip,vmaf", *outputs)
    assert result.exit_code in (0, 1), result.output
    reason = f"needs at least 11 pixels a side, the frame is {size[1]} x {size[0]}"
    assert f"Note: a: no SSIM of frame 1: SSIM (wang) {reason}" in result.output
    stored = json.loads(files[0].read_text())["tests"]["a"]
    assert stored["mean"]["ssim"] is None
    assert stored["mean"]["psnr"] > 20
    assert stored["frames"]["1"]["ssim"] is None
    assert reason in stored["frames"]["1"]["reasons"]["ssim"]
    row = next(csv.DictReader(io.StringIO(files[1].read_text())))
    assert row["ssim"] == ""
    assert reason in row["reasons"]
    assert reason in files[2].read_text()
    merged = rtsr("evaluate", "--merge", files[0])
    assert reason in merged.output


def test_a_demand_on_what_is_null_is_missed(
    rtsr: Run, write_pair: Callable[[int, int], tuple[Path, Path]]
) -> None:
    result = rtsr("evaluate", *write_pair(8, 8), "--metric", "ssim", "--fail-under", "ssim>0.5")
    assert result.exit_code == 1
    assert "ssim is missing" in result.output
