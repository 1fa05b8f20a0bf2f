"""Files and options that mean harm: one message, exit 2 or 3, soon."""

from __future__ import annotations

import json
import os
import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]
DIGITS, DEEP = "9" * 5000, "[" * 100_000
UPSCALE = ("--system", "bicubic", "--scale", 2)


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    rng = np.random.default_rng(1)
    for n in (1, 2):
        planes = {name: rng.random((12, 16), np.float32) for name in "RGB"}
        write_exr(tmp_path / f"in/f.{n:04d}.exr", planes)
    return tmp_path / "in"


def refused(result: Result, code: int = 3) -> str:
    """One message, and no traceback."""
    assert result.exit_code == code, result.output
    assert isinstance(result.exception, SystemExit)
    assert result.stderr.count("Error: ") == 1
    assert len(result.stderr) < 3000
    return result.stderr


CAPTURES = [
    f"scale = {DIGITS}",
    f"camera_cuts = {DEEP}",
    "camera_cuts = [1000000000000000000000000000000000000]",
    "jitter_px = [nan, 0.0]",
    "jitter_px = [inf, 0.0]",
    "jitter_px = {period = 1000000000000}",
    "jitter_px = {scale = 1e300}",
    "frame_step = 0",
    "scale = 1000",
    'scale = "4"\n[motion]\nscale = 1e300',
    "[motion]\nzero = nan",
    "[depth]\nunit = inf",
    "[depth]\nunit = 1e300",
    "[depth]\nsky = 1e300",
    "[normal]\nsky = [1e300, 0.0, 0.0]",
    "[position]\nunit = 0",
    '[buffers]\nalbedo = [{channel = "R", factor = 1e300}, "G", "B"]',
    "[motion]\nscale = 0",
    "[motion]\nscale = true",
    "[motion]\nscale = 1e-300",
    "camera_cuts = [1e18]",
    "camera_cuts = [2.0]",
    "camera_cuts = [true]",
    "frame_step = true",
    "frame_step = 2.0",
    'frame_step = "2"',
    "scale = true",
    "jitter_px = [true, false]",
    'jitter_px = {period = "8"}',
    "jitter_px = {first_frame = true}",
    "[depth]\nunit = true",
    "[depth]\nunit = 1e-300",
    "[depth]\nnear = true",
    '[buffers]\nalbedo = [{channel = "R", factor = true}, "G", "B"]',
    f"{'.'.join('a' * 30_000)} = 1",
    f"[{'.'.join('a' * 30_000)}]",
    f"a = {{ {' . '.join(['a'] * 30_000)} = 1 }}",
    f"{'.'.join([chr(34) + 'a' + chr(34)] * 30_000)} = 1",
    f'[buffers]\nalbedo = "{" + ".join(["a.R"] * 20_000)}"',
    f'[buffers]\nalbedo = "{" * ".join(["2"] * 20_000)} * a.R"',
    f'[buffers]\nalbedo = "{" - ".join(["a.R"] * 20_000)}"',
    f"[buffers]\nalbedo = [{', '.join([chr(34) + 'a + b' + chr(34)] * 20_000)}]",
    "depth = 1979-05-27",
    "\0",
    'camera = "/dev/zero"',
    'camera = "../../../etc/passwd"',
    'camera = "f.0001.exr"',
    'camera = "."',
    'layout = "/dev/zero.toml"',
    f'layout = "{"x" * 100_000}.toml"',
]


@pytest.mark.parametrize("text", CAPTURES, ids=[text[:40] for text in CAPTURES])
def test_a_hostile_capture_toml_is_one_message(
    rtsr: Run, shot: Path, tmp_path: Path, text: str
) -> None:
    (shot / "capture.toml").write_text(text)
    started = time.process_time()
    message = refused(rtsr("upscale", shot, tmp_path / "out", *UPSCALE))
    assert "toml" in message or str(shot) in message
    assert "sys." not in message
    assert time.process_time() - started < 5.0


def list_numbers(schema: Any) -> list[dict[str, Any]]:
    """Every number that a schema of pydantic's allows."""
    if isinstance(schema, list):
        return [found for part in schema for found in list_numbers(part)]
    if not isinstance(schema, dict):
        return []
    own = [schema] if schema.get("type") in ("number", "integer") else []
    return own + [found for part in schema.values() for found in list_numbers(part)]


def test_every_number_of_a_capture_toml_has_a_range() -> None:
    numbers = list_numbers(CaptureDeclaration.model_json_schema())
    assert len(numbers) > 15
    for number in numbers:
        assert {"minimum", "exclusiveMinimum"} & number.keys(), number
        assert {"maximum", "exclusiveMaximum"} & number.keys(), number


@pytest.mark.parametrize("place", ["../beside.csv", "{beside}"])
def test_a_side_car_lies_below_in(rtsr: Run, shot: Path, tmp_path: Path, place: str) -> None:
    beside = tmp_path / "beside.csv"
    beside.write_text("frame,cut\n1,false\n2,true\n")
    (shot / "capture.toml").write_text(f'camera = "{place.format(beside=beside)}"')
    message = refused(rtsr("upscale", shot, tmp_path / "out", *UPSCALE))
    assert "leads out of" in message
    named = tmp_path / "cap.toml"
    named.write_text('camera = "beside.csv"')
    result = rtsr("upscale", shot, tmp_path / "out", *UPSCALE, "--capture", named)
    assert result.exit_code == 0, result.output


CAMERAS = [
    ("json", DEEP),
    ("json", f'[{{"frame": {DIGITS}}}]'),
    ("json", "[" + '{"frame": 1},' * 300_000 + "{}]"),
    ("json", '[{"frame": 1, "pre_exposure": 1e999}]'),
    ("json", '[{"frame": 1, "pre_exposure": NaN}]'),
    ("json", '[{"frame": 1, "worldToCamera": "x"}]'),
    ("json", '{"Frames": [{"Frame": 1}], "ReverseZ": 7}'),
    ("json", "null"),
    ("csv", "frame\n" * 300_000),
    ("csv", ",".join(f"c{i}" for i in range(100_000)) + "\n1"),
    ("csv", "frame,pre_exposure\n1,inf"),
    ("csv", "frame\n1\0"),
    ("csv", "\0\0"),
    ("csv", ""),
    ("csv", "frame,cut\n"),
    ("json", "[]"),
    ("json", '[{"frame": true}]'),
    ("json", '[{"frame": 1, "pre_exposure": true}]'),
    ("csv", "frame,cut\n" + "x" * 200_000),
]


@pytest.mark.parametrize(("kind", "text"), CAMERAS, ids=[t[:30] for _, t in CAMERAS])
def test_a_hostile_side_car_is_one_message(
    rtsr: Run, shot: Path, tmp_path: Path, kind: str, text: str
) -> None:
    (shot / f"camera.{kind}").write_text(text)
    (shot / "capture.toml").write_text(f'camera = "camera.{kind}"')
    started = time.perf_counter()
    assert f"camera.{kind}" in refused(rtsr("upscale", shot, tmp_path / "out", *UPSCALE))
    assert time.perf_counter() - started < 10.0


@pytest.mark.parametrize("option", ["--config", "--capture", "--layout", "--weights", "--init"])
def test_a_pipe_is_no_file_that_an_option_names(
    rtsr: Run, shot: Path, tmp_path: Path, option: str
) -> None:
    pipe = tmp_path / ("pipe.toml" if option == "--layout" else "pipe.json")
    os.mkfifo(pipe)
    if option in ("--config", "--init"):
        result = rtsr("train", "fusesr-fast", shot, "--out", tmp_path / "run", option, pipe)
    else:
        system = ("--system", "fusesr-fast") if option == "--weights" else UPSCALE
        result = rtsr("upscale", shot, tmp_path / "out", *system, "--simulate-lr", 4, option, pipe)
    assert result.exit_code in (2, 3), result.output
    assert isinstance(result.exception, SystemExit)


VALUES = [
    "nan",
    "inf",
    "-1",
    "1e300",
    DIGITS,
    "0x" + "f" * 5000,
    DEEP,
    "[]",
    "1979-05-27",
    "x" * 9000,
]
NAMES = [
    "training.steps", "training.batch", "training.crop", "training.seed", "training.ema",
    "training.learning_rate", "training.augmentation.exposure_stops", "network.loss.log",
    "data.workers", "training.picture_side",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", VALUES, ids=[v[:12] for v in VALUES])
def test_settings_out_of_range_are_one_message(
    rtsr: Run, tmp_path: Path, name: str, value: str
) -> None:
    chosen = ("--out", tmp_path / "run", "--dry-run", "--set", f"{name}={value}")
    arguments = ("train", "fusesr-fast", tmp_path, *chosen)
    message = refused(rtsr(*arguments))
    assert name.rpartition(".")[2] in message


def make_exr(path: Path, channels: list[bytes], size: tuple[int, int], extra: bytes = b"") -> Path:
    """Write the bytes of a file of empty rows, as no library would."""

    def attribute(name: bytes, kind: bytes, value: bytes) -> bytes:
        return name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value

    facts = struct.pack("<iIii", 1, 0, 1, 1)
    listed = b"".join(name + b"\0" + facts for name in sorted(channels)) + b"\0"
    window = struct.pack("<iiii", 0, 0, size[1] - 1, size[0] - 1)
    header = b"".join(
        (
            attribute(b"channels", b"chlist", listed),
            attribute(b"compression", b"compression", b"\0"),
            attribute(b"dataWindow", b"box2i", window),
            attribute(b"displayWindow", b"box2i", window),
            attribute(b"lineOrder", b"lineOrder", b"\0"),
            attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
            attribute(b"screenWindowCenter", b"v2f", bytes(8)),
            attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)),
            extra,
        )
    )
    start = b"\x76\x2f\x31\x01" + struct.pack("<I", 2) + header + b"\0"
    row = bytes(2 * len(channels) * size[1])
    block = 8 + len(row)
    table = b"".join(
        struct.pack("<Q", len(start) + 8 * size[0] + i * block) for i in range(size[0])
    )
    rows = b"".join(struct.pack("<ii", i, len(row)) + row for i in range(size[0]))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(start + table + rows)
    return path


def test_many_channels_are_refused_and_an_option_reads_them(rtsr: Run, tmp_path: Path) -> None:
    names = [b"c%05d" % i for i in range(4097)]
    path = make_exr(tmp_path / "in/f.0001.exr", [*names, b"R", b"G", b"B"], (2, 3))
    started = time.perf_counter()
    arguments = ("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE)
    message = refused(rtsr(*arguments))
    assert f"{path}: it has more than 4096 channels; rtsr --unlimited" in message
    assert time.perf_counter() - started < 5.0
    result = rtsr("--unlimited", *arguments)
    assert result.exit_code == 0, result.output
    assert "more than 4096 channels" in refused(rtsr(*arguments[:2], tmp_path / "again", *UPSCALE))


def test_200000_channels_and_a_large_attribute_take_no_time(rtsr: Run, tmp_path: Path) -> None:
    make_exr(tmp_path / "a/f.0001.exr", [b"c%06d" % i for i in range(200_000)], (1, 1))
    big = b"big\0string\0" + struct.pack("<I", 40 << 20) + bytes(40 << 20)
    make_exr(tmp_path / "b/f.0001.exr", [b"R", b"G", b"B"], (1, 1), big)
    started = time.perf_counter()
    for name, why in (("a", "more than 4096 channels"), ("b", "takes more than 32 MiB")):
        assert why in refused(rtsr("upscale", tmp_path / name, tmp_path / "out", *UPSCALE))
        assert why in rtsr("inspect", tmp_path / name).output
    assert time.perf_counter() - started < 10.0


def test_a_small_file_that_unpacks_to_gigabytes_is_refused(rtsr: Run, tmp_path: Path) -> None:
    zeros = np.zeros((10_000, 10_000), np.float32)
    write_exr(tmp_path / "in/f.0001.exr", dict.fromkeys("RGB", zeros))
    del zeros
    tracemalloc.start()
    message = refused(rtsr("upscale", tmp_path / "in", tmp_path / "out", *UPSCALE))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "unpack to 1144 MiB; rtsr --unlimited" in message
    assert peak < 50 << 20


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 3)], ids=str)
def test_frames_of_a_pixel_or_a_line_of_them_are_done_or_refused(
    rtsr: Run, tmp_path: Path, size: tuple[int, int]
) -> None:
    height, width = size
    rng = np.random.default_rng(2)
    for folder, scale in (("lr", 1), ("hr", 2)):
        for n in (1, 2, 3):
            shape = (height * scale, width * scale)
            planes = {name: rng.random(shape, np.float32) for name in (*"RGB", "depth.Z")}
            planes |= {f"albedo.{c}": rng.random(shape, np.float32) for c in "RGB"}
            planes |= {f"motion.{c}": rng.random(shape, np.float32) for c in "XY"}
            planes |= {f"normal.{c}": np.full(shape, c == "Z", np.float32) for c in "XYZ"}
            planes |= {name: rng.random(shape, np.float32) for name in ("roughness", "metallic")}
            write_exr(tmp_path / "in" / folder / f"f.{n:04d}.exr", planes)
    lr = tmp_path / "in" / "lr"
    commands: list[tuple[object, ...]] = [
        ("inspect", tmp_path / "in"),
        *(
            ("upscale", tmp_path / "in", tmp_path / name, "--system", name, "--preview")
            for name in ("bicubic", "demod-bicubic", "demod-guided", "taau", "fusesr-fast")
        ),
        ("demodulate", lr, tmp_path / "parts"),
        ("label", lr, tmp_path / "label", "--kind", "vrs"),
        ("predict-vrs", lr, tmp_path / "vrs"),
        ("evaluate", tmp_path / "bicubic", "--ref", tmp_path / "in/hr", "--metric", "psnr,flip"),
    ]
    for command in commands:
        result = rtsr(*command)
        assert result.exit_code in (0, 1, 3), (command, result.output)
        assert isinstance(result.exception, SystemExit | None), (command, result.exc_info)
    assert rtsr("upscale", lr, tmp_path / "alone", *UPSCALE).exit_code == 0


def make_part(**changes: Any) -> dict[str, Any]:
    frame = {"psnr": 30.0, "nonfinite": 0, "counted": True, "regions": {"all": None}}
    test = {"method": "m", "shot": ".", "notes": [], "frames": {"1": frame}}
    metric = {"title": "PSNR", "unit": "dB", "better": "higher"}
    return {
        "protocol": "rtsr", "options": {}, "metrics": {"psnr": metric}, "rules": "",
        "tests": {"m": test}, **changes,
    }  # fmt: skip


def test_parts_of_a_shard_of_any_size_take_no_memory(rtsr: Run, tmp_path: Path) -> None:
    path = tmp_path / "part.json"
    path.write_text(json.dumps(make_part(shard={"parts": [1], "of": 10**18, "frames": None})))
    result = rtsr("evaluate", "--merge", path)
    assert result.exit_code in (0, 3), result.output
    assert isinstance(result.exception, SystemExit | None)


@pytest.mark.parametrize(
    "number", ["9" * 5000, "1" * 40, "x", "\u0661"], ids=["digits", "long", "word", "arabic"]
)
def test_frames_of_a_part_have_numbers(rtsr: Run, tmp_path: Path, number: str) -> None:
    part = make_part()
    part["tests"]["m"]["frames"] = {number: part["tests"]["m"]["frames"]["1"]}
    path = tmp_path / "part.json"
    path.write_text(json.dumps(part))
    assert "has no number" in refused(rtsr("evaluate", "--merge", path))
