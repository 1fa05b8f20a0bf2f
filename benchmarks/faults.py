"""Faulty inputs by the thousand: what commands make of files that are damaged or hostile.

    python benchmarks/faults.py [--seconds 600] [--seed 1] [--only exr-header]

Every case spoils one file of a small valid set (EXR headers and chunks, TOML, JSON, CSV, weights,
packs, states) or one option, runs one command in this process, and holds it to: an exit code of
the table, no traceback, no file outside OUT that was made or changed, an end within ten seconds.
Prints counts by kind and exit code, and each case that failed with what repeats it. `tests/fuzz`
runs the same for half a minute.
"""

from __future__ import annotations

import json
import random
import shutil
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import torch
from click.testing import CliRunner

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.network.weights import SHIPPED

EXIT_CODES = frozenset({0, 1, 2, 3})
SLOWEST_S = 10.0
SIDE = 12
"""Height of the LR frames in pixels; HR is twice as large."""

HEADER_BYTES = 1500

HOSTILE = (
    "nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "1e999", "9" * 5000, "0x" + "f" * 5000,
    "-1", "0", "-0.0", "2147483648", "18446744073709551616", "1000000000000000000000",
    "true", "null", "NaN", "1979-05-27", "[]", "{}", "[[[]]]", "[1, 2", "[" * 2000,
    "[" + "1," * 500 + "1]", '""', '"x"', '"/dev/zero"', '"../../.."', '"\\u0000"',
    '"' + "x" * 70000 + '"',
)  # fmt: skip
"""Tokens that take the place of a value."""

CAPTURE = """layout = "rtsr"
roughness = "perceptual"
specular = "metallic"
colorspace = "lin_rec709"
jitter_px = [0.125, -0.125]
scale = 2
frame_step = 1
camera_cuts = [3]
camera = "camera.json"
[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
scale = 1.0
zero = 0.0
file_offset = 0
[depth]
kind = "planar"
unit = "m"
sky = 65504.0
[normal]
space = "world"
packed = false
sky = [0.0, 0.0, 0.0]
[buffers]
albedo = "albedo.RGB"
motion = ["motion.X", {channel = "motion.Y", factor = 1.0, zero = 0.0}]
"""

TRAINING = """[training]
steps = 1
crop = 4
batch = 2
scale = 2
seed = 1
learning_rate = 1e-3
ema = 0.9
warmup = 0
validation_frames = 1
picture_side = 16
[training.augmentation]
turns = true
exposure_stops = 1.0
material_share = 0.5
[network.loss]
log = 0.1
tonemapped = 1.0
[data]
workers = 1
"""

SETTINGS = (
    "training.steps", "training.batch", "training.scale", "training.seed", "training.ema",
    "training.learning_rate", "training.decay", "training.precision", "training.jitter",
    "training.crop", "training.augmentation.exposure_stops", "training.augmentation.turns",
    "training", "training.steps.x", "network", "network.loss.log", "network.base",
    "network.preset", "data.workers", "data.validation", "a.b.c", "",
)  # fmt: skip


@dataclass(frozen=True)
class FaultReport:
    """What became of the cases.

    Attributes:
        counts: (kind, exit code) -> cases.
        failures: what went wrong, with what repeats it.
        slowest_s: the longest case.
    """

    counts: Counter[tuple[str, int]]
    failures: list[str]
    slowest_s: float


def make_planes(number: int, height: int) -> dict[str, np.ndarray]:
    """Channels of the canonical layout, a wave that moves."""
    width = height * 4 // 3
    y, x = np.mgrid[0:height, 0:width].astype(np.float32) * (SIDE / height)
    wave = (0.5 + 0.4 * np.sin(0.8 * (x + number)) * np.cos(0.5 * y)).astype(np.float32)
    flat = np.zeros_like(wave)
    planes = {name: wave * gain for name, gain in zip("RGB", (1.0, 0.7, 0.4), strict=True)}
    planes |= {f"albedo.{c}": 0.8 * wave for c in "RGB"}
    planes |= {"normal.X": flat, "normal.Y": flat, "normal.Z": flat + 1, "depth.Z": 2 + wave}
    planes |= {"motion.X": flat + height / SIDE, "motion.Y": flat, "metallic": flat}
    planes["roughness"] = flat + 0.5
    return {name: plane.astype(np.float32) for name, plane in planes.items()}


def run_rtsr(*arguments: object) -> tuple[int, str, BaseException | None]:
    """Run a command in this process: exit code, what it said, what it raised."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = CliRunner().invoke(group, [str(a) for a in arguments])
    raised = None if isinstance(result.exception, SystemExit) else result.exception
    return result.exit_code, result.output, raised


def make_inputs(folder: Path) -> Path:
    """Write the valid set that cases spoil."""
    matrix = np.eye(4)
    projection = np.diag([1.3, 1.3, -1.0, 0.0])
    projection[2, 3], projection[3, 2] = -1.0, -0.05
    rows = [
        {
            "frame": n,
            "worldToCamera": matrix.flatten().tolist(),
            "worldToNDC": projection.flatten().tolist(),
            "jitter_px": [0.1, 0.2],
            "pre_exposure": 1.0,
        }
        for n in (1, 2, 3)
    ]
    for number in (1, 2, 3):
        for name, height in (("lr", SIDE), ("hr", 2 * SIDE)):
            attributes = {
                "worldToCamera": matrix.astype(np.float32),
                "worldToNDC": projection.astype(np.float32),
            }
            path = folder / "shot" / name / f"f.{number:04d}.exr"
            write_exr(path, make_planes(number, height), attributes=attributes)
    (folder / "shot" / "capture.toml").write_text(CAPTURE)
    (folder / "shot" / "camera.json").write_text(json.dumps({"frames": rows}, indent=0))
    head = "frame,worldToCamera,jitter_px,pre_exposure,cut\n"
    lines = [f"{n},{' '.join(['1'] * 16)},0.1 0.2,1.0,false\n" for n in (1, 2, 3)]
    (folder / "camera.csv").write_text(head + "".join(lines))
    (folder / "by-csv.toml").write_text('layout = "rtsr"\ncamera = "camera.csv"\n')
    layout = '[buffers]\ncolor = "RGB"\ndepth = "depth.Z"\n[depth]\nkind = "planar"\nunit = 1.0\n'
    (folder / "layout.toml").write_text(layout)
    (folder / "training.toml").write_text(TRAINING)
    shutil.copy(SHIPPED / "fusesr-fast-2x.safetensors", folder / "weights.safetensors")
    commands = (
        "evaluate {in}/shot/hr {in}/shot/hr --metric psnr --output {in}/part.json",
        "train fusesr-fast {in}/shot --pack {in}/pack.rtsr-clips --pack-crops 3"
        f" --cache {{in}}/cache {CONFIG}",
        f"{TRAIN_PACK} {{in}}/run",
    )
    done = [run_rtsr(*command.format(**{"in": folder}).split()) for command in commands]
    shutil.rmtree(folder / "cache")
    if any(code for code, _, _ in done):
        raise RuntimeError(f"the valid set is refused: {done}")
    return folder


def spoil_bytes(content: bytes, rng: random.Random, end: int) -> bytes:
    """Change, cut, double or blank bytes before `end`."""
    spoilt = bytearray(content)
    end = min(end, len(content))
    kind = rng.randrange(6)
    at = rng.randrange(end)
    if kind == 0:
        return content[:at]
    if kind == 1:
        return content[:at] + rng.randbytes(rng.choice((1, 4, 64))) + content[at:]
    if kind == 2:
        return content[:at] + content[min(at + rng.choice((1, 4, 64)), len(content)) :]
    if kind == 3:
        word = struct.pack("<I", rng.choice((0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 65536)))
        spoilt[at : at + 4] = word
        return bytes(spoilt)
    for _ in range(rng.choice((1, 1, 2, 8))):
        spoilt[rng.randrange(end)] = rng.randrange(256)
    return bytes(spoilt)


def spoil_text(content: bytes, rng: random.Random) -> bytes:
    """Put hostile tokens in the place of values, or spoil lines, or bytes."""
    text = content.decode()
    kind = rng.randrange(10)
    if kind == 0:
        return spoil_bytes(content, rng, len(content))
    if kind == 1:
        lines = text.splitlines(keepends=True)
        line = rng.randrange(len(lines))
        return "".join(
            lines[:line] + lines[line:][:1] * rng.choice((0, 2, 3)) + lines[line + 1 :]
        ).encode()
    if kind == 2:
        return f"{'[' * 100_000}{text}".encode()
    starts = [i for i, c in enumerate(text) if c in "=:,[ " and i + 1 < len(text)]
    at = rng.choice(starts) + 1
    end = at
    while end < len(text) and text[end] not in ",]}\n":
        end += 1
    return (text[:at] + " " + rng.choice(HOSTILE) + text[end:]).encode()


Spoil = Callable[[bytes, random.Random], bytes]


def spoil_header(content: bytes, rng: random.Random) -> bytes:
    """Spoil the header of an EXR file, or its table of chunks."""
    return spoil_bytes(content, rng, HEADER_BYTES)


def spoil_chunks(content: bytes, rng: random.Random) -> bytes:
    """Spoil any bytes behind the header."""
    start = min(HEADER_BYTES, len(content) - 1)
    return content[:start] + spoil_bytes(content[start:], rng, len(content))


def spoil_metadata(content: bytes, rng: random.Random) -> bytes:
    """Spoil the JSON before tensors, as text or as bytes, or the tensors."""
    size = int.from_bytes(content[:8], "little")
    if rng.random() < 0.3:
        return spoil_bytes(content, rng, len(content))
    head = spoil_text(content[8 : 8 + size], rng)
    if rng.random() < 0.2:
        return content[:8] + head + content[8 + size :]
    return struct.pack("<Q", len(head)) + head + content[8 + size :]


SHOT_COMMANDS = (
    "inspect {in}/shot --json",
    "inspect {in}/shot/lr",
    "upscale {in}/shot {out} --system bicubic",
    "upscale {in}/shot {out} --system taau --on-nonfinite zero",
    "upscale {in}/shot {out} --system demod-guided --on-missing hold",
    "demodulate {in}/shot/lr {out}",
    "evaluate {in}/shot/lr {in}/shot/lr --metric psnr --output {out}/r.html",
    "predict-vrs {in}/shot/lr {out} --tile 8",
)

CONFIG = "--config {in}/training.toml"
TRAIN_SHOT = "train fusesr-fast {in}/shot --out {out}"
TRAIN_PACK = f"train fusesr-fast {{in}}/pack.rtsr-clips {CONFIG} --out"
WEIGHTS = "weights.safetensors"
UPSCALE = "upscale {in}/shot {out} --system"

KINDS: dict[str, tuple[str, Spoil | None, Sequence[str]]] = {
    "exr-header": ("shot/lr/f.0002.exr", spoil_header, SHOT_COMMANDS),
    "exr-chunks": ("shot/lr/f.0002.exr", spoil_chunks, SHOT_COMMANDS),
    "capture": ("shot/capture.toml", spoil_text, SHOT_COMMANDS[:6]),
    "camera-json": ("shot/camera.json", spoil_text, SHOT_COMMANDS[:4]),
    "camera-csv": (
        "camera.csv",
        spoil_text,
        ("inspect {in}/shot/lr --capture {in}/by-csv.toml",),
    ),
    "layout": ("layout.toml", spoil_text, ("inspect {in}/shot/lr --layout {in}/layout.toml",)),
    "settings": (
        "training.toml",
        spoil_text,
        (
            f"{TRAIN_SHOT} {CONFIG} --dry-run",
            f"{TRAIN_PACK} {{out}} --set training.steps=1 --set training.batch=2",
        ),
    ),
    "set": ("", None, (f"{TRAIN_SHOT} --dry-run --set {{value}}",)),
    "frames": ("", None, (f"{UPSCALE} bicubic --frames {{value}}",)),
    "weights": (WEIGHTS, spoil_metadata, (f"{UPSCALE} fusesr-fast --weights {{in}}/{WEIGHTS}",)),
    "part": ("part.json", spoil_text, ("evaluate {in}/part.json --merge --output {out}/r.html",)),
    "pack": ("pack.rtsr-clips", spoil_metadata, (f"{TRAIN_PACK} {{out}}",)),
    "state": ("run/state/state.json", spoil_text, (f"{TRAIN_PACK} {{in}}/run",)),
    "manifest": ("shot/manifest.json", spoil_text, (f"{TRAIN_SHOT} {CONFIG} --cache {{out}}/c",)),
}
"""Kind -> the file that is spoilt, how, and commands that read it."""

MANIFEST = b'{"sequences": [{"scene": "a", "sequence": "b", "split": "train"}]}'


def snapshot(folder: Path, out: Path) -> dict[str, tuple[int, int]]:
    """Size and time of every file, but those of OUT."""
    files = (p for p in folder.rglob("*") if not p.is_relative_to(out) and p.is_file())
    return {str(p): (p.stat().st_size, p.stat().st_mtime_ns) for p in files}


def run_case(inputs: Path, work: Path, kind: str, number: str) -> tuple[int, list[str], float]:
    """Run one case; return the exit code, what went wrong, and seconds."""
    rng = random.Random(f"{kind} {number}")
    file, spoil, commands = KINDS[kind]
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(inputs, work / "in", copy_function=shutil.copy)
    out = work / ("in/run" if kind == "state" else "out")
    if spoil is not None:
        path = work / "in" / file
        original = path.read_bytes() if path.exists() else MANIFEST
        path.write_bytes(spoil(original, rng))
    value = rng.choice(HOSTILE).strip('"').replace("\0", "")
    if kind == "set":
        value = f"{rng.choice(SETTINGS)}={value}"
    places = {"in": work / "in", "out": work / "out", "value": value}
    arguments = [word.format(**places) for word in rng.choice(commands).split()]
    before = snapshot(work, out)
    started = time.perf_counter()
    code, said, raised = run_rtsr(*arguments)
    seconds = time.perf_counter() - started
    wrong = []
    if raised is not None:
        lines = traceback.format_exception(raised)
        wrong.append(f"raises {type(raised).__name__}: {raised!s:.200}\n{''.join(lines[-4:])}")
    elif code not in EXIT_CODES:
        wrong.append(f"exit code {code}")
    if "Traceback" in said:
        wrong.append("prints a traceback")
    if snapshot(work, out) != before:
        wrong.append("changes files outside OUT")
    if seconds > SLOWEST_S:
        wrong.append(f"takes {seconds:.1f} s")
    where = f"{kind} {number}: rtsr {' '.join(arguments)[:300]}"
    return code, [f"{where}: {what}" for what in wrong], seconds


def list_cases(seed: int, only: str | None) -> Iterator[tuple[str, str]]:
    """Kinds in turn, numbered."""
    number = 0
    while True:
        for kind in KINDS:
            if only in (None, kind):
                yield kind, f"{seed}.{number}"
        number += 1


def run_faults(folder: Path, *, seconds: float, seed: int, only: str | None = None) -> FaultReport:
    """Run cases for so many seconds, every kind alike often."""
    inputs = make_inputs(folder / "inputs")
    counts: Counter[tuple[str, int]] = Counter()
    failures: list[str] = []
    slowest = 0.0
    end = time.perf_counter() + seconds
    for kind, number in list_cases(seed, only):
        if time.perf_counter() > end:
            break
        code, wrong, took = run_case(inputs, folder / "work", kind, number)
        counts[kind, code] += 1
        failures += wrong
        slowest = max(slowest, took)
    return FaultReport(counts, failures, slowest)


@click.command()
@click.option("--seconds", default=600.0, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option("--only", type=click.Choice(list(KINDS)), help="One kind alone.")
def main(seconds: float, seed: int, only: str | None) -> None:
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        report = run_faults(Path(folder), seconds=seconds, seed=seed, only=only)
    for failure in report.failures:
        print(failure)
    print(f"| kind | {' | '.join(f'exit {code}' for code in sorted(EXIT_CODES))} |")
    print(f"|---|{'---|' * len(EXIT_CODES)}")
    for kind in KINDS:
        row = [str(report.counts[kind, code]) for code in sorted(EXIT_CODES)]
        print(f"| {kind} | {' | '.join(row)} |")
    total = sum(report.counts.values())
    print(f"{total} cases, {len(report.failures)} failures, the slowest {report.slowest_s:.1f} s")
    sys.exit(1 if report.failures else 0)


if __name__ == "__main__":
    main()
