"""Frames of a made scene as engines write them: names, axes and units spelled out by hand.

Independent of the layouts and their writer: what is asserted of a layout is asserted of files that
nothing of it has made.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Planes = dict[str, NDArray[Any]]
Made = Mapping[str, NDArray[np.float32]]
"""Channels of one frame in rtsr's own convention."""

SKY = 65504.0
"""What the scene stores for depth where nothing is seen, or more."""


def read_made(folder: Path) -> Iterator[tuple[int, Made, Mapping[str, Any]]]:
    """Number, channels and header attributes of every frame of a made folder."""
    for path in sorted(folder.glob("*.exr")):
        header = read_header(path)
        channels = read_channels(path, header.channels)
        planes = {name: plane.astype(np.float32) for name, plane in channels.items()}
        yield int(path.suffixes[-2][1:]), planes, header.attributes


def pick(made: Made, name: str, letters: str = "RGB", to: str = "RGB") -> Planes:
    """Channels of a buffer under other letters."""
    dotted = f"{name}." if name else ""
    return {t: made[f"{dotted}{c}"] for c, t in zip(letters, to, strict=True)}


def repeat(plane: NDArray[Any]) -> Planes:
    """One value as engines write it: in R, G and B."""
    return dict.fromkeys("RGB", plane)


def prefix(name: str, planes: Planes) -> Planes:
    """Channels of a layer."""
    return {f"{name}.{c}": plane for c, plane in planes.items()}


def write_mitsuba(made: Made, out: Path, number: int, *, positions: bool = False) -> None:
    """One file: the image, the nested integrator, and AOVs by the names of their types."""
    surface = made["depth.Z"] < SKY
    rays = np.where(surface, made["distance"], 0.0)
    channels = {
        **pick(made, ""),
        **prefix("img", {**pick(made, ""), "A": np.ones_like(rays)}),
        **prefix("albedo", pick(made, "albedo")),
        "depth.T": rays,
        **prefix("sh_normal", pick(made, "normal", "XYZ", "XYZ")),
        **prefix("geo_normal", pick(made, "geonormal", "XYZ", "XYZ")),
        **prefix("uv", {"U": rays, "V": rays}),
        "shape_index.I": np.where(surface, made["objectid"], 0.0),
        "prim_index.I": np.zeros_like(rays),
        **(prefix("position", pick(made, "position", "XYZ", "XYZ")) if positions else {}),
    }
    write_exr(out / f"frame_{number:04d}.exr", channels)


def write_falcor(made: Made, out: Path, number: int) -> None:
    """One file an output, `.RGBA` where it has alpha.

    `mvec` is a share of the screen, position before minus position now.
    """
    height, width = made["R"].shape
    surface = made["depth.Z"] < SKY
    metal = made["metallic"]
    base = pick(made, "albedo")
    outputs = {
        "AccumulatePass.output": pick(made, ""),
        "GBufferRT.diffuseOpacity": {c: base[c] * (1.0 - metal) for c in "RGB"},
        "GBufferRT.specRough": {
            **{c: 0.04 * (1.0 - metal) + base[c] * metal for c in "RGB"},
            "A": made["roughness"],
        },
        "GBufferRT.emissive": pick(made, "emission"),
        "GBufferRT.normW": pick(made, "normal", "XYZ"),
        "GBufferRT.faceNormalW": pick(made, "geonormal", "XYZ"),
        "GBufferRT.posW": pick(made, "position", "XYZ"),
        "GBufferRT.mvec": {
            "R": made["motion.X"] / width,
            "G": made["motion.Y"] / height,
            "B": np.zeros_like(metal),
        },
        "GBufferRT.linearZ": {
            "R": np.where(surface, made["depth.Z"], 1e8),
            "G": np.zeros_like(metal),
            "B": np.zeros_like(metal),
        },
    }
    for output, planes in outputs.items():
        mask = ".RGBA" if "A" in planes else ""
        write_exr(out / f"Mogwai.{output}.{number}{mask}.exr", planes)


def list_mrq_passes(made: Made) -> dict[str, Planes]:
    """Passes of Movie Render Queue by name: centimetres, vectors as 0.5 + 0.5 v with y up."""
    height, width = made["R"].shape
    # v = now - before, of a screen that is 1 wide; y up
    v_x, v_y = -made["motion.X"] / width, made["motion.Y"] / height
    cm = np.minimum(made["depth.Z"] * 100.0, SKY)
    return {
        "": {**pick(made, ""), "A": np.ones_like(cm)},
        "MovieRenderQueue_WorldDepth": repeat(cm),
        "MovieRenderQueue_MotionVectors": {
            "R": 0.5 + 0.5 * v_x,
            "G": 0.5 + 0.5 * v_y,
            "B": np.zeros_like(cm),
        },
        "MovieRenderQueue_WorldNormal": pick(made, "normal", "XYZ"),
        "M_BaseColor": pick(made, "albedo"),
        "M_Metallic": repeat(made["metallic"]),
        "M_Roughness": repeat(made["roughness"]),
        "M_Specular": repeat(np.full_like(cm, 0.5)),
    }


def write_mrq_layers(made: Made, out: Path, number: int) -> None:
    """One multilayer file; the image's channels are bare."""
    channels: Planes = {}
    for name, planes in list_mrq_passes(made).items():
        channels |= prefix(f"FinalImage{name}", planes) if name else planes
    write_exr(out / f"Seq.{number:04d}.exr", channels)


def write_mrq_files(made: Made, out: Path, number: int) -> None:
    """A file a pass."""
    for name, planes in list_mrq_passes(made).items():
        write_exr(out / f"FinalImage{name}.{number:04d}.exr", planes)


def write_mrq_folders(made: Made, out: Path, number: int) -> None:
    """A folder a pass, `{render_pass}/{sequence_name}.{frame_number}`."""
    for name, planes in list_mrq_passes(made).items():
        write_exr(out / f"FinalImage{name}" / f"Seq.{number:04d}.exr", planes)


def write_extranet(made: Made, out: Path, number: int) -> None:
    """`<Scene><Buffer>`: depth in 100 m, vectors now minus before with y up, sky by its normal."""
    surface = made["depth.Z"] < SKY
    normal = pick(made, "normal", "XYZ")
    passes = {
        "PreTonemapHDRColor": pick(made, ""),
        "BaseColor": pick(made, "albedo"),
        "WorldNormal": {c: np.where(surface, plane, -1.0) for c, plane in normal.items()},
        "SceneDepth": repeat(np.where(surface, made["depth.Z"] * 1e-2, 0.0)),
        "Metallic": repeat(made["metallic"]),
        "Roughness": repeat(made["roughness"]),
        "Specular": repeat(np.full_like(made["metallic"], 0.5)),
        "MotionVector": {
            "R": -made["motion.X"],
            "G": made["motion.Y"],
            "B": np.zeros_like(made["metallic"]),
        },
    }
    for name, planes in passes.items():
        write_exr(out / f"Bunker{name}.{number:04d}.exr", planes)


WRITERS: Mapping[str, Callable[[Made, Path, int], None]] = {
    "mitsuba": write_mitsuba,
    "mitsuba-positions": partial(write_mitsuba, positions=True),
    "falcor": write_falcor,
    "mrq-layers": write_mrq_layers,
    "mrq-files": write_mrq_files,
    "mrq-folders": write_mrq_folders,
    "extranet": write_extranet,
}


def write_engine_shot(engine: str, made: Path, out: Path) -> None:
    """Write `lr/` and `hr/` of a made pair as an engine would, and no declaration."""
    truth = {number: planes for number, planes, _ in read_made(made / "reference")}
    for size in ("lr", "hr"):
        for number, planes, attributes in read_made(made / size):
            radiance = planes if size == "lr" else truth[number]
            full = {**planes, **pick(radiance, ""), **see_points(planes["depth.Z"], attributes)}
            WRITERS[engine](full, out / size, number)


def see_points(depth: NDArray[Any], attributes: Mapping[str, Any]) -> Planes:
    """Distance from the camera, and position in the world, of what each pixel shows."""
    view = np.asarray(attributes["worldToCamera"], float)
    projection = np.linalg.inv(view) @ np.asarray(attributes["worldToNDC"], float)
    height, width = depth.shape
    x = ((np.arange(width) + 0.5) / width * 2.0 - 1.0) / projection[0, 0]
    y = (1.0 - (np.arange(height) + 0.5) / height * 2.0) / projection[1, 1]
    rays = np.stack([*np.broadcast_arrays(x[None], y[:, None]), np.full(depth.shape, -1.0)], -1)
    seen = np.where(depth < SKY, depth, 0.0)
    points = rays * seen[..., None]
    homogeneous = np.concatenate([points, np.ones((*depth.shape, 1))], -1)
    world = homogeneous @ np.linalg.inv(view)
    positions = {f"position.{c}": world[..., i].astype(np.float32) for i, c in enumerate("XYZ")}
    return {"distance": np.linalg.norm(points, axis=-1).astype(np.float32), **positions}


def write_nss_shot(
    made: Path, out: Path, *, subtracts: int, motion: str = "motion", cuts: Collection[int] = ()
) -> None:
    """Arm's Unreal plug-in: LR colour, depth and vectors, HR colour, a side-car; no HR vectors.

    Args:
        made: pair of one shot.
        out: root of the data set.
        subtracts: 1 for vectors now minus before, -1 for the other way round.
        motion: folder of the vectors.
        cuts: frames before which the camera jumps.
    """
    rows = []
    for number, planes, attributes in read_made(made / "lr"):
        height, width = planes["R"].shape
        view = np.asarray(attributes["worldToCamera"], float)
        ndc = np.asarray(attributes["worldToNDC"], float)
        projection = np.linalg.inv(view) @ ndc
        near = 0.1
        device = np.where(planes["depth.Z"] < SKY, near / planes["depth.Z"], 0.0)
        vectors = {
            "R": -subtracts * planes["motion.X"] / width,
            "G": -subtracts * planes["motion.Y"] / height,
        }
        name = f"{number:04d}.exr"
        write_exr(out / "x4" / "color" / "0000" / name, pick(planes, ""))
        write_exr(out / "x4" / "depth" / "0000" / name, {"R": device.astype(np.float32)})
        for folder in (motion, "motion_m2"):
            halves = {c: plane.astype(np.float16) for c, plane in vectors.items()}
            write_exr(out / "x4" / folder / "0000" / name, halves)
        # reversed depth without a far plane: clip z = near, w = view depth
        clip = np.zeros((4, 4))
        clip[0, 0], clip[1, 1] = projection[0, 0], projection[1, 1]
        clip[2, 3], clip[3, 2] = -1.0, near
        rows.append(
            {
                "FrameNumber": number,
                "FovX": 2.0 * float(np.arctan(1.0 / projection[0, 0])),
                "FovY": 2.0 * float(np.arctan(1.0 / projection[1, 1])),
                "CameraNearPlane": near,
                "CameraFarPlane": -1.0,
                "Exposure": 1.0,
                "CameraCut": number in cuts,
                # matrix[row][column], column by column
                "ViewProjection": (view @ clip).T.flatten().tolist(),
                "Jitter": {"X": 0.0, "Y": 0.0},
                "NormalizedPerRatioJitter": [{"X": 0.0, "Y": 0.0}],
            }
        )
    for number, planes, _ in read_made(made / "reference"):
        write_exr(out / "ground_truth" / "0000" / f"{number:04d}.exr", pick(planes, ""))
    side_car = {
        "Version": "1.0.1",
        "EmulatedFramerate": 60,
        "ReverseZ": True,
        "UpscalingRatiosIndices": {"x4_index": 0},
        "TargetResolution": {"X": width * 4, "Y": height * 4},
        "Frames": rows,
        "Samples": {"Sequence": "TiledHalton", "Count": len(rows), "Quantized": True},
    }
    (out / "0000.json").write_text(json.dumps(side_car))
