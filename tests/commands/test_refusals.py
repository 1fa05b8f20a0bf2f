"""Bad input: one message with folder, frame, buffer and remedy; the right exit code."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow

Run = Callable[..., Result]
Changed = Callable[[Path, Callable[[dict[str, Any], int], None]], Path]
REFUSED, USAGE, FAILED = 3, 2, 1
FOURTH = "frame.0004.exr"


@pytest.fixture
def shot(small_shot: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(small_shot, tmp_path / "shot"))


def rewrite(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    header = read_header(path)
    planes = {name: plane.copy() for name, plane in read_channels(path, header.channels).items()}
    change(planes)
    write_exr(path, planes, attributes=header.attributes)


def refusal(result: Result, code: int = REFUSED) -> str:
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    assert not isinstance(result.exception, Exception) or isinstance(result.exception, SystemExit)
    message = " ".join(result.stderr.split())
    assert result.stderr.count("Error:") == (0 if code == FAILED else 1)
    return message


def test_an_empty_folder(rtsr: Run, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    message = refusal(rtsr("upscale", tmp_path / "empty", tmp_path / "out"))
    assert f"{tmp_path}/empty: no numbered EXR frames here or below" in message


def test_a_folder_that_does_not_exist(rtsr: Run, tmp_path: Path) -> None:
    assert "nosuch: no such folder" in refusal(rtsr("demodulate", tmp_path / "nosuch", tmp_path))


def test_a_file_in_place_of_a_folder(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    message = refusal(rtsr("upscale", shot / "lr" / "frame.0001.exr", tmp_path / "out"))
    assert "name the folder that holds the frames" in message


def test_a_missing_hr_channel_names_folder_buffer_and_remedy(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    for path in (shot / "hr").iterdir():
        rewrite(path, lambda planes: [planes.pop(f"albedo.{c}") for c in "RGB"] and None)
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-bicubic")
    message = refusal(result)
    assert f"{shot}/lr: system 'demod-bicubic' cannot run, missing: hr albedo" in message
    assert "choose another --system" in message
    assert not (tmp_path / "out").exists()


def test_a_channel_that_disappears_names_the_frame(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    rewrite(shot / "hr" / "frame.0003.exr", lambda p: p.pop("roughness") is None or None)
    message = refusal(rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided"))
    assert "Render what these frames lack, or choose another --system" in message
    assert "left out by --on-missing skip" in message
    assert "missing: hr roughness of frame 3" in message


def test_a_frame_of_another_size(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    rewrite(
        shot / "lr" / "frame.0002.exr",
        lambda planes: planes.update({k: v[:-4] for k, v in planes.items()}),
    )
    message = refusal(rtsr("upscale", shot, tmp_path / "out"))
    assert f"{shot}/lr: sizes differ" in message
    assert "frame 1 is 48 x 32" in message
    assert "frame 2 is 48 x 28" in message


def test_hr_that_is_no_multiple_of_lr(
    rtsr: Run, shot: Path, tmp_path: Path, changed: Changed
) -> None:
    hr = changed(shot / "hr", lambda p, _: p.update({k: v[:, :-6] for k, v in p.items()}))
    message = refusal(rtsr("upscale", shot / "lr", tmp_path / "out", "--hr", hr))
    assert "HR is 186 x 128, which is no whole multiple of LR 48 x 32" in message
    assert "render both with one ratio" in message


def test_a_missing_frame_is_listed_before_work_starts(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    (shot / "lr" / "frame.0002.exr").unlink()
    message = refusal(rtsr("upscale", shot, tmp_path / "out"))
    assert f"{shot}/lr: frames are missing: 'frame' lacks 2" in message
    assert "--on-missing" in message
    assert not (tmp_path / "out").exists()


def test_skipping_a_missing_frame_writes_the_others(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    (shot / "lr" / "frame.0002.exr").unlink()
    result = rtsr("upscale", shot, tmp_path / "out", "--on-missing", "skip")
    assert result.exit_code == 0, result.output
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["frame.0001.exr", "frame.0003.exr", "frame.0004.exr"]


def test_holding_a_missing_frame_repeats_the_one_before(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    (shot / "lr" / "frame.0002.exr").unlink()
    choice = ("--on-missing", "hold", "--system", "bicubic")
    assert rtsr("upscale", shot, tmp_path / "out", *choice).exit_code == 0
    held, source = (read_channels(tmp_path / "out" / f"frame.000{n}.exr", "R")["R"] for n in (2, 1))
    np.testing.assert_array_equal(held, source)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"not an image at all"),
        lambda path: path.write_bytes(path.read_bytes()[:64]),
    ],
    ids=["empty", "text", "cut header"],
)
def test_a_file_that_is_no_exr_is_refused_by_name(
    rtsr: Run, shot: Path, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    path = shot / "lr" / "frame.0003.exr"
    spoil(path)
    message = refusal(rtsr("upscale", shot, tmp_path / "out"))
    assert f"{path}: cannot be read as OpenEXR" in message
    assert "render this frame again" in message


def test_damaged_pixels_fail_one_frame_and_the_rest_is_done(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    path = shot / "lr" / "frame.0003.exr"
    path.write_bytes(path.read_bytes()[:-2000])
    message = refusal(rtsr("upscale", shot, tmp_path / "out"), FAILED)
    assert f"Failed: {path}: cannot be read as OpenEXR" in message
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["frame.0001.exr", "frame.0002.exr", "frame.0004.exr"]


def test_nan_fails_its_frame_unless_it_is_repaired(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    def spoil(planes: dict[str, Any]) -> None:
        planes["G"][3, 4] = np.nan

    rewrite(shot / "lr" / "frame.0002.exr", spoil)
    message = refusal(rtsr("upscale", shot, tmp_path / "a"), FAILED)
    assert "frame 2: 1 value of 'color' is NaN or Inf" in message
    for policy in ("zero", "inpaint"):
        out = tmp_path / policy
        assert rtsr("upscale", shot, out, "--on-nonfinite", policy).exit_code == 0
        planes = read_channels(out / "frame.0002.exr", "RGB")
        assert all(np.isfinite(plane).all() for plane in planes.values())
        assert read_header(out / "frame.0002.exr").attributes["rtsr:nonfinite"] == 1


def test_an_output_folder_that_cannot_be_made(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    message = refusal(rtsr("upscale", shot, tmp_path / "file" / "out"))
    assert f"{tmp_path}/file/out: cannot write here" in message
    assert "choose another output folder" in message


def test_outputs_never_replace_their_inputs(rtsr: Run, shot: Path) -> None:
    lr = shot / "lr"
    before = (lr / "frame.0001.exr").read_bytes()
    message = refusal(rtsr("upscale", lr, lr, "--scale", 2, "--overwrite"))
    assert f"{lr}: OUT is IN itself" in message
    assert (lr / "frame.0001.exr").read_bytes() == before


@pytest.mark.parametrize(
    ("option", "value", "hint"),
    [
        ("--system", "demod-bicubik", "did you mean 'demod-bicubic'?"),
        ("--layout", "blendr", "did you mean 'blender'?"),
        ("--frames", "one", "write 1-100"),
        ("--shard", "5/4", "write 1/4 to 4/4"),
    ],
)
def test_a_wrong_value_is_a_usage_error_with_a_hint(
    rtsr: Run, shot: Path, tmp_path: Path, option: str, value: str, hint: str
) -> None:
    assert hint in refusal(rtsr("upscale", shot, tmp_path / "out", option, value), USAGE)


def test_a_layout_that_does_not_fit(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    message = refusal(rtsr("upscale", shot, tmp_path / "out", "--layout", "blender"))
    assert "layout 'blender' matches no channel of these files" in message


def test_every_error_of_a_capture_file_at_once(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    (shot / "capture.toml").write_text(
        'scale = "four"\n[motion]\ndirecton = "x"\nunit = "feet"\n', encoding="utf-8"
    )
    message = refusal(rtsr("upscale", shot, tmp_path / "out"))
    assert f"{shot}/capture.toml" in message
    assert "motion.directon: no such field, did you mean 'direction'?" in message
    assert "motion.unit" in message
    assert "scale" in message


def test_a_device_that_is_not_there(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    message = refusal(rtsr("upscale", shot, tmp_path / "out", "--device", "nosuch"))
    assert "choose --device cpu" in message


def test_lr_and_hr_of_different_crops(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    for path in sorted((shot / "lr").iterdir()):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        moved = PixelWindow(left=5, top=0, width=48, height=32)
        plane = PixelWindow(left=0, top=0, width=60, height=40)
        write_exr(path, planes, data_window=moved, display_window=plane)
    message = refusal(rtsr("upscale", shot, tmp_path / "out"))
    assert "no whole multiple of LR 60 x 40" in message


@pytest.mark.parametrize("command", ["upscale", "demodulate"])
def test_no_file_of_a_shot_is_replaced_even_with_overwrite(
    rtsr: Run, shot: Path, command: str
) -> None:
    before = {p: p.read_bytes() for p in shot.rglob("*.exr")}
    out = shot / "hr" if command == "upscale" else shot
    choice = ("--system", "bicubic") if command == "upscale" else ()
    message = refusal(rtsr(command, shot, out, *choice, "--overwrite"))
    assert "choose another output folder" in message
    assert {p: p.read_bytes() for p in before} == before


def test_a_frame_that_only_hr_lacks_can_be_skipped(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    (shot / "hr" / "frame.0004.exr").unlink()
    assert "--on-missing skip" in refusal(rtsr("upscale", shot, tmp_path / "a"))
    result = rtsr("upscale", shot, tmp_path / "b", "--on-missing", "skip")
    assert result.exit_code == 0, result.output
    assert "3 written" in result.output


def test_outputs_that_would_be_taken_for_inputs_next_time_are_refused(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    lr = shot / "lr"
    message = refusal(rtsr("upscale", lr, lr / "out" / "a", "--scale", 2))
    assert f"{lr}/out/a: lies inside IN, where its frames would be taken for inputs" in message
    assert not (lr / "out").exists()
    tree = tmp_path / "tree"
    shutil.copytree(shot, tree / "a")
    assert "lies inside IN" in refusal(rtsr("upscale", tree, tree / "out"))


def test_outputs_beside_lr_and_hr_are_none_of_their_frames(rtsr: Run, shot: Path) -> None:
    for written in ("4 written, 0 kept", "0 written, 4 kept"):
        result = rtsr("upscale", shot, shot / "out", "--system", "bicubic")
        assert result.exit_code == 0, result.output
        assert written in result.output


def test_outputs_among_hr_frames_of_elsewhere_are_refused(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    hr = shutil.move(shot / "hr", tmp_path / "elsewhere")
    for path in sorted(Path(hr).iterdir()):
        path.rename(path.with_name(path.name.replace("frame", "other")))
    message = refusal(rtsr("upscale", shot / "lr", hr, "--hr", hr))
    assert "holds frames that are read" in message


def test_a_selection_of_nothing_is_said(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    for command in ("upscale", "demodulate"):
        source = shot if command == "upscale" else shot / "lr"
        message = refusal(rtsr(command, source, tmp_path / "out", "--frames", "50-60"))
        assert f"--frames 50-60 selects nothing: {shot}/lr has 1-4" in message
        assert not (tmp_path / "out").exists()


def test_a_shard_of_nothing_is_done(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    """A farm may have more machines than a shot has frames."""
    choice = ("--frames", "1", "--shard", "1/2", "--system", "bicubic")
    result = rtsr("upscale", shot, tmp_path / "out", *choice)
    assert result.exit_code == 0, result.output
    assert "nothing selected" in result.stderr


def test_one_shot_without_selected_frames_is_warned_about_where_another_has_some(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    tree = tmp_path / "tree"
    shutil.copytree(shot / "lr", tree / "a")
    shutil.copytree(shot / "lr", tree / "b")
    (tree / "b" / FOURTH).unlink()
    result = rtsr("upscale", tree, tmp_path / "out", "--scale", 2, "--frames", 4)
    assert result.exit_code == 0, result.output
    assert "b: nothing selected, its frames are 1-3" in result.stderr


def test_a_layout_file_that_is_wrong_is_one_message(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text('[buffers]\ncolour = "RGB"')
    message = refusal(rtsr("upscale", shot, tmp_path / "out", "--layout", path))
    assert f"{path}: buffers.colour: no such buffer, did you mean 'color'?" in message


def test_a_layout_file_that_is_not_there(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    message = refusal(rtsr("upscale", shot, tmp_path / "out", "--layout", tmp_path / "no.toml"))
    assert "no.toml: the layout cannot be read" in message


def test_a_layout_that_does_not_exist_gets_a_suggestion(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    result = rtsr("upscale", shot, tmp_path / "out", "--layout", "extranett")
    assert "did you mean 'extranet'?" in refusal(result, USAGE)


@pytest.mark.parametrize("kind", ["file", "loop", "dangling"])
@pytest.mark.parametrize("command", ["evaluate", "synth", "precompute-lut", "upscale", "train"])
def test_what_stands_where_a_folder_would_be_is_named(
    rtsr: Run, small_capture: Path, tmp_path: Path, command: str, kind: str
) -> None:
    there = tmp_path / "there"
    if kind == "file":
        there.write_text("mine")
    else:
        there.symlink_to("there" if kind == "loop" else "nowhere")
    asked = {
        "evaluate": (
            "evaluate", small_capture, small_capture, "--metric", "psnr",
            "--output", there / "r.json",
        ),
        "synth": ("synth", there / "out", "--size", "32x32", "--frames", 1),
        "precompute-lut": ("precompute-lut", there / "l.exr", "--size", 16),
        "upscale": (
            "upscale", small_capture, there / "out", "--simulate-lr", 2, "--system", "bicubic",
        ),
        "train": ("train", "fusesr-fast", small_capture, "--out", there / "run"),
    }[command]  # fmt: skip
    result = rtsr(*asked)
    assert result.exit_code == 3, result.output
    what = {"file": "is a file", "loop": "leads back to itself", "dangling": "what is not there"}
    assert str(there) in result.stderr
    assert what[kind] in result.stderr
    assert "permission" not in result.stderr


def test_a_name_that_is_too_long_is_refused_before_anything_is_computed(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    for path in small_capture.glob("*.exr"):
        (tmp_path / "in").mkdir(exist_ok=True)
        (tmp_path / "in" / path.name.replace("frame", "n" * 240)).hardlink_to(path)
    choice = ("--estimator", "analytic", "--overlay", "--no-compare")
    result = rtsr("predict-vrs", tmp_path / "in", tmp_path / "out", *choice)
    assert result.exit_code == 3, result.output
    assert "overlay.png: the name of this output is 257 bytes long" in result.stderr
    assert not (tmp_path / "out").exists()
