"""Camera matrices of wrong kinds through every command: who is told, and who is not.

    python benchmarks/wrong_cameras.py DATA [--part KINDS|COMMANDS|FILES] [--only SEQUENCE]
        [--shot FOLDER] [--kind KIND] [--way both|view|ndc|each] [--held WHAT]

DATA holds our own sequences; FOLDER is any capture with right cameras, as `rtsr inspect` reads it.
Copies of a few frames get matrices that are wrong in one way. A cell says what came of them:
`not used` (with the reason; `refused` where the command needs them), `named` (warned of, with what
they look like), `open` (verified, but for what the message names), `unverified` (nothing could
tell, and that is said), `right` (matrices that are used, and are right, as those of another frame
are where the camera stands still), or `SILENT`: wrong, and used without a word. Part KINDS varies
what the files hold; COMMANDS runs every command that reads cameras, FILES reads side-cars in place
of headers. KINDS and FILES end with one table of all sequences.
"""

from __future__ import annotations

import csv
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch
from click.testing import CliRunner
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.captures.measuring.geometry_finder import unproject_depth
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.exr import read_header, read_pixels, write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of, measure_set, open_shot

Matrix4 = NDArray[np.float64]
Camera = tuple[Matrix4, Matrix4]
"""World to camera, and the projection behind it."""

STATIC = "static camera"
"""Made by `rtsr synth --static-camera`: objects and lights move."""

SEQUENCES = ("court/fly", "bath/wash", "yard/stroll", "court/fly still", STATIC)
STILL = " still"
"""One frame several times, and no motion: a locked-off camera, and nothing that moves."""

FRAMES = 3
CROP = PixelWindow(left=120, top=72, width=240, height=144)
DISPLAY = PixelWindow(left=0, top=0, width=480, height=288)
ROUNDING, UNSEEN_PX = 1e-6, 0.1
"""How far numbers of a matrix, and pixels at the picture's side, may be off and be right: the check
itself takes as much for vectors that were rounded."""

SILENT = "SILENT"
SAME = "right"

HELD: Mapping[str, tuple[str, ...]] = {
    "positions": ("position", "motion", "depth", "normal"),
    "motion, normals": ("motion", "depth", "normal"),
    "motion": ("motion", "depth"),
    "normals": ("depth", "normal"),
    "depth": ("depth",),
}
"""What tells, as far as files hold it -> names of channels."""


TOLD = frozenset({Buffer.COLOR, Buffer.POSITION, Buffer.MOTION, Buffer.DEPTH, Buffer.NORMAL})
"""What is read of other captures."""


def _flip(axis: int) -> Matrix4:
    return np.diag([-1.0 if i == axis else 1.0 for i in range(4)])


SWAP = np.eye(4)[[1, 0, 2, 3]]

LITTLE = 0.03
"""Radians that a camera is turned by, and the share of its focal length, where it is a bit off."""


def _turn(axis: int) -> Matrix4:
    one, other = (i for i in range(3) if i != axis)
    turn = np.eye(4)
    turn[one, one] = turn[other, other] = np.cos(LITTLE)
    turn[one, other], turn[other, one] = np.sin(LITTLE), -np.sin(LITTLE)
    return turn


RIGHT = "as it is"

TURNS: Mapping[str, Callable[[Matrix4], Matrix4]] = {
    RIGHT: lambda m: m,
    "transposed": lambda m: m.T,
    "inverse": np.linalg.inv,
    "x flipped": lambda m: m @ _flip(0),
    "y flipped": lambda m: m @ _flip(1),
    "z flipped": lambda m: m @ _flip(2),
    "x and y swapped": lambda m: m @ SWAP,
    "world mirrored": lambda m: _flip(2) @ m,
    "world swapped": lambda m: np.eye(4)[[0, 2, 1, 3]] @ m,
    "pitch 1.7 degrees off": lambda m: m @ _turn(0),
    "yaw 1.7 degrees off": lambda m: m @ _turn(1),
    "roll 1.7 degrees off": lambda m: m @ _turn(2),
}
"""Kinds that change one frame's matrix."""

LONGER = "lens 3 % longer"
"""The kind whose clip space alone is off."""

OTHERS: Mapping[str, Callable[[int], int]] = {
    "next frame's": lambda n: n + 1,
    "frame before's": lambda n: n - 1,
    "first frame's": lambda n: 1,
    "reversed order": lambda n: FRAMES + 1 - n,
}
"""Kinds that take another frame's."""

WAYS = ("both", "view", "ndc", "each")
"""Both wrong alike, one alone, or each turned by itself."""


def spoil(kind: str, way: str, cameras: Mapping[int, Camera], number: int) -> Camera:
    """WorldToCamera and worldToNDC of one frame, wrong in one way."""
    view, lens = cameras[number]
    right = view, view @ lens
    if kind == LONGER:
        return view, view @ lens @ np.diag([1.0 + LITTLE, 1.0 + LITTLE, 1.0, 1.0])
    if kind in OTHERS:
        # the camera of a frame that is not there goes on as the last ones did
        view, lens = cameras[OTHERS[kind](number)]
        wrong = view, view @ lens
    else:
        turn = TURNS[kind]
        wrong = turn(view), turn(view) @ lens
        if way == "each":
            return turn(view), turn(right[1])
    return (wrong[0] if way != "ndc" else right[0]), (wrong[1] if way != "view" else right[1])


@dataclass(frozen=True)
class Sequence:
    """Frames in memory, with their true cameras."""

    name: str
    planes: Mapping[int, Mapping[str, Any]]
    cameras: Mapping[int, Camera]
    data: PixelWindow = CROP
    display: PixelWindow = DISPLAY

    def write(self, folder: Path, held: tuple[str, ...], kind: str, way: str) -> None:
        """Write the frames with matrices that are wrong in one way."""
        dropped = {"position", "motion", "depth", "normal"} - set(held)
        for number, planes in self.planes.items():
            view, ndc = spoil(kind, way, self.cameras, number)
            kept = {
                c: p
                for c, p in planes.items()
                if c.split(".")[0].removeprefix("geo") not in dropped
            }
            write_exr(
                folder / f"frame.{number:04d}.exr",
                kept,
                attributes={
                    "worldToCamera": np.ascontiguousarray(view, np.float32),
                    "worldToNDC": np.ascontiguousarray(ndc, np.float32),
                },
                data_window=self.data,
                display_window=self.display,
            )


def read_capture(folder: Path) -> Sequence:
    """Read the first frames of a capture, in the conventions of rtsr's own layout."""
    options = ReadOptions()
    shot = find_shots_of(folder, options)[0]
    reader = measure_set(shot.frames, open_shot(shot, folder, options), jittered=False).reader
    numbers = dict(enumerate(reader.numbers[: FRAMES + 1], 1))
    cameras = {}
    for number, stored in numbers.items():
        camera = reader.cameras[stored]
        assert camera.world_to_camera is not None
        assert camera.world_to_ndc is not None
        view, ndc = (m.double().numpy() for m in (camera.world_to_camera, camera.world_to_ndc))
        cameras[number] = view, np.linalg.inv(view) @ ndc
    cameras[0] = cameras[1]
    planes = {n: _list_planes(reader, numbers[n]) for n in range(1, FRAMES + 1)}
    height, width = reader.size
    whole = PixelWindow(left=0, top=0, width=width, height=height)
    return Sequence(str(folder), planes, cameras, whole, whole)


def _list_planes(reader: FrameReader, number: int) -> dict[str, Any]:
    frame = reader.read(number, reader.readable & TOLD)
    letters = {Buffer.COLOR: ("R", "G", "B"), Buffer.DEPTH: ("depth.Z",)}
    return {
        (letters[b][i] if b in letters else f"{b}.{'XYZ'[i]}"): plane.numpy()
        for b, image in frame.gbuffer.items()
        for i, plane in enumerate(image[0])
    }


def read_sequence(data: Path, name: str) -> Sequence:
    if name == STATIC:
        with tempfile.TemporaryDirectory() as folder:
            size = f"{DISPLAY.width}x{DISPLAY.height}"
            words = ("--size", size, "--frames", f"1-{FRAMES + 1}", "--static-camera")
            run("synth", Path(folder) / "made", *words)
            return _read_frames(Path(folder), "made", name)
    return _read_frames(data, name.removesuffix(STILL), name)


def _read_frames(data: Path, folder: str, name: str) -> Sequence:
    still = name.endswith(STILL)
    paths = sorted((data / folder).glob("frame.*.exr"))[: FRAMES + 1]
    cameras = {}
    for number, path in enumerate(paths, 1):
        attributes = read_header(path).attributes
        view, ndc = (np.asarray(attributes[n], float) for n in ("worldToCamera", "worldToNDC"))
        cameras[number] = view, np.linalg.inv(view) @ ndc
    cameras[0] = cameras[1]
    planes = {
        n: _read_planes(paths[0 if still else n - 1], cameras[n]) for n in range(1, FRAMES + 1)
    }
    if still:
        cameras = dict.fromkeys(cameras, cameras[1])
        for one in planes.values():
            one.update({c: np.zeros_like(p) for c, p in one.items() if c.startswith("motion")})
    return Sequence(name, planes, cameras)


def _read_planes(path: Path, camera: Camera) -> dict[str, Any]:
    planes = dict(read_pixels(path, sorted(read_header(path).channels))[0])
    view, lens = (torch.from_numpy(m) for m in camera)
    depth = torch.from_numpy(planes["depth.Z"])[None, None]
    metadata = CameraMetadata(world_to_camera=view, world_to_ndc=view @ lens)
    size = (depth.shape[-2], depth.shape[-1])
    position = unproject_depth(depth, metadata, View(display=size))
    assert position is not None
    sky = depth[0, 0] >= 65504
    for axis, plane in zip("XYZ", position[0], strict=True):
        planes[f"position.{axis}"] = plane.masked_fill(sky, 0.0).numpy().astype(np.float32)
    rows = slice(CROP.top, CROP.top + CROP.height)
    columns = slice(CROP.left, CROP.left + CROP.width)
    return {c: np.ascontiguousarray(p[rows, columns]) for c, p in planes.items()}


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(group, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


def judge(code: int, output: str) -> str:
    """Say what came of matrices by what a user reads."""
    text = " ".join(output.split())
    if "are not used" in text:
        return "refused" if code == 3 else "not used"
    if "one frame's matrices in every frame" in text or "a camera beside the one" in text:
        return "named"
    if "unverified" in text:
        return "unverified"
    if "cannot tell them" in text:
        return "open"
    if "lies off the path" in text:
        return "stray"
    return SILENT if code in {0, 1} else f"exit {code}?"


def look(folder: Path) -> str:
    """Say what every command hears of the cameras of a folder: what `inspect` shows, and faster."""
    options = ReadOptions()
    shot = find_shots_of(folder, options)[0]
    settled = measure_set(shot.frames, open_shot(shot, folder, options), jittered=False)
    return judge(0, " ".join((*settled.warnings, *settled.notes)))


def list_commands(shot: Path, out: Path, *, real: bool) -> Iterator[tuple[str, list[object]]]:
    """Every command that reads cameras."""
    dry = [] if real else ["--dry-run"]
    for system in ("bicubic", "demod-bicubic", "demod-guided", "taau", "nsrd", "fusesr"):
        words = ["upscale", shot, out / system, "--system", system, "--simulate-lr", 4]
        yield system, [*words, *dry]
    for system in ("warp", "warp-guided"):
        yield system, ["extrapolate", shot, out / system, "--system", system, *dry]
    yield "demodulate", ["demodulate", shot, out / "parts", *dry]
    yield "- by albedo", ["demodulate", shot, out / "more", "--mode", "albedo", *dry]
    yield "label", ["label", shot, out / "label", "--kind", "vrs", *dry]
    for estimator in ("network", "analytic"):
        yield (
            f"vrs {estimator}",
            ["predict-vrs", shot, out / estimator, "--estimator", estimator, *dry],
        )
    yield "evaluate", ["evaluate", shot, "--ref", shot, *dry]
    yield "train", ["train", "nsrd", shot, "--pack", out / "pack", "--pack-crops", 1]
    yield "inspect", ["inspect", shot]


def show_table(title: str, head: tuple[str, ...], rows: Iterator[tuple[str, list[str]]]) -> None:
    counts: Counter[str] = Counter()
    print(f"\n{title}\n", " | ".join(head), sep="")
    for name, cells in rows:
        counts.update(cells)
        print(f"{name:24}", " | ".join(cells), flush=True)
    print("in all:", ", ".join(f"{n} {what}" for what, n in counts.most_common()))


def list_cases(kinds: tuple[str, ...], ways: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Kinds and ways; one way where all are the same."""
    for kind, way in product(kinds, ways):
        alike = kind == RIGHT and way != "both"
        alike |= kind == LONGER and way != "both"
        if not alike and not (kind in OTHERS and way == "each"):
            yield kind, way


def is_right(sequence: Sequence, kind: str, way: str, form: str = "") -> bool:
    """Tell whether matrices come out right, as another frame's do where the camera stands still.

    Of a lens that is written as an angle no axis is flipped, and one that moves no pixel is right.
    """

    def differ(number: int) -> float:
        view, lens = sequence.cameras[number]
        wrong = spoil(kind, way, sequence.cameras, number)
        turned = float(np.abs(wrong[0] - view).max()) / ROUNDING
        if form != "angles":
            return max(turned, float(np.abs(wrong[1] - view @ lens).max()) / ROUNDING)
        one, other = (
            np.tan(np.radians(_measure_angle(v, n) / 2)) for v, n in (wrong, (view, view @ lens))
        )
        moved_px = float(abs(one / other - 1.0)) * sequence.display.width / 2
        return max(turned, moved_px / UNSEEN_PX)

    return max(map(differ, sequence.planes)) < 1.0


def settle(outcome: str, *, right: bool) -> str:
    """A word alone is no proof: matrices that are used without one may be right."""
    return SAME if outcome == SILENT and right else outcome


@dataclass(frozen=True)
class Trials:
    """What is tried.

    Attributes:
        kinds: of wrong matrices.
        ways: how they are wrong.
        held: keys of `HELD`.
        real: run commands, in place of a dry run.
    """

    kinds: tuple[str, ...]
    ways: tuple[str, ...]
    held: tuple[str, ...]
    real: bool


def try_kinds(sequence: Sequence, trials: Trials) -> Iterator[tuple[str, list[str]]]:
    for kind, way in list_cases(trials.kinds, trials.ways):
        right, cells = is_right(sequence, kind, way), []
        # the form of matrices that do not belong together is wrong whatever files hold
        form = way in {"view", "ndc"}
        for held in [HELD["depth"]] if form else [HELD[h] for h in trials.held]:
            with tempfile.TemporaryDirectory() as folder:
                sequence.write(Path(folder), held, kind, way)
                cells.append(settle(look(Path(folder)), right=right))
        yield f"{kind}, {way}", cells * len(trials.held) if form else cells


def try_commands(sequence: Sequence, trials: Trials) -> Iterator[tuple[str, list[str]]]:
    for kind, way in list_cases(trials.kinds, trials.ways):
        right = is_right(sequence, kind, way)
        for held in trials.held:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                sequence.write(folder / "shot", HELD[held], kind, way)
                commands = list_commands(folder / "shot", folder / "out", real=trials.real)
                cells = [settle(judge(*run(*words)), right=right) for _, words in commands]
                yield f"{kind}, {way}, {held}", cells


def _measure_angle(view: Matrix4, ndc: Matrix4) -> float:
    """Horizontal field of view in degrees."""
    lens = np.linalg.inv(view) @ ndc
    return float(np.degrees(2 * np.arctan(1 / abs(lens[0, 0]))))


def _write_rows(folder: Path, form: str, cameras: Mapping[int, Camera]) -> None:
    """Write a side-car: clip space, or a projection, or angles beside the view."""
    rows = []
    for number, (view, ndc) in cameras.items():
        row: dict[str, Any] = {"frame": number, "worldToCamera": view}
        if form == "angles":
            row |= {"fov_x": _measure_angle(view, ndc), "near": 0.05}
        else:
            lens = np.linalg.inv(view) @ ndc
            row |= {"projection": lens} if form == "projection" else {"worldToNDC": ndc}
        rows.append(row)
    if form == "JSON":
        text = json.dumps(rows, default=lambda m: m.tolist())
        (folder / "camera.json").write_text(text, encoding="utf-8")
    else:
        with (folder / "camera.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            for row in rows:
                cells = {
                    k: " ".join(map(repr, v.ravel().tolist())) if isinstance(v, np.ndarray) else v
                    for k, v in row.items()
                }
                writer.writerow(cells)
    name = "camera.json" if form == "JSON" else "camera.csv"
    (folder / "capture.toml").write_text(f'camera = "{name}"\n', encoding="utf-8")


FORMS = ("CSV", "JSON", "projection", "angles")


def try_files(sequence: Sequence, trials: Trials) -> Iterator[tuple[str, list[str]]]:
    for kind, way in list_cases(trials.kinds, trials.ways):
        for held in trials.held:
            cells = []
            for form in FORMS:
                right = is_right(sequence, kind, way, form)
                with tempfile.TemporaryDirectory() as name:
                    folder = Path(name)
                    sequence.write(folder, HELD[held], RIGHT, "both")
                    cameras = {n: spoil(kind, way, sequence.cameras, n) for n in sequence.planes}
                    _write_rows(folder, form, cameras)
                    cells.append(settle(look(Path(folder)), right=right))
            yield f"{kind}, {way}, {held}", cells


def show_outcomes(rows: Mapping[str, list[list[str]]], head: tuple[str, ...]) -> None:
    """Print one table, kind by kind, of the outcomes in all sequences."""
    print(f"\n| matrices | {' | '.join(head)} |\n|---|{'---|' * len(head)}")
    for name, found in rows.items():
        columns = zip(*found, strict=True)
        cells = (", ".join(c for c, _ in Counter(column).most_common()) for column in columns)
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def keep_rows(
    rows: Iterator[tuple[str, list[str]]], kept: dict[str, list[list[str]]]
) -> Iterator[tuple[str, list[str]]]:
    for name, cells in rows:
        kept.setdefault(name, []).append(cells)
        yield name, cells


@click.command()
@click.argument("data", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--part", type=click.Choice(["KINDS", "COMMANDS", "FILES"]), multiple=True)
@click.option("--only", multiple=True, help="Sequences, 'SCENE/NAME' or 'SCENE/NAME still'.")
@click.option(
    "--shot",
    "shots",
    multiple=True,
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Captures in place of DATA's sequences.",
)
@click.option("--kind", multiple=True, default=(*TURNS, LONGER, *OTHERS), help="Of wrong matrices.")
@click.option("--way", type=click.Choice(WAYS), multiple=True, default=WAYS)
@click.option("--held", type=click.Choice(tuple(HELD)), multiple=True, help="What files hold.")
@click.option("--real", is_flag=True, help="Run the commands, in place of a dry run.")
def main(
    data: Path,
    *,
    part: tuple[str, ...],
    only: tuple[str, ...],
    shots: tuple[Path, ...],
    kind: tuple[str, ...],
    way: tuple[str, ...],
    held: tuple[str, ...],
    real: bool,
) -> None:
    torch.set_num_threads(1)
    few = Trials(kind, way, held or ("motion, normals",), real)
    every = Trials(kind, way, held or tuple(HELD), real)
    outcomes: dict[str, list[list[str]]] = {}
    side_cars: dict[str, list[list[str]]] = {}
    names = only or (() if shots else SEQUENCES)
    readers = [
        *(partial(read_sequence, data, n) for n in names),
        *(partial(read_capture, s) for s in shots),
    ]
    for read in readers:
        sequence = read()
        name = sequence.name
        if not part or "KINDS" in part:
            rows = keep_rows(try_kinds(sequence, every), outcomes)
            show_table(f"{name}: what files hold", every.held, rows)
        if not part or "COMMANDS" in part:
            head = tuple(n for n, _ in list_commands(Path(), Path(), real=real))
            show_table(f"{name}: commands", head, try_commands(sequence, few))
        if not part or "FILES" in part:
            rows = keep_rows(try_files(sequence, few), side_cars)
            show_table(f"{name}: side-cars", FORMS, rows)
    if outcomes:
        show_outcomes(outcomes, every.held)
    if side_cars:
        show_outcomes(side_cars, FORMS)


if __name__ == "__main__":
    main()
