"""Frames of a Mitsuba 3 scene, as rtsr reads them: `python mitsuba.py SCENE OUT [options]`.

SCENE is

- a Python file with a function `scene(frame)`, which returns a dictionary for `mi.load_dict`, or a
  `mi.Scene`. What moves is what it returns otherwise for another frame;
- or an XML file. It is loaded anew for every frame, with the parameter `frame` (`<default
  name="frame" value="1"/>`, used as `$frame`), with `--define NAME=VALUE`, and with the columns of
  `--params FILE.csv`, which has a row for each frame and a column `frame`.

OUT becomes `lr/` and `hr/` with `--scale S`, or frames of one size without (for `--simulate-lr`),
and a `capture.toml` that says all there is to say. Frames that are there are kept.

    python mitsuba.py my_scene.py shot --frames 1-8 --size 960x540 --scale 4
    rtsr upscale shot out --system fusesr
    rtsr evaluate out --ref shot/hr

Every ray goes through the centre of its pixel (`--jitter halton` moves it, the same for a whole
frame), as an engine without anti-aliasing renders; depth of field and motion blur are left out.
G-buffers are those of the first surface, through what is masked; they need a ray a pixel.

- Motion is made from the vertices of meshes, the `to_world` of other shapes and of instances, and
  the camera. Curves and signed distance fields count as still, but for the camera.
- Metallic and roughness are read from the BSDFs, with their textures: principled, conductors,
  plastics and diffuse, through twosided, mask, blendbsdf, bumpmap and normalmap. Metals have their
  reflectance at normal incidence as base colour. Dielectrics have base colour 1: what is seen
  through them is no surface of theirs. Of other BSDFs the diffuse reflectance is taken. Normals
  do not contain bump maps; they do contain normal maps.
- Emission is what area lights and the environment show directly.
- Camera matrices are in the headers: row vectors, x right, y up, looking along -z.

`--variant auto` takes llvm_ad_rgb where LLVM is installed and works (this is tried in a process of
its own, because some releases of LLVM end the process), else scalar_rgb, which needs nothing, can
do all of this, and is some thirty times slower. Variants of polarisation or spectra will not do.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# this file's own name must not stand for the renderer's
_HERE = Path(__file__).resolve().parent
sys.path[:] = [folder for folder in sys.path if Path(folder or ".").resolve() != _HERE]

try:
    import drjit as dr
    import mitsuba as mi
    import numpy as np
except ModuleNotFoundError as error:  # pragma: no cover
    sys.exit(f"mitsuba.py: {error}; pip install mitsuba numpy")

SKY_DEPTH = 65504.0
"""What rtsr takes for sky: the largest half."""

LAYERS = 8
"""Cut-out surfaces before the one that is seen."""

LANES = 1 << 22
"""Paths at a time: what a gigabyte or two hold."""

VECTOR, SCALAR = "llvm_ad_rgb", "scalar_rgb"

PROBE = """
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.load_dict({"type": "scene", "integrator": {"type": "path"}, "sky": {"type": "constant"},
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
    "ball": {"type": "sphere", "bsdf": {"type": "principled"}}})
mi.render(scene, spp=1).numpy()
"""
"""Ends the process where LLVM is missing or does not fit."""

Arrays = dict[str, Any]


class CaptureError(Exception):
    """What the one who runs this can mend."""


# --- scenes -----------------------------------------------------------------------------------


@dataclass
class Source:
    """Where scenes come from, frame by frame; the last two are kept."""

    make: Callable[[int], Any]
    kept: dict[int, World] = field(default_factory=dict)

    def at(self, frame: int, sensor: str, size: tuple[int, int] | None) -> World:
        """Scene of a frame."""
        if frame not in self.kept:
            self.kept = {n: w for n, w in self.kept.items() if abs(n - frame) <= 1}
            scene = self.make(frame)
            if any(scene is world.scene for world in self.kept.values()):
                raise CaptureError(
                    "scene(frame) returned one mi.Scene for two frames, so that what moves in it "
                    "cannot be told: return a new one each time, or a dictionary"
                )
            self.kept[frame] = make_world(scene, sensor, size)
        return self.kept[frame]


def open_source(options: argparse.Namespace) -> Source:
    """Tell a Python file from an XML file."""
    path: Path = options.scene
    if not path.is_file():
        raise CaptureError(f"{path}: there is no such file")
    if path.suffix != ".py":
        return Source(lambda frame: load_xml(path, list_parameters(options, frame)))
    sys.path.insert(0, str(path.resolve().parent))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not hasattr(module, "scene"):
        raise CaptureError(f"{path}: has no function scene(frame)")
    return Source(lambda frame: load_description(module.scene(frame)))


def load_description(description: Any) -> Any:
    """Scene of what `scene(frame)` returned."""
    if isinstance(description, mi.Scene):
        return description
    try:
        return mi.load_dict(description, optimize=False)
    except RuntimeError as error:
        raise CaptureError(f"what scene(frame) returned is no scene: {error}") from error


def load_xml(path: Path, parameters: dict[str, str]) -> Any:
    """Scene of an XML file; shapes stay apart, so that each keeps its number."""
    if "$frame" not in path.read_text(encoding="utf-8"):
        del parameters["frame"]
    try:
        return mi.load_file(str(path), optimize=False, **parameters)
    except RuntimeError as error:
        raise CaptureError(f"{path}: {error}") from error


def list_parameters(options: argparse.Namespace, frame: int) -> dict[str, str]:
    """What an XML file is loaded with: the frame's row of the table where there is one."""
    parameters = {"frame": str(frame)}
    parameters |= dict(text.split("=", 1) for text in options.define)
    if options.params is not None:
        with options.params.open(encoding="utf-8", newline="") as stream:
            rows = {int(row["frame"]): row for row in csv.DictReader(stream, skipinitialspace=True)}
        # the frame before the first has none: nothing has moved there
        row = rows.get(frame) or rows.get(frame + 1)
        if row is None:
            raise CaptureError(f"{options.params}: has no row for frame {frame}")
        parameters |= {k: v.strip() for k, v in row.items() if k != "frame"}
    return parameters


@dataclass
class Children:
    """The objects and values that an object of Mitsuba is made of."""

    node: Any
    objects: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    nested: list[Children] = field(default_factory=list)


def list_children(node: Any) -> Children:
    """Ask an object what it is made of."""
    found = Children(node)

    # the base class depends on the variant
    class Callback(mi.TraversalCallback):  # type: ignore[misc]
        def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            if isinstance(value, mi.Object):
                found.objects[name] = value
            elif value is not None:
                found.values[name] = mi.get_property(value, cpptype, node)

        put_object = put_value = put

    node.traverse(Callback())
    if isinstance(node, mi.BSDF):
        inner = (o for o in found.objects.values() if isinstance(o, mi.BSDF))
        found.nested = [list_children(o) for o in inner]
    return found


@dataclass
class World:
    """A scene of one frame, and what of it is looked up by number."""

    scene: Any
    camera: Camera
    shapes: list[Any]
    names: list[str]
    materials: list[Children]
    material_of: list[int]
    meshes: dict[int, tuple[Any, Any]] = field(default_factory=dict)

    def mesh(self, index: int) -> tuple[Any, Any]:
        """Positions and faces of a mesh."""
        if index not in self.meshes:
            mesh = self.shapes[index]
            positions = np.array(mesh.vertex_positions_buffer(), np.float64).reshape(-1, 3)
            faces = np.array(mesh.faces_buffer(), np.int64).reshape(-1, 3)
            self.meshes[index] = positions, faces
        return self.meshes[index]

    def to_world(self, index: int) -> Any | None:
        """Transform of a shape that is no mesh."""
        transform = list_children(self.shapes[index]).values.get("to_world")
        return None if transform is None else read_matrix(transform)


def make_world(scene: Any, sensor: str, size: tuple[int, int] | None) -> World:
    """Number the shapes of a scene and read their materials."""
    shapes = list_shapes(scene)
    materials: list[Children] = []
    found: list[Any] = []
    material_of = []
    for shape in shapes:
        bsdf = list_children(shape).objects.get("bsdf")
        if bsdf is not None and bsdf not in found:
            found.append(bsdf)
            materials.append(list_children(bsdf))
        material_of.append(-1 if bsdf is None else found.index(bsdf))
    return World(
        scene=scene,
        camera=read_camera(choose_sensor(scene, sensor), size),
        shapes=shapes,
        names=name_shapes(shapes),
        materials=materials,
        material_of=material_of,
    )


def list_shapes(parent: Any) -> list[Any]:
    """Shapes, with those in groups."""
    shapes = [o for o in list_children(parent).objects.values() if isinstance(o, mi.Shape)]
    return shapes + [inner for shape in shapes for inner in list_shapes(shape)]


def name_shapes(shapes: list[Any]) -> list[str]:
    """Names of shapes, each once, so that a frame's are those of another."""
    counts: dict[str, int] = {}
    names = []
    for shape in shapes:
        name = shape.id() or shape.class_name()
        counts[name] = counts.get(name, 0) + 1
        names.append(name if counts[name] == 1 else f"{name}#{counts[name]}")
    return names


# --- the camera -------------------------------------------------------------------------------


@dataclass
class Camera:
    """A pinhole: its origin, axes, and the picture's edges in the plane at distance 1."""

    sensor: Any
    size: tuple[int, int]
    origin: Any
    axes: Any
    edges: tuple[float, float, float, float]
    clip: tuple[float, float]

    def to_camera(self, points: Any) -> Any:
        """World to camera: x right, y up, z forward."""
        return (points - self.origin) @ self.axes.T

    def project(self, local: Any) -> Any:
        """Camera to the picture, 0..1, y down."""
        left, right, top, bottom = self.edges
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = local[:, 0] / local[:, 2], local[:, 1] / local[:, 2]
        return np.stack([(x - left) / (right - left), (y - top) / (bottom - top)], -1)

    def matrices(self) -> tuple[Any, Any]:
        """worldToCamera and worldToNDC of row vectors, looking along -z."""
        view = np.eye(4)
        view[:3, :3] = (self.axes * [[1.0], [1.0], [-1.0]]).T
        view[3, :3] = -self.origin @ view[:3, :3]
        left, right, top, bottom = self.edges
        near, far = self.clip
        clip = np.zeros((4, 4))
        clip[0, 0], clip[2, 0] = 2.0 / (right - left), (left + right) / (right - left)
        clip[1, 1], clip[2, 1] = 2.0 / (top - bottom), (top + bottom) / (top - bottom)
        clip[2, 2], clip[3, 2], clip[2, 3] = far / (near - far), near * far / (near - far), -1.0
        return view, view @ clip


def choose_sensor(scene: Any, name: str) -> Any:
    """Sensor by number or id."""
    sensors = scene.sensors()
    for index, sensor in enumerate(sensors):
        if name in (str(index), sensor.id()):
            return sensor
    known = ", ".join(f"{i} ({s.id()})" for i, s in enumerate(sensors))
    raise CaptureError(f"there is no sensor {name}; there are {known or 'none'}")


def read_camera(sensor: Any, size: tuple[int, int] | None) -> Camera:
    """Read a sensor's pinhole off its own rays, whatever it was declared with."""
    parameters = mi.traverse(sensor)
    if size is not None and tuple(sensor.film().crop_size()) != size:
        parameters["film.size"], parameters["film.crop_size"] = list(size), list(size)
        parameters["film.crop_offset"] = [0, 0]
        parameters.update()
    matrix = read_matrix(sensor.world_transform())
    forward, up = (matrix[:3, i] / np.linalg.norm(matrix[:3, i]) for i in (2, 1))
    axes = np.stack([np.cross(forward, up), up, forward])
    slopes = [shoot_axis(sensor, axes, x, y) for x, y in ((0, 0), (1, 1), (0.25, 0.75))]
    (left, top), (right, bottom), seen = slopes
    expected = (left + 0.25 * (right - left), top + 0.75 * (bottom - top))
    # rays of an orthographic sensor are parallel
    if left == right or not np.allclose(seen, expected, atol=1e-4):
        raise CaptureError(f"sensor {sensor.id()} is no pinhole: use a perspective sensor")
    return Camera(
        sensor=sensor,
        size=tuple(int(n) for n in sensor.film().crop_size()),
        origin=matrix[:3, 3],
        axes=axes,
        edges=(left, right, top, bottom),
        clip=(read_number(sensor.near_clip()), read_number(sensor.far_clip())),
    )


def shoot_axis(sensor: Any, axes: Any, x: float, y: float) -> tuple[float, float]:
    """Where a ray meets the plane at distance 1."""
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5, 0.5))
    local = axes @ np.array(ray.d, np.float64).reshape(3)
    if local[2] <= 0:
        raise CaptureError(f"sensor {sensor.id()} is no pinhole: use a perspective sensor")
    return local[0] / local[2], local[1] / local[2]


def read_matrix(transform: Any) -> Any:
    """A transform as 4 x 4 numbers, for column vectors."""
    return np.array(transform.matrix, np.float64).reshape(4, 4)


def read_number(value: Any) -> float:
    """A number of any variant."""
    return float(np.array(value).reshape(-1)[0])


# --- surfaces ---------------------------------------------------------------------------------


@dataclass
class Point:
    """Where a ray meets something, and for which rays that is asked."""

    si: Any
    active: Any


@dataclass
class Surface:
    """What a BSDF is at a point."""

    albedo: Any
    metallic: Any
    roughness: Any
    f0: Any
    opacity: Any
    normal: Any

    def mix(self, other: Surface, weight: Any) -> Surface:
        """`weight` of another."""
        pairs = zip(vars(self).items(), vars(other).values(), strict=True)
        return Surface(**{name: a * (1.0 - weight) + b * weight for (name, a), b in pairs})


def read_color(part: Children, name: str, default: float, at: Point) -> Any:
    """A colour of a BSDF: its texture at the point, its value, or the plug-in's default."""
    if name in part.objects:
        return mi.Color3f(part.objects[name].eval(at.si, at.active))
    return mi.Color3f(part.values.get(name, default))


def read_value(part: Children, name: str, default: float, at: Point) -> Any:
    """A number of a BSDF."""
    if name in part.objects:
        return mi.Float(part.objects[name].eval_1(at.si, at.active))
    return mi.Float(part.values.get(name, default))


def make_surface(at: Point, albedo: Any, f0: Any, *, metallic: float, roughness: Any) -> Surface:
    """An opaque surface."""
    return Surface(
        albedo=mi.Color3f(albedo),
        metallic=mi.Float(metallic),
        roughness=mi.Float(roughness),
        f0=mi.Color3f(f0),
        opacity=mi.Float(1.0),
        normal=mi.Vector3f(at.si.sh_frame.n),
    )


def find_fresnel(eta: Any, k: Any) -> Any:
    """Reflectance at normal incidence of an index of refraction eta + i k."""
    return ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)


def read_conductor(part: Children, at: Point) -> Surface:
    """A metal: its base colour is F0."""
    eta, k = read_color(part, "eta", 0.0, at), read_color(part, "k", 1.0, at)
    f0 = find_fresnel(eta, k) * read_color(part, "specular_reflectance", 1.0, at)
    return make_surface(at, f0, f0, metallic=1.0, roughness=read_roughness(part, at))


def read_roughness(part: Children, at: Point) -> Any:
    """Perceptual roughness: alpha is its square."""
    name = "alpha_u" if {"alpha_u"} & {*part.objects, *part.values} else "alpha"
    alpha = read_value(part, name, 0.0, at)
    if name == "alpha_u":
        alpha = 0.5 * (alpha + read_value(part, "alpha_v", 0.0, at))
    return mi.Float(alpha) ** 0.5


def read_plastic(part: Children, at: Point) -> Surface:
    """A diffuse base below a dielectric coat."""
    f0 = find_fresnel(read_value(part, "eta", 1.49, at), 0.0)
    f0 = read_color(part, "specular_reflectance", 1.0, at) * f0
    albedo = read_color(part, "diffuse_reflectance", 0.5, at)
    return make_surface(at, albedo, f0, metallic=0.0, roughness=read_roughness(part, at))


def read_principled(part: Children, at: Point) -> Surface:
    """The material of engines."""
    color = read_color(part, "base_color", 0.5, at)
    if "eta" in part.values or "eta" in part.objects:
        dielectric = find_fresnel(read_value(part, "eta", 1.5, at), 0.0)
    else:
        dielectric = read_value(part, "specular", 0.5, at) * 0.08
    metallic = read_value(part, "metallic", 0.0, at)
    f0 = mi.Color3f(dielectric) * (1.0 - metallic) + color * metallic
    roughness = read_value(part, "roughness", 0.5, at)
    return make_surface(at, color, f0, metallic=metallic, roughness=roughness)


def read_dielectric(part: Children, at: Point) -> Surface:
    """What is seen through it is not its own: nothing much to divide by."""
    tint = read_color(part, "specular_transmittance", 1.0, at)
    f0 = find_fresnel(read_value(part, "eta", 1.5, at), 0.0)
    return make_surface(at, tint, f0, metallic=0.0, roughness=read_roughness(part, at))


def read_diffuse(part: Children, at: Point) -> Surface:
    """No more than a colour."""
    color = read_color(part, "reflectance", 0.5, at)
    return make_surface(at, color, 0.0, metallic=0.0, roughness=1.0)


def read_other(part: Children, at: Point) -> Surface:
    """Whatever a BSDF says that its diffuse part is."""
    color = part.node.eval_diffuse_reflectance(at.si, at.active)
    return make_surface(at, color, 0.04, metallic=0.0, roughness=1.0)


def read_two_sides(part: Children, at: Point) -> Surface:
    """The front, and the back where the ray meets it."""
    sides = [read_surface(side, at) for side in part.nested]
    behind = mi.Float(1.0) * (at.si.wi.z < 0)
    return sides[0].mix(sides[-1], behind)


def read_mask(part: Children, at: Point) -> Surface:
    """What is below, where it is not cut out."""
    surface = read_nested(part, at)
    surface.opacity = read_value(part, "opacity", 1.0, at)
    return surface


def read_blend(part: Children, at: Point) -> Surface:
    """The first to the second, by weight."""
    first, second = (read_surface(side, at) for side in part.nested)
    return first.mix(second, read_value(part, "weight", 0.5, at))


def read_normal_map(part: Children, at: Point) -> Surface:
    """What is below, turned."""
    surface = read_nested(part, at)
    texture = part.objects.get("normalmap")
    if texture is not None:
        stored = mi.Vector3f(texture.eval_3(at.si, at.active)) * 2.0 - 1.0
        surface.normal = at.si.sh_frame.to_world(stored)
    return surface


def read_nested(part: Children, at: Point) -> Surface:
    """What is below."""
    return read_surface(part.nested[0], at)


def read_nothing(part: Children, at: Point) -> Surface:
    """The border of a medium is no surface."""
    surface = make_surface(at, 0.0, 0.0, metallic=0.0, roughness=1.0)
    surface.opacity = mi.Float(0.0)
    return surface


READERS: dict[str, Callable[[Children, Any], Surface]] = {
    "SmoothDiffuse": read_diffuse,
    "SmoothConductor": read_conductor,
    "RoughConductor": read_conductor,
    "SmoothPlastic": read_plastic,
    "RoughPlastic": read_plastic,
    "PolarizedPlastic": read_plastic,
    "Principled": read_principled,
    "PrincipledThin": read_principled,
    "SmoothDielectric": read_dielectric,
    "RoughDielectric": read_dielectric,
    "ThinDielectric": read_dielectric,
    "TwoSidedBRDF": read_two_sides,
    "TwoSided": read_two_sides,
    "MaskBSDF": read_mask,
    "BlendBSDF": read_blend,
    "BumpMap": read_nested,
    "NormalMap": read_normal_map,
    "Null": read_nothing,
}
"""By the class that a plug-in makes."""


def read_surface(part: Children, at: Point) -> Surface:
    """A BSDF at a point."""
    return READERS.get(part.node.class_name(), read_other)(part, at)


# --- rays -------------------------------------------------------------------------------------


def is_scalar() -> bool:
    """Tell whether values are single numbers."""
    return str(mi.variant()).startswith("scalar")


def to_array(values: Any, width: int) -> Any:
    """N x width numbers of what Mitsuba returns."""
    array = np.array(values, np.float64)
    return array.reshape(width, -1).T if array.ndim else array.reshape(1, 1)


def shoot_surfaces(world: World, x: Any, y: Any) -> Arrays:
    """What rays through places of the picture (0..1, y down) meet first."""
    if not is_scalar():
        return shoot_block(world, mi.Point2f(x, y))
    rows = [shoot_block(world, mi.Point2f(*at)) for at in zip(x, y, strict=True)]
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def shoot_block(world: World, place: Any) -> Arrays:
    """As many rays as a variant traces at once."""
    ray, _ = world.camera.sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5, 0.5))
    for _ in range(LAYERS):
        hit = world.scene.ray_intersect_preliminary(ray)
        si = hit.compute_surface_interaction(ray)
        evaluate(hit, si)
        # of instances the preliminary intersection has no shape
        shape, instance = number_shapes(world, si.shape), number_shapes(world, si.instance)
        arrays = shade(world, si, shape)
        passes = (arrays["opacity"][:, 0] < 0.5) & (shape >= 0)
        if not passes.any():
            break
        ray = step_through(si, ray, passes)
    emitter = si.emitter(world.scene)
    emission = emitter.eval(si) if not is_scalar() or emitter is not None else mi.Color3f(0.0)
    evaluate(emission)
    arrays |= {
        "shape": shape,
        "instance": instance,
        "prim": to_array(hit.prim_index, 1)[:, 0].astype(np.int64),
        "bary": to_array(hit.prim_uv, 2),
        "point": to_array(si.p, 3),
        "ray": to_array(ray.d, 3),
        "geonormal": to_array(si.n, 3),
        "emission": to_array(emission, 3),
    }
    return arrays


def evaluate(*values: Any) -> None:
    """Compute what was asked for until here, once."""
    if not is_scalar():
        dr.eval(*values)


def step_through(si: Any, ray: Any, passes: Any) -> Any:
    """Go on behind what is cut out."""
    if is_scalar():
        return si.spawn_ray(ray.d)
    onward = si.spawn_ray(ray.d)
    mask = mi.Bool(passes)
    ray.o = dr.select(mask, onward.o, ray.o)
    ray.maxt = dr.select(mask, onward.maxt, ray.maxt)
    return ray


def number_shapes(world: World, found: Any) -> Any:
    """Index of shapes; -1 is none."""
    if is_scalar():
        return np.array([-1 if found is None else world.shapes.index(found)])
    ids = np.array(dr.reinterpret_array(mi.UInt32, found))
    table = {0: -1}
    for index, shape in enumerate(world.shapes):
        table[int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])] = index
    keys, places = np.unique(ids, return_inverse=True)
    return np.array([table.get(int(key), -1) for key in keys])[places.reshape(-1)]


WIDTHS = {"albedo": 3, "metallic": 1, "roughness": 1, "f0": 3, "opacity": 1, "normal": 3}


def shade(world: World, si: Any, shape: Any) -> Arrays:
    """Materials of what was met; nothing for the sky."""
    kinds = np.append(world.material_of, -1)[shape]
    met = [int(kind) for kind in np.unique(kinds[kinds >= 0])]
    if is_scalar():
        values = vars(read_surface(world.materials[met[0]], Point(si, True))) if met else {}
    else:
        values = shade_together(world, si, kinds, met)
    empty = np.zeros((len(shape), 1))
    return {
        name: to_array(values[name], width) + empty if met else np.zeros((len(shape), width))
        for name, width in WIDTHS.items()
    }


def shade_together(world: World, si: Any, kinds: Any, met: list[int]) -> Arrays:
    """All materials in one kernel: compiling one takes longer than running it."""
    number = mi.Int32(kinds.astype(np.int32))
    values: Arrays = {}
    for kind in met:
        active = number == kind
        surface = vars(read_surface(world.materials[kind], Point(si, active)))
        values = {
            name: dr.select(active, value, values.get(name, dr.zeros(type(value))))
            for name, value in surface.items()
        }
    dr.eval(values)
    return values


@dataclass
class Rays:
    """How a picture is sampled: `spread` is a pixel's size, of 0..1; none is a point."""

    samples: int
    seed: int
    spread: tuple[float, float] = (0.0, 0.0)
    lost: int = 0

    def count(self, color: Any) -> Any:
        """Samples that are no numbers are black, and counted."""
        finite = np.isfinite(color).all(-1, keepdims=True)
        self.lost += int(np.count_nonzero(~finite))
        return np.where(finite, color, 0.0)


def shoot_radiance(world: World, x: Any, y: Any, plan: Rays) -> Any:
    """Mean radiance along rays."""
    integrator = world.scene.integrator()
    if integrator is None or not hasattr(integrator, "sample"):
        integrator = mi.load_dict({"type": "path"})
    sampler = mi.load_dict({"type": "independent", "sample_count": 1})
    shoot = trace_singly if is_scalar() else trace_together
    return shoot(world, integrator, sampler, (x, y), plan) / plan.samples


def trace_singly(world: World, integrator: Any, sampler: Any, at: Any, plan: Rays) -> Any:
    """One ray after the other."""
    sampler.seed(plan.seed, 1)
    total = np.zeros((len(at[0]), 3))
    for index, (x, y) in enumerate(zip(*at, strict=True)):
        for _ in range(plan.samples):
            offset = sampler.next_2d() if any(plan.spread) else (0.5, 0.5)
            place = mi.Point2f(
                x + (offset[0] - 0.5) * plan.spread[0], y + (offset[1] - 0.5) * plan.spread[1]
            )
            total[index] += plan.count(np.array(trace(world, integrator, sampler, place)))
    return total


def trace_together(world: World, integrator: Any, sampler: Any, at: Any, plan: Rays) -> Any:
    """As many rays as memory holds."""
    count = len(at[0])
    together = max(1, min(plan.samples, LANES // count))
    total, done = np.zeros((count, 3)), 0
    while done < plan.samples:
        now = min(together, plan.samples - done)
        sampler.seed(plan.seed * 8191 + done, count * now)
        x, y = (mi.Float(np.repeat(values, now)) for values in at)
        if any(plan.spread):
            offset = sampler.next_2d()
            x += (offset.x - 0.5) * plan.spread[0]
            y += (offset.y - 0.5) * plan.spread[1]
        color = to_array(trace(world, integrator, sampler, mi.Point2f(x, y)), 3)
        color = plan.count(color)
        total += color.reshape(count, now, 3).sum(1)
        done += now
    return total


def trace(world: World, integrator: Any, sampler: Any, place: Any) -> Any:
    """Radiance along rays."""
    ray, weight = world.camera.sensor.sample_ray_differential(
        0.0, sampler.next_1d(), place, mi.Point2f(0.5, 0.5)
    )
    color = integrator.sample(world.scene, sampler, ray)[0]
    return color * weight


# --- frames -----------------------------------------------------------------------------------


def move_points(now: World, before: World, found: Arrays, still: set[str]) -> Any:
    """Where surface points were in the frame before."""
    points = found["point"].copy()
    for shape, instance in np.unique(np.stack([found["shape"], found["instance"]], 1), axis=0):
        if shape < 0:
            continue
        chosen = (found["shape"] == shape) & (found["instance"] == instance)
        part = {name: found[name][chosen] for name in ("point", "prim", "bary")}
        local = part["point"]
        if instance >= 0:
            matrices = pair_transforms(now, before, instance, still)
            local = transform(local, np.linalg.inv(matrices[0]))
        local = move_shape(now, before, shape, {**part, "point": local}, still)
        points[chosen] = transform(local, matrices[1]) if instance >= 0 else local
    return points


def move_shape(now: World, before: World, shape: int, part: Arrays, still: set[str]) -> Any:
    """Points of one shape: by its vertices where it has any, else by its transform."""
    name, points = now.names[shape], part["point"]
    if name not in before.names:
        still.add(f"{name} (not there in the frame before)")
        return points
    other = before.names.index(name)
    if not now.shapes[shape].is_mesh():
        first, second = pair_transforms(now, before, shape, still)
        return (
            points if (first == second).all() else transform(points, second @ np.linalg.inv(first))
        )
    (positions, faces), (earlier, earlier_faces) = now.mesh(shape), before.mesh(other)
    if faces.shape != earlier_faces.shape or positions.shape != earlier.shape:
        still.add(f"{name} (its mesh is another)")
        return points
    corners = faces[part["prim"]]
    u, v = part["bary"].T[:, :, None]
    weights = (1.0 - u - v, u, v)
    moved = sum(w * (earlier - positions)[corners[:, i]] for i, w in enumerate(weights))
    return points + moved


def pair_transforms(now: World, before: World, index: int, still: set[str]) -> tuple[Any, Any]:
    """To-world matrices of a shape, now and before."""
    name = now.names[index]
    first = now.to_world(index)
    second = before.to_world(before.names.index(name)) if name in before.names else None
    if first is None or second is None:
        still.add(f"{name} (its motion cannot be known)")
        return np.eye(4), np.eye(4)
    return first, second


def transform(points: Any, matrix: Any) -> Any:
    """Points times a matrix for column vectors."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def find_motion(
    now: World, before: World, found: Arrays, size: tuple[int, int], still: set[str]
) -> Any:
    """Pixels from where a point is to where it was, y down; of the sky what turns."""
    sky = found["shape"] < 0
    points = move_points(now, before, found, still)
    current = now.camera.to_camera(found["point"])
    earlier = before.camera.to_camera(points)
    current[sky] = found["ray"][sky] @ now.camera.axes.T
    earlier[sky] = found["ray"][sky] @ before.camera.axes.T
    motion = (before.camera.project(earlier) - now.camera.project(current)) * size
    # what was behind the camera was nowhere in the picture
    behind = ~np.isfinite(motion).all(1) | (earlier[:, 2] <= 0)
    motion[behind] = 2.0 * np.array(size)
    return np.clip(motion, -2.0 * max(size), 2.0 * max(size))


def render_frame(shot: Shot, frame: int, role: Role) -> Arrays:
    """All channels of a file."""
    now, before = shot.world(frame), shot.world(frame - 1, fallback=frame)
    width, height = role.size
    jitter = shot.jitter(frame) if role.jittered else (0.0, 0.0)
    y, x = (axis.reshape(-1) for axis in np.mgrid[0:height, 0:width])
    at = (x + 0.5 + jitter[0]) / width, (y + 0.5 + jitter[1]) / height
    found = shoot_surfaces(now, *at)
    motion = find_motion(now, before, found, role.size, shot.still)
    depth = now.camera.to_camera(found["point"])[:, 2]
    sky = found["shape"] < 0
    normal, geonormal = (turn_normals(found[n], found) for n in ("normal", "geonormal"))
    planes = {
        **name_planes("albedo", "RGB", found["albedo"]),
        **name_planes("specular", "RGB", found["f0"]),
        "metallic": found["metallic"][:, 0],
        "roughness": found["roughness"][:, 0],
        **name_planes("normal", "XYZ", normal),
        **name_planes("geonormal", "XYZ", geonormal),
        "depth.Z": np.where(sky, SKY_DEPTH, depth),
        **name_planes("position", "XYZ", np.where(sky[:, None], 0.0, found["point"])),
        **name_planes("motion", "XY", motion),
        **name_planes("emission", "RGB", found["emission"]),
        "objectid": shot.number_objects(now, found),
    }
    if role.samples:
        spread = (0.0, 0.0) if shot.points else (1.0 / width, 1.0 / height)
        rays = Rays(samples=role.samples, seed=frame * 4 + role.seed, spread=spread)
        planes |= name_planes("", "RGB", shoot_radiance(now, *at, rays))
        shot.lost += rays.lost
    return {name: plane.reshape(height, width) for name, plane in planes.items()}


def turn_normals(normals: Any, found: Arrays) -> Any:
    """Unit normals on the side that is seen; 0 on the sky."""
    away = (found["geonormal"] * found["ray"]).sum(1, keepdims=True) > 0
    lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    turned = np.where(away, -normals, normals) / lengths
    return np.where(found["shape"][:, None] < 0, 0.0, turned)


def name_planes(prefix: str, letters: str, values: Any) -> Arrays:
    """Channels of a buffer."""
    dot = "." if prefix else ""
    return {f"{prefix}{dot}{letter}": values[:, i] for i, letter in enumerate(letters)}


@dataclass
class Role:
    """One of the files of a frame; no samples is no radiance."""

    folder: Path
    size: tuple[int, int]
    samples: int
    seed: int
    jittered: bool


@dataclass
class Shot:
    """What a run makes, and what it notices."""

    source: Source
    options: argparse.Namespace
    ids: dict[str, int]
    still: set[str] = field(default_factory=set)
    lost: int = 0

    @property
    def points(self) -> bool:
        """Tell whether every ray goes through one place of its pixel."""
        return bool(self.options.point_sampling)

    def world(self, frame: int, fallback: int | None = None) -> World:
        """Scene of a frame, or, before the first there is, of another."""
        try:
            return self.source.at(frame, self.options.sensor, self.options.size)
        except Exception as error:
            if fallback is None or isinstance(error, CaptureError):
                raise
            self.still.add(f"everything in frame {fallback} (no frame {frame}: {error})")
            return self.world(fallback)

    def jitter(self, frame: int) -> tuple[float, float]:
        """Offset of a frame in its own pixels."""
        if self.options.jitter == "none":
            return 0.0, 0.0
        index = (frame - 1) % jitter_period(self.options) + 1
        return radical_inverse(index, 2) - 0.5, radical_inverse(index, 3) - 0.5

    def number_objects(self, world: World, found: Arrays) -> Any:
        """A number for each object and instance, the same in all frames; 0 is the sky."""
        pairs = np.stack([found["shape"], found["instance"]], 1)
        keys, places = np.unique(pairs, axis=0, return_inverse=True)
        numbers = [self.number(world, int(s), int(i)) for s, i in keys]
        return np.array(numbers, np.float64)[places.reshape(-1)]

    def number(self, world: World, shape: int, instance: int) -> int:
        """The number of an object by its name."""
        if shape < 0:
            return 0
        name = world.names[shape]
        name = f"{world.names[instance]}/{name}" if instance >= 0 else name
        return self.ids.setdefault(name, max(self.ids.values(), default=0) + 1)


def jitter_period(options: argparse.Namespace) -> int:
    """Frames until the pattern comes again: 8 S^2."""
    return 8 * int(options.scale or 1) ** 2


def radical_inverse(index: int, base: int) -> float:
    """Element of the van der Corput sequence."""
    result, digit = 0.0, 1.0
    while index:
        digit /= base
        index, remainder = divmod(index, base)
        result += remainder * digit
    return result


# --- files ------------------------------------------------------------------------------------


def write_frame(path: Path, planes: Arrays, camera: Camera, frame: int) -> None:
    """Write a file beside, then name it."""
    names = list(planes)
    image = np.ascontiguousarray(np.stack([planes[n] for n in names], -1), np.float32)
    bitmap = mi.Bitmap(image, channel_names=names)
    metadata = bitmap.metadata()
    view, projection = camera.matrices()
    # a transform is written row by row as it is
    metadata["worldToCamera"] = mi.ScalarTransform4f(view)
    metadata["worldToNDC"] = mi.ScalarTransform4f(projection)
    metadata["frame"] = frame
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".capture-", dir=path.parent) as folder:
        beside = Path(folder) / path.name
        bitmap.write(str(beside))
        beside.replace(path)


def write_text(path: Path, text: str) -> None:
    """Write a text beside, then name it."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)


def declare(options: argparse.Namespace) -> str:
    """What capture.toml says."""
    jitter = "[0.0, 0.0]"
    if options.jitter == "halton":
        jitter = f'{{pattern = "halton", period = {jitter_period(options)}, first_frame = 1}}'
    lines = [
        "# what the frames beside this file hold; every field is optional, see docs/frames.md",
        'layout = "rtsr"',
        *([f"scale = {options.scale}"] if options.scale else []),
        'roughness = "perceptual"',
        'colorspace = "lin_rec709"',
        f"jitter_px = {jitter}",
        '[motion]\nunit = "pixels"\ndirection = "previous-minus-current"',
        'y_axis = "down"\njittered = false',
        f'[depth]\nkind = "planar"\nunit = "{options.unit}"',
        '[normal]\nspace = "world"\npacked = false',
        f'[position]\nunit = "{options.unit}"',
    ]
    return "\n".join(lines) + "\n"


def check_declaration(path: Path, text: str, *, overwrite: bool) -> None:
    """Keep a capture.toml that is there if the frames beside it were made alike."""
    if not path.exists() or overwrite:
        write_text(path, text)
        return
    for key in ("scale", "jitter_px"):
        there, wanted = (
            [line for line in content.splitlines() if line.split("=")[0].strip() == key]
            for content in (path.read_text(encoding="utf-8"), text)
        )
        if there != wanted:
            told = (there or [f"no {key}"])[0]
            raise CaptureError(
                f"{path}: the frames there were made with {told}; --overwrite, or another OUT"
            )


# --- the run ----------------------------------------------------------------------------------


def main(arguments: list[str] | None = None) -> None:
    """Render what is not there yet."""
    options = parse(arguments)
    mi.set_variant(choose_variant(options.variant))
    try:
        run(options)
    except CaptureError as error:
        sys.exit(f"mitsuba.py: {error}")


def run(options: argparse.Namespace) -> None:
    """Render frame after frame."""
    numbers = options.out / "objects.json"
    known = json.loads(numbers.read_text(encoding="utf-8")) if numbers.exists() else {}
    shot = Shot(source=open_source(options), options=options, ids=known)
    # nothing is written for a scene that cannot be rendered
    list(list_roles(shot, options.frames[0]))
    shot.world(options.frames[0])
    options.out.mkdir(parents=True, exist_ok=True)
    check_declaration(options.out / "capture.toml", declare(options), overwrite=options.overwrite)
    print(f"mitsuba {mi.__version__}, {mi.variant()}")
    for frame in options.frames:
        for role in list_roles(shot, frame):
            path = role.folder / f"frame.{frame:04d}.exr"
            if path.exists() and not options.overwrite:
                print(f"{path}: kept")
                continue
            started = time.perf_counter()
            planes = render_frame(shot, frame, role)
            write_text(numbers, json.dumps(shot.ids, indent=1) + "\n")
            write_frame(path, planes, shot.world(frame).camera, frame)
            print(f"{path}: {time.perf_counter() - started:.1f} s", flush=True)
    for name in sorted(shot.still):
        print(f"taken as still: {name}")
    if shot.lost:
        print(f"{shot.lost} samples were no numbers, and count as black")


def list_roles(shot: Shot, frame: int) -> Iterator[Role]:
    """Files of a frame."""
    options = shot.options
    size = options.size or shot.world(frame).camera.size
    if not options.scale:
        yield Role(options.out, size, options.samples, 0, jittered=True)
        return
    if any(n % options.scale for n in size):
        wanted = "x".join(str(n - n % options.scale) for n in size)
        raise CaptureError(
            f"{size[0]}x{size[1]} is no multiple of {options.scale}: --size {wanted}"
        )
    small = (size[0] // options.scale, size[1] // options.scale)
    reference = 0 if options.no_reference else options.reference_samples or options.samples
    yield Role(options.out / "lr", small, options.samples, 0, jittered=True)
    yield Role(options.out / "hr", size, reference, 1, jittered=False)


def choose_variant(asked: str) -> str:
    """Find out what works here."""
    if asked != "auto":
        return asked
    tried = subprocess.run(
        [sys.executable, "-c", PROBE], capture_output=True, check=False, cwd=tempfile.gettempdir()
    )
    if tried.returncode == 0:
        return VECTOR
    print(
        f"{VECTOR} does not work here: {SCALAR} is used, which is slow. It needs LLVM, newer "
        "than 15; DRJIT_LIBLLVM_PATH names its library",
        file=sys.stderr,
    )
    return SCALAR


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    text, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        description=text, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="my_scene.py or my_scene.xml")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the shot")
    parser.add_argument("--frames", type=read_range, default=range(1, 9), help="A-B [1-8]")
    parser.add_argument("--size", type=read_size, help="WxH of the HR frames [the film's]")
    parser.add_argument("--scale", type=int, help="write lr/ and hr/, hr/ this much larger")
    parser.add_argument("--jitter", choices=("none", "halton"), default="none")
    parser.add_argument("--samples", type=int, default=64, help="paths a pixel [64]")
    parser.add_argument("--reference-samples", type=int, help="of hr/ [as many]")
    parser.add_argument(
        "--no-reference", action="store_true", help="no radiance in hr/: much faster"
    )
    parser.add_argument(
        "--point-sampling",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="radiance of one place of the pixel, not its mean [yes]",
    )
    parser.add_argument("--sensor", default="0", help="number or id, of several [0]")
    parser.add_argument("--unit", default="m", help="the scene's: m, cm, mm, in, ft, km [m]")
    parser.add_argument("--variant", default="auto", help=f"{VECTOR}, {SCALAR}, cuda_ad_rgb [auto]")
    parser.add_argument(
        "--define", action="append", default=[], metavar="NAME=VALUE", help="parameter of an XML"
    )
    parser.add_argument("--params", type=Path, metavar="CSV", help="parameters of an XML by frame")
    parser.add_argument("--overwrite", action="store_true", help="render what is there again")
    options = parser.parse_args(arguments)
    if options.scale is not None and options.scale < 1:
        parser.error("--scale is 1 or more")
    if options.samples < 1:
        parser.error("--samples is 1 or more")
    return options


def read_range(text: str) -> range:
    """A-B, or A."""
    first, _, last = text.partition("-")
    numbers = range(int(first), int(last or first) + 1)
    if not numbers:
        raise argparse.ArgumentTypeError(f"{text} holds no frame")
    return numbers


def read_size(text: str) -> tuple[int, int]:
    """WxH."""
    width, height = (int(part) for part in text.lower().split("x"))
    return width, height


if __name__ == "__main__":
    main()
