"""The motion-convention finder on rewritten motion: a table of margins.

    python benchmarks/finder.py DATA [--no-camera] [--only SEQUENCE]

Each sequence's motion is rewritten as another engine would store it and written to disk with the
rest of its channels; nothing is declared. A cell holds the margin of the winner over the next
reading, `tie` where the right reading is among those that cannot be told apart (then named so by
`rtsr inspect`), `geo` where pictures tie and camera and depth decide, or WRONG.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.decision import measure_and_decide
from rtsr_cli.core.captures.measuring.geometry_finder import project_points, unproject_depth
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.motion import Axes, MotionConvention, MotionDirection, MotionUnit, YAxis
from rtsr_cli.core.imaging.resampling import HALTON_BASES, radical_inverse
from rtsr_cli.core.imaging.splatting import forward_motion_by_splat
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of

Motion = NDArray[np.float32]
Motions = Mapping[int, Motion]
"""Frame number -> 2 x h x w."""

CHANNELS = (
    *("R", "G", "B", "albedo.R", "albedo.G", "albedo.B", "normal.X", "normal.Y", "normal.Z"),
    *("depth.Z", "objectid"),
)
P, C = MotionDirection.PREVIOUS_MINUS_CURRENT, MotionDirection.CURRENT_MINUS_PREVIOUS
UP, UV, NDC = YAxis.UP, MotionUnit.UV, MotionUnit.NDC
JITTER_PERIOD = 8
MOVING_OBJECT_PX = 0.3
"""An object whose splatted motion differs more than this from the camera's moves by itself."""


def scaled(x: float, y: float) -> Callable[[Motions], Motions]:
    factors = np.array([x, y], np.float32).reshape(2, 1, 1)
    return lambda motions: {n: m * factors for n, m in motions.items()}


def shares(motions: Motions, x: float, y: float) -> Motions:
    """Divide by the frame's size over (x, y)."""
    height, width = next(iter(motions.values())).shape[1:]
    return scaled(x / width, y / height)(motions)


def half(motions: Motions) -> Motions:
    return {n: m.astype(np.float16).astype(np.float32) for n, m in motions.items()}


def jittered(motions: Motions, sign: float) -> Motions:
    def jitter(n: int) -> NDArray[np.float32]:
        offset = [radical_inverse(n % JITTER_PERIOD + 1, base) - 0.5 for base in HALTON_BASES]
        return np.array(offset, np.float32).reshape(2, 1, 1)

    return {n: m + sign * (jitter(n - 1) - jitter(n)) for n, m in motions.items()}


def of_previous_file(motions: Motions) -> Motions:
    return {n: motions.get(n - 1, np.zeros_like(m)) for n, m in motions.items()}


REWRITES: dict[str, tuple[Callable[[Motions], Motions], MotionConvention]] = {
    "as it is": (lambda m: m, MotionConvention()),
    "negated": (scaled(-1, -1), MotionConvention(direction=C)),
    "x flipped": (scaled(-1, 1), MotionConvention(direction=C, y_axis=UP)),
    "y flipped": (scaled(1, -1), MotionConvention(y_axis=UP)),
    "swapped": (
        lambda m: {n: v[::-1].copy() for n, v in m.items()},
        MotionConvention(axes=Axes.YX),
    ),
    "UV": (lambda m: shares(m, 1, 1), MotionConvention(unit=UV)),
    "UV negated, y up": (
        lambda m: shares(m, -1, 1),
        MotionConvention(unit=UV, direction=C, y_axis=UP),
    ),
    "NDC": (lambda m: shares(m, 2, 2), MotionConvention(unit=NDC)),
    "NDC y up": (lambda m: shares(m, 2, -2), MotionConvention(unit=NDC, y_axis=UP)),
    "pixels / 4": (scaled(0.25, 0.25), MotionConvention(scale=4.0)),
    "pixels * 4": (scaled(4, 4), MotionConvention(scale=0.25)),
    "half": (half, MotionConvention()),
    "half, centred UV": (
        lambda m: half({n: v + 0.5 for n, v in shares(m, 1, 1).items()}),
        MotionConvention(unit=UV, zero=0.5),
    ),
    "jitter added": (lambda m: jittered(m, 1.0), MotionConvention()),
    "jitter subtracted": (lambda m: jittered(m, -1.0), MotionConvention()),
    "previous file's": (of_previous_file, MotionConvention(file_offset=1)),
}
"""Name -> rewrite and the convention that is right for it; `to the next frame` needs more."""

TO_NEXT = "to the next frame"
IN_VECTORS = ("jitter added", "jitter subtracted")


def frames_of(folder: Path) -> dict[int, Path]:
    return {int(p.stem.split(".")[-1]): p for p in sorted(folder.glob("frame.*.exr"))}


def camera_of(path: Path) -> CameraMetadata:
    attributes = read_header(path).attributes

    def matrix(name: str) -> torch.Tensor:
        return torch.from_numpy(np.asarray(attributes[name], np.float64))

    return CameraMetadata(
        world_to_camera=matrix("worldToCamera"), world_to_ndc=matrix("worldToNDC")
    )


def to_next_frame(files: Mapping[int, Path], motions: Motions) -> Motions:
    """Vectors to the next frame: the camera's on what stands still, splatted on what moves."""
    result = {}
    for number, motion in motions.items():
        if number + 1 not in files:
            result[number] = np.zeros_like(motion)
            continue
        now = read_channels(files[number], ("depth.Z", "objectid"))
        then = read_channels(files[number + 1], ("depth.Z",))
        splat, known = forward_motion_by_splat(
            torch.from_numpy(motions[number + 1])[None],
            torch.from_numpy(then["depth.Z"])[None, None],
        )
        height, width = motion.shape[1:]
        view = View(display=(height, width))
        depth = torch.from_numpy(now["depth.Z"])[None, None]
        world = unproject_depth(depth, camera_of(files[number]), view)
        assert world is not None
        landed = project_points(world, camera_of(files[number + 1]), view)
        assert landed is not None
        y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
        still = landed[0] - torch.stack([x, y])
        ids = torch.from_numpy(now["objectid"].astype(np.int64))
        there = known[0, 0] > 0
        differs = ((splat[0] - still).abs().sum(0) > MOVING_OBJECT_PX).float()
        count = torch.bincount(ids[there])
        moved = torch.bincount(ids[there], differs[there]) / count.clamp(min=1)
        moving = moved[ids.clamp(max=len(moved) - 1)] > 0.5
        chosen = torch.where((moving & there)[None], splat[0], still)
        result[number] = chosen.nan_to_num().numpy()
    return result


def write(files: Mapping[int, Path], motions: Motions, folder: Path, *, camera: bool) -> None:
    for number, path in files.items():
        planes = read_channels(path, CHANNELS)
        x, y = motions[number]
        planes |= {"motion.X": np.ascontiguousarray(x), "motion.Y": np.ascontiguousarray(y)}
        attributes = dict(read_header(path).attributes) if camera else {}
        write_exr(folder / path.name, planes, attributes=attributes, compression="none")


def cell(folder: Path, name: str, expected: MotionConvention) -> tuple[str, float]:
    """Measure a folder without any declaration; return the table's cell and the seconds."""
    shot = find_shots_of(folder, ReadOptions())[0]
    reader = open_frames(shot.frames, layout=None, capture=CaptureDeclaration(), side_car={})
    started = time.perf_counter()
    measured = measure_and_decide(reader, CaptureDeclaration(), named=False).measured
    seconds = time.perf_counter() - started
    finding, best = measured.motion, measured.best
    assert finding is not None
    if name in IN_VECTORS and not (measured.jitter and measured.jitter.in_vectors):
        return "WRONG (jitter)", seconds
    if best is None:
        tied = expected in {c.convention for c in finding.ties}
        return ("tie" if tied else "WRONG (nothing)"), seconds
    if best.convention != expected:
        return f"WRONG ({best.convention})", seconds
    if measured.by_geometry is not None:
        return "geo", seconds
    others = [c.margin for c in finding.candidates if c.convention != expected]
    return f"{min(others):.1%}", seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--no-camera", action="store_true", help="leave the matrices out")
    parser.add_argument("--only", help="one sequence, e.g. court/fly")
    parser.add_argument(
        "--frames", type=int, default=4, help="of each sequence, from the second on"
    )
    arguments = parser.parse_args()
    manifest = json.loads((arguments.data / "manifest.json").read_text(encoding="utf-8"))
    names = [f"{s['scene']}/{s['sequence']}" for s in manifest["sequences"]] + ["sample"]
    names = [n for n in names if arguments.only in {None, n}]
    columns = [*REWRITES, TO_NEXT]
    print("| sequence | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    times = []
    for name in names:
        files = dict(list(frames_of(arguments.data / name).items())[1 : 1 + arguments.frames])
        planes = {n: read_channels(p, ("motion.X", "motion.Y")) for n, p in files.items()}
        motions = {n: np.stack([p["motion.X"], p["motion.Y"]]) for n, p in planes.items()}
        cells = []
        for column in columns:
            if column == TO_NEXT:
                rewritten = to_next_frame(files, motions)
                expected = MotionConvention(direction=MotionDirection.NEXT_MINUS_CURRENT)
            else:
                rewrite, expected = REWRITES[column]
                rewritten = rewrite(motions)
            with tempfile.TemporaryDirectory() as folder:
                write(files, rewritten, Path(folder), camera=not arguments.no_camera)
                text, seconds = cell(Path(folder), column, expected)
            cells.append(text)
            times.append(seconds / (len(files) - 1))
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    print(f"\nmedian {statistics.median(times):.2f} s a pair of frames, reading included")


if __name__ == "__main__":
    main()
