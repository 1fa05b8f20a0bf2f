"""Capture any Blender scene for rtsr: passes, AOVs, camera and `capture.toml`, in one command.

    blender -b scene.blend -P blender.py -- OUT [options]
    python blender.py scene.blend OUT [options]          # with `pip install bpy`

OUT/*.exr, or with `--scale S` OUT/lr/*.exr (a sample a pixel centre, jittered) and OUT/hr/*.exr
(every buffer; its radiance is the reference). Then, without any edit:

    rtsr upscale OUT result --system fusesr
    rtsr evaluate result --ref OUT/hr

The scene is changed in memory only; nothing is saved to the .blend.
Tested with Blender 4.5 and 5.0, Cycles.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

DIFFUSE_GREY = 0.8
"""Colour of what has no material, in Cycles."""

UNKNOWN_COLOR = 0.5
"""Base colour of surfaces that nothing is known of."""

POINT_FILTER_PX = 0.01
"""The narrowest pixel filter that Cycles has: every sample at the pixel's centre."""

HALTON_BASES, HALTON_PERIOD = (2, 3), 128

PASSES = ("combined", "z", "vector", "normal", "position", "emit", "environment", "object_index")
"""Passes that are written; `use_pass_` in front of them."""

CAPTURE_FILE, CAMERA_FILE = "capture.toml", "camera.csv"

SETTINGS_MARK = "# Written by rtsr's blender.py: "

MOTION = {
    "unit": '"pixels"',
    "direction": '"previous-minus-current"',
    "y_axis": '"up"',
    "jittered": "false",
}
"""How Blender stores the first two components of `Vector`."""

COLOR_SPACES = {"lin_rec709", "lin_rec2020", "lin_p3d65", "lin_ap1", "lin_ap0"}

REFUSED = 3
"""Exit code where the scene or an option stands in the way."""

AOVS = {"albedo": "COLOR", "metallic": "VALUE", "roughness": "VALUE"}

VIEW_COSINE = "nov"
"""AOV that stands in for the matrices of orthographic cameras."""

SMALLEST_MOVE = 1e-6
"""Of the picture, where the lens is shifted by its sensor's size."""


class CaptureError(Exception):
    """What the user can mend; the message says how."""


# --- options ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line asks for.

    Attributes:
        out: folder.
        scale: HR pixels per LR pixel, 1 for a single capture.
        jitter: whether LR (or single, point-sampled) frames are jittered.
        samples: light paths a pixel; None for the scene's.
        lr_samples: the same of LR frames; None for `samples`.
        point_sampling: whether samples lie at pixel centres.
        frames: first and last, or None for the scene's.
        size: (width, height), or None for the scene's.
        engine: identifiers to try in turn, or None for the scene's.
        layer: view layer, or None for the only one in use.
        overwrite: whether frames that are there are rendered again.
        keep_passes: whether other passes of the scene are written, too.
        denoise: whether the scene's denoising stays on.
    """

    out: Path
    scale: int
    jitter: bool
    samples: int | None
    lr_samples: int | None
    point_sampling: bool
    frames: tuple[int, int] | None
    size: tuple[int, int] | None
    engine: tuple[str, ...] | None
    layer: str | None
    overwrite: bool
    keep_passes: bool
    denoise: bool


ENGINES = {"cycles": ("CYCLES",), "eevee": ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT")}


def parse_range(text: str) -> tuple[int, int]:
    """Read `A-B` or `A`."""
    first, _, last = text.partition("-")
    return read_numbers(first, last or first, example="1-24")


def parse_size(text: str) -> tuple[int, int]:
    """Read `WxH`."""
    width, _, height = text.lower().partition("x")
    return read_numbers(width, height, example="1280x720")


def read_numbers(first: str, second: str, *, example: str) -> tuple[int, int]:
    """Read two whole numbers.

    Raises:
        ArgumentTypeError: they are none.
    """
    if not (first.isdecimal() and second.isdecimal()):
        raise argparse.ArgumentTypeError(f"write it like {example}")
    return int(first), int(second)


def make_parser() -> argparse.ArgumentParser:
    """Make the parser of what stands behind the scene."""
    parser = argparse.ArgumentParser(prog="blender.py", description=__doc__.split("\n\n")[0])
    add = parser.add_argument
    add("out", type=Path, metavar="OUT")
    add("--scale", type=int, choices=(2, 3, 4, 6, 8), default=1, help="write LR/HR pairs")
    add("--jitter", choices=("halton", "none"), help="of LR frames; halton with --scale")
    add("--samples", type=int, metavar="N", help="light paths a pixel; the scene's by default")
    add("--lr-samples", type=int, metavar="N", help="of LR frames; as --samples by default")
    add("--point-sampling", action="store_true", help="no pixel filter; always so with --scale")
    add("--frames", type=parse_range, metavar="A-B", help="the scene's by default")
    add("--size", type=parse_size, metavar="WxH", help="of HR frames; the scene's by default")
    add("--engine", choices=sorted(ENGINES), help="eevee needs a GPU, or a screen")
    add("--layer", metavar="NAME", help="view layer; needed where several are in use")
    add("--overwrite", action="store_true", help="render frames that are there again")
    add("--resume", action="store_true", help="keep frames that are there (as by default)")
    add("--keep-passes", action="store_true", help="write the scene's other passes, too")
    add("--denoise", action="store_true", help="leave the scene's denoising on")
    return parser


def parse_options(arguments: list[str]) -> Options:
    """Read the command line."""
    given = make_parser().parse_args(arguments)
    pair = given.scale > 1
    return Options(
        out=given.out.absolute(),
        scale=given.scale,
        jitter=given.jitter == "halton" or (pair and given.jitter is None),
        samples=given.samples,
        lr_samples=given.lr_samples or given.samples,
        point_sampling=given.point_sampling or pair,
        frames=given.frames,
        size=given.size,
        engine=ENGINES[given.engine] if given.engine else None,
        layer=given.layer,
        overwrite=given.overwrite,
        keep_passes=given.keep_passes,
        denoise=given.denoise,
    )


# --- what surfaces are made of ----------------------------------------------------------------

Socket = bpy.types.NodeSocket

Value = float | tuple[float, ...] | Socket | None
"""A number, three numbers, or the output socket of a node in the tree at hand."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """What a shader reflects; None where it says nothing of it.

    Attributes:
        base: base colour.
        metallic: 0..1.
        roughness: perceptual, as Blender's sliders are.
        alpha: 0 where light passes straight through.
    """

    base: Value = None
    metallic: Value = None
    roughness: Value = None
    alpha: Value = 1.0


DARK = Surface(base=(0.0, 0.0, 0.0))
CLEAR = Surface(alpha=0.0)


@dataclass(frozen=True)
class Leaf:
    """How a node of one kind is read: names of inputs, or constants."""

    base: tuple[str, ...] = ("Base Color", "Color")
    metallic: str | float = 0.0
    roughness: str | float = "Roughness"


LEAVES = {
    "BSDF_PRINCIPLED": Leaf(metallic="Metallic"),
    "BSDF_DIFFUSE": Leaf(roughness=1.0),
    "BSDF_GLOSSY": Leaf(metallic=1.0),
    "BSDF_METALLIC": Leaf(metallic=1.0),
    "BSDF_GLASS": Leaf(),
    "BSDF_REFRACTION": Leaf(),
    "BSDF_TRANSLUCENT": Leaf(roughness=1.0),
    "BSDF_SHEEN": Leaf(),
    "BSDF_TOON": Leaf(roughness=1.0),
    "BSDF_HAIR": Leaf(roughness="RoughnessU"),
    "BSDF_HAIR_PRINCIPLED": Leaf(),
    "SUBSURFACE_SCATTERING": Leaf(roughness=1.0),
    "EEVEE_SPECULAR": Leaf(),
}
EXACT = {"BSDF_PRINCIPLED", "BSDF_DIFFUSE", "BSDF_METALLIC", "EMISSION", "BSDF_TRANSPARENT"}
DARK_KINDS = {"EMISSION", "HOLDOUT", "BACKGROUND", "VOLUME_ABSORPTION", "VOLUME_SCATTER"}


@dataclass
class ShaderReader:
    """Follows shaders from the output of a tree, and adds nodes that compute what they are made of.

    Attributes:
        approximated: kinds of nodes that were read roughly, by material.
    """

    approximated: dict[str, set[str]] = field(default_factory=dict)
    _material: str = ""
    _groups: dict[tuple[str, str], Surface] = field(default_factory=dict)

    def read_material(self, material: bpy.types.Material, target: str) -> Surface:
        """Return what the surface of a material is made of, for one engine."""
        self._material = material.name
        output = material.node_tree.get_output_node(target)
        if output is None:
            return DARK
        return self._read_input(output.inputs["Surface"], material.node_tree)

    def _read_input(self, socket: Socket, tree: bpy.types.NodeTree) -> Surface:
        source = find_source(socket)
        if source is None:
            return DARK
        node = source.node
        if node.type in {"MIX_SHADER", "ADD_SHADER"}:
            first, second = (self._read_input(s, tree) for s in list(node.inputs)[-2:])
            if node.type == "ADD_SHADER":
                return add_surfaces(tree, first, second)
            return mix_surfaces(tree, first, second, read_value(node.inputs[0]))
        if node.type == "GROUP" and node.node_tree is not None:
            return self._read_group(node, source.identifier)
        if node.type not in EXACT:
            self.approximated.setdefault(self._material, set()).add(node.bl_label)
        if node.type == "BSDF_TRANSPARENT":
            return CLEAR
        return DARK if node.type in DARK_KINDS else read_leaf(node)

    def _read_group(self, node: bpy.types.Node, identifier: str) -> Surface:
        """Return what a group's shader is made of, from outputs that are added to the group."""
        key = (node.node_tree.name_full, identifier)
        if key not in self._groups:
            self._groups[key] = self._expose_group(node.node_tree, identifier)
        outputs = {s.identifier: s for s in node.outputs}
        parts = vars(self._groups[key]).items()
        return Surface(**{n: outputs[v] if isinstance(v, str) else v for n, v in parts})

    def _expose_group(self, tree: bpy.types.NodeTree, identifier: str) -> Surface:
        """Give a group outputs for what one of its shaders is made of; their identifiers."""
        output = next(
            (n for n in tree.nodes if n.type == "GROUP_OUTPUT" and n.is_active_output), None
        )
        if output is None:
            return DARK
        surface = self._read_input(find_socket(output.inputs, identifier), tree)
        exposed = dict(vars(surface))
        for name, value in exposed.items():
            if is_socket(value):
                kind = "NodeSocketColor" if name == "base" else "NodeSocketFloat"
                item = tree.interface.new_socket(f"rtsr {name}", in_out="OUTPUT", socket_type=kind)
                tree.links.new(value, find_socket(output.inputs, item.identifier))
                exposed[name] = item.identifier
        return Surface(**exposed)


def find_socket(sockets: Iterable[Socket], identifier: str) -> Socket:
    """Return the socket of an identifier, which is unique where names are not."""
    return next(s for s in sockets if s.identifier == identifier)


def find_source(socket: Socket) -> Socket | None:
    """Return the socket that feeds an input, through reroutes and muted nodes; None without."""
    link = next((k for k in socket.links if not k.is_muted and k.is_valid), None)
    if link is None:
        return None
    source = link.from_socket
    if source.node.type == "REROUTE":
        return find_source(source.node.inputs[0])
    if source.node.mute:
        through = next((k for k in source.node.internal_links if k.to_socket == source), None)
        return None if through is None else find_source(through.from_socket)
    return source


def is_socket(value: Value) -> bool:
    """Tell whether a value comes out of a node."""
    return isinstance(value, bpy.types.NodeSocket)


def read_value(socket: Socket) -> Value:
    """Return what feeds an input, or the constant that it holds."""
    source = find_source(socket)
    if source is not None:
        return source
    held = socket.default_value
    return tuple(held)[:3] if hasattr(held, "__len__") else float(held)


def read_leaf(node: bpy.types.Node) -> Surface:
    """Return what a closure is made of."""
    leaf = LEAVES.get(node.type, Leaf())
    base = next((node.inputs[n] for n in leaf.base if n in node.inputs), None)
    return Surface(
        base=(UNKNOWN_COLOR,) * 3 if base is None else read_value(base),
        metallic=_read_part(node, leaf.metallic),
        roughness=_read_part(node, leaf.roughness),
        alpha=_read_part(node, "Alpha") if node.type == "BSDF_PRINCIPLED" else 1.0,
    )


def _read_part(node: bpy.types.Node, part: str | float) -> Value:
    if isinstance(part, float):
        return part
    return read_value(node.inputs[part]) if part in node.inputs else 1.0


def compute(tree: bpy.types.NodeTree, part: str, operation: str, values: Iterable[Value]) -> Socket:
    """Add a node of arithmetic on colours (part `base`) or on numbers to a tree."""
    vector = part == "base"
    node = tree.nodes.new("ShaderNodeVectorMath" if vector else "ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values, strict=False):
        if is_socket(value):
            tree.links.new(value, socket)
        else:
            socket.default_value = (value,) * 3 if vector and isinstance(value, float) else value
    return node.outputs[0]


def mix_values(
    tree: bpy.types.NodeTree, part: str, first: Value, second: Value, factor: Value
) -> Value:
    """Return first + factor (second - first); one alone where the other says nothing."""
    if first is None or second is None or (not is_socket(first) and first == second):
        return second if first is None else first
    if factor in {0.0, 1.0}:
        return second if factor else first
    difference = compute(tree, part, "SUBTRACT", (second, first))
    return compute(tree, part, "MULTIPLY_ADD", (difference, factor, first))


def mix_surfaces(
    tree: bpy.types.NodeTree, first: Surface, second: Surface, factor: Value
) -> Surface:
    """Mix what two shaders are made of; what passes light through has a share, and no colour."""
    pairs = ((n, v, getattr(second, n)) for n, v in vars(first).items())
    return Surface(**{n: mix_values(tree, n, a, b, factor) for n, a, b in pairs})


def add_surfaces(tree: bpy.types.NodeTree, first: Surface, second: Surface) -> Surface:
    """Add what two shaders reflect; light that one of them emits reflects nothing."""
    for one, other in ((first, second), (second, first)):
        if one in (DARK, CLEAR):
            return other
    half = mix_surfaces(tree, first, second, 0.5)
    if first.base is None or second.base is None:
        return half
    total = compute(tree, "base", "ADD", (first.base, second.base))
    return replace(half, base=compute(tree, "base", "MINIMUM", (total, 1.0)))


def add_outputs(material: bpy.types.Material, surface: Surface, names: Iterable[str]) -> None:
    """Add AOVs of what a surface is made of, weighed by its share; those of the user stay."""
    tree = material.node_tree
    there = {read_aov_name(n) for n in tree.nodes if n.type == "OUTPUT_AOV"}
    values = {
        "albedo": ("base", surface.base, (0.0, 0.0, 0.0)),
        "metallic": ("metallic", surface.metallic, 0.0),
        "roughness": ("roughness", surface.roughness, 1.0),
    }
    if VIEW_COSINE in names:
        values[VIEW_COSINE] = (VIEW_COSINE, compute_view_cosine(tree), 1.0)
    for name, (part, value, otherwise) in values.items():
        if name not in there:
            write_aov(tree, name, part, otherwise if value is None else value, surface.alpha)


def compute_view_cosine(tree: bpy.types.NodeTree) -> Socket:
    """Return the cosine of a surface's normal and the way to the camera."""
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "DOT_PRODUCT"
    for name, socket in zip(("Normal", "Incoming"), node.inputs, strict=False):
        tree.links.new(geometry.outputs[name], socket)
    return node.outputs["Value"]


def write_aov(tree: bpy.types.NodeTree, name: str, part: str, value: Value, alpha: Value) -> None:
    """Add one AOV to a tree."""
    if is_socket(alpha) or alpha != 1.0:
        value = compute(tree, part, "MULTIPLY", (value, alpha))
    elif part != "base" and is_socket(value):
        # as the closures do with what feeds them
        value = compute(tree, part, "ADD", (value, 0.0))
        value.node.use_clamp = True
    node = tree.nodes.new("ShaderNodeOutputAOV")
    setattr(node, "aov_name" if hasattr(node, "aov_name") else "name", name)
    socket = node.inputs["Color" if part == "base" else "Value"]
    if is_socket(value):
        tree.links.new(value, socket)
    else:
        socket.default_value = (*value, 1.0) if part == "base" else value


def read_aov_name(node: bpy.types.Node) -> str:
    """Return the name of the AOV that a node writes."""
    return node.aov_name if hasattr(node, "aov_name") else node.name


def make_default_material() -> bpy.types.Material:
    """Return a material that looks as what has none."""
    material = bpy.data.materials.new("rtsr default")
    rebuild_as_diffuse(material, (DIFFUSE_GREY,) * 3)
    return material


def has_nodes(material: bpy.types.Material) -> bool:
    """Tell whether nodes say what a material is; they always do from Blender 5 on."""
    always = bpy.app.version >= (5,)
    return material.node_tree is not None and (always or material.use_nodes)


def rebuild_as_diffuse(material: bpy.types.Material, color: Iterable[float]) -> None:
    """Give a material without nodes the nodes that Cycles makes of it."""
    if not has_nodes(material):
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    closure, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    closure.inputs["Color"].default_value = (*color, 1.0)
    links.new(closure.outputs[0], output.inputs["Surface"])


def list_surfaces() -> list[bpy.types.Object]:
    """Return every object that has a surface."""
    return [o for o in bpy.data.objects if hasattr(o.data, "materials") and o.type != "GPENCIL"]


def fill_empty_slots() -> None:
    """Give objects without material one that looks the same, so that its colour can be written."""
    material = None
    for ob in list_surfaces():
        empty = [slot for slot in ob.material_slots if slot.material is None]
        if ob.material_slots and not empty:
            continue
        material = material or make_default_material()
        for slot in empty:
            slot.material = material
        if not ob.material_slots:
            ob.data.materials.append(material)


def describe_materials(target: str, names: Iterable[str]) -> dict[str, set[str]]:
    """Add AOVs to every material, and return what was read roughly."""
    fill_empty_slots()
    reader = ShaderReader()
    for material in list(bpy.data.materials):
        if material.is_grease_pencil:
            continue
        if not has_nodes(material):
            rebuild_as_diffuse(material, material.diffuse_color[:3])
        add_outputs(material, reader.read_material(material, target), names)
    return reader.approximated


# --- the scene --------------------------------------------------------------------------------


def choose_layer(scene: bpy.types.Scene, name: str | None) -> bpy.types.ViewLayer:
    """Return the view layer that is captured.

    Raises:
        CaptureError: there is none of the name, or several are in use and none is named.
    """
    names = [v.name for v in scene.view_layers]
    used = [v for v in scene.view_layers if v.use]
    if name is not None:
        if name not in names:
            raise CaptureError(f"no view layer is called '{name}'; there are: {', '.join(names)}")
        return scene.view_layers[name]
    if len(used) != 1:
        raise CaptureError(f"{len(used)} view layers are in use; name one of {names} with --layer")
    return used[0]


def clear_passes(layer: bpy.types.ViewLayer) -> None:
    """Turn off every pass of a view layer; AOVs stay."""
    for flag in dir(layer):
        if flag.startswith("use_pass_") and flag != "use_pass_cryptomatte_accurate":
            setattr(layer, flag, False)
    if hasattr(layer, "cycles"):
        layer.cycles.denoising_store_passes = False


def prepare_layer(
    scene: bpy.types.Scene, layer: bpy.types.ViewLayer, aovs: Mapping[str, str], *, keep: bool
) -> None:
    """Leave one view layer in use, with the passes and AOVs that rtsr reads."""
    for other in scene.view_layers:
        other.use = other == layer
    if not keep:
        clear_passes(layer)
    for name in PASSES:
        if hasattr(layer, f"use_pass_{name}"):
            setattr(layer, f"use_pass_{name}", True)
    there = {aov.name for aov in layer.aovs}
    for name, kind in aovs.items():
        if name not in there:
            aov = layer.aovs.add()
            aov.name, aov.type = name, kind


def set_engine(scene: bpy.types.Scene, engines: tuple[str, ...] | None) -> None:
    """Choose the engine; Cycles where the scene's own writes no passes.

    Raises:
        CaptureError: this Blender has none of them.
    """
    for engine in engines or (scene.render.engine, "CYCLES"):
        try:
            scene.render.engine = engine
        except TypeError:
            continue
        if engine == "CYCLES" or engine in ENGINES["eevee"]:
            return
    raise CaptureError(f"this Blender has none of the engines {engines}")


def prepare_scene(scene: bpy.types.Scene, options: Options) -> None:
    """Set what holds for every frame: no motion blur, no compositing, raw multilayer files."""
    render, image = scene.render, scene.render.image_settings
    render.use_motion_blur = False
    render.use_compositing = render.use_sequencer = False
    render.use_border = render.use_multiview = render.use_stamp = False
    render.use_file_extension = render.use_overwrite = True
    render.resolution_percentage = 100
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_depth, image.exr_codec = "32", "ZIP"
    if hasattr(image, "use_exr_interleave"):
        # Blender 5 cannot write a part a pass where pixels are not square
        image.use_exr_interleave = True
    if render.engine == "CYCLES":
        scene.cycles.use_animated_seed = True
        scene.cycles.use_denoising = scene.cycles.use_denoising and options.denoise
    if options.point_sampling:
        sample_points(scene)


def sample_points(scene: bpy.types.Scene) -> None:
    """Let every sample lie at its pixel's centre, and every lens be a pinhole."""
    if scene.render.engine == "CYCLES":
        # Cycles takes a box to be a pixel wide, whatever its width is set to
        scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        scene.cycles.filter_width = POINT_FILTER_PX
    else:
        scene.render.filter_size = 0.0
    for camera in bpy.data.cameras:
        camera.dof.use_dof = False


def set_samples(scene: bpy.types.Scene, samples: int | None) -> None:
    """Set the number of light paths a pixel."""
    if scene.render.engine != "CYCLES":
        scene.eevee.taa_render_samples = samples or scene.eevee.taa_render_samples
        return
    if samples is not None:
        scene.cycles.samples = samples
        scene.cycles.use_adaptive_sampling = False


def number_objects() -> bool:
    """Give every object a number of its own, if nothing shows the numbers that they have."""
    trees = [m.node_tree for m in bpy.data.materials] + list(bpy.data.node_groups)
    nodes = (n for tree in trees if tree is not None for n in tree.nodes)
    if any(n.type == "OBJECT_INFO" and n.outputs["Object Index"].is_linked for n in nodes):
        return False
    for number, ob in enumerate(bpy.data.objects, start=1):
        ob.pass_index = number
    return True


# --- cameras ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class CameraFrame:
    """The camera of one frame.

    Attributes:
        world_to_camera: rows of a 4x4 matrix on row vectors, metres.
        world_to_ndc: the same; None for orthographic lenses, whose w is not depth.
        jitter_px: of LR frames, pixels of theirs, x right, y down.
        cut: whether another camera took the frame before.
    """

    frame: int
    world_to_camera: list[list[float]]
    world_to_ndc: list[list[float]] | None
    jitter_px: tuple[float, float]
    cut: bool


def radical_inverse(index: int, base: int) -> float:
    """Return the digits of `index` in `base`, mirrored at the point (Halton's sequence)."""
    result, share = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        result, share = result + digit * share, share / base
    return result


def halton_jitter(position: int) -> tuple[float, float]:
    """Offset of the frame at a position of the shot, from 0 on: Halton(2, 3) - 0.5."""
    index = position % HALTON_PERIOD + 1
    x, y = (radical_inverse(index, base) - 0.5 for base in HALTON_BASES)
    return x, y


def read_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the camera of the current frame.

    Raises:
        CaptureError: there is none, or its lens has no projection matrix.
    """
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise CaptureError(f"frame {scene.frame_current}: the scene has no camera")
    if camera.data.type == "PANO":
        raise CaptureError(
            f"camera '{camera.name}' is panoramic, which no matrix describes; make it perspective"
        )
    return camera


def read_projection(scene: bpy.types.Scene, camera: bpy.types.Object) -> Matrix:
    """Return a camera's projection (columns) as the current frame renders it."""
    render = scene.render
    graph = bpy.context.evaluated_depsgraph_get()
    return camera.evaluated_get(graph).calc_matrix_camera(
        graph,
        x=render.resolution_x,
        y=render.resolution_y,
        scale_x=render.pixel_aspect_x,
        scale_y=render.pixel_aspect_y,
    )


def read_view(camera: bpy.types.Object) -> Matrix:
    """Return world to camera (columns), without the scale that lenses leave out."""
    graph = bpy.context.evaluated_depsgraph_get()
    return camera.evaluated_get(graph).matrix_world.normalized().inverted()


def to_rows(columns: Matrix) -> list[list[float]]:
    """Return a matrix for row vectors."""
    return [list(row) for row in columns.transposed()]


def in_metres(columns: Matrix, unit_m: float) -> Matrix:
    """Return world to camera for points in metres."""
    result = columns.copy()
    result.translation = columns.translation * unit_m
    return result


def measure_camera(
    scene: bpy.types.Scene, jitter_px: tuple[float, float], before: str | None
) -> CameraFrame:
    """Return the camera of the current frame; `before` is the name of the last frame's."""
    camera = read_camera(scene)
    view = in_metres(read_view(camera), scene.unit_settings.scale_length)
    flat = camera.data.type == "ORTHO"
    return CameraFrame(
        frame=scene.frame_current,
        world_to_camera=to_rows(view),
        world_to_ndc=None if flat else to_rows(read_projection(scene, camera) @ view),
        jitter_px=jitter_px,
        cut=before is not None and camera.name_full != before,
    )


def find_screen_centre(projection: Matrix) -> tuple[float, float]:
    """Return where on the screen (-1..1, y up) a point straight ahead lies."""
    point = projection @ Vector((0.0, 0.0, -1.0, 1.0))
    return point.x / point.w, point.y / point.w


def shift_lens(
    scene: bpy.types.Scene, camera: bpy.types.Object, jitter_px: tuple[float, float]
) -> tuple[float, float]:
    """Let samples lie `jitter_px` beside pixel centres; returns the lens shift that was there.

    What lies at a pixel's centre plus the offset is to come to the centre, so that the picture
    moves by minus the offset. How far a shift of 1 moves it is asked of Blender, since that
    depends on sensor fit, size and pixel aspect.

    Raises:
        CaptureError: something else moves the lens shift.
    """
    data = camera.data
    there = (data.shift_x, data.shift_y)
    before = find_screen_centre(read_projection(scene, camera))
    data.shift_x, data.shift_y = there[0] + 1.0, there[1] + 1.0
    bpy.context.view_layer.update()
    after = find_screen_centre(read_projection(scene, camera))
    size = (scene.render.resolution_x, scene.render.resolution_y)
    wanted = (-2.0 * jitter_px[0] / size[0], 2.0 * jitter_px[1] / size[1])
    if abs(after[0] - before[0]) < SMALLEST_MOVE or abs(after[1] - before[1]) < SMALLEST_MOVE:
        raise CaptureError(
            f"the lens shift of camera '{camera.name}' is animated or driven, which Blender's "
            "vectors leave out; take its animation away, or use --jitter none"
        )
    data.shift_x = there[0] + wanted[0] / (after[0] - before[0])
    data.shift_y = there[1] + wanted[1] / (after[1] - before[1])
    bpy.context.view_layer.update()
    return there


def write_cameras(path: Path, cameras: Iterable[CameraFrame]) -> None:
    """Write the side-car that capture.toml names."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("frame", "worldToCamera", "worldToNDC", "jitter_px", "cut"))
        for camera in cameras:
            cells = (camera.world_to_camera, camera.world_to_ndc)
            if camera.world_to_ndc is None:
                cells = (None, None)
            jitter = " ".join(f"{v:.9g}" for v in camera.jitter_px)
            rows.writerow((camera.frame, *map(format_matrix, cells), jitter, str(camera.cut)))


def format_matrix(rows: list[list[float]] | None) -> str:
    """Write a matrix as one cell, row by row."""
    return "" if rows is None else " ".join(f"{v:.9g}" for row in rows for v in row)


@dataclass(frozen=True, kw_only=True)
class Part:
    """One resolution of a capture.

    Attributes:
        folder: of its frames.
        size: (width, height).
        samples: light paths a pixel.
        jittered: whether its samples move from frame to frame.
    """

    folder: Path
    size: tuple[int, int]
    samples: int | None
    jittered: bool


# --- capture.toml -----------------------------------------------------------------------------


def read_color_space() -> str | None:
    """Return rtsr's name of the primaries that Blender renders in; None where that is unknown."""
    settings = getattr(bpy.data, "colorspace", None)
    if settings is None:
        return "lin_rec709"
    name = settings.working_space_interop_id.removesuffix("_scene")
    return name if name in COLOR_SPACES else None


def quote(text: str) -> str:
    """Write a string of TOML."""
    return json.dumps(text)


def describe_frames(
    options: Options, layer: bpy.types.ViewLayer, *, scale: int, unit_m: float, flat: bool
) -> str:
    """Return the content of capture.toml; rtsr need measure nothing.

    Args:
        options: of the command line.
        layer: that is rendered.
        scale: HR pixels per LR pixel, 1 where there are no LR frames.
        unit_m: metres in one of Blender's units.
        flat: whether a camera is orthographic.
    """
    space = read_color_space()
    head = {
        "layout": quote("blender"),
        "layer": quote(layer.name),
        "scale": str(scale) if scale > 1 else None,
        "camera": quote(CAMERA_FILE),
        "colorspace": quote(space) if space else None,
        "roughness": quote("perceptual"),
        "specular": quote("metallic"),
    }
    unit = f"{unit_m:.7g}"
    tables = {
        "motion": MOTION,
        "depth": {"kind": quote("planar"), "unit": unit},
        "normal": {"space": quote("world"), "packed": "false"},
        "position": {"unit": unit},
        "buffers": {VIEW_COSINE: quote(f"{layer.name}.{VIEW_COSINE}.X")} if flat else {},
    }
    lines = [f"{SETTINGS_MARK}{describe_settings(options)}"]
    lines += [f"{key} = {value}" for key, value in head.items() if value is not None]
    for name, fields in tables.items():
        lines += [f"[{name}]", *(f"{key} = {value}" for key, value in fields.items())]
    return "\n".join(lines) + "\n"


def write_declarations(
    options: Options, parts: list[Part], layer: bpy.types.ViewLayer, cameras: list[CameraFrame]
) -> None:
    """Write capture.toml and the cameras, for the pair and for each of its folders alone."""
    unit_m = bpy.context.scene.unit_settings.scale_length
    flat = any(camera.world_to_ndc is None for camera in cameras)
    folders = {part.folder: part.jittered for part in parts}
    for folder, jittered in {options.out: parts[0].jittered, **folders}.items():
        folder.mkdir(parents=True, exist_ok=True)
        scale = 1 if folder == parts[-1].folder else options.scale
        text = describe_frames(options, layer, scale=scale, unit_m=unit_m, flat=flat)
        (folder / CAPTURE_FILE).write_text(text, encoding="utf-8")
        still = [c if jittered else replace(c, jitter_px=(0.0, 0.0)) for c in cameras]
        write_cameras(folder / CAMERA_FILE, still)


def describe_settings(options: Options) -> str:
    """Return what frames of one folder have in common."""
    free = {"out", "frames", "overwrite"}
    settings = {k: v for k, v in vars(options).items() if k not in free}
    return json.dumps({**settings, "file": bpy.data.filepath}, sort_keys=True)


def refuse_other_settings(options: Options) -> None:
    """Hold the frames of a folder to one set of options.

    Raises:
        CaptureError: frames that are there were made otherwise.
    """
    path = options.out / CAPTURE_FILE
    if options.overwrite or not path.exists():
        return
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    if first != f"{SETTINGS_MARK}{describe_settings(options)}":
        raise CaptureError(
            f"{options.out} holds frames of other options or of another scene; name another "
            "folder, or replace them with --overwrite"
        )


# --- the run ----------------------------------------------------------------------------------


def plan_parts(scene: bpy.types.Scene, options: Options) -> list[Part]:
    """Return what is rendered of each frame.

    Raises:
        CaptureError: the size does not divide by the scale.
    """
    render, scale = scene.render, options.scale
    share = render.resolution_percentage / 100
    width, height = options.size or (
        int(render.resolution_x * share),
        int(render.resolution_y * share),
    )
    if width % scale or height % scale:
        nearest = f"{width - width % scale}x{height - height % scale}"
        raise CaptureError(f"{width}x{height} does not divide by {scale}; try --size {nearest}")
    whole = Part(
        folder=options.out if scale == 1 else options.out / "hr",
        size=(width, height),
        samples=options.samples,
        jittered=scale == 1 and options.jitter,
    )
    if scale == 1:
        return [whole]
    small = Part(
        folder=options.out / "lr",
        size=(width // scale, height // scale),
        samples=options.lr_samples,
        jittered=options.jitter,
    )
    return [small, whole]


def set_size(scene: bpy.types.Scene, size: tuple[int, int]) -> None:
    """Set the size that is rendered."""
    scene.render.resolution_x, scene.render.resolution_y = size
    bpy.context.view_layer.update()


def render_part(scene: bpy.types.Scene, part: Part, camera: CameraFrame, *, again: bool) -> bool:
    """Render the current frame into one folder; False where it is there already.

    Raises:
        CaptureError: Blender wrote no file.
    """
    path = part.folder / f"frame_{camera.frame:04d}.exr"
    if path.exists() and not again:
        return False
    set_size(scene, part.size)
    set_samples(scene, part.samples)
    lens = read_camera(scene)
    shift = (lens.data.shift_x, lens.data.shift_y)
    if part.jittered:
        shift_lens(scene, lens, camera.jitter_px)
    # beside the frames, so that what an aborted run leaves is none of them
    unfinished = part.folder.parent / ".unfinished.exr"
    scene.render.filepath = str(unfinished)
    try:
        bpy.ops.render.render(write_still=True)
    except RuntimeError as error:
        raise CaptureError(f"{path}: {str(error).partition(chr(10))[0]}") from error
    lens.data.shift_x, lens.data.shift_y = shift
    if not unfinished.exists():
        raise CaptureError(f"{path}: Blender wrote no file; its own message stands above")
    unfinished.replace(path)
    return True


def measure_cameras(scene: bpy.types.Scene, options: Options) -> list[CameraFrame]:
    """Return the cameras of all frames."""
    first, last = options.frames or (scene.frame_start, scene.frame_end)
    cameras: list[CameraFrame] = []
    before = None
    for position, frame in enumerate(range(first, last + 1)):
        scene.frame_set(frame)
        jitter_px = halton_jitter(position) if options.jitter else (0.0, 0.0)
        cameras.append(measure_camera(scene, jitter_px, before))
        before = scene.camera.name_full
    return cameras


def capture_scene(options: Options) -> None:
    """Capture the scene that is open.

    Raises:
        CaptureError: something that the user can mend is in the way.
    """
    scene = bpy.context.scene
    refuse_other_settings(options)
    set_engine(scene, options.engine)
    parts = plan_parts(scene, options)
    layer = choose_layer(scene, options.layer)
    if bpy.context.window is not None:
        bpy.context.window.view_layer = layer
    prepare_scene(scene, options)
    set_size(scene, parts[-1].size)
    cameras = measure_cameras(scene, options)
    flat = any(camera.world_to_ndc is None for camera in cameras)
    aovs = {**AOVS, VIEW_COSINE: "VALUE"} if flat else AOVS
    prepare_layer(scene, layer, aovs, keep=options.keep_passes)
    if flat:
        # Cycles projects the vectors of orthographic cameras as if they were perspective ones
        layer.use_pass_vector = False
        say("orthographic camera: there are no right vectors, so none are written")
    if scene.render.engine != "CYCLES":
        say("Eevee draws on a GPU; where there is none, Blender stands still from here on")
    number_objects()
    target = "CYCLES" if scene.render.engine == "CYCLES" else "EEVEE"
    report_approximated(describe_materials(target, aovs))
    write_declarations(options, parts, layer, cameras)
    for camera in cameras:
        scene.frame_set(camera.frame)
        made = [render_part(scene, part, camera, again=options.overwrite) for part in parts]
        say(f"frame {camera.frame}: {'rendered' if any(made) else 'there already'}")
    say(f"{options.out}: {len(cameras)} frames")


def report_approximated(materials: dict[str, set[str]]) -> None:
    """Name the materials that have no base colour, metallic and roughness of their own."""
    for name, kinds in sorted(materials.items()):
        say(f"material '{name}': {', '.join(sorted(kinds))} is described roughly")


def say(text: str) -> None:
    """Tell the user something, between Blender's own lines."""
    sys.stdout.write(f"capture: {text}\n")
    sys.stdout.flush()


def list_arguments() -> list[str]:
    """Return the arguments that are ours, and open the scene if Blender is a module."""
    if not bpy.app.module:
        return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    scene, *arguments = sys.argv[1:] or ["--help"]
    if scene not in {"-h", "--help"}:
        if not Path(scene).is_file():
            raise CaptureError(f"{scene}: no such file; python blender.py scene.blend OUT")
        bpy.ops.wm.open_mainfile(filepath=str(Path(scene).absolute()), load_ui=False)
        return arguments
    return [scene]


def main() -> int:
    """Capture, and return the exit code."""
    try:
        capture_scene(parse_options(list_arguments()))
    except (CaptureError, OSError) as error:
        say(f"error: {error}")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main())
