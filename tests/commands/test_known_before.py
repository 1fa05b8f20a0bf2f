"""What a frame can fail for without a pixel being read is said before the run, by its frame."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Planes = dict[str, Any]
Change = Callable[[Planes, dict[str, Any], int], None]

MATRICES = ("worldToCamera", "worldToNDC")
BAD = 3
"""The frame that is not like the others."""

DECLARED = """layout = "rtsr"
[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
"""


@pytest.fixture
def frames(small_capture: Path, tmp_path: Path) -> Callable[..., Path]:
    """Four frames of a capture, changed one by one, with a capture.toml."""

    def make(change: Change, declared: str = "") -> Path:
        folder = tmp_path / "shot"
        for number, path in enumerate(sorted(small_capture.glob("*.exr")), 1):
            header = read_header(path)
            planes = dict(read_channels(path, header.channels))
            attributes = dict(header.attributes)
            change(planes, attributes, number)
            write_exr(folder / path.name, planes, attributes=attributes)
        (folder / "capture.toml").write_text(DECLARED + declared)
        return folder

    return make


def no_camera(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    for name in MATRICES:
        del attributes[name]


def no_camera_once(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    if number == BAD:
        no_camera(planes, attributes, number)


def singular_once(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    if number == BAD:
        attributes[MATRICES[0]] = np.zeros((4, 4), np.float32)


def no_roughness_once(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    if number == BAD:
        del planes["roughness"]


def smaller_once(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    if number == BAD:
        for name, plane in planes.items():
            planes[name] = plane[::2, ::2].copy()


def spare_but_once(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    if number != BAD:
        planes["spare"] = planes["roughness"]


def cut(folder: Path) -> None:
    path = sorted(folder.glob("*.exr"))[BAD - 1]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


SYSTEM = ("--system", "demod-guided")
TAAU = ("--system", "taau")

REASONS = [
    pytest.param(
        no_camera,
        '[depth]\nkind = "ray"',
        TAAU,
        "camera (to convert depth from ray distance)",
        id="ray",
    ),
    pytest.param(
        no_camera_once,
        '[depth]\nkind = "ray"',
        TAAU,
        f"camera of frame {BAD} (to convert depth from ray distance)",
        id="ray, one frame",
    ),
    pytest.param(
        no_camera_once,
        '[depth]\nkind = "device"',
        TAAU,
        f"camera of frame {BAD} (to convert depth from device depth)",
        id="device, one frame",
    ),
    pytest.param(
        no_camera_once,
        '[normal]\nspace = "view"',
        SYSTEM,
        f"camera of frame {BAD} (to convert normal from view-space normals)",
        id="view normals",
    ),
    pytest.param(no_camera_once, "", SYSTEM, f"camera of frame {BAD}", id="view cosine"),
    pytest.param(singular_once, "", SYSTEM, f"camera (frame {BAD}: worldToCamera", id="singular"),
    pytest.param(no_roughness_once, "", SYSTEM, f"missing: roughness of frame {BAD}", id="channel"),
    pytest.param(smaller_once, "", TAAU, f"frame {BAD} is 96 x 64", id="size"),
    pytest.param(
        spare_but_once,
        "",
        (*TAAU, "--passthrough", "spare"),
        f"frame {BAD}: channels",
        id="pass",
    ),
]


@pytest.mark.parametrize(("change", "declared", "options", "text"), REASONS)
def test_a_dry_run_says_what_the_run_would_and_names_the_frame(
    rtsr: Run,
    frames: Callable[..., Path],
    tmp_path: Path,
    change: Change,
    declared: str,
    options: tuple[str, ...],
    text: str,
) -> None:
    folder = frames(change, declared)
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4, *options)
    planned = rtsr(*line, "--dry-run")
    assert planned.exit_code == 3, planned.output
    assert text in planned.output
    assert rtsr(*line).exit_code == 3
    assert not (tmp_path / "out").exists()


def test_a_cut_file_is_known_before(rtsr: Run, frames: Callable[..., Path], tmp_path: Path) -> None:
    folder = frames(lambda *_: None)
    cut(folder)
    planned = rtsr("upscale", folder, tmp_path / "out", "--simulate-lr", 4, "--dry-run")
    assert planned.exit_code == 3
    assert "0003.exr" in planned.output
    assert "ends too early" in planned.output


@pytest.mark.parametrize(
    ("declared", "system", "missing"),
    [
        (
            '[depth]\nkind = "ray"',
            "taau",
            f"camera of frame {BAD} (to convert depth from ray distance)",
        ),
        ("", "demod-guided", f"camera of frame {BAD}"),
    ],
)
def test_inspect_names_the_frame_and_what_can_do_without_runs(
    rtsr: Run,
    frames: Callable[..., Path],
    tmp_path: Path,
    declared: str,
    system: str,
    missing: str,
) -> None:
    folder = frames(no_camera_once, declared)
    report = rtsr("inspect", folder)
    line = next(line for line in report.output.splitlines() if f" {system} " in line)
    assert missing in line
    assert report.exit_code == 0, "bicubic runs on these frames"
    done = rtsr("upscale", folder, tmp_path / "out", "--simulate-lr", 4, "--system", "bicubic")
    assert done.exit_code == 0, done.output
    assert ("depth is not read: it is ray distance" in done.output) == bool(declared)


def test_demodulate_and_predict_vrs_know_it_before(
    rtsr: Run, frames: Callable[..., Path], tmp_path: Path
) -> None:
    folder = frames(no_camera_once, '[normal]\nspace = "view"')
    for command in (("demodulate",), ("predict-vrs", "--estimator", "analytic")):
        planned = rtsr(command[0], folder, tmp_path / "out", *command[1:], "--dry-run")
        assert planned.exit_code == 3, planned.output
        assert f"camera of frame {BAD}" in planned.output


def test_frames_outside_of_the_selection_need_nothing(
    rtsr: Run, frames: Callable[..., Path], tmp_path: Path
) -> None:
    folder = frames(lambda *_: None)
    (sorted(folder.glob("*.exr"))[BAD - 1]).unlink()
    line = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4, *TAAU, "--dry-run")
    assert rtsr(*line).exit_code == 3
    assert rtsr(*line, "--frames", "1-4").exit_code == 3
    for outside in ("1-2", "4", "1"):
        assert rtsr(*line, "--frames", outside).exit_code == 0


def test_hr_frames_outside_of_the_selection_need_not_be_there(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    for folder in ("lr", "hr"):
        (shot / folder).mkdir(parents=True)
        for path in sorted((small_shot / folder).glob("*.exr")):
            (shot / folder / path.name).write_bytes(path.read_bytes())
    (shot / "capture.toml").write_bytes((small_shot / "capture.toml").read_bytes())
    sorted((shot / "hr").glob("*.exr"))[-1].unlink()
    line = ("upscale", shot, tmp_path / "out", "--system", "bicubic", "--dry-run")
    assert rtsr(*line).exit_code == 3
    assert rtsr(*line, "--frames", "2").exit_code == 0


def test_a_frame_without_the_others_matrices_is_named_where_none_are_needed(
    rtsr: Run, frames: Callable[..., Path], tmp_path: Path
) -> None:
    line = ("upscale", frames(no_camera_once), tmp_path / "out", "--simulate-lr", 4, *TAAU)
    planned = rtsr(*line, "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert f"frame {BAD} without the camera matrices that the other frames have" in planned.output
    assert "write them into the headers, or" in planned.output


NO_CAMERA = {
    "zero": [0.0] * 16,
    "singular": [1.0] * 16,
    "NaN": [math.nan] * 16,
    "huge": [1e38] * 16,
}


@pytest.mark.parametrize("side_car", [False, True])
@pytest.mark.parametrize("cells", NO_CAMERA.values(), ids=NO_CAMERA)
def test_matrices_that_are_none_stop_only_what_needs_a_camera(
    rtsr: Run, frames: Callable[..., Path], tmp_path: Path, cells: list[float], side_car: bool
) -> None:
    true: dict[int, list[float]] = {}

    def spoil(planes: Planes, attributes: dict[str, Any], number: int) -> None:
        true[number] = attributes[MATRICES[0]].ravel().tolist()
        if number == BAD and not side_car:
            attributes[MATRICES[0]] = np.array(cells, np.float32).reshape(4, 4)
        if side_car:
            no_camera(planes, attributes, number)

    folder = frames(spoil)
    if side_car:
        row = {"fov_x": 60.0, "near": 0.1}
        rows = [{"frame": n, MATRICES[0]: cells if n == BAD else true[n], **row} for n in true]
        (folder / "camera.json").write_text(json.dumps(rows))
        (folder / "capture.toml").write_text(f'camera = "camera.json"\n{DECLARED}')
    for system in ("bicubic", "taau"):
        line = ("upscale", folder, tmp_path / system, "--simulate-lr", 4, "--system", system)
        done = rtsr(*line)
        assert done.exit_code == 0, done.output
        assert done.output.count(f"frame {BAD}: ") == 1
        assert MATRICES[0] in done.output
    refused = rtsr("upscale", folder, tmp_path / "out", "--simulate-lr", 4, *SYSTEM)
    assert refused.exit_code == 3
    assert f"camera (frame {BAD}: " in refused.output


def mistake_cameras(planes: Planes, attributes: dict[str, Any], number: int) -> None:
    for name in MATRICES:
        attributes[name] = np.ascontiguousarray(np.asarray(attributes[name]).T)
    no_camera_once(planes, attributes, number)


def test_matrices_are_checked_though_one_frame_has_none(
    rtsr: Run, frames: Callable[..., Path], tmp_path: Path
) -> None:
    line = ("upscale", frames(mistake_cameras), tmp_path / "out", "--simulate-lr", 4, *TAAU)
    planned = rtsr(*line, "--dry-run")
    assert planned.exit_code == 0, planned.output
    assert "are not used: worldToCamera looks transposed" in planned.output
