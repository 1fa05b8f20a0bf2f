"""LR frames of a renderer with a pixel filter, beside an HR G-buffer: the width is measured."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.imaging.resampling import decimate_filtered, measure_filter_width
from rtsr_cli.core.pairs.pixel_filter import FilterFinding

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
        "rtsr_cli.core.pairs.pixel_filter.measure_first",
        lambda read, numbers, scale: FilterFinding(0.0, filtered=False),
    )
    assert rtsr("upscale", pair, tmp_path / "plain", *options).exit_code == 0
    matched, plain = (judge(tmp_path / n, capture, load_rgb) for n in ("matched", "plain"))
    assert matched > plain + 0.3


WIDTH_PX = measure_filter_width("blackman-harris", SCALE)


@pytest.fixture
def pair(capture: Path, tmp_path: Path) -> Path:
    return write_filtered_pair(capture, tmp_path / "pair")


def declare_width(pair: Path, width: float) -> None:
    path = pair / "capture.toml"
    path.write_text(f"filter_width_px = {width}\n{path.read_text(encoding='utf-8')}", "utf-8")


def read_width(output: str) -> float:
    (found,) = re.findall(r"standard deviation ([\d.]+) LR pixels", output)
    return float(found)


@pytest.mark.parametrize("system", ["demod-guided", "demod-temporal"])
def test_the_measured_width_is_said(rtsr: Run, pair: Path, tmp_path: Path, system: str) -> None:
    run = rtsr("upscale", pair, tmp_path / "out", "--system", system, "--dry-run")
    assert read_width(run.output) == pytest.approx(WIDTH_PX, abs=0.12)
    assert "measured" in run.output
    told = rtsr("inspect", pair)
    assert read_width(told.output) == read_width(run.output)
    assert json.loads(rtsr("inspect", pair, "--json").stdout)["filter_width_px"] == pytest.approx(
        read_width(run.output), abs=0.01
    )


def test_of_systems_that_know_no_filter_nothing_is_said(
    rtsr: Run, pair: Path, tmp_path: Path
) -> None:
    run = rtsr("upscale", pair, tmp_path / "out", "--system", "demod-bicubic", "--dry-run")
    assert "filter" not in run.output


def test_what_is_declared_is_obeyed_and_stamped(rtsr: Run, pair: Path, tmp_path: Path) -> None:
    options = ("--system", "demod-guided")
    assert rtsr("upscale", pair, tmp_path / "measured", *options).exit_code == 0
    declare_width(pair, 0.0)
    run = rtsr("upscale", pair, tmp_path / "none", *options)
    assert run.exit_code == 0
    assert "pixel filter" not in run.output
    (first,), (second,) = (
        [p.read_bytes() for p in (tmp_path / name).glob("*.exr")] for name in ("measured", "none")
    )
    assert first != second
    again = rtsr("upscale", pair, tmp_path / "measured", *options)
    assert again.exit_code == 3
    assert "--overwrite" in again.output


@pytest.mark.parametrize("width", [0.0, 0.9])
def test_a_declared_width_that_is_another_is_doubted(
    rtsr: Run, pair: Path, tmp_path: Path, width: float
) -> None:
    declare_width(pair, width)
    words = ("upscale", pair, tmp_path / "out", "--dry-run", "--system")
    run = rtsr(*words, "demod-guided")
    assert run.exit_code == 0
    (line,) = [line for line in run.stderr.splitlines() if "filter_width_px" in line]
    found = re.search(
        rf"Warning: .*filter_width_px is declared as {width:g}, but LR radiance looks "
        r"filtered by ([\d.]+) LR pixels; the declaration is obeyed: correct it",
        line,
    )
    assert found is not None, line
    assert float(found[1]) == pytest.approx(WIDTH_PX, abs=0.12)
    assert "is declared as" in rtsr("inspect", pair).output
    # who knows no filter reckons with none
    assert "is declared as" not in rtsr(*words, "demod-bicubic").output


def test_a_declared_width_that_is_about_right_is_not_doubted(
    rtsr: Run, pair: Path, tmp_path: Path
) -> None:
    declare_width(pair, round(WIDTH_PX + 0.1, 2))
    run = rtsr("upscale", pair, tmp_path / "out", "--dry-run", "--system", "demod-guided")
    assert "is declared as" not in run.output
    assert "is declared as" not in rtsr("inspect", pair).output


def test_parts_of_a_run_take_no_measured_width(rtsr: Run, pair: Path, tmp_path: Path) -> None:
    refused = rtsr("inspect", pair, "--write", "--overwrite")
    assert "filter_width_px" in (pair / "capture.toml").read_text(encoding="utf-8"), refused.output
    declared = (pair / "capture.toml").read_text(encoding="utf-8")
    options = ("--system", "demod-guided", "--shard", "1/1")
    run = rtsr("upscale", pair, tmp_path / "out", *options)
    assert run.exit_code == 0, run.output
    assert "declared" in run.output
    without = [line for line in declared.splitlines() if "filter_width_px" not in line]
    (pair / "capture.toml").write_text("\n".join(without), "utf-8")
    run = rtsr("upscale", pair, tmp_path / "other", *options)
    assert run.exit_code == 3
    assert "filter_width_px = 0." in run.output
    assert not list((tmp_path / "other").rglob("*.exr"))


def test_a_farm_pins_it(rtsr: Run, pair: Path) -> None:
    pinned = rtsr("farm", "pin", pair)
    assert pinned.exit_code == 0, pinned.output
    assert "pixel filter" in pinned.output
    text = (pair / "capture.toml").read_text(encoding="utf-8")
    assert "filter_width_px = 0." in text
    rtsr("farm", "pin", pair)
    assert (pair / "capture.toml").read_text(encoding="utf-8") == text


def test_a_width_that_cannot_be_told_is_said(
    rtsr: Run, pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "rtsr_cli.core.pairs.pixel_filter.measure_first",
        lambda read, numbers, scale: FilterFinding(None, filtered=True),
    )
    run = rtsr("upscale", pair, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    assert "no filter width that was tried fits it" in run.output
    assert "filter_width_px" in run.output


@pytest.mark.parametrize("width", [-0.1, 3.0, "nan", "true", '"0.37"'])
def test_widths_that_are_none_are_refused(
    rtsr: Run, pair: Path, tmp_path: Path, width: Any
) -> None:
    declare_width(pair, width)
    run = rtsr("upscale", pair, tmp_path / "out", "--system", "demod-guided")
    assert run.exit_code in {2, 3}
    assert "filter_width_px" in run.output
