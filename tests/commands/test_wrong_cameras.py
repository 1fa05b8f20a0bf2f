"""Camera matrices that do not hold: what needs them is refused, the rest runs and says so."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.files.exr import read_header, read_pixels, write_exr

FIRST_FRAMES = (1, 2, 3)
MATRICES = ("worldToCamera", "worldToNDC")


def copy_frames(source: Path, target: Path, *, transpose: bool, drop: tuple[str, ...] = ()) -> None:
    """Copy some frames of a set, with matrices for column vectors, or without buffers."""
    target.mkdir(parents=True)
    for path in sorted(source.glob("*.exr"))[: len(FIRST_FRAMES)]:
        header = read_header(path)
        names = [c for c in header.channels if not c.startswith(drop or ("#",))]
        attributes: dict[str, Any] = {}
        for name in MATRICES:
            matrix = np.asarray(header.attributes[name], np.float32)
            attributes[name] = np.ascontiguousarray(matrix.T if transpose else matrix)
        write_exr(target / path.name, read_pixels(path, names)[0], attributes=attributes)


@pytest.fixture
def make_shot(sample_root: Path, tmp_path: Path) -> Any:
    """A shot of the frames that come with the project."""

    def make(extra: str = "", **options: Any) -> Path:
        shot = tmp_path / "shot"
        for size in ("lr", "hr"):
            copy_frames(sample_root / size, shot / size, **options)
        text = (sample_root / "capture.toml").read_text(encoding="utf-8")
        (shot / "capture.toml").write_text(text + extra, encoding="utf-8")
        return shot

    return make


def inspect_camera(rtsr: Any, shot: Path) -> Mapping[str, Any]:
    facts = json.loads(rtsr("inspect", shot, "--json").stdout)
    shots = facts.get("shots", [facts])
    found: Mapping[str, Any] = shots[0]["camera_check"]
    return found


def test_what_needs_the_camera_is_refused_and_the_rest_runs(
    make_shot: Any, tmp_path: Path, rtsr: Any
) -> None:
    shot = make_shot(transpose=True)
    refused = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    assert refused.exit_code == 3
    assert "transposed" in refused.output
    assert "column-vectors" in refused.output
    divided = rtsr("demodulate", shot, tmp_path / "out", "--dry-run")
    assert divided.exit_code == 3
    assert "transposed" in divided.output
    runs = rtsr("upscale", shot, tmp_path / "out", "--system", "bicubic", "--dry-run")
    assert runs.exit_code == 0
    assert "transposed" in runs.output


def test_the_default_says_that_matrices_are_there_and_not_used(
    make_shot: Any, tmp_path: Path, rtsr: Any
) -> None:
    shot = make_shot(transpose=True)
    planned = rtsr("upscale", shot, tmp_path / "out", "--dry-run").output
    (line,) = [line for line in planned.splitlines() if "buffers found" in line]
    assert "need camera: the matrices that are there are not used, see the warning" in line
    # what is offered to paste is what they look like, not a place for the same matrices again
    pasted = rtsr("inspect", shot).output
    assert 'convention = "column-vectors"  ' in pasted
    assert "camera.csv" not in pasted


def test_a_declared_convention_is_read_and_verified(make_shot: Any, rtsr: Any) -> None:
    shot = make_shot('[camera]\nconvention = "column-vectors"\n', transpose=True)
    found = inspect_camera(rtsr, shot)
    assert found["refused"] is None
    assert found["verified"]


def test_a_camera_that_nothing_can_verify_is_said_to_be_so(make_shot: Any, rtsr: Any) -> None:
    shot = make_shot(transpose=False, drop=("motion", "normal", "depth"))
    found = inspect_camera(rtsr, shot)
    assert not found["verified"]
    assert "unverified" in found["unverified"]


def test_hr_cameras_that_are_not_the_lr_ones_are_named(
    make_shot: Any, tmp_path: Path, rtsr: Any
) -> None:
    shot = make_shot(transpose=False, drop=("motion",))
    commands = (("inspect", shot), ("upscale", shot, tmp_path / "out", "--dry-run"))
    for words in commands:
        assert "are not those of the LR frames" not in " ".join(rtsr(*words).output.split())
    paths = sorted((shot / "hr").glob("*.exr"))
    headers = [read_header(path) for path in paths]
    # each frame gets the camera of the next one; the last keeps its own
    for path, header, following in zip(paths[:-1], headers[:-1], headers[1:], strict=True):
        matrices = {name: following.attributes[name] for name in MATRICES}
        write_exr(path, read_pixels(path, sorted(header.channels))[0], attributes=matrices)
    said = f"of frames {FIRST_FRAMES[0]}-{FIRST_FRAMES[-2]} are not those of the LR frames"
    for words in commands:
        assert said in " ".join(rtsr(*words).output.split())


@pytest.mark.parametrize("word", ["column-vectors", "opencv"])
def test_of_a_declaration_that_spoils_right_matrices_the_remedy_is_to_take_it_out(
    make_shot: Any, rtsr: Any, word: str
) -> None:
    shot = make_shot(f'[camera]\nconvention = "{word}"\n', transpose=False)
    said = inspect_camera(rtsr, shot)["refused"]
    assert f"read as declared: {word}" in said
    assert "take the line [camera] convention out of capture.toml" in said
    assert "write row vectors" not in said


def test_a_side_car_without_a_projection_says_that_it_lacks(make_shot: Any, rtsr: Any) -> None:
    shot = make_shot('[camera]\nfile = "camera.csv"\n', transpose=False)
    lines = ["frame,worldToCamera"]
    for number, path in enumerate(sorted((shot / "hr").glob("*.exr")), start=1):
        view = np.asarray(read_header(path).attributes["worldToCamera"]).ravel()
        lines.append(f"{number},{' '.join(map(str, view))}")
    (shot / "camera.csv").write_text("\n".join(lines), encoding="utf-8")
    said = " ".join(rtsr("inspect", shot).output.split())
    assert "frames 1-3: worldToCamera is there, the projection is not" in said
    assert "no matrices" not in said


def test_hr_cameras_that_fail_are_refused_alike_by_inspect_and_upscale(
    make_shot: Any, tmp_path: Path, rtsr: Any
) -> None:
    """HR motion, which no frame is made of, tells what normals do not; LR's cameras stay."""
    shot = make_shot(transpose=False)
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    for path in sorted((shot / "hr").glob("*.exr")):
        header = read_header(path)
        view, ndc = (np.asarray(header.attributes[n], np.float64) for n in MATRICES)
        wrong = view @ flip, view @ flip @ np.linalg.inv(view) @ ndc
        attributes = dict(zip(MATRICES, (m.astype(np.float32) for m in wrong), strict=True))
        write_exr(path, read_pixels(path, sorted(header.channels))[0], attributes=attributes)
    facts = json.loads(rtsr("inspect", shot, "--json").stdout)
    assert facts["systems"]["demod-guided"]["missing"] == ["hr camera"]
    refused = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    assert refused.exit_code == 3
    assert f"{shot / 'hr'}: system 'demod-guided' needs the camera" in refused.output
    assert "its x axis flipped" in refused.output
    runs = rtsr("upscale", shot, tmp_path / "out", "--system", "taau", "--dry-run")
    assert runs.exit_code == 0
    assert "its x axis flipped" in runs.output


def write_synth(rtsr: Any, folder: Path, frames: int) -> Path:
    """A made shot whose camera moves; depth, motion, normals."""
    made = rtsr("synth", folder, "--size", "96x56", "--frames", f"1-{frames}", "--seed", "3")
    assert made.exit_code == 0, made.output
    return folder


def give_matrices(shot: Path, of: Mapping[int, int], *, transpose: bool = False) -> None:
    """Write matrices of other frames of a shot into some of its frames, or for column vectors."""
    paths = sorted(shot.glob("*.exr"))
    headers = [read_header(path) for path in paths]
    for frame, other in of.items():
        found = {n: np.asarray(headers[other - 1].attributes[n], np.float32) for n in MATRICES}
        attributes = {n: np.ascontiguousarray(m.T if transpose else m) for n, m in found.items()}
        path, names = paths[frame - 1], sorted(headers[frame - 1].channels)
        write_exr(path, read_pixels(path, names)[0], attributes=attributes)


def test_evaluate_names_matrices_of_the_buffers_that_are_not_used(
    rtsr: Any, tmp_path: Path
) -> None:
    shot = write_synth(rtsr, tmp_path / "shot", 3)
    words = ("evaluate", shot, "--ref", write_synth(rtsr, tmp_path / "ref", 3), "--metric", "psnr")
    assert "are not used" not in rtsr(*words).output
    give_matrices(tmp_path / "ref", {n: n for n in FIRST_FRAMES}, transpose=True)
    for more in ((), ("--dry-run",)):
        said = " ".join(rtsr(*words, *more).output.split())
        assert "the buffers: the camera matrices of all frames looked at (1-3) are not used" in said
        assert "transposed" in said


def test_evaluate_says_once_what_is_wrong_with_the_buffers(rtsr: Any, tmp_path: Path) -> None:
    """Before figures, or behind them where nothing was said before; of all tests together."""
    truth, buffers = (write_synth(rtsr, tmp_path / name, 3) for name in ("ref", "buffers"))
    give_matrices(buffers, {n: n for n in FIRST_FRAMES}, transpose=True)
    tests = [write_synth(rtsr, tmp_path / name, 3) for name in ("a", "b")]
    words = ("evaluate", *tests, "--ref", truth, "--gbuffer", buffers, "--metric", "psnr")
    for more, whose in (((), ""), (("-q",), "Note: a, b: ")):
        said = rtsr(*words, *more).output
        assert said.count("are not used") == 1
        assert f"{whose}the buffers: the camera matrices" in said


def test_evaluate_names_one_camera_in_all_frames(rtsr: Any, tmp_path: Path) -> None:
    shot = write_synth(rtsr, tmp_path / "shot", 3)
    give_matrices(shot, dict.fromkeys(FIRST_FRAMES, 1))
    said = " ".join(rtsr("evaluate", shot, "--ref", shot, "--dry-run").output.split())
    assert "one frame's matrices in every frame?" in said


def test_train_says_what_is_unverified_each_time(rtsr: Any, tmp_path: Path) -> None:
    shot = write_synth(rtsr, tmp_path / "shot", 3)
    give_matrices(shot, dict.fromkeys(FIRST_FRAMES, 1))
    words = ("train", "nsrd", shot, "--pack-crops", "1", "--cache", tmp_path / "cache")
    for pack in ("first", "second"):
        said = " ".join(rtsr(*words, "--pack", tmp_path / pack).output.split())
        assert "the camera matrices are unverified" in said
        assert "one frame's matrices in every frame?" in said


def test_facts_of_single_frames_are_those_of_the_text(rtsr: Any, tmp_path: Path) -> None:
    shot = write_synth(rtsr, tmp_path / "shot", 12)
    give_matrices(shot, {10: 2})
    found = inspect_camera(rtsr, shot)
    assert "the camera of frame 10 lies off the path" in found["unverified"]
    assert found["refused"] is None
    give_matrices(shot, {12: 12}, transpose=True)
    assert "of frame 12, worldToCamera has a last column" in inspect_camera(rtsr, shot)["refused"]


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("to_world", "column-vectors, mitsuba"),
        ("worldToCamera", "column-vectors, camera-to-world, mitsuba"),
        ("view", "mitsuba"),
    ],
)
def test_mitsuba_matrices_beside_a_field_of_view_are_recognised(
    rtsr: Any, tmp_path: Path, column: str, words: str
) -> None:
    """`to_world` looks along +z with x left; clip space follows from the field of view."""
    shot = write_synth(rtsr, tmp_path / "shot", 3)
    text = '[camera]\nfile = "camera.csv"\n'
    (shot / "capture.toml").write_text(text, encoding="utf-8")
    lines = [f"frame,{column},fov_x,near"]
    for number, path in enumerate(sorted(shot.glob("*.exr")), start=1):
        view, ndc = (np.asarray(read_header(path).attributes[name], float) for name in MATRICES)
        lens = np.linalg.inv(view) @ ndc
        turned = view @ np.diag([-1.0, 1.0, -1.0, 1.0])
        stored = turned if column == "view" else np.linalg.inv(turned).T
        angle = np.degrees(2.0 * np.arctan(1.0 / lens[0, 0]))
        lines.append(f"{number},{' '.join(map(str, stored.ravel()))},{angle},0.1")
    (shot / "camera.csv").write_text("\n".join(lines), encoding="utf-8")
    assert f'[camera] convention = "{words}"' in inspect_camera(rtsr, shot)["refused"]
    (shot / "capture.toml").write_text(f'{text}convention = "{words}"\n', encoding="utf-8")
    checked = inspect_camera(rtsr, shot)
    assert not checked["refused"]
    assert checked["verified"]
