"""From `pip install` to the first demodulated picture, step by step, as a stranger does it.

    python benchmarks/first_picture.py [--renderer blender|mitsuba] [--python PYTHON3.11]
        [--with blender|mitsuba PYTHON] [--rtsr RTSR] [--size 192x112] [--frames 1-4] [--samples 64]

Environments that hold nothing are made, with the commands of README.md and docs/capture.md: one
for rtsr, one for each renderer (Blender's module takes another NumPy than rtsr does). Then a small
scene is rendered as a pair at 4x by the script of `examples/capture`, looked at by `rtsr inspect`,
and upscaled by `rtsr upscale --system demod-guided`. Where an interpreter that has the renderer, or
an rtsr, is named, that step is left out. The scene itself, which a user has, is not timed.

A step's figures: seconds on the clock; seconds of processor time, of all its processes; and the
machine's load when it began (processes that want a core, mean of a minute), in front of how many
cores there are. With other work on the machine the clock tells of that, too. What `pip` takes is
mostly the way to its index.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import click

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "examples" / "capture"

SCALE = 4

NAME = 46
"""Letters of a step's name."""

BLENDER_SCENE = """
import sys
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene


def paint(thing, name, **values):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    closure = material.node_tree.nodes["Principled BSDF"]
    for key, value in values.items():
        closure.inputs[key.replace("_", " ")].default_value = value
    thing.data.materials.append(material)
    return material.node_tree, closure


bpy.ops.mesh.primitive_plane_add(size=20)
tree, closure = paint(bpy.context.object, "floor")
checks = tree.nodes.new("ShaderNodeTexChecker")
checks.inputs["Scale"].default_value = 24
tree.links.new(checks.outputs["Color"], closure.inputs["Base Color"])
bpy.ops.mesh.primitive_uv_sphere_add(radius=0.8, location=(-1, 0, 0.8))
paint(bpy.context.object, "gold", Base_Color=(0.9, 0.7, 0.3, 1), Metallic=1.0, Roughness=0.3)
bpy.ops.mesh.primitive_cube_add(size=1, location=(1, 0, 0.5))
box = bpy.context.object
paint(box, "box", Base_Color=(0.2, 0.4, 0.8, 1))
sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
sun.data.energy, sun.rotation_euler = 3, (0.7, 0.3, 0)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.rotation_euler = (1.35, 0, 0)
for thing in (sun, camera):
    scene.collection.objects.link(thing)
scene.camera = camera
for frame in range(10):
    box.rotation_euler = (0, 0, 0.1 * frame)
    box.keyframe_insert("rotation_euler", frame=frame)
    camera.location = (0.05 * frame, -6, 2)
    camera.keyframe_insert("location", frame=frame)
scene.world = bpy.data.worlds.new("sky")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.4, 0.5, 0.7, 1)
scene.render.engine = "CYCLES"
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
"""

MITSUBA_SCENE = """
from mitsuba import ScalarTransform4f as T


def rgb(*value):
    return {"type": "rgb", "value": value}


def scene(frame):
    eye = [0.05 * frame, 2, 6]
    checks = {"type": "checkerboard", "to_uv": T().scale(24), "color0": rgb(0.8, 0.8, 0.8),
              "color1": rgb(0.1, 0.2, 0.3)}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {"type": "perspective", "fov": 40,
                   "to_world": T().look_at(origin=eye, target=[eye[0], 0.7, 0], up=[0, 1, 0])},
        "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(10),
                  "bsdf": {"type": "diffuse", "reflectance": checks}},
        "gold": {"type": "sphere", "to_world": T().translate([-1, 0.8, 0]).scale(0.8),
                 "bsdf": {"type": "roughconductor", "material": "Au", "alpha": 0.1}},
        "box": {"type": "cube",
                "to_world": T().translate([1, 0.5, 0]).rotate([0, 1, 0], 6 * frame).scale(0.5),
                "bsdf": {"type": "principled", "base_color": rgb(0.2, 0.4, 0.8)}},
        "sun": {"type": "directional", "direction": [0.4, -1, -0.6],
                "irradiance": rgb(3, 2.8, 2.5)},
        "sky": {"type": "constant", "radiance": rgb(0.4, 0.5, 0.7)},
    }
"""


@dataclass(frozen=True, kw_only=True)
class Renderer:
    """What a stranger does to render with one.

    Attributes:
        packages: to install.
        module: that they bring.
        script: of `examples/capture`.
        scene: Python that is the scene, or that saves it.
        saved: file that it saves; empty if the scene is the Python file itself.
    """

    packages: tuple[str, ...]
    module: str
    script: str
    scene: str
    saved: str = ""


RENDERERS = {
    "blender": Renderer(
        packages=("bpy==5.0.*",),
        module="bpy",
        script="blender.py",
        scene=BLENDER_SCENE,
        saved="scene.blend",
    ),
    "mitsuba": Renderer(
        packages=("mitsuba", "numpy"), module="mitsuba", script="mitsuba.py", scene=MITSUBA_SCENE
    ),
}


@contextmanager
def timed(name: str) -> Iterator[None]:
    """Print a row of what runs within."""
    load, before, start = os.getloadavg()[0], processor_seconds(), time.perf_counter()
    yield
    wall, used = time.perf_counter() - start, processor_seconds() - before
    click.echo(f"{name:{NAME}} {wall:8.1f} {used:12.1f} {load:9.1f} of {os.cpu_count()}")


def processor_seconds() -> float:
    """Of all processes that were started here and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(*command: object, folder: Path) -> None:
    """Run a step; nothing of the caller's Python is seen by it.

    Raises:
        click.ClickException: it fails.
    """
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    words = [str(word) for word in command]
    done = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise click.ClickException(f"{' '.join(words)}:\n{done.stdout}{done.stderr}")


def install(python: str, where: Path, *packages: object, folder: Path) -> Path:
    """Make an environment with some packages; return its interpreter."""
    run(python, "-m", "venv", where, folder=folder)
    run(where / "bin" / "pip", "install", *packages, folder=folder)
    return where / "bin" / "python"


def install_rtsr(python: str, work: Path) -> Path:
    """Install this tree as README.md says; return the command."""
    words = ("-c", ROOT / "constraints.txt", ROOT)
    with timed("install rtsr (README.md)"):
        return install(python, work / "rtsr_env", *words, folder=work).with_name("rtsr")


def install_renderer(name: str, python: str, work: Path) -> Path:
    """Install a renderer as docs/capture.md says; return the interpreter that has it."""
    packages = RENDERERS[name].packages
    with timed(f"{name}: pip install {' '.join(packages)}"):
        return install(python, work / f"{name}_env", *packages, folder=work)


def make_scene(renderer: Renderer, python: Path, work: Path) -> Path:
    """Write the scene that a user has."""
    written = work / f"{renderer.module}_scene.py"
    written.write_text(renderer.scene)
    if not renderer.saved:
        return written
    run(python, written, work / renderer.saved, folder=work)
    return work / renderer.saved


def measure(name: str, rtsr: Path, python: Path, work: Path, options: list[str]) -> None:
    """Render, inspect and upscale with one renderer, a row a step."""
    renderer = RENDERERS[name]
    scene, shot, out = make_scene(renderer, python, work), work / name, work / f"{name}_out"
    with timed(f"{name}: render (examples/capture/{renderer.script})"):
        script = SCRIPTS / renderer.script
        run(python, script, scene, shot, "--scale", SCALE, *options, folder=work)
    with timed(f"{name}: rtsr inspect"):
        run(rtsr, "inspect", shot, folder=work)
    with timed(f"{name}: rtsr upscale, the first picture"):
        run(rtsr, "upscale", shot, out, "--system", "demod-guided", "--frames", "1", folder=work)
    with timed(f"{name}: rtsr upscale, the other frames"):
        run(rtsr, "upscale", shot, out, "--system", "demod-guided", folder=work)


@click.command()
@click.option("--renderer", "names", multiple=True, type=click.Choice(list(RENDERERS)))
@click.option("--python", default=sys.executable, help="What environments are made of: 3.11.")
@click.option(
    "--with",
    "given",
    multiple=True,
    type=(click.Choice(list(RENDERERS)), click.Path(path_type=Path)),
    help="A renderer and a Python that has it: it is not installed.",
)
@click.option("--rtsr", "ready", type=click.Path(path_type=Path), help="rtsr, installed already.")
@click.option("--size", default="192x112", show_default=True, help="Of the HR frames.")
@click.option("--frames", default="1-4", show_default=True)
@click.option("--samples", default="64", show_default=True, help="Light paths a pixel.")
def main(
    names: tuple[str, ...],
    python: str,
    given: tuple[tuple[str, Path], ...],
    ready: Path | None,
    **drawn: str,
) -> None:
    """Print what each step takes."""
    click.echo(", ".join(f"{name} {value}" for name, value in drawn.items()))
    click.echo(f"{'step':{NAME}} {'clock, s':>8} {'processor, s':>12} {'load':>9}")
    options = [word for name, value in drawn.items() for word in (f"--{name}", value)]
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        rtsr = ready.absolute() if ready is not None else install_rtsr(python, work)
        for name in names or RENDERERS:
            there = dict(given).get(name)
            interpreter = there.absolute() if there else install_renderer(name, python, work)
            measure(name, rtsr, interpreter, work, options)


if __name__ == "__main__":
    main()
