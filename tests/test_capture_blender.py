"""examples/capture/blender.py, where an interpreter with `bpy` is at hand.

`bpy` needs a NumPy that rtsr does not take, so it lives in an environment of its own, named by
RTSR_BPY_PYTHON.
"""

from __future__ import annotations

import csv
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner

from rtsr_cli.cli import group

pytestmark = [pytest.mark.capture, pytest.mark.slow]

SCRIPT = Path(__file__).resolve().parents[1] / "examples" / "capture" / "blender.py"

SIZE, SCALE, LAST = (96, 64), 4, 3

LENS_MM, SENSOR_MM, SHIFT = 35.0, 36.0, 0.05

SPHERE = (-0.9, 0.0, 0.7)

SCENE = f"""
import math, sys
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene


def add(name, kind, material, **where):
    getattr(bpy.ops.mesh, "primitive_" + kind + "_add")(**where)
    bpy.context.object.name = name
    if material is not None:
        bpy.context.object.data.materials.append(material)
    return bpy.context.object


def make(name):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    return material, nodes, material.node_tree.links, nodes.get("Principled BSDF")


gold, _, _, closure = make("gold")
closure.inputs["Base Color"].default_value = (0.9, 0.6, 0.2, 1)
closure.inputs["Metallic"].default_value = 1.0
closure.inputs["Roughness"].default_value = 0.3
checks, nodes, links, closure = make("checks")
texture = nodes.new("ShaderNodeTexChecker")
texture.inputs["Color1"].default_value = (0.8, 0.7, 0.6, 1)
texture.inputs["Color2"].default_value = (0.1, 0.2, 0.3, 1)
texture.inputs["Scale"].default_value = 12
links.new(texture.outputs["Color"], closure.inputs["Base Color"])
closure.inputs["Roughness"].default_value = 0.6
lamp, nodes, links, _ = make("lamp")
nodes.clear()
light, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
light.inputs["Strength"].default_value = 2.0
links.new(light.outputs[0], out.inputs["Surface"])

# half diffuse, half metal, within a group
group = bpy.data.node_groups.new("paint", "ShaderNodeTree")
group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
nodes = group.nodes
into, outof = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
soft, hard, both = (
    nodes.new("ShaderNode" + n) for n in ("BsdfDiffuse", "BsdfAnisotropic", "MixShader")
)
hard.inputs["Color"].default_value = (1, 1, 1, 1)
hard.inputs["Roughness"].default_value = 0.5
both.inputs[0].default_value = 0.5
for a, b in ((into.outputs[0], soft.inputs[0]), (soft.outputs[0], both.inputs[1]),
             (hard.outputs[0], both.inputs[2]), (both.outputs[0], outof.inputs[0])):
    group.links.new(a, b)
paint, nodes, links, _ = make("paint")
nodes.clear()
use, out = nodes.new("ShaderNodeGroup"), nodes.new("ShaderNodeOutputMaterial")
use.node_tree = group
use.inputs["Tint"].default_value = (0.2, 0.4, 0.6, 1)
links.new(use.outputs[0], out.inputs["Surface"])

floor = add("floor", "plane", checks, size=12)
ball = add("ball", "uv_sphere", gold, radius=0.7, location={SPHERE!r})
box = add("box", "cube", paint, size=0.9, location=(0.6, 0.3, 0.45))
add("bare", "cube", None, size=0.5, location=(1.6, -0.2, 0.25))
add("lamp", "cube", lamp, size=0.4, location=(-0.1, -0.9, 0.2))
sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
sun.rotation_euler = (0.7, 0.2, 0.5)
scene.collection.objects.link(sun)
scene.world = bpy.data.worlds.new("sky")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.3, 0.5, 0.8, 1)
dolly = bpy.data.objects.new("dolly", None)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
for ob in (dolly, camera):
    scene.collection.objects.link(ob)
camera.parent, camera.rotation_euler = dolly, (math.radians(80), 0, 0)
camera.data.lens, camera.data.shift_x = {LENS_MM}, {SHIFT}
camera.data.dof.use_dof = True
for frame in range(0, {LAST} + 2):
    dolly.location = (0.08 * frame, -4.5, 1.3 + 0.02 * frame)
    dolly.keyframe_insert("location", frame=frame)
    box.location = (0.6, 0.3 + 0.05 * frame, 0.45)
    box.keyframe_insert("location", frame=frame)
scene.camera, scene.frame_start, scene.frame_end = camera, 1, {LAST}
scene.render.engine = "CYCLES"
scene.render.use_motion_blur = True
scene.render.resolution_x, scene.render.resolution_y = {SIZE}
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


@pytest.fixture(scope="module")
def python() -> str:
    """Return an interpreter that imports bpy."""
    path = os.environ.get("RTSR_BPY_PYTHON", "")
    if not path or not Path(path).is_file():
        pytest.skip("RTSR_BPY_PYTHON names no interpreter with bpy")
    return path


@pytest.fixture(scope="module")
def scene(python: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a .blend of metal, checks, a lamp, a group, sky, and a camera on a dolly."""
    folder = tmp_path_factory.mktemp("scene")
    (folder / "make.py").write_text(SCENE, encoding="utf-8")
    run(python, folder / "make.py", folder / "scene.blend")
    return folder / "scene.blend"


@pytest.fixture(scope="module")
def shot(python: str, scene: Path) -> Path:
    """Capture the scene as a pair."""
    out = scene.parent / "shot"
    done = run(python, SCRIPT, scene, out, "--scale", str(SCALE), "--samples", "48")
    assert done.returncode == 0, done.stdout[-2000:]
    return out


def run(*command: object) -> subprocess.CompletedProcess[str]:
    """Run a script of an interpreter that is not ours."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        [str(part) for part in command],
        env=clean,
        check=False,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=300,
    )


def rtsr(*arguments: object) -> str:
    """Run rtsr, and return what it says."""
    result = CliRunner().invoke(group, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    return result.output


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the channels of a file, without the name of the view layer."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        parts = [part.channels.items() for part in file.parts]
        return {n.removeprefix("ViewLayer."): c.pixels for part in parts for n, c in part}


def stack(frame: Mapping[str, np.ndarray], name: str, letters: str) -> np.ndarray:
    """Return the channels of one buffer, the last axis."""
    return np.stack([frame[f"{name}.{c}"] for c in letters], -1).astype(float)


def project(points: np.ndarray, frame: int, size: tuple[int, int]) -> tuple[np.ndarray, ...]:
    """Return pixel x, y (centres at integers) and depth of world points, from the scene's lens."""
    width, height = size
    angle = np.radians(80)
    right = np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, np.cos(angle), np.sin(angle)])
    back = np.array([0.0, -np.sin(angle), np.cos(angle)])
    seen = points - np.array([0.08 * frame, -4.5, 1.3 + 0.02 * frame])
    depth = -seen @ back
    focal = width * LENS_MM / SENSOR_MM
    x = seen @ right / depth * focal - SHIFT * width
    y = seen @ up / depth * focal
    return width / 2 + x - 0.5, height / 2 - y - 0.5, depth


def test_geometry_lies_where_the_scenes_lens_says(shot: Path) -> None:
    for folder, size in (("hr", SIZE), ("lr", (SIZE[0] // SCALE, SIZE[1] // SCALE))):
        with (shot / folder / "camera.csv").open() as file:
            rows = {int(row["frame"]): row for row in csv.DictReader(file)}
        for number in range(1, LAST + 1):
            frame = read(shot / folder / f"frame_{number:04d}.exr")
            surface = frame["Depth.Z"] < 1e9
            assert surface.any()
            assert not surface.all()
            x, y, depth = project(stack(frame, "Position", "XYZ"), number, size)
            rows_of, columns = np.mgrid[: size[1], : size[0]]
            jitter = [float(v) for v in rows[number]["jitter_px"].split()]
            assert any(jitter) == (folder == "lr")
            off = np.hypot(x - columns - jitter[0], y - rows_of - jitter[1])[surface]
            assert np.percentile(off, 99) < 0.01
            relative = np.abs(depth - frame["Depth.Z"])[surface] / depth[surface]
            assert np.percentile(relative, 99) < 1e-4


def test_vectors_lead_to_the_frame_before_from_the_first_frame_on(shot: Path) -> None:
    for number in range(1, LAST + 1):
        frame = read(shot / "hr" / f"frame_{number:04d}.exr")
        surface = frame["Depth.Z"] < 1e9
        points = stack(frame, "Position", "XYZ")
        box = (np.abs(points - (0.6, 0.3 + 0.05 * number, 0.45)) < 0.4501).all(-1)
        before = points - np.where(box[..., None], (0.0, 0.05, 0.0), 0.0)
        now, then = project(points, number, SIZE), project(before, number - 1, SIZE)
        x, y = frame["Vector.X"] - (then[0] - now[0]), -frame["Vector.Y"] - (then[1] - now[1])
        off = np.hypot(x, y)[surface]
        assert np.abs(then[0] - now[0])[surface].max() > 1.0
        assert np.percentile(off, 98) < 0.01


def test_materials_are_what_feeds_their_closures(shot: Path) -> None:
    frame = read(shot / "hr" / "frame_0002.exr")
    points = stack(frame, "Position", "XYZ")
    base = stack(frame, "albedo", "RGB")
    surface = frame["Depth.Z"] < 1e9
    expected = {
        "ball": (np.linalg.norm(points - SPHERE, axis=-1) < 0.71, (0.9, 0.6, 0.2), 1.0, 0.3),
        "box": (
            (np.abs(points - (0.6, 0.4, 0.45)) < 0.451).all(-1),
            (0.6, 0.7, 0.8),
            0.5,
            0.75,
        ),
        "bare": (
            (np.abs(points - (1.6, -0.2, 0.25)) < 0.251).all(-1),
            (0.8, 0.8, 0.8),
            0.0,
            1.0,
        ),
        "lamp": ((np.abs(points - (-0.1, -0.9, 0.2)) < 0.201).all(-1), (0.0, 0.0, 0.0), 0.0, 1.0),
    }
    for name, (mask, color, metallic, roughness) in expected.items():
        inside = mask & surface & (points[..., 2] > 0.01)
        assert inside.sum() > 20, name
        assert np.median(base[inside], 0) == pytest.approx(color, abs=1e-3), name
        assert np.median(frame["metallic.X"][inside]) == pytest.approx(metallic, abs=1e-3), name
        assert np.median(frame["roughness.X"][inside]) == pytest.approx(roughness, abs=1e-3), name
    checks = np.unique(base[surface & (np.abs(points[..., 2]) < 1e-4)].round(2), axis=0)
    assert [0.8, 0.7, 0.6] in checks.tolist()
    assert [0.1, 0.2, 0.3] in checks.tolist()


def test_rtsr_takes_the_pair_as_it_is_and_demodulation_gains(shot: Path, tmp_path: Path) -> None:
    said = rtsr("inspect", shot)
    assert "PROBLEM" not in said
    scores = {}
    for system in ("bicubic", "demod-guided", "taau", "nsrd", "fusesr"):
        rtsr("upscale", shot, tmp_path / system, "--system", system)
    for system in ("bicubic", "demod-guided", "nsrd", "fusesr"):
        said = rtsr("evaluate", tmp_path / system, "--ref", shot / "hr", "--metric", "psnr")
        scores[system] = float(said.splitlines()[2].split()[-1].rstrip("*"))
    gains = {name: score - scores["bicubic"] for name, score in scores.items()}
    assert all(gain > 2.0 for name, gain in gains.items() if name != "bicubic"), gains
    rtsr("predict-vrs", shot / "hr", tmp_path / "rates")


def test_frames_that_are_there_stay_and_other_options_are_refused(
    python: str, scene: Path, shot: Path
) -> None:
    before = {p: p.stat().st_mtime_ns for p in shot.glob("*/*.exr")}
    arguments = (python, SCRIPT, scene, shot, "--scale", str(SCALE))
    again = run(*arguments, "--samples", "48")
    assert again.returncode == 0, again.stdout[-2000:]
    assert {p: p.stat().st_mtime_ns for p in shot.glob("*/*.exr")} == before
    other = run(*arguments, "--samples", "8")
    assert other.returncode == 3
    assert "--overwrite" in other.stdout


def test_a_size_that_does_not_divide_is_refused_with_the_nearest(
    python: str, scene: Path, tmp_path: Path
) -> None:
    done = run(python, SCRIPT, scene, tmp_path / "x", "--scale", "4", "--size", "97x64")
    assert done.returncode == 3
    assert "--size 96x64" in done.stdout
    assert not (tmp_path / "x").exists()


def test_the_scene_on_disk_is_not_changed(scene: Path, shot: Path) -> None:
    assert shot.is_dir()
    assert scene.stat().st_mtime_ns < min(p.stat().st_mtime_ns for p in shot.rglob("*.exr"))
