"""Presets on files made by hand: names and values as the layouts' specifications have them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.channel_matching import bind_layout, match_layout
from rtsr_cli.core.captures.layout_detection import detect_layout
from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derived_geometry import derive_sky
from rtsr_cli.core.pairs.opening import (
    ReadOptions,
    find_shots_of,
    measure_set,
    open_pairs,
    open_shot,
)

HEIGHT, WIDTH = 2, 4
VERIFIED = (
    *("rtsr", "blender", "extranet", "nss", "nsrd"),
    *("mitsuba", "falcor", "unreal-mrq"),
)


def planes(dtype: Any = np.float32, **values: float) -> dict[str, Any]:
    return {name: np.full((HEIGHT, WIDTH), value, dtype) for name, value in values.items()}


def grey(value: float) -> dict[str, Any]:
    """A single value as UE dumps have it: repeated in R, G and B."""
    return planes(np.float16, R=value, G=value, B=value, A=1.0)


def rgb(r: float, g: float, b: float, dtype: Any = np.float16) -> dict[str, Any]:
    return planes(dtype, R=r, G=g, B=b, A=1.0)


def reader_of(root: Path, *, hr: bool = False, layout: str | None = None) -> FrameReader:
    return settle(root, hr=hr, layout=layout).reader


def settle(root: Path, *, hr: bool = False, layout: str | None = None) -> MeasuredReader:
    options = ReadOptions(layout=layout)
    (shot,) = find_shots_of(root, options)
    frames = shot.hr if hr else shot.frames
    assert frames is not None
    return measure_set(frames, open_shot(shot, root, options), jittered=not hr)


def values(frame: Frame, buffer: Buffer) -> list[float]:
    return [round(float(v), 4) for v in frame.gbuffer[buffer][0, :, 0, 0]]


EXTRANET: Mapping[str, dict[str, Any]] = {
    "PreTonemapHDRColor": rgb(2.0, 1.0, 0.5),
    "BaseColor": rgb(0.25, 0.5, 0.75),
    "WorldNormal": rgb(0.0, 0.0, -1.0),
    "SceneDepth": grey(0.0625),
    "Roughness": grey(0.5),
    "Metallic": grey(1.0),
    # previous position of (row i, column j) is (i + 3, j - 2)
    "MotionVector": rgb(2.0, 3.0, 0.0, np.float32),
    "WorldPosition": rgb(100.0, -250.0, 50.0, np.float32),
    "NoV": grey(0.75),
    "MyStencil": grey(7.0),
}


@pytest.mark.parametrize("scene", ["Bunker", "MedievalDocks", ""])
@pytest.mark.parametrize("folders", [False, True])
def test_extranet_dumps_are_read_to_the_letter(tmp_path: Path, scene: str, folders: bool) -> None:
    for buffer, channels in EXTRANET.items():
        for number in (1, 2):
            base = f"{scene}." if scene else ""
            name = f"{buffer}/{base}" if folders else f"{scene}{buffer}."
            write_exr(tmp_path / f"{name}{number:04d}.exr", channels)
    reader = reader_of(tmp_path)
    assert reader.layout.name == "extranet"
    assert len(reader.stored) == len(EXTRANET)
    frame = reader.read(2, reader.stored)
    assert values(frame, Buffer.COLOR) == [2.0, 1.0, 0.5]
    assert values(frame, Buffer.ALBEDO) == [0.25, 0.5, 0.75]
    assert values(frame, Buffer.NORMAL) == [0.0, 0.0, -1.0]
    assert values(frame, Buffer.DEPTH) == [6.25]  # 1.0 is 100 m
    assert values(frame, Buffer.ROUGHNESS) == [0.5]
    assert values(frame, Buffer.METALLIC) == [1.0]
    assert values(frame, Buffer.MOTION) == [-2.0, 3.0]  # to column j - 2, row i + 3
    assert values(frame, Buffer.POSITION) == [1.0, -2.5, 0.5]  # centimetres
    assert values(frame, Buffer.NOV) == [0.75]
    assert frame.gbuffer[Buffer.OBJECT_ID].unique().tolist() == [7]


def test_extranets_sky_is_known_by_its_normal(tmp_path: Path) -> None:
    normal = rgb(0.0, 1.0, 0.0)
    for channel in "RGB":
        normal[channel][:, 1] = -1.0
    write_exr(tmp_path / "FWorldNormal.0001.exr", normal)
    write_exr(tmp_path / "FSceneDepth.0001.exr", grey(0.5))
    reader = reader_of(tmp_path)
    frame = reader.read(1, reader.stored)
    assert frame.gbuffer[Buffer.NORMAL][0, :, 0, 1].tolist() == [0.0, 0.0, 0.0]
    assert derive_sky(frame.gbuffer)[0, 0].tolist() == [[0.0, 1.0, 0.0, 0.0]] * HEIGHT
    # whoever reads depth alone knows it too, and depends on both files
    alone = reader.read(1, (Buffer.DEPTH,))
    assert set(alone.gbuffer) == {Buffer.DEPTH}
    assert alone.gbuffer[Buffer.DEPTH][0, 0, 0].tolist() == [50.0, SKY_DEPTH_M, 50.0, 50.0]
    assert len(reader.files(1, (Buffer.DEPTH,))) == 2


@pytest.mark.parametrize(
    ("stored", "unit_m"),
    # 7 m and 90 m times 1e-4, and 7 m and 500 m in centimetres without the constant
    [(0.07, 100.0), (0.9, 100.0), (700.0, 0.01), (5e4, 0.01)],
)
def test_extranets_constant_holds_where_it_makes_no_kilometres(
    tmp_path: Path, stored: float, unit_m: float
) -> None:
    write_exr(tmp_path / "FBaseColor.0001.exr", EXTRANET["BaseColor"])
    write_exr(tmp_path / "FSceneDepth.0001.exr", rgb(stored, stored, stored, np.float32))
    settled = settle(tmp_path)
    depth = settled.reader.read(1, (Buffer.DEPTH,)).gbuffer[Buffer.DEPTH]
    assert float(depth[0, 0, 0, 0]) == pytest.approx(stored * unit_m, rel=1e-5)
    assert bool(settled.warnings) is (unit_m != 100.0)
    if settled.warnings:
        assert "km at 100 m a unit, as layout 'extranet' has it" in settled.warnings[0]
        assert settled.by_measurement == ("depth",)


def test_unreals_specular_is_never_f0_and_that_is_said(tmp_path: Path) -> None:
    for buffer in ("PreTonemapHDRColor", "BaseColor", "Metallic", "Roughness"):
        write_exr(tmp_path / f"F{buffer}.0001.exr", EXTRANET[buffer])
    write_exr(tmp_path / "FSpecular.0001.exr", grey(0.5))
    reader = reader_of(tmp_path)
    assert Buffer.SPECULAR not in reader.stored
    (note,) = reader.notes
    assert "'FSpecular' is not read: Unreal's Specular" in note


def test_a_folder_of_a_pass_that_is_not_read_is_named_as_files_are(tmp_path: Path) -> None:
    for buffer in ("PreTonemapHDRColor", "BaseColor", "Metallic", "Roughness"):
        write_exr(tmp_path / buffer / "0001.exr", EXTRANET[buffer])
    write_exr(tmp_path / "Specular" / "0001.exr", grey(0.5))
    (note,) = reader_of(tmp_path).notes
    assert "'Specular' is not read: Unreal's Specular" in note


def test_two_scenes_in_one_folder_are_refused_by_name(tmp_path: Path) -> None:
    for scene in ("Bunker", "Docks"):
        for buffer in ("BaseColor", "SceneDepth", "WorldNormal"):
            write_exr(tmp_path / f"{scene}{buffer}.0001.exr", EXTRANET[buffer])
    with pytest.raises(
        FrameFolderError, match=r"/.*: buffer .*'BunkerBaseColor', 'DocksBaseColor'"
    ):
        reader_of(tmp_path)


NEAR_M = 0.5


def nss_json(**change: Any) -> dict[str, Any]:
    """A camera in the origin that looks along -z, 90 degrees wide and high, no far plane."""
    # rows act on (x, y, z, 1): clip = (x, y, -z - near, -z); the list holds the columns of the
    # matrix that acts on column vectors, one after another
    combined = [
        *(1.0, 0.0, 0.0, 0.0),
        *(0.0, 1.0, 0.0, 0.0),
        *(0.0, 0.0, -1.0, -1.0),
        *(0.0, 0.0, -NEAR_M, 0.0),
    ]
    frame = {
        "Frame": 0,
        "FovX": math.pi / 2,
        "FovY": math.pi / 2,
        "CameraNearPlane": NEAR_M,
        "CameraFarPlane": -1.0,
        "ViewProjection": combined,
        "Jitter": {"X": 0.25, "Y": -0.375},
        "NormalizedPerRatioJitter": [{"X": 0.25 / WIDTH, "Y": -0.375 / HEIGHT}],
        "Exposure": 3.0,
        "CameraCut": True,
    } | change
    return {
        "Version": "1.0.1",
        "EmulatedFramerate": 60,
        "TargetResolution": {"X": 2 * WIDTH, "Y": 2 * HEIGHT},
        "Samples": {"Sequence": "Halton", "Count": 16, "Quantized": True},
        "Frames": [{k: v for k, v in frame.items() if v is not None}],
        "ReverseZ": False,
        "UpscalingRatiosIndices": {"x2_index": 0},
    }


def write_nss(root: Path, side_car: dict[str, Any], device_depth: float, ratio: str = "2") -> None:
    big = (2 * HEIGHT, 2 * WIDTH)
    lr = root / f"x{ratio}"
    write_exr(lr / "color" / "0000" / "0000.exr", rgb(1.0, 2.0, 3.0))
    write_exr(lr / "depth" / "0000" / "0000.exr", planes(R=device_depth))
    write_exr(lr / "motion" / "0000" / "0000.exr", planes(np.float16, R=0.25, G=-0.5))
    hr = {c: np.full(big, 1.0, np.float16) for c in "RGBA"}
    write_exr(root / "ground_truth" / "0000" / "0000.exr", hr)
    write_exr(root / "motion_gt" / "0000" / "0000.exr", {c: hr[c] * 0.25 for c in "RG"})
    (root / "0000.json").write_text(json.dumps(side_car))


def test_nss_captures_are_read_to_the_letter(tmp_path: Path) -> None:
    write_nss(tmp_path, nss_json(), 1.0 - NEAR_M / 5.0)
    (shot,) = find_shots_of(tmp_path, ReadOptions())
    assert shot.name == "0000"
    lr, hr = reader_of(tmp_path), reader_of(tmp_path, hr=True)
    assert (lr.layout.name, hr.layout.name) == ("nss", "nss")
    assert lr.stored == {Buffer.COLOR, Buffer.ALPHA, Buffer.DEPTH, Buffer.MOTION}
    assert hr.stored == {Buffer.COLOR, Buffer.ALPHA, Buffer.MOTION}
    frame = lr.read(0, lr.stored)
    assert values(frame, Buffer.COLOR) == [1.0, 2.0, 3.0]
    assert values(frame, Buffer.DEPTH) == [5.0]  # d = 1 - near / depth
    # sources disagree which way vectors subtract, and one frame does not tell
    assert (lr.readable, hr.readable) == (lr.stored - {Buffer.MOTION}, hr.stored - {Buffer.MOTION})
    assert frame.camera.jitter_px == (0.25, -0.375)
    assert hr.cameras[0].jitter_px == (0.0, 0.0)
    assert frame.camera.cut
    assert frame.camera.pre_exposure == 1.0  # Exposure is for display only
    assert torch.allclose(frame.camera.world_to_camera, torch.eye(4, dtype=torch.float64))


@pytest.mark.parametrize(
    ("sense", "sign"), [("previous-minus-current", 1), ("current-minus-previous", -1)]
)
def test_nss_vectors_are_read_as_they_are_declared(tmp_path: Path, sense: str, sign: int) -> None:
    write_nss(tmp_path, nss_json(), 1.0 - NEAR_M / 5.0)
    declared = f'[motion]\nunit = "uv"\ndirection = "{sense}"\ny_axis = "down"\n'
    (tmp_path / "capture.toml").write_text(declared)
    lr, hr = (reader_of(tmp_path, hr=hr).read(0, (Buffer.MOTION,)) for hr in (False, True))
    assert values(lr, Buffer.MOTION) == [sign * 0.25 * WIDTH, sign * -0.5 * HEIGHT]
    assert values(hr, Buffer.MOTION) == [sign * 0.5 * WIDTH, sign * 0.5 * HEIGHT]


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("transposed", [False, True])
def test_nss_matrices_are_read_however_they_are_listed(
    tmp_path: Path, nested: bool, transposed: bool
) -> None:
    matrix = np.array(nss_json()["Frames"][0]["ViewProjection"]).reshape(4, 4)
    listed = (matrix.T if transposed else matrix).tolist()
    stored = listed if nested else [v for row in listed for v in row]
    write_nss(tmp_path, nss_json(ViewProjection=stored), 1.0 - NEAR_M / 5.0)
    reader = reader_of(tmp_path)
    assert values(reader.read(0, (Buffer.DEPTH,)), Buffer.DEPTH) == [5.0]
    assert torch.allclose(reader.cameras[0].world_to_ndc, torch.from_numpy(matrix), atol=1e-9)


@pytest.mark.parametrize("matrix_reversed", [False, True])
def test_reversed_nss_depth_is_linear_whichever_way_the_matrix_has_it(
    tmp_path: Path, matrix_reversed: bool
) -> None:
    side_car = nss_json()
    side_car["ReverseZ"] = True
    if matrix_reversed:  # clip z = near for every point
        side_car["Frames"][0]["ViewProjection"][10] = 0.0
        side_car["Frames"][0]["ViewProjection"][14] = NEAR_M
    write_nss(tmp_path, side_car, NEAR_M / 5.0)
    assert values(reader_of(tmp_path).read(0, (Buffer.DEPTH,)), Buffer.DEPTH) == [5.0]


def test_a_finite_far_plane_of_nss_is_sky(tmp_path: Path) -> None:
    far = 100.0
    a, b = far / (far - NEAR_M), -NEAR_M * far / (far - NEAR_M)
    side_car = nss_json(CameraFarPlane=far)
    side_car["Frames"][0]["ViewProjection"][10] = -a
    side_car["Frames"][0]["ViewProjection"][14] = b
    write_nss(tmp_path, side_car, a + b / 20.0)
    assert values(reader_of(tmp_path).read(0, (Buffer.DEPTH,)), Buffer.DEPTH)[0] == pytest.approx(
        20.0, rel=1e-4
    )
    write_nss(tmp_path, side_car, 1.0)
    assert values(reader_of(tmp_path).read(0, (Buffer.DEPTH,)), Buffer.DEPTH) == [SKY_DEPTH_M]


def test_nss_frames_may_be_called_frame_numbers(tmp_path: Path) -> None:
    write_nss(tmp_path, nss_json(Frame=None, FrameNumber=0), 0.9)
    assert reader_of(tmp_path).cameras[0].cut


@pytest.mark.parametrize(
    "change", [{"FovX": 1.0, "CameraNearPlane": 20.0}, {"ViewProjection": [0.0] * 16}]
)
def test_an_nss_matrix_that_fits_no_camera_is_unknown_and_named_with_the_frame(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    write_nss(tmp_path, nss_json(**change), 0.9)
    reader = reader_of(tmp_path)
    assert not reader.has_camera
    assert reader.camera_faults.startswith("frame 0: ViewProjection does not fit")
    assert reader.cameras[0].jitter_px == (0.25, -0.375)


def test_nss_ratios_that_are_no_whole_scale_are_refused_by_name(tmp_path: Path) -> None:
    write_nss(tmp_path, nss_json(), 0.9, ratio="1_5")
    with pytest.raises(FrameFolderError, match=r"'x1_5'.* only whole scales"):
        find_shots_of(tmp_path, ReadOptions())


def test_of_several_nss_ratios_the_usual_or_the_named_one_is_read(tmp_path: Path) -> None:
    for ratio in ("1_5", "2", "3"):
        write_nss(tmp_path, nss_json(), 0.9, ratio=ratio)

    def chosen(scale: int | None) -> str:
        (shot,) = find_shots_of(tmp_path, ReadOptions(), scale)
        return shot.frames.root.name

    assert [chosen(s) for s in (None, 2, 3)] == ["x2", "x2", "x3"]
    with pytest.raises(FrameFolderError, match=r"'x1_5', 'x2', 'x3', none has the scale 4"):
        chosen(4)


def write_nsrd(root: Path, numbers: tuple[int, ...] = (0, 1, 10)) -> None:
    big = (4 * HEIGHT, 4 * WIDTH)
    for number in numbers:
        for buffer, channels in {
            "Irradiance": rgb(4.0, 2.0, 1.0),
            "Normal": rgb(0.0, 0.0, 1.0),
            "Depth": rgb(0.5, 9.0, 9.0),
            "MV": rgb(0.25, -0.5, 9.0),
            "OCMV": rgb(0.0, 0.0, 9.0),
        }.items():
            write_exr(root / "X4" / "3" / buffer / f"{number}.exr", channels)
        for buffer, value in {"Irradiance": 3.0, "BRDF": 0.5, "Emission_Sky": 2.0}.items():
            hr = {c: np.full(big, value, np.float16) for c in "RGBA"}
            write_exr(root / "GT" / "3" / buffer / f"{number}.exr", hr)


def test_nsrd_data_sets_are_read_to_the_letter(tmp_path: Path) -> None:
    write_nsrd(tmp_path / "Bistro" / "train", (0, 1, 2))
    (shot,) = find_shots_of(tmp_path, ReadOptions())
    assert shot.name == "Bistro/train/3"
    lr, hr = reader_of(tmp_path), reader_of(tmp_path, hr=True)
    assert (lr.layout.name, hr.layout.name) == ("nsrd", "nsrd")
    assert lr.stored == {Buffer.LIGHTING, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION}
    assert hr.stored == {Buffer.LIGHTING, Buffer.MATERIAL, Buffer.EMISSION}
    frame = lr.read(2, lr.stored)
    assert values(frame, Buffer.LIGHTING) == [4.0, 2.0, 1.0]
    assert values(frame, Buffer.DEPTH) == [0.5]
    # current minus previous in shares of the screen, rows down
    assert values(frame, Buffer.MOTION) == [-0.25 * WIDTH, 0.5 * HEIGHT]
    other = hr.read(2, hr.stored)
    assert values(other, Buffer.MATERIAL) == [0.5, 0.5, 0.5]
    assert values(other, Buffer.EMISSION) == [2.0, 2.0, 2.0]


def test_more_buffers_than_the_published_ones_are_read_from_nsrds_high_resolution(
    tmp_path: Path,
) -> None:
    write_nsrd(tmp_path, (0, 1))
    for number in (0, 1):
        depth = {"R": np.full((4 * HEIGHT, 4 * WIDTH), 7.0, np.float32)}
        write_exr(tmp_path / "GT" / "3" / "Depth" / f"{number}.exr", depth)
    assert Buffer.DEPTH in reader_of(tmp_path, hr=True).stored


def test_nsrd_pairs_take_their_scale_from_the_sizes(tmp_path: Path) -> None:
    write_nsrd(tmp_path, (0, 1))
    ((name, source),) = open_pairs(tmp_path, ReadOptions())
    assert (name, source.scale, source.reader.numbers) == ("3", 4, (0, 1))


def test_unpadded_numbers_of_a_data_set_are_in_order_and_its_gaps_are_found(
    tmp_path: Path,
) -> None:
    write_nsrd(tmp_path)
    with pytest.raises(FrameFolderError, match=r"lacks 2-9"):
        reader_of(tmp_path)


def test_presets_are_listed_verified_first() -> None:
    assert tuple(LAYOUTS) == LAYOUT_NAMES
    assert tuple(name for name in LAYOUTS if LAYOUTS[name].verified) == VERIFIED


def letters(*groups: str) -> list[str]:
    return [f"{g.split(':')[0]}.{c}" for g in groups for c in g.split(":")[1]]


@pytest.mark.parametrize(
    ("streams", "layout", "found"),
    [
        (
            {"shot": [*"RGBA", *letters("FinalImageMovieRenderQueue_WorldDepth:RGBA",
              "FinalImageMovieRenderQueue_MotionVectors:RGB", "FinalImageMyBaseColor:RGB")]},
            "unreal-mrq",
            {"color", "alpha", "depth", "motion", "albedo"},
        ),
        (
            {f"seq.FinalImage{p}": list("RGBA") for p in ("", "MovieRenderQueue_WorldDepth",
             "MovieRenderQueue_MotionVectors", "MovieRenderQueue_WorldNormal", "Roughness")},
            "unreal-mrq",
            {"color", "alpha", "depth", "motion", "normal", "roughness"},
        ),
        (
            {f"Mogwai.{p}": list("RGBA") for p in ("AccumulatePass.output", "GBufferRT.posW",
             "GBufferRT.normW", "GBufferRT.mvec", "GBufferRT.linearZ", "GBufferRT.specRough")},
            "falcor",
            {"color", "position", "normal", "motion", "depth", "specular", "roughness"},
        ),
        (
            {"movie": [*"RGBA", *letters("Albedo:RGB", "Normal:RGB", "MotionVectors:RG",
              "Smoothness:RGB")]},
            "unity",
            {"color", "albedo", "normal", "motion", "roughness"},
        ),
        (
            {f"take_1_{p}": list("RGBA") for p in ("Beauty", "Albedo", "Normal", "Smoothness")},
            "unity",
            {"color", "albedo", "normal", "roughness"},
        ),
        (
            {"render": [*"RGB", *letters("alb:RGB", "nn:XYZ", "pos:XYZ", "dd.y:T")]},
            "mitsuba",
            {"color", "albedo", "normal", "position", "depth"},
        ),
        (
            {"comp": [*"RGBA", *letters("depth:Z", "forward:uv", "backward:uv")]},
            "nuke",
            {"color", "alpha", "depth", "forward", "motion"},
        ),
        # other renderers' spellings of the same things
        (
            {"vray": [*"RGBA", "diffuse.red", "diffuse.green", "diffuse.blue",
              *letters("bump_normals:XYZ")]},
            "rtsr",
            {"color", "alpha", "albedo", "normal"},
        ),
        (
            {"max": [*"RGBA", "Z", "NX", "NY", "NZ", "velX", "velY"]},
            "rtsr",
            {"color", "alpha", "depth", "normal", "motion"},
        ),
        (
            {"oidn": [*letters("Beauty:RGB", "N:RGB"), "albedo.red", "albedo.green",
              "albedo.blue"]},
            "rtsr",
            {"color", "normal", "albedo"},
        ),
        # parts of one file: the first one's channels are bare, the others' have the part's name
        (
            {"parts": [*"RGBA", *letters("albedo:RGB", "normal:XYZ", "depth:Z", "motion:XY",
              "roughness:Y", "metallic:Y", "objectid:Y")]},
            "rtsr",
            {"color", "alpha", "albedo", "normal", "depth", "motion", "roughness", "metallic",
             "object_id"},
        ),
        ({"beauty": list("RGBA")}, "rtsr", {"color", "alpha"}),
    ],
)  # fmt: skip
def test_names_of_other_tools_are_understood(
    streams: dict[str, list[str]], layout: str, found: set[str]
) -> None:
    chosen, binding = detect_layout(streams, LAYOUTS.values(), "shot")
    assert (chosen.name, set(binding)) == (layout, found)


def test_channels_of_one_buffer_are_never_taken_from_two_spellings() -> None:
    binding = bind_layout(LAYOUTS["rtsr"], {"f": ["albedo.R", "diffuse.green", "albedo.blue"]})
    assert Buffer.ALBEDO not in binding


def test_own_names_come_before_other_spellings() -> None:
    streams = {"f": ["Z", "depth.Z", "roughness.X", "roughness"]}
    binding = bind_layout(LAYOUTS["rtsr"], streams)
    assert binding[Buffer.DEPTH][0].channel == "depth.Z"
    assert binding[Buffer.ROUGHNESS][0].channel == "roughness"


def test_layouts_that_find_the_same_channels_are_one_and_the_first_is_taken() -> None:
    streams = {"f": [*"RGBA", "depth.Z"]}
    matches = [match_layout(LAYOUTS[name], streams).binding for name in ("rtsr", "nuke")]
    assert matches[0] == matches[1]
    assert detect_layout(streams, LAYOUTS.values(), "shot")[0].name == "rtsr"


def test_two_dumps_in_one_folder_are_refused_with_both_layouts_and_their_files() -> None:
    streams = {
        "frame": [*"RGB", *letters("albedo:RGB", "normal:XYZ")],
        "render": letters("Layer.Combined:RGBA", "Layer.Normal:XYZ", "Layer.Depth:Z"),
    }
    with pytest.raises(FrameFolderError) as caught:
        detect_layout(streams, LAYOUTS.values(), "/shots/a")
    message = str(caught.value)
    assert message.startswith("/shots/a: holds two dumps: layout blender in 'render'")
    assert "layout rtsr in 'frame'" in message
    assert "--layout" in message


def test_unreal_vectors_are_shifted_scaled_and_turned(tmp_path: Path) -> None:
    (tmp_path / "capture.toml").write_text(
        '[motion]\nunit = "uv"\ndirection = "current-minus-previous"\ny_axis = "up"'
    )
    write_exr(tmp_path / "FinalImage.0001.exr", rgb(1.0, 1.0, 1.0))
    # v = (2 s - 1): 0.5 of the screen to the right, 0.25 up, current minus previous
    name = "FinalImageMovieRenderQueue_MotionVectors.0001.exr"
    write_exr(tmp_path / name, rgb(0.75, 0.625, 0.0, np.float32))
    reader = reader_of(tmp_path)
    assert reader.layout.name == "unreal-mrq"
    found = values(reader.read(1, (Buffer.MOTION,)), Buffer.MOTION)
    assert found == [-0.5 * WIDTH, 0.25 * HEIGHT]


def test_a_buffers_folder_that_lacks_a_frame_is_found_before_work(tmp_path: Path) -> None:
    for buffer in ("BaseColor", "SceneDepth"):
        for number in (1, 2, 3):
            write_exr(tmp_path / buffer / f"{number:04d}.exr", EXTRANET[buffer])
    (tmp_path / "SceneDepth" / "0002.exr").unlink()
    with pytest.raises(FrameFolderError, match=r"frames are missing: 'SceneDepth/' lacks 2"):
        reader_of(tmp_path)


def test_a_channel_that_disappears_in_one_file_of_a_buffer_is_found(tmp_path: Path) -> None:
    for number in (1, 2):
        write_exr(tmp_path / f"FBaseColor.{number:04d}.exr", EXTRANET["BaseColor"])
        write_exr(tmp_path / f"FSceneDepth.{number:04d}.exr", EXTRANET["SceneDepth"])
    write_exr(tmp_path / "FBaseColor.0002.exr", planes(R=1.0, G=1.0))
    reader = reader_of(tmp_path)
    assert Buffer.ALBEDO not in reader.stored
    assert Buffer.DEPTH in reader.stored
    assert reader.lacking[Buffer.ALBEDO] == {2}
    (warning,) = (text for text in reader.warnings if "albedo" in text)
    assert "frame 2: buffer 'albedo' is missing (channel 'B'" in warning


@pytest.mark.parametrize("other", ["rougness", "crypto00"])
def test_a_channel_that_one_file_names_otherwise_is_named(tmp_path: Path, other: str) -> None:
    for number in (1, 2, 3):
        name = other if number == 3 else "roughness"
        write_exr(tmp_path / f"frame.{number:04d}.exr", planes(R=1.0, G=1.0, B=1.0, **{name: 0.5}))
    (warning,) = reader_of(tmp_path).warnings
    assert "frame 3: buffer 'roughness' is missing" in warning
    renamed = "not in this one, which has 'rougness' in its place: renamed?)" in warning
    # what is nothing like it is another pass
    assert renamed == (other == "rougness")
    assert "crypto00" not in warning


def test_buffers_of_different_sizes_are_found(tmp_path: Path) -> None:
    write_exr(tmp_path / "FBaseColor.0001.exr", EXTRANET["BaseColor"])
    write_exr(tmp_path / "FSceneDepth.0001.exr", {"R": np.ones((3, 3), np.float32)})
    with pytest.raises(FrameFolderError, match=r"'FBaseColor' frame 1 is 4 x 2, 'FSceneDepth'"):
        reader_of(tmp_path)
