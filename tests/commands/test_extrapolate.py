"""`rtsr extrapolate` as a user runs it: what is predicted, from what, and what is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Planes = dict[str, NDArray[Any]]

PREDICTED = (2, 4, 6)


def load(path: Path) -> NDArray[np.float32]:
    planes = read_channels(path, {"R", "G", "B"})
    return np.stack([planes[c].astype(np.float32) for c in "RGB"])


def score(test: NDArray[np.float32], reference: NDArray[np.float32]) -> float:
    difference = test / (1 + test) - reference / (1 + reference)
    return float(-10 * np.log10(np.mean(difference.astype(np.float64) ** 2)))


def change(source: Path, target: Path, edit: Callable[[Planes, int], None]) -> Path:
    """Copy frames with other pixels."""
    for path in sorted(source.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        edit(planes, int(path.stem.split(".")[-1]))
        write_exr(target / path.name, planes, attributes=header.attributes)
    return target


def names_in(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.suffix == ".exr")


@pytest.fixture(scope="module")
def sequence(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames with radiance and G-buffer, of one size."""
    shot = tmp_path_factory.mktemp("sequence") / "shot"
    shutil.copytree(sample_root / "lr", shot)
    return shot


def test_every_second_frame_is_predicted_and_says_so(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "3 rendered, 3 to predict, system extranet" in result.output
    assert names_in(tmp_path / "out") == [f"frame.{n:04d}.exr" for n in PREDICTED]
    attributes = read_header(tmp_path / "out" / "frame.0004.exr").attributes
    assert int(attributes["rtsr:predicted"]) == 1
    assert attributes["rtsr:system"] == "extranet"


def test_lighting_on_surfaces_beats_moved_radiance(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    for system in ("warp", "warp-guided"):
        assert rtsr("extrapolate", sequence, tmp_path / system, "--system", system).exit_code == 0
    gains = []
    for number in PREDICTED:
        name = f"frame.{number:04d}.exr"
        guided, plain = (
            score(load(tmp_path / s / name), load(sequence / name)) for s in ("warp-guided", "warp")
        )
        gains.append(guided - plain)
    assert min(gains) > 1.5
    assert np.mean(gains) > 2.8


def test_radiance_of_predicted_frames_is_never_read(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    random = np.random.default_rng(1)

    def spoil(planes: Planes, number: int) -> None:
        if number in PREDICTED:
            for channel in "RGB":
                planes[channel] = random.uniform(0, 9, planes[channel].shape).astype(np.float16)

    noisy = change(sequence, tmp_path / "noisy", spoil)
    rtsr("extrapolate", sequence, tmp_path / "a")
    assert rtsr("extrapolate", noisy, tmp_path / "b").exit_code == 0
    for name in names_in(tmp_path / "a"):
        assert np.array_equal(load(tmp_path / "a" / name), load(tmp_path / "b" / name))


def test_the_whole_sequence_is_written_where_that_is_asked_for(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    assert rtsr("extrapolate", sequence, tmp_path / "out", "--keep-rendered").exit_code == 0
    assert names_in(tmp_path / "out") == names_in(sequence)
    assert np.array_equal(
        load(tmp_path / "out" / "frame.0003.exr"), load(sequence / "frame.0003.exr")
    )
    assert "rtsr:predicted" not in read_header(tmp_path / "out" / "frame.0003.exr").attributes


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        (("--every", "3"), [2, 3, 5, 6]),
        (("--rendered", "1,4"), [2, 3, 5, 6]),
        (("--rendered", "1-5"), [6]),
        (("--frames", "4-6"), [4, 6]),
    ],
)
def test_other_frames_can_be_the_rendered_ones(
    rtsr: Run, sequence: Path, tmp_path: Path, options: tuple[str, ...], numbers: list[int]
) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    assert names_in(tmp_path / "out") == [f"frame.{n:04d}.exr" for n in numbers]


def test_a_second_run_keeps_what_is_there(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    rtsr("extrapolate", sequence, tmp_path / "out")
    (tmp_path / "out" / "frame.0004.exr").unlink()
    result = rtsr("extrapolate", sequence, tmp_path / "out")
    assert "1 written, 2 kept" in result.output
    # another cadence is another sequence
    assert rtsr("extrapolate", sequence, tmp_path / "out", "--every", "3").exit_code == 3


def test_shards_write_what_the_whole_run_writes(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    rtsr("extrapolate", sequence, tmp_path / "whole")
    for part in ("1/2", "2/2"):
        assert rtsr("extrapolate", sequence, tmp_path / "parts", "--shard", part).exit_code == 0
    assert names_in(tmp_path / "parts") == names_in(tmp_path / "whole")
    for name in names_in(tmp_path / "whole"):
        assert np.array_equal(load(tmp_path / "whole" / name), load(tmp_path / "parts" / name))


def test_a_frame_that_no_rendered_one_precedes_fails_alone(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out", "--rendered", "3,5")
    assert result.exit_code == 1
    assert "frame.0001.exr: no rendered frame" in result.output
    assert names_in(tmp_path / "out") == ["frame.0004.exr", "frame.0006.exr"]


def test_a_cut_leaves_no_past_to_predict_from(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    shot = tmp_path / "shot"
    shutil.copytree(sequence, shot)
    (shot / "capture.toml").write_text("camera_cuts = [4]\n")
    result = rtsr("extrapolate", shot, tmp_path / "out")
    assert result.exit_code == 1
    assert "frame.0004.exr: no rendered frame" in result.output
    assert names_in(tmp_path / "out") == ["frame.0002.exr", "frame.0006.exr"]


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--every", "1"), 2, "none left to predict"),
        (("--every", "2", "--rendered", "1,3"), 2, "--every and --rendered"),
        (("--rendered", "1-6"), 3, "none is left to predict"),
        (("--rendered", "77"), 3, "none of its frames"),
        (("--system", "fusesr"), 2, "fusesr"),
    ],
)
def test_what_leaves_nothing_to_do_is_refused(
    rtsr: Run, sequence: Path, tmp_path: Path, options: tuple[str, ...], code: int, said: str
) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out", *options)
    assert result.exit_code == code, result.output
    assert said in result.output
    assert not (tmp_path / "out").exists()


def test_without_motion_nothing_is_predicted(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    def drop(planes: Planes, number: int) -> None:
        del number
        for channel in ("motion.X", "motion.Y"):
            planes.pop(channel)

    still = change(sequence, tmp_path / "still", drop)
    result = rtsr("extrapolate", still, tmp_path / "out")
    assert result.exit_code == 3
    assert "motion" in result.output


def test_coverage_goes_along_with_rendered_and_predicted_frames(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    def cover(planes: Planes, number: int) -> None:
        del number
        planes["A"] = np.full_like(planes["R"], 0.5)

    covered = change(sequence, tmp_path / "covered", cover)
    assert rtsr("extrapolate", covered, tmp_path / "out", "--keep-rendered").exit_code == 0
    for name in names_in(covered):
        alpha = read_channels(tmp_path / "out" / name, {"A"})["A"]
        assert np.allclose(alpha, 0.5, atol=1e-3)


def write_layer(shot: Path, value: float, *, sky: bool) -> Path:
    """Four frames of a premultiplied disc of one colour that moves by 1.5 pixels a frame."""
    height, width, samples = 48, 64, 8
    for number in (1, 2, 3, 4):
        y, x = ((np.arange(n * samples) + 0.5) / samples for n in (height, width))
        inside = (x[None] - 20 - 1.5 * number) ** 2 + (y[:, None] - 24) ** 2 < 144
        alpha = inside.reshape(height, samples, width, samples).mean((1, 3)).astype(np.float32)
        centre = inside[samples // 2 :: samples, samples // 2 :: samples].astype(np.float32)
        one = np.ones((height, width), np.float32)
        on = centre if sky else one
        planes = {
            **{c: value * alpha for c in "RGB"}, "A": alpha,
            **{f"albedo.{c}": 0.5 * one for c in "RGB"},
            "normal.X": 0 * one, "normal.Y": 0 * one, "normal.Z": on,
            "depth.Z": np.where(on > 0, 5.0, 65504.0).astype(np.float32),
            "roughness": 0.5 * one, "metallic": 0 * one, "nov": one,
            "motion.X": np.where(on > 0, -1.5, 0.0).astype(np.float32), "motion.Y": 0 * one,
        }  # fmt: skip
        write_exr(shot / f"frame.{number:04d}.exr", planes)
    return shot


@pytest.mark.parametrize("system", ["warp", "warp-guided"])
@pytest.mark.parametrize(("value", "sky"), [(0.8, True), (8.0, True), (8.0, False)])
def test_a_layer_over_its_own_colour_stays_that_colour(
    rtsr: Run, tmp_path: Path, system: str, value: float, sky: bool
) -> None:
    shot = write_layer(tmp_path / "shot", value, sky=sky)
    run = ("extrapolate", shot, tmp_path / "out", "--system", system, "--keep-rendered")
    result = rtsr(*run)
    assert result.exit_code == 0, result.output
    for number in (2, 4):
        made = read_channels(tmp_path / "out" / f"frame.{number:04d}.exr", "RGBA")
        alpha = made["A"].astype(np.float32)
        assert 0.02 < ((alpha > 0.01) & (alpha < 0.99)).mean() < 0.2
        for channel in "RGB":
            over = made[channel].astype(np.float32) + (1.0 - alpha) * value
            np.testing.assert_allclose(over, value, rtol=0.01)
    # what was rendered is handed on as it was
    for channel in "RGBA":
        name = "frame.0003.exr"
        ours, theirs = (read_channels(f / name, "RGBA")[channel] for f in (tmp_path / "out", shot))
        np.testing.assert_array_equal(ours, theirs.astype(np.float16))


@pytest.mark.parametrize("system", ["warp", "warp-guided"])
def test_debug_pictures_of_every_frame_make_it_done(
    rtsr: Run, sequence: Path, tmp_path: Path, system: str
) -> None:
    run = ("extrapolate", sequence, tmp_path / "out", "--keep-rendered", "--debug-buffers")
    assert "6 written" in rtsr(*run, "--system", system).output
    assert "0 written, 6 kept" in rtsr(*run, "--system", system).output


def test_why_the_better_system_cannot_run_is_said(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    def drop(planes: Planes, number: int) -> None:
        del number
        planes.pop("depth.Z")

    flat = change(sequence, tmp_path / "flat", drop)
    result = rtsr("extrapolate", flat, tmp_path / "out")
    assert result.exit_code == 0
    assert "system warp;" in result.output
    assert "extranet and warp-guided need depth: render or declare it" in result.output


def test_surfaces_without_material_keep_their_radiance(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    """A material of 0 carries no lighting: what was seen there is moved, and never black."""

    def blacken(planes: Planes, number: int) -> None:
        del number
        for channel in "RGB":
            planes[f"material.{channel}"] = np.zeros_like(planes[channel])

    black = change(sequence, tmp_path / "black", blacken)
    for system in ("warp", "warp-guided"):
        assert rtsr("extrapolate", black, tmp_path / system, "--system", system).exit_code == 0
    for number in PREDICTED:
        name = f"frame.{number:04d}.exr"
        truth = load(sequence / name)
        guided, plain = (load(tmp_path / system / name) for system in ("warp-guided", "warp"))
        assert score(guided, truth) > score(plain, truth)
        assert guided.min() > 0.0
