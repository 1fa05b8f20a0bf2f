from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch

from rtsr_cli.core.captures.cameras import read_side_car
from rtsr_cli.core.captures.capture_file import CaptureDeclaration, read_capture
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.conventions import (
    ColorSpace,
    Conventions,
    DepthConvention,
    DepthKind,
    NormalConvention,
    NormalSpace,
    RoughnessKind,
    SpecularWorkflow,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis

COMPLETE = """
layout = "blender"
roughness = "alpha"
specular = "f0"
colorspace = "acescg"
jitter_px = [0.25, -0.5]
scale = 4
frame_step = 10
camera_cuts = [20, 50]
camera = "camera.csv"

[motion]
unit = "uv"
direction = "current-minus-previous"
y_axis = "up"
jittered = true
scale = 0.5

[depth]
kind = "device"
reversed = true
unit = "cm"
sky = 1e10

[normal]
space = "view"
packed = true
"""


def capture(tmp_path: Path, text: str) -> CaptureDeclaration:
    path = tmp_path / "capture.toml"
    path.write_text(text, encoding="utf-8")
    return read_capture(path)


def refusal(tmp_path: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        capture(tmp_path, text)
    return str(caught.value)


def test_every_field_is_parsed(tmp_path: Path) -> None:
    found = capture(tmp_path, COMPLETE)
    assert found.layout == "blender"
    assert found.jitter(7) == (0.25, -0.5)
    assert (found.scale, found.frame_step) == (4, 10)
    assert found.camera_cuts == {20, 50}
    assert found.camera.file == "camera.csv"
    assert found.conventions(Conventions()) == Conventions(
        motion=MotionConvention(
            unit=MotionUnit.UV,
            direction=MotionDirection.CURRENT_MINUS_PREVIOUS,
            y_axis=YAxis.UP,
            jittered=True,
            scale=0.5,
        ),
        depth=DepthConvention(kind=DepthKind.DEVICE, reversed=True, unit_m=0.01, sky=1e10),
        normal=NormalConvention(space=NormalSpace.VIEW, packed=True),
        roughness=RoughnessKind.ALPHA,
        specular=SpecularWorkflow.F0,
        colorspace=ColorSpace.AP1,
    )


def test_an_empty_file_declares_nothing(tmp_path: Path) -> None:
    preset = Conventions(motion=MotionConvention(y_axis=YAxis.UP), roughness=RoughnessKind.ALPHA)
    found = capture(tmp_path, "")
    assert found.conventions(preset) == preset
    assert found.jitter(1) is None
    assert found.frame_step == 1


def test_a_declared_field_replaces_the_layouts_and_leaves_its_neighbours(tmp_path: Path) -> None:
    preset = Conventions(motion=MotionConvention(y_axis=YAxis.UP, unit=MotionUnit.NDC))
    found = capture(tmp_path, '[motion]\ny_axis = "down"').conventions(preset)
    assert found.motion == MotionConvention(y_axis=YAxis.DOWN, unit=MotionUnit.NDC)


def test_declaring_false_is_not_the_same_as_declaring_nothing(tmp_path: Path) -> None:
    preset = Conventions(motion=MotionConvention(jittered=True))
    assert not capture(tmp_path, "[motion]\njittered = false").conventions(preset).motion.jittered


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ('"m"', 1.0),
        ('"cm"', 0.01),
        ('"mm"', 0.001),
        ('"ft"', 0.3048),
        ('"in"', 0.0254),
        ("2.5", 2.5),
    ],
)
def test_units_of_depth_are_names_or_metres(tmp_path: Path, unit: str, metres: float) -> None:
    found = capture(tmp_path, f"[depth]\nunit = {unit}").conventions(Conventions())
    assert found.depth.unit_m == pytest.approx(metres)


def test_jitter_can_be_listed_by_frame(tmp_path: Path) -> None:
    found = capture(tmp_path, "[jitter_px]\n1 = [0.25, 0.0]\n-2 = [0.0, -0.25]")
    assert found.jitter(1) == (0.25, 0.0)
    assert found.jitter(-2) == (0.0, -0.25)
    assert found.jitter(3) is None


def test_a_halton_pattern_begins_at_its_first_frame_and_repeats(tmp_path: Path) -> None:
    text = 'jitter_px = {pattern = "halton", period = 4, first_frame = 10, scale = 0.5}'
    found = capture(tmp_path, text)
    # half of (1/2, 1/3) - 1/2, then of (1/4, 2/3) - 1/2
    assert found.jitter(10) == pytest.approx((0.0, -1 / 12))
    assert found.jitter(11) == pytest.approx((-0.125, 1 / 12))
    assert found.jitter(14) == found.jitter(10)
    assert found.jitter(9) == found.jitter(13)


def test_all_errors_are_listed_at_once_with_the_file_and_their_place(tmp_path: Path) -> None:
    text = """
frame_step = 0
scale = "four"
[motion]
unit = "furlongs"
jittered = "perhaps"
[depth]
kind = 7
"""
    message = refusal(tmp_path, text)
    assert message.startswith(str(tmp_path / "capture.toml"))
    for place in ("frame_step", "scale", "motion.unit", "motion.jittered", "depth.kind"):
        assert f"{place}: " in message
    assert "'furlongs'" in message


@pytest.mark.parametrize(
    ("text", "place", "meant"),
    [
        ('layuot = "rtsr"', "layuot", "layout"),
        ('[motion]\ndirecton = "x"', "motion.directon", "direction"),
        ('[motion]\ny-axis = "up"', "motion.y-axis", "y_axis"),
        ('[depth]\nunits = "m"', "depth.units", "unit"),
        ("[norml]\npacked = true", "norml", "normal"),
    ],
)
def test_an_unknown_key_gets_a_suggestion(
    tmp_path: Path, text: str, place: str, meant: str
) -> None:
    assert f"{place}: no such field, did you mean '{meant}'?" in refusal(tmp_path, text)


def test_a_key_unlike_any_gets_the_list(tmp_path: Path) -> None:
    message = refusal(tmp_path, "[normal]\nqqqq = 1")
    assert "normal.qqqq: no such field (there are: space, packed, sky)" in message


@pytest.mark.parametrize("text", ["layout = ", "[motion", 'layout = "a"\nlayout = "b"'])
def test_a_file_that_is_no_toml_is_named(tmp_path: Path, text: str) -> None:
    assert "capture.toml: is not valid TOML" in refusal(tmp_path, text)


def test_a_file_in_another_encoding_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "capture.toml"
    path.write_bytes('layout = "gr\xfcn"'.encode("latin-1"))
    with pytest.raises(ConfigError, match=r"capture\.toml: is not valid TOML"):
        read_capture(path)


def test_a_capture_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        read_capture(tmp_path / "none.toml")


@pytest.mark.parametrize("text", ["[motion]\nscale = nan", "scale = 0", "jitter_px = [1.0]"])
def test_values_out_of_range_are_refused(tmp_path: Path, text: str) -> None:
    assert str(tmp_path) in refusal(tmp_path, text)


MATRIX = [100.0, 1.0, 2.0, 3.0, 4.0, 50.0, *(float(i) for i in range(6, 16))]
CELL = " ".join(str(number) for number in MATRIX)


def test_a_csv_of_cameras_has_a_row_a_frame(tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_text(
        "frame, worldToCamera, worldToNDC, jitter_px, pre_exposure, cut\n"
        f"1, {CELL}, {CELL.replace(' ', ';')}, 0.25 -0.5, 2.0, true\n"
        f"2, {CELL}, {CELL}, , ,\n",
        encoding="utf-8",
    )
    first, second = (read_side_car(path).rows[n].metadata() for n in (1, 2))
    assert first.world_to_camera is not None
    assert first.world_to_camera.flatten().tolist() == MATRIX
    assert first.world_to_camera[3].tolist() == [12.0, 13.0, 14.0, 15.0]
    assert first.world_to_ndc is not None
    assert first.world_to_ndc.flatten().tolist() == MATRIX
    assert first.jitter_px == (0.25, -0.5)
    assert first.pre_exposure == 2.0
    assert first.cut
    assert (second.jitter_px, second.pre_exposure, second.cut) == ((0.0, 0.0), 1.0, False)


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_json_of_cameras_may_nest_its_matrices_and_its_list(
    tmp_path: Path, wrapped: bool
) -> None:
    nested = [MATRIX[i : i + 4] for i in range(0, 16, 4)]
    rows = [{"frame": -3, "worldToCamera": nested, "cut": True}, {"frame": 4}]
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({"frames": rows} if wrapped else rows), encoding="utf-8")
    cameras = read_side_car(path).rows
    assert set(cameras) == {-3, 4}
    assert cameras[-3].world_to_camera == MATRIX
    assert cameras[-3].cut
    assert cameras[4].world_to_camera is None


def test_wrong_camera_rows_are_all_listed(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    rows = [{"frame": 1, "worldToCamera": [1.0, 2.0]}, {"jitter_px": [0, 0]}, {"frame": "x"}]
    path.write_text(json.dumps(rows), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        read_side_car(path)
    message = str(caught.value)
    for place in (str(path), "0.worldToCamera", "1.frame", "2.frame"):
        assert place in message


@pytest.mark.parametrize(
    ("name", "text"), [("camera.json", "{"), ("camera.json", "3"), ("camera.csv", "a,b\n1,2\n")]
)
def test_a_side_car_that_makes_no_sense_is_refused_by_name(
    tmp_path: Path, name: str, text: str
) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=name):
        read_side_car(path)


def test_a_side_car_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.csv: the camera side-car cannot be read"):
        read_side_car(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera.csv", "frame,worldToCamra,jitterpx\n1,2,3\n"),
        ("camera.json", '[{"frame": 1, "worldToCamra": [], "jitterpx": [0, 0]}]'),
    ],
)
def test_unknown_columns_of_a_camera_side_car_are_refused_with_a_suggestion(
    tmp_path: Path, name: str, text: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_side_car(path)
    message = str(caught.value)
    assert "no column is called 'worldToCamra', did you mean 'worldToCamera'?" in message
    assert "no column is called 'jitterpx', did you mean 'jitter_px'?" in message


def test_a_shorthand_is_a_name_where_one_channel_is_meant(tmp_path: Path) -> None:
    path = tmp_path / "capture.toml"
    path.write_text('[buffers]\nroughness = "rg"\nmotion = "mv.rg"\n', encoding="utf-8")
    found = {b.value: [str(c) for c in specs] for b, specs in read_capture(path).buffers.items()}
    assert found == {"roughness": ["rg"], "motion": ["mv.r", "mv.g"]}


def test_a_byte_order_mark_of_an_editor_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "capture.toml"
    path.write_bytes(b"\xef\xbb\xbfscale = 4\r\n")
    assert read_capture(path).scale == 4


def read_rows(tmp_path: Path, name: str, text: str) -> dict[int, CameraMetadata]:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return {n: row.metadata((9, 16)) for n, row in read_side_car(path).rows.items()}


VIEW = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -2, 3, -5, 1]
INVERSE = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, -3, 5, 1]


@pytest.mark.parametrize("name", ["worldToCamera", "world_to_camera", "view", "viewMatrix"])
def test_world_to_camera_has_several_spellings(tmp_path: Path, name: str) -> None:
    text = json.dumps([{"frame": 1, name: VIEW}])
    found = read_rows(tmp_path, "camera.json", text)[1].world_to_camera
    assert found is not None
    assert found.flatten().tolist() == VIEW


@pytest.mark.parametrize("name", ["cameraToWorld", "camera_to_world"])
def test_camera_to_world_is_inverted(tmp_path: Path, name: str) -> None:
    text = json.dumps({"7": {name: INVERSE, "viewProjection": MATRIX}})
    camera = read_rows(tmp_path, "camera.json", text)[7]
    assert camera.world_to_camera is not None
    assert camera.world_to_camera.flatten().tolist() == pytest.approx(VIEW, abs=1e-12)
    assert camera.world_to_ndc is not None
    assert camera.world_to_ndc.flatten().tolist() == MATRIX


@pytest.mark.parametrize("cells", [range(16), [f"{i}{j}" for i in range(4) for j in range(4)]])
def test_a_matrix_may_have_sixteen_columns(tmp_path: Path, cells: Sequence[object]) -> None:
    head = ",".join(["frame", *(f"worldToCamera_{cell}" for cell in cells)])
    text = f"{head}\n1,{','.join(map(str, VIEW))}\n"
    found = read_rows(tmp_path, "camera.csv", text)[1].world_to_camera
    assert found is not None
    assert found.flatten().tolist() == VIEW


@pytest.mark.parametrize("angle", [{"fov_x": 90.0}, {"fov_x": 90.0, "verticalFov": 58.7155}])
def test_fields_of_view_make_a_projection(tmp_path: Path, angle: dict[str, float]) -> None:
    row = {"frame": 1, "view": VIEW, "near": 0.5, "far": 100.0, **angle}
    projection = read_rows(tmp_path, "camera.json", json.dumps([row]))[1].projection
    assert projection is not None
    # 90 degrees wide: the edge lies as far aside as ahead; 16 to 9
    assert projection[0, 0].item() == pytest.approx(1.0)
    assert projection[1, 1].item() == pytest.approx(16 / 9, rel=1e-5)
    near, far = (torch.tensor([0.0, 0.0, -d, 1.0]).double() @ projection for d in (0.5, 100.0))
    assert (near[2] / near[3]).item() == pytest.approx(0.0)
    assert (far[2] / far[3]).item() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ({"worldToCamera": VIEW[:12]}, "frame 5: holds 12 numbers; a matrix is 16"),
        ({"view": [*VIEW[:6], "none", *VIEW[7:]]}, "cell 7 (row 2, column 3) is no number"),
        ({"view": VIEW, "worldToCamera": VIEW}, "'view' and 'worldToCamera' are the same column"),
        ({"worldToCamera": VIEW, "cameraToWorld": VIEW}, "not both"),
        ({"view": VIEW, "fov_x": 60.0}, "need the column 'near'"),
    ],
)
def test_a_wrong_matrix_is_one_message_with_file_frame_and_cell(
    tmp_path: Path, row: dict[str, object], said: str
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps([{"frame": 5, **row}]), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        read_side_car(path)
    assert str(path) in str(caught.value)
    assert said in str(caught.value)


def test_the_convention_of_matrices_is_declared_beside_the_side_car(tmp_path: Path) -> None:
    found = capture(
        tmp_path, '[camera]\nfile = "camera.csv"\nconvention = ["column-vectors", "opencv"]'
    )
    assert found.camera.file == "camera.csv"
    assert str(found.camera.matrices) == "column-vectors, opencv"
    text = '[camera]\nconvention = "column-vectors, row-vectors"'
    assert "exclude each other" in refusal(tmp_path, text)
    assert "did you mean 'mitsuba'" in refusal(tmp_path, '[camera]\nconvention = "mitsubi"')
