"""examples/capture/mitsuba.py writes what the scene's matrices say, and what rtsr reads."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header

pytestmark = pytest.mark.capture

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT / "examples" / "capture" / "mitsuba.py"
SIZE, SCALE = (48, 32), 4
FOV = 60.0

SCENE = """
from mitsuba import ScalarTransform4f as T

def checks(*colors):
    a, b = ({"type": "rgb", "value": list(c)} for c in colors)
    return {"type": "checkerboard", "color0": a, "color1": b, "to_uv": T().scale([16, 16, 1])}

def scene(frame):
    eye = [0.1 * frame, 1.5, 5.0]
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "sensor": {"type": "perspective", "fov": 60.0, "fov_axis": "x",
            "to_world": T().look_at(origin=eye, target=[eye[0], 1.0, 0.0], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 48, "height": 32}},
        "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale([6, 6, 1]),
            "bsdf": {"type": "diffuse", "reflectance": checks((.8, .7, .6), (.2, .3, .4))}},
        "gold": {"type": "sphere", "center": [-1.2, 0.8, 0], "radius": 0.8,
            "bsdf": {"type": "roughconductor", "material": "Au", "alpha": 0.25}},
        "ball": {"type": "sphere", "to_world": T().translate([0.7 + 0.2 * frame, 0.6, 0])
            .scale(0.6), "bsdf": {"type": "principled",
                "base_color": {"type": "rgb", "value": [.9, .1, .1]},
                "metallic": 0.25, "roughness": 0.6}},
        "box": {"type": "cube", "to_world": T().translate([0.2, 0.4, 2]).rotate([0, 1, 0],
            9 * frame).scale(0.4), "bsdf": {"type": "twosided", "bsdf": {"type": "roughplastic",
                "diffuse_reflectance": {"type": "rgb", "value": [.1, .5, .2]}, "alpha": 0.09}}},
        "group": {"type": "shapegroup", "small": {"type": "sphere", "radius": 0.3}},
        "twin": {"type": "instance", "group": {"type": "ref", "id": "group"},
            "to_world": T().translate([-0.4 - 0.1 * frame, 0.3, 2.5])},
        "lamp": {"type": "sphere", "center": [1.6, 2.2, -1], "radius": 0.4,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [5.0, 4.0, 3.0]}}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.4, 0.6]}},
    }
"""

XML = """<scene version="3.0.0">
  <default name="x" value="0"/>
  <integrator type="path"/>
  <sensor type="perspective"><float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="8"/></film>
  </sensor>
  <shape type="sphere" id="ball"><transform name="to_world"><translate x="$x"/></transform></shape>
  <emitter type="constant"/>
</scene>
"""

Planes = dict[str, NDArray[Any]]


@pytest.fixture(scope="module")
def python() -> str:
    """An interpreter that has the renderer."""
    named = os.environ.get("RTSR_MITSUBA_PYTHON")
    if named:
        return named
    if importlib.util.find_spec("mitsuba") is None:
        pytest.skip("no mitsuba: name an interpreter that has it in RTSR_MITSUBA_PYTHON")
    return sys.executable


def capture(python: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [python, str(SCRIPT), *map(str, arguments), "--variant", "scalar_rgb"]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, timeout=300
    )


@pytest.fixture(scope="module")
def shot(python: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames, LR and HR."""
    folder = tmp_path_factory.mktemp("mitsuba")
    (folder / "room.py").write_text(SCENE, encoding="utf-8")
    run = capture(
        python, folder / "room.py", folder / "shot",
        *("--frames", "1-2", "--scale", SCALE, "--samples", 4, "--jitter", "halton"),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return folder / "shot"


def read(path: Path) -> Planes:
    planes = read_channels(path, read_header(path).channels)
    return {name: np.asarray(plane, np.float64) for name, plane in planes.items()}


def join(planes: Planes, prefix: str, letters: str) -> NDArray[Any]:
    return np.stack([planes[f"{prefix}.{letter}"] for letter in letters], -1)


def look(frame: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Camera: its place, and right, up, forward."""
    eye = np.array([0.1 * frame, 1.5, 5.0])
    forward = np.array([0.0, -0.5, -5.0]) / np.hypot(0.5, 5.0)
    right = np.array([1.0, 0.0, 0.0])
    return eye, np.stack([right, np.cross(right, forward), forward])


def project(points: NDArray[Any], frame: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Pixels of HR, y down, and planar depth."""
    eye, axes = look(frame)
    x, y, depth = np.moveaxis((points - eye) @ axes.T, -1, 0)
    focal = SIZE[0] / 2 / np.tan(np.radians(FOV / 2))
    return np.stack([SIZE[0] / 2 + focal * x / depth, SIZE[1] / 2 - focal * y / depth], -1), depth


def where_before(points: NDArray[Any], ids: NDArray[Any], numbers: dict[str, int]) -> NDArray[Any]:
    """Points of frame 2 in frame 1."""
    before = points.copy()
    before[ids == numbers["ball"]] -= [0.2, 0.0, 0.0]
    before[ids == numbers["twin/small"]] += [0.1, 0.0, 0.0]
    angle, centre = np.radians(-9.0), np.array([0.2, 0.4, 2.0])
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    box = ids == numbers["box"]
    before[box] = (points[box] - centre) @ turn.T + centre
    return before


def pixel_centres(planes: Planes) -> NDArray[Any]:
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    return np.stack([x + 0.5, y + 0.5], -1)


def read_numbers(shot: Path) -> dict[str, int]:
    return dict(json.loads((shot / "objects.json").read_text(encoding="utf-8")))


def test_positions_and_depth_are_those_of_the_pixels_centres(shot: Path) -> None:
    planes = read(shot / "hr" / "frame.0002.exr")
    hit = planes["depth.Z"] < 65504
    pixels, depth = project(join(planes, "position", "XYZ"), 2)
    np.testing.assert_allclose(pixels[hit], pixel_centres(planes)[hit], atol=1e-3)
    np.testing.assert_allclose(depth[hit], planes["depth.Z"][hit], rtol=1e-5)
    assert 0.05 < (~hit).mean() < 0.95


def test_motion_is_that_of_the_transforms(shot: Path) -> None:
    planes = read(shot / "hr" / "frame.0002.exr")
    hit = planes["depth.Z"] < 65504
    points = where_before(join(planes, "position", "XYZ"), planes["objectid"], read_numbers(shot))
    expected = project(points, 1)[0] - pixel_centres(planes)
    motion = join(planes, "motion", "XY")
    np.testing.assert_allclose(motion[hit], expected[hit], atol=1e-3)
    # the camera moves and does not turn
    np.testing.assert_allclose(motion[~hit], 0.0, atol=1e-4)
    assert np.abs(expected[hit]).max() > 1.0
    assert {0, *read_numbers(shot).values()} == set(planes["objectid"].reshape(-1))


def test_matrices_of_the_header_are_the_camera(shot: Path) -> None:
    attributes = read_header(shot / "hr" / "frame.0002.exr").attributes
    planes = read(shot / "hr" / "frame.0002.exr")
    hit = planes["depth.Z"] < 65504
    points = np.concatenate([join(planes, "position", "XYZ")[hit], np.ones((hit.sum(), 1))], 1)
    seen = points @ np.asarray(attributes["worldToCamera"], np.float64)
    np.testing.assert_allclose(-seen[:, 2], planes["depth.Z"][hit], rtol=1e-5)
    clip = points @ np.asarray(attributes["worldToNDC"], np.float64)
    x, y = (clip[:, i] / clip[:, 3] for i in (0, 1))
    pixels = np.stack([(x + 1) / 2 * SIZE[0], (1 - y) / 2 * SIZE[1]], -1)
    np.testing.assert_allclose(pixels, pixel_centres(planes)[hit], atol=1e-3)
    np.testing.assert_allclose(clip[:, 3], planes["depth.Z"][hit], rtol=1e-5)


def test_materials_are_those_of_the_bsdfs(shot: Path) -> None:
    planes, numbers = read(shot / "hr" / "frame.0002.exr"), read_numbers(shot)
    of = {name: planes["objectid"] == number for name, number in numbers.items()}
    albedo = join(planes, "albedo", "RGB")
    # F0 of n and k of gold in Rec.709: ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2)
    n, k = np.array([0.143, 0.375, 1.442]), np.array([3.983, 2.386, 1.603])
    gold = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    np.testing.assert_allclose(albedo[of["gold"]], np.tile(gold, (of["gold"].sum(), 1)), atol=2e-3)
    assert set(planes["metallic"][of["gold"]]) == {1.0}
    np.testing.assert_allclose(planes["roughness"][of["gold"]], 0.5, atol=1e-6)
    np.testing.assert_allclose(planes["metallic"][of["ball"]], 0.25, atol=1e-6)
    np.testing.assert_allclose(planes["roughness"][of["ball"]], 0.6, atol=1e-6)
    np.testing.assert_allclose(planes["roughness"][of["box"]], 0.3, atol=1e-6)
    np.testing.assert_allclose(albedo[of["box"]].mean(0), [0.1, 0.5, 0.2], atol=1e-6)
    floor = np.unique(albedo[of["floor"]].round(4), axis=0)
    np.testing.assert_allclose(floor, [[0.2, 0.3, 0.4], [0.8, 0.7, 0.6]], atol=1e-3)


def test_normals_face_the_camera_in_world_space(shot: Path) -> None:
    planes, numbers = read(shot / "hr" / "frame.0002.exr"), read_numbers(shot)
    normal, position = join(planes, "normal", "XYZ"), join(planes, "position", "XYZ")
    gold = planes["objectid"] == numbers["gold"]
    expected = (position[gold] - [-1.2, 0.8, 0.0]) / 0.8
    np.testing.assert_allclose(normal[gold], expected, atol=1e-4)
    sky = planes["objectid"] == 0
    np.testing.assert_array_equal(normal[sky], 0.0)


def test_what_shines_is_in_the_emission(shot: Path) -> None:
    planes, numbers = read(shot / "hr" / "frame.0002.exr"), read_numbers(shot)
    emission = join(planes, "emission", "RGB")
    lamp, sky = planes["objectid"] == numbers["lamp"], planes["objectid"] == 0
    np.testing.assert_allclose(emission[lamp].mean(0), [5.0, 4.0, 3.0], rtol=1e-5)
    np.testing.assert_allclose(emission[sky].mean(0), [0.3, 0.4, 0.6], rtol=1e-5)
    np.testing.assert_array_equal(emission[~lamp & ~sky], 0.0)
    radiance = np.stack([planes[c] for c in "RGB"], -1)
    np.testing.assert_allclose(radiance[sky].mean(0), [0.3, 0.4, 0.6], rtol=1e-5)


def test_jitter_is_the_declared_one(shot: Path) -> None:
    planes = read(shot / "lr" / "frame.0002.exr")
    hit = planes["depth.Z"] < 65504
    pixels = project(join(planes, "position", "XYZ"), 2)[0][hit] / SCALE
    offsets = pixels - np.floor(pixels) - 0.5
    # element 2 of Halton(2, 3): 1/4 and 2/3
    np.testing.assert_allclose(offsets, np.tile([-0.25, 1 / 6], (hit.sum(), 1)), atol=1e-3)


def test_every_demodulating_system_reads_it_as_it_is(shot: Path, tmp_path: Path) -> None:
    run = CliRunner().invoke(group, ["inspect", str(shot)])
    assert "planar" in run.output, run.output
    assert "previous-minus-current, pixels, y down" in run.output
    for system in ("demod-guided", "taau", "fusesr", "nsrd"):
        out = str(tmp_path / system)
        run = CliRunner().invoke(group, ["upscale", str(shot), out, "--system", system])
        assert run.exit_code == 0, run.output
    run = CliRunner().invoke(group, ["predict-vrs", str(shot / "hr"), str(tmp_path / "rates")])
    assert run.exit_code == 0, run.output


def test_frames_that_are_there_are_kept_and_other_options_are_refused(
    python: str, shot: Path
) -> None:
    scene, frame = shot.parent / "room.py", shot / "lr" / "frame.0001.exr"
    before = frame.stat().st_mtime_ns
    arguments = (scene, shot, "--frames", "1-1", "--scale", SCALE, "--samples", 4)
    assert "frame.0001.exr: kept" in capture(python, *arguments, "--jitter", "halton").stdout
    other = capture(python, *arguments)
    assert other.returncode == 1
    assert "--overwrite" in other.stderr
    assert "Traceback" not in other.stderr
    assert frame.stat().st_mtime_ns == before


def test_an_xml_file_takes_its_parameters_from_a_table(python: str, tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(XML, encoding="utf-8")
    (tmp_path / "ball.csv").write_text("frame, x\n1, 0.0\n2, 0.5\n", encoding="utf-8")
    run = capture(
        python, tmp_path / "ball.xml", tmp_path / "shot", "--params", tmp_path / "ball.csv",
        *("--frames", "1-2", "--samples", 1),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    first, second = (read(tmp_path / "shot" / f"frame.000{n}.exr") for n in (1, 2))
    assert np.abs(first["motion.X"]).max() == 0.0
    ball = second["objectid"] > 0
    # half a metre to the left, seen from the depth of each point
    focal = 8.0 / np.tan(np.radians(30.0))
    np.testing.assert_allclose(
        second["motion.X"][ball], -0.5 * focal / second["depth.Z"][ball], atol=1e-3
    )


REFUSED = {
    "use a perspective sensor": """
def scene(frame):
    return {"type": "scene", "s": {"type": "orthographic", "film": {"type": "hdrfilm"}}}
""",
    "returned one mi.Scene for two frames": """
import mitsuba as mi
ONE = []
def scene(frame):
    sensor = {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}
    ONE or ONE.append(mi.load_dict({"type": "scene", "sensor": sensor}))
    return ONE[0]
""",
    "is no scene": "def scene(frame): return {'type': 'scene', 'ball': {'type': 'spheer'}}",
    "has no function scene(frame)": "",
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_cannot_be_captured_is_one_message(python: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "odd.py").write_text(REFUSED[said], encoding="utf-8")
    run = capture(python, tmp_path / "odd.py", tmp_path / "shot", "--frames", "2-3")
    assert run.returncode == 1
    assert said in run.stderr
    assert "Traceback" not in run.stderr
