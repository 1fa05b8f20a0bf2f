"""`upscale --passthrough`: channels that go through unchanged, at the output's size."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
FRAME = "frame.0002.exr"


@pytest.fixture
def shot(small_shot: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(small_shot, tmp_path / "shot"))


def add(folder: Path, make: Callable[[np.ndarray], dict[str, Any]]) -> None:
    """Give every frame of a folder more channels."""
    for path in sorted(folder.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        planes |= make(next(iter(planes.values())))
        write_exr(path, planes, attributes=header.attributes)


def channels(path: Path) -> dict[str, Any]:
    return read_channels(path, read_header(path).channels)


def test_channels_of_hr_come_out_bit_by_bit(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    numbers = np.arange(128 * 192, dtype=np.uint32).reshape(128, 192) + 2**31
    add(shot / "hr", lambda _: {"crypto.id": numbers, "crypto.weight": numbers.astype(np.float32)})
    choice = ("--passthrough", "crypto.*", "--passthrough", "albedo.G", "--system", "bicubic")
    result = rtsr("upscale", shot, tmp_path / "out", *choice)
    assert result.exit_code == 0, result.output
    out, source = channels(tmp_path / "out" / FRAME), channels(shot / "hr" / FRAME)
    assert set(out) == {"R", "G", "B", "crypto.id", "crypto.weight", "albedo.G"}
    for name in ("crypto.id", "crypto.weight", "albedo.G"):
        assert out[name].dtype == source[name].dtype
        assert np.array_equal(out[name], source[name])


CRYPTO = "cryptomatte/ab12cd3/"
MANIFEST = {
    f"{CRYPTO}name": "crypto_object",
    f"{CRYPTO}hash": "MurmurHash3_32",
    f"{CRYPTO}conversion": "uint32_to_float32",
    f"{CRYPTO}manifest": '{"ball":"3f2a9c11"}',
}
OTHER = {"cryptomatte/9999999/name": "crypto_material", "cryptomatte/9999999/manifest": "{}"}
HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def fill(value: float, *names: str, scale: int = 1) -> dict[str, Any]:
    return {name: np.full((8 * scale, 12 * scale), value, np.float32) for name in names}


def write_in_another_part(folder: Path) -> None:
    ids = {**MANIFEST, **OTHER, "ids": "of this part", "colorInteropID": "data"}
    parts = [
        OpenEXR.Part({**HEADER, "owner": "me"}, fill(0.5, *"RGB"), "rgba"),
        OpenEXR.Part({**HEADER, **ids}, fill(0.25, *"RG"), "crypto_object00"),
    ]
    folder.mkdir(parents=True)
    OpenEXR.File(parts).write(str(folder / "f.0001.exr"))


def write_in_another_file(folder: Path) -> None:
    write_exr(folder / "beauty.0001.exr", fill(0.5, *"RGB"), attributes={"owner": "me"})
    names = ("crypto_object00.R", "crypto_object00.G")
    ids = {**MANIFEST, **OTHER, "ids": "of this part", "owner": "another", "rtsr:stamp": "none"}
    write_exr(folder / "crypto.0001.exr", fill(0.25, *names), attributes=ids)


def write_in_hr(folder: Path) -> None:
    stale = {f"{CRYPTO}name": "crypto_object", f"{CRYPTO}manifest": "stale"}
    write_exr(folder / "lr" / "f.0001.exr", fill(0.5, *"RGB"), attributes={"owner": "me", **stale})
    names = ("crypto_object00.R", "crypto_object00.G", "depth.Z")
    write_exr(
        folder / "hr" / "f.0001.exr",
        fill(0.25, *names, scale=2),
        attributes={**MANIFEST, **OTHER, "ids": "of this part", "owner": "another"},
    )


@pytest.mark.parametrize("make", [write_in_another_part, write_in_another_file, write_in_hr])
def test_channels_bring_the_attributes_of_the_header_that_they_come_from(
    rtsr: Run, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "in")
    scale = () if make is write_in_hr else ("--scale", 2)
    choice = ("--system", "bicubic", *scale, "--passthrough", "crypto_object*")
    result = rtsr("upscale", tmp_path / "in", tmp_path / "out", *choice)
    assert result.exit_code == 0, result.output
    (out,) = (tmp_path / "out").iterdir()
    attributes = read_header(out).attributes
    assert {k: v for k, v in attributes.items() if k.startswith("cryptomatte")} == MANIFEST
    # the picture's own attributes stay, and those of the channels' header go along
    assert (attributes["owner"], attributes["ids"]) == ("me", "of this part")
    assert attributes.get("colorInteropID") != "data"
    assert attributes["rtsr:stamp"] != "none"


def test_nothing_of_a_header_comes_along_that_no_channel_comes_from(
    rtsr: Run, tmp_path: Path
) -> None:
    write_in_another_part(tmp_path / "in")
    choice = ("--system", "bicubic", "--scale", 2)
    assert rtsr("upscale", tmp_path / "in", tmp_path / "out", *choice).exit_code == 0
    attributes = read_header(tmp_path / "out" / "f.0001.exr").attributes
    assert not any(name.startswith(("cryptomatte", "ids")) for name in attributes)


def test_channels_that_only_lr_has_are_repeated(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    add(shot / "lr", lambda plane: {"flag": np.arange(plane.size, dtype=np.uint32).reshape(32, 48)})
    result = rtsr("upscale", shot, tmp_path / "out", "--passthrough", "fl?g")
    assert result.exit_code == 0, result.output
    flag = channels(tmp_path / "out" / FRAME)["flag"]
    y, x = np.mgrid[0:128, 0:192]
    assert np.array_equal(flag, (y // 4) * 48 + x // 4)


def test_a_wildcard_takes_everything_but_the_outputs_own(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    plain = tmp_path / "plain"
    assert rtsr("upscale", shot, plain, "--system", "bicubic").exit_code == 0
    choice = ("--passthrough", "*", "--system", "bicubic")
    assert rtsr("upscale", shot, tmp_path / "out", *choice).exit_code == 0
    out, expected = channels(tmp_path / "out" / FRAME), channels(plain / FRAME)
    assert all(np.array_equal(out[c], expected[c]) for c in "RGB")
    sources = channels(shot / "lr" / FRAME), channels(shot / "hr" / FRAME)
    assert set(out) == set(sources[0]) | set(sources[1])


def test_radiance_of_hr_never_goes_through(
    rtsr: Run, small_capture: Path, shot: Path, tmp_path: Path
) -> None:
    """HR files that hold radiance give their G-buffer only; its noise changes nothing."""
    random = np.random.default_rng(1)
    for path in sorted((shot / "hr").glob("*.exr")):
        planes = channels(small_capture / path.name)
        planes |= {c: random.random(planes[c].shape).astype(np.float16) for c in "RGB"}
        planes["A"] = random.random(planes["R"].shape).astype(np.float16)
        write_exr(path, planes, attributes=read_header(path).attributes)
    result = rtsr("upscale", shot, tmp_path / "out", "--passthrough", "*", "--system", "bicubic")
    assert result.exit_code == 0, result.output
    out = channels(tmp_path / "out" / FRAME)
    assert "A" not in out
    noise = channels(shot / "hr" / FRAME)
    assert not any(np.array_equal(out[c], noise[c]) for c in "RGB")
    assert np.array_equal(out["roughness"], noise["roughness"])


def test_a_capture_gives_the_middle_sample_of_each_output_pixel(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    choice = ("--simulate-lr", 2, "--samples-per-pixel", 2, "--passthrough", "objectid")
    result = rtsr("upscale", small_capture, tmp_path / "out", *choice, "--system", "bicubic")
    assert result.exit_code == 0, result.output
    found = channels(tmp_path / "out" / FRAME)["objectid"]
    assert np.array_equal(found, channels(small_capture / FRAME)["objectid"][1::2, 1::2])


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("R", "--passthrough R would replace the output's own channel"),
        ("A", "--passthrough A would replace the output's own channel"),
        ("nosuch.*", "no channel matches --passthrough nosuch.*; there are: albedo.B"),
    ],
)
def test_patterns_that_cannot_be_met_are_refused(
    rtsr: Run, shot: Path, tmp_path: Path, pattern: str, message: str
) -> None:
    result = rtsr("upscale", shot, tmp_path / "out", "--passthrough", pattern)
    assert result.exit_code == 3
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_channel_that_some_frames_lack_is_refused_before_work(
    rtsr: Run, shot: Path, tmp_path: Path
) -> None:
    add(shot / "hr", lambda plane: {"extra": plane})
    path = shot / "hr" / "frame.0003.exr"
    planes = channels(path)
    del planes["extra"]
    write_exr(path, planes, attributes=read_header(path).attributes)
    result = rtsr("upscale", shot, tmp_path / "out", "--passthrough", "extra")
    assert result.exit_code == 3
    assert f"{shot}/hr, frame 3: channels of --passthrough are missing (extra" in result.stderr


def test_what_goes_through_is_part_of_the_stamp(rtsr: Run, shot: Path, tmp_path: Path) -> None:
    add(shot / "hr", lambda plane: {"extra": plane})
    choice = ("upscale", shot, tmp_path / "out", "--system", "bicubic")
    assert rtsr(*choice).exit_code == 0
    assert rtsr(*choice, "--passthrough", "extra").exit_code == 3
    assert rtsr(*choice, "--passthrough", "extra", "--overwrite").exit_code == 0
    assert "0 written, 4 kept" in rtsr(*choice, "--passthrough", "extra").output
    add(shot / "hr", lambda plane: {"extra": plane * 0})
    assert rtsr(*choice, "--passthrough", "extra").exit_code == 3
