"""LR frames of a renderer with a pixel filter, beside an HR G-buffer: the width is measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.imaging.resampling import decimate_filtered

Run = Callable[..., Any]

SCALE = 2
OFFSET = (1, 1)


def write_filtered_pair(capture: Path, folder: Path) -> Path:
    """LR frames of a capture, radiance filtered, the rest point-sampled; HR without radiance."""
    for path in sorted(capture.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        color = torch.from_numpy(np.stack([planes[c] for c in "RGB"]).astype(np.float32))[None]
        filtered = decimate_filtered(color, "blackman-harris", SCALE, OFFSET)[0].numpy()
        small = {n: np.ascontiguousarray(p[OFFSET[1] :: SCALE, OFFSET[0] :: SCALE])
                 for n, p in planes.items()}  # fmt: skip
        small |= dict(zip("RGB", filtered, strict=True))
        small |= {n: p / SCALE for n, p in small.items() if n.startswith("motion")}
        for name, kept in (
            ("lr", small),
            ("hr", {n: p for n, p in planes.items() if n not in "RGB"}),
        ):
            target = folder / name / path.name
            target.parent.mkdir(parents=True, exist_ok=True)
            write_exr(target, kept, attributes=header.attributes)
    jitter = (OFFSET[0] + 0.5) / SCALE - 0.5
    text = f"jitter_px = [{jitter}, {jitter}]\n"
    (folder / "capture.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def capture(rtsr: Run, tmp_path: Path) -> Path:
    made = rtsr("synth", tmp_path / "capture", "--size", "256x160", "--frames", 3, "--seed", 5)
    assert made.exit_code == 0, made.output
    (shot,) = {path.parent for path in (tmp_path / "capture").rglob("*.exr")}
    return Path(shot)


def judge(test: Path, truth: Path, load_rgb: Callable[[Path], Any]) -> float:
    """Mean PSNR of the frames after c / (1 + c)."""
    scores = []
    for path in sorted(test.glob("*.exr")):
        ours, theirs = (np.asarray(load_rgb(p), np.float64) for p in (path, truth / path.name))
        difference = ours / (1.0 + ours) - theirs / (1.0 + theirs)
        scores.append(-10.0 * np.log10(np.square(difference).mean()))
    return float(np.mean(scores))


def test_rendered_pairs_are_as_good_as_simulated_ones(
    rtsr: Run, capture: Path, tmp_path: Path, load_rgb: Callable[[Path], Any]
) -> None:
    pair = write_filtered_pair(capture, tmp_path / "pair")
    options = ("--system", "demod-guided", "-q")
    simulated = ("--simulate-lr", SCALE, "--lr-filter", "blackman-harris")
    for source, name, more in ((pair, "real", ()), (capture, "simulated", simulated)):
        run = rtsr("upscale", source, tmp_path / name, *options, *more)
        assert run.exit_code == 0, run.output
    found = {n: judge(tmp_path / n, capture, load_rgb) for n in ("real", "simulated")}
    assert found["real"] > found["simulated"] - 0.5


def test_dividing_by_filtered_material_gains(
    rtsr: Run,
    capture: Path,
    tmp_path: Path,
    load_rgb: Callable[[Path], Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = write_filtered_pair(capture, tmp_path / "pair")
    options = ("--system", "demod-guided", "-q")
    assert rtsr("upscale", pair, tmp_path / "matched", *options).exit_code == 0
    monkeypatch.setattr(
        "rtsr_cli.core.pairs.pixel_filter.measure_first", lambda read, numbers, scale: 0.0
    )
    assert rtsr("upscale", pair, tmp_path / "plain", *options).exit_code == 0
    matched, plain = (judge(tmp_path / n, capture, load_rgb) for n in ("matched", "plain"))
    assert matched > plain + 0.3
