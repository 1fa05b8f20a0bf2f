"""A buffer that one frame of a shot lacks: what does without runs, and the frame is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels

Run = Callable[..., Result]
Copy = Callable[..., Path]

CHANNELS = {
    "depth": ("depth.Z",),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
}


def drop(buffer: str, bad: int) -> Callable[[dict[str, Any], int], None]:
    def change(planes: dict[str, Any], number: int) -> None:
        if number == bad:
            for channel in CHANNELS[buffer]:
                del planes[channel]

    return change


@pytest.mark.parametrize(("buffer", "bad"), [("depth", 2), ("albedo", 1), ("normal", 4)])
def test_the_best_system_that_all_frames_allow_runs(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path, buffer: str, bad: int
) -> None:
    folder = changed(small_capture, drop(buffer, bad))
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4)
    planned = rtsr(*line, "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert f"need {buffer} of frame {bad}: render those frames again, or leave" in planned.output
    assert f"frame {bad}: buffer '{buffer}' is missing" in planned.output
    assert "render this frame again, or leave it out: --on-missing skip" in planned.output
    refused = rtsr(*line, "--system", "demod-guided")
    assert refused.exit_code == 3
    assert f"cannot run, missing: {buffer} of frame {bad}" in refused.output
    assert not (tmp_path / "out").exists()


def test_a_frame_that_lacks_it_is_done_by_what_needs_it_not(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("albedo", 3))
    done = rtsr("upscale", folder, tmp_path / "out", "--simulate-lr", 4)
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "out").rglob("*.exr"))) == 4


@pytest.mark.parametrize("bad", [1, 3])
def test_inspect_names_the_frame_and_offers_no_line_for_it(
    rtsr: Run, small_capture: Path, changed: Copy, bad: int
) -> None:
    folder = changed(small_capture, drop("depth", bad))
    report = rtsr("inspect", folder).output
    assert f"frame {bad}: buffer 'depth' is missing" in report
    (guided,) = (line for line in report.splitlines() if " demod-guided " in line)
    assert f"missing: depth of frame {bad} (runs without those, by --on-missing skip)" in guided
    assert "depth = " not in report


def test_at_one_size_that_size_is_named(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    changed(small_shot / "hr", drop("normal", 2)).rename(shot / "hr")
    (shot / "lr").symlink_to(small_shot / "lr")
    planned = rtsr("upscale", shot, tmp_path / "out", "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert "need hr normal of frame 2: render those frames again" in planned.output


@pytest.mark.parametrize("size", ["lr", "hr"])
def test_with_skip_a_frame_that_lacks_what_the_system_needs_is_left_out(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, size: str
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    (other,) = {"lr", "hr"} - {size}
    changed(small_shot / size, drop("normal", 2)).rename(shot / size)
    (shot / other).symlink_to(small_shot / other)
    (shot / "capture.toml").write_bytes((small_shot / "capture.toml").read_bytes())
    done = rtsr(
        "upscale", shot, tmp_path / "out", "--system", "demod-guided", "--on-missing", "skip"
    )
    assert done.exit_code == 0, done.output
    said = f"{shot / size}: frame 2 left out (--on-missing skip): buffer 'normal' is missing there"
    assert said in done.output
    made = sorted(path.name for path in (tmp_path / "out").rglob("*.exr"))
    assert made == [f"frame.{number:04d}.exr" for number in (1, 3, 4)]
    # the default is what runs on the other frames
    chosen = rtsr("upscale", shot, tmp_path / "best", "--on-missing", "skip", "--dry-run")
    assert "frames 1, 3-4" in chosen.output
    assert "bicubic" not in chosen.output


def test_with_skip_what_needs_it_not_does_every_frame(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("albedo", 1))
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4, "--on-missing", "skip")
    done = rtsr(*line, "--system", "bicubic", "--dry-run")
    assert done.exit_code == 0, done.output
    assert "frames 1-4" in done.output
    assert "left out (" not in done.output
    part = rtsr(*line, "--system", "demod-guided", "--dry-run")
    assert "frames 2-4" in part.output


def test_radiance_is_missed_in_every_command(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    def dark(planes: dict[str, Any], number: int) -> None:
        if number == 2:
            del planes["G"]

    refused = rtsr("upscale", changed(small_capture, dark), tmp_path / "out", "--simulate-lr", 4)
    assert refused.exit_code == 3
    assert "frame 2: buffer 'color' is missing" in refused.output
    assert "render this frame again, or leave it out: --on-missing skip" in refused.output
    line = ("upscale", changed(small_capture, dark), tmp_path / "out", "--simulate-lr", 4)
    skipped = rtsr(*line, "--on-missing", "skip", "--dry-run")
    assert skipped.exit_code == 0, skipped.output
    assert "frames 1, 3-4" in skipped.output
    assert "frame 2 left out (--on-missing skip): buffer 'color' is missing" in skipped.output


def test_where_a_network_runs_the_others_are_named_one_by_one(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    changed(small_shot / "hr", drop("depth", 2)).rename(shot / "hr")
    (shot / "lr").symlink_to(small_shot / "lr")
    planned = rtsr("upscale", shot, tmp_path / "out", "--dry-run").output
    assert "system fusesr-fast" in planned
    assert "networks" not in planned
    assert "gather" in planned


SKIPPING = (
    ("demodulate",),
    ("predict-vrs",),
    ("label", "--kind", "cgts", "--samples-per-pixel", 2),
    ("extrapolate", "--system", "warp-guided"),
    ("extrapolate",),
)


@pytest.mark.parametrize("command", SKIPPING, ids=lambda line: " ".join(map(str, line)))
def test_every_command_leaves_such_a_frame_out(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path, command: tuple[object, ...]
) -> None:
    name, *options = command
    buffer = "depth" if name == "label" else "normal"
    folder = changed(small_capture, drop(buffer, 4))
    line = (name, folder, tmp_path / "out", *options)
    if len(command) > 1:
        refused = rtsr(*line, "--dry-run")
        assert refused.exit_code == 3
        assert f"missing: {buffer} of frame 4" in refused.output
        assert "left out by --on-missing skip" in refused.output
    planned = rtsr(*line, "--on-missing", "skip", "--dry-run")
    assert planned.exit_code == 0, planned.output
    said = f"frame 4 left out (--on-missing skip): buffer '{buffer}' is missing there"
    assert said in planned.output
    held = rtsr(*line, "--on-missing", "hold", "--dry-run")
    assert held.exit_code == 0, held.output
    said = "frame 4 counts as missing (--on-missing hold): "
    assert f"{said}buffer '{buffer}' is missing there" in held.output
    assert "left out (" not in held.output


@pytest.mark.parametrize("size", ["lr", "hr"])
def test_with_hold_the_frame_before_stands_in_as_for_one_without_a_file(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, size: str, load_rgb: Any
) -> None:
    shot, bare = tmp_path / "shot", tmp_path / "bare"
    (other,) = {"lr", "hr"} - {size}
    for folder in (shot, bare):
        folder.mkdir()
        changed(small_shot / size, drop("normal", 3)).rename(folder / size)
        (folder / other).symlink_to(small_shot / other)
        (folder / "capture.toml").write_bytes((small_shot / "capture.toml").read_bytes())
    (bare / size / "frame.0003.exr").unlink()
    for folder in (shot, bare):
        out = tmp_path / f"out_{folder.name}"
        options = ("--system", "demod-guided", "--on-missing", "hold")
        done = rtsr("upscale", folder, out, *options)
        assert done.exit_code == 0, done.output
    for number in range(1, 5):
        name = f"frame.{number:04d}.exr"
        one, two = (load_rgb(tmp_path / f"out_{n}" / name) for n in ("shot", "bare"))
        assert (one == two).all()


def test_a_last_frame_that_is_held_is_not_predicted_and_fails_by_its_own_name(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("normal", 4))
    done = rtsr("extrapolate", folder, tmp_path / "out", "--on-missing", "hold")
    (failed,) = (line for line in done.output.splitlines() if line.startswith("Failed"))
    assert f"{folder}, frame 4: it counts as missing, and frame 3 stands in" in failed
    assert "0003.exr" not in failed


def test_with_hold_a_first_frame_is_left_out(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("normal", 1))
    planned = rtsr("demodulate", folder, tmp_path / "out", "--on-missing", "hold", "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert "frame 1 left out (--on-missing hold, no frame before stands in)" in planned.output


def test_training_leaves_such_a_frame_out(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    folder = changed(small_capture, drop("normal", 4))
    run = ("train", "nsrd", folder, "--set", "training.steps=1", "--set", "training.crop=16")
    refused = rtsr(*run, "--out", tmp_path / "a", "--on-missing", "error")
    assert refused.exit_code == 3
    assert "normal of frame 4" in refused.output
    done = rtsr(*run, "--out", tmp_path / "b", "--on-missing", "skip")
    assert "frame 4 left out (--on-missing skip): buffer 'normal' is missing" in done.output
    assert "frames 1-3" in done.output


def test_pictures_are_judged_and_regions_leave_the_frame_out(
    rtsr: Run, small_capture: Path, changed: Copy
) -> None:
    folder = changed(small_capture, drop("normal", 2))
    line = ("evaluate", small_capture, folder, "--metric", "psnr")
    plain, skipped = rtsr(*line), rtsr(*line, "--on-missing", "skip")
    assert plain.exit_code == skipped.exit_code == 0, skipped.output
    said = "the buffers: frame 2 left out (--on-missing skip): buffer 'normal' is missing there"
    assert said in skipped.output
    assert said not in plain.output
    assert "frames 1-4" in skipped.output
    # neither said of the reference as well, nor with the advice that was taken
    assert skipped.output.count("'normal' is missing") == 1
    assert "so that it is not used in any frame" not in skipped.output
    assert "frame 2 is judged as pictures, not by region" in skipped.output
    assert plain.output.count("'normal' is missing") == 1


def with_passes(planes: dict[str, Any], number: int) -> None:
    """Say the same as sums of passes: Blender's, without metallic and roughness."""
    del number
    metal = planes.pop("metallic")
    planes.pop("roughness")
    for c in "RGB":
        albedo = planes.pop(f"albedo.{c}")
        planes[f"ViewLayer.Diffuse Color.{c}"] = albedo * (1 - metal)
        planes[f"ViewLayer.Glossy Color.{c}"] = 0.04 + albedo * metal
        planes[f"ViewLayer.Combined.{c}"] = planes.pop(c)
    planes["ViewLayer.Depth.Z"] = planes.pop("depth.Z")
    for c in "XYZ":
        planes[f"ViewLayer.Normal.{c}"] = planes.pop(f"normal.{c}")
    for name in [name for name in planes if not name.startswith("ViewLayer.")]:
        del planes[name]


def test_a_pass_that_one_frame_lacks_is_declared_for_none(
    rtsr: Run, small_capture: Path, changed: Copy, tmp_path: Path
) -> None:
    def change(planes: dict[str, Any], number: int) -> None:
        with_passes(planes, number)
        if number == 3:
            for c in "RGB":
                del planes[f"ViewLayer.Glossy Color.{c}"]

    folder = changed(small_capture, change)
    report = rtsr("inspect", folder).output
    (guided,) = (line for line in report.splitlines() if " demod-guided " in line)
    assert "material of frame 3" in guided
    assert "metallic" not in guided
    assert "material = " not in report
    (warning,) = (line for line in report.splitlines() if "is in the other frames" in line)
    assert "frame 3: buffers 'specular' and 'material' are missing" in warning
    assert "render this frame again, or leave it out: --on-missing skip" in warning
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4)
    for options in ((), ("--system", "demod-guided")):
        said = rtsr(*line, *options, "--dry-run").output
        assert "material = " not in said
        assert "material of frame 3" in said
    skipped = rtsr(*line, "--system", "demod-guided", "--on-missing", "skip", "--dry-run")
    assert skipped.exit_code == 0, skipped.output
    assert "frames 1-2, 4" in skipped.output
    refused = rtsr("demodulate", folder, tmp_path / "out")
    assert "missing: material of frame 3" in refused.output
    assert rtsr("demodulate", folder, tmp_path / "o", "--on-missing", "skip").exit_code == 0


def drop_emission(planes: dict[str, Any], number: int) -> None:
    for channel in ("emission.R", "emission.G", "emission.B"):
        del planes[channel]


def shine(planes: dict[str, Any], number: int) -> None:
    for channel in "RGB":
        planes[f"emission.{channel}"] = 0.1 * planes[f"albedo.{channel}"]


@pytest.mark.parametrize("bad", [(1, 2, 3, 4), (2,)])
def test_emission_of_lr_alone_is_taken_off_nothing_and_said(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, bad: tuple[int, ...]
) -> None:
    def drop_some(planes: dict[str, Any], number: int) -> None:
        if number in bad:
            drop_emission(planes, number)

    shots = {}
    for name, lr in (("one", shine), ("both", drop_emission)):
        shot = shots[name] = tmp_path / name
        shot.mkdir()
        changed(small_shot / "hr", drop_some).rename(shot / "hr")
        changed(small_shot / "lr", lr).rename(shot / "lr")
        (shot / "capture.toml").write_bytes((small_shot / "capture.toml").read_bytes())
    made = {}
    for name, shot in shots.items():
        done = rtsr("upscale", shot, tmp_path / f"{name}_out", "--system", "demod-guided")
        assert done.exit_code == 0, done.output
        said = f"LR frames hold emission that HR frames ({shot / 'hr'}) lack"
        assert (said in done.output) == (name == "one")
        first = sorted((tmp_path / f"{name}_out").rglob("*.exr"))[0]
        made[name] = read_channels(first, {"R", "G", "B"})
    assert all(np.array_equal(made["one"][c], made["both"][c]) for c in "RGB")
