from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.captures.capture_file import read_capture
from rtsr_cli.core.captures.layout_files import read_layout
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import ConfigError, FrameFolderError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import RoughnessKind
from rtsr_cli.core.frames.motion import MotionUnit, YAxis
from rtsr_cli.core.pairs.opening import (
    ReadOptions,
    check_shot,
    find_shots_of,
    measure_set,
    open_shot,
)

SIZE = (2, 4)

COMPLETE = """
roughness = "smoothness"

[buffers]
color = "beauty.RGB"
normal = "nrm:XYZ"
depth = "zpass:R"
motion = [
    {channel = "R", file = "mv*", factor = 2.0, zero = 0.5},
    {channel = "G", file = "mv*", factor = -2.0, zero = 0.5},
]
roughness = "gloss"

[motion]
unit = "uv"
direction = "previous-minus-current"
y_axis = "up"

[depth]
unit = "cm"

[position]
unit = "mm"
"""


def layout(tmp_path: Path, text: str) -> Layout:
    path = tmp_path / "my.toml"
    path.write_text(text, encoding="utf-8")
    return read_layout(path)


def refusal(tmp_path: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        layout(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "my.toml"))
    return message


def write(folder: Path, name: str, **channels: float) -> None:
    """One frame 1 of flat channels; `_` in a keyword is a dot in the channel."""
    planes = {k.replace("_", "."): np.full(SIZE, v, np.float32) for k, v in channels.items()}
    write_exr(folder / f"{name}.0001.exr", planes)


def reader_of(root: Path, layout: Path | str | None = None) -> FrameReader:
    options = ReadOptions(layout=None if layout is None else str(layout))
    shot = find_shots_of(root, options)[0]
    opened = open_shot(shot, root, options)
    check_shot(opened)
    return measure_set(shot.frames, opened, jittered=True).reader


def value(reader: FrameReader, buffer: Buffer) -> list[float]:
    return [round(float(v), 4) for v in reader.read(1, (buffer,)).gbuffer[buffer][0, :, 0, 0]]


def test_a_layout_file_says_which_channel_of_which_file_is_which_buffer(tmp_path: Path) -> None:
    found = layout(tmp_path, COMPLETE)
    assert found.name == "my.toml"
    places = {
        b: [(c.places[0].file, c.places[0].channel) for c in cs] for b, cs in found.buffers.items()
    }
    assert places == {
        Buffer.COLOR: [("*", "beauty.R"), ("*", "beauty.G"), ("*", "beauty.B")],
        Buffer.NORMAL: [("nrm", "X"), ("nrm", "Y"), ("nrm", "Z")],
        Buffer.DEPTH: [("zpass", "R")],
        Buffer.MOTION: [("mv*", "R"), ("mv*", "G")],
        Buffer.ROUGHNESS: [("*", "gloss")],
    }
    assert [(c.factor, c.offset) for c in found.buffers[Buffer.MOTION]] == [(2.0, 0.5), (-2.0, 0.5)]
    conventions = found.conventions
    assert conventions.motion.unit is MotionUnit.UV
    assert conventions.motion.y_axis is YAxis.UP
    assert conventions.roughness is RoughnessKind.SMOOTHNESS
    assert (conventions.depth.unit_m, conventions.position_unit_m) == (0.01, 0.001)


def dump(folder: Path) -> Path:
    write(folder, "main", beauty_R=1.0, beauty_G=2.0, beauty_B=3.0, gloss=0.25)
    write(folder, "nrm", X=0.0, Y=0.0, Z=1.0)
    write(folder, "zpass", R=250.0)
    write(folder, "mvpass", R=0.75, G=0.625)
    return folder


def test_a_dump_is_read_by_a_layout_file(tmp_path: Path) -> None:
    layout(tmp_path, COMPLETE)
    reader = reader_of(dump(tmp_path / "shot"), tmp_path / "my.toml")
    assert value(reader, Buffer.COLOR) == [1.0, 2.0, 3.0]
    assert value(reader, Buffer.DEPTH) == [2.5]
    assert value(reader, Buffer.ROUGHNESS) == [0.75]
    # (0.75 - 0.5) * 2 of 4 columns; -(0.625 - 0.5) * 2 of 2 rows, y up
    assert value(reader, Buffer.MOTION) == [2.0, 0.5]


def test_a_capture_names_a_layout_file_relative_to_itself(tmp_path: Path) -> None:
    dump(tmp_path / "shots" / "a")
    layout(tmp_path, COMPLETE)
    capture = tmp_path / "shots" / "capture.toml"
    capture.write_text('layout = "../my.toml"')
    reader = reader_of(tmp_path / "shots")
    assert reader.layout.name == "my.toml"
    assert value(reader, Buffer.COLOR) == [1.0, 2.0, 3.0]


def test_buffers_in_a_capture_are_laid_over_the_detected_layout(tmp_path: Path) -> None:
    write(tmp_path, "f", R=1.0, G=1.0, B=1.0, albedo_R=0.5, albedo_G=0.5, albedo_B=0.5, zz=7.0)
    (tmp_path / "capture.toml").write_text('[buffers]\ndepth = "zz"\nroughness = "albedo.G"')
    reader = reader_of(tmp_path)
    assert reader.layout.name == "rtsr + capture.toml"
    assert reader.stored == {Buffer.COLOR, Buffer.ALBEDO, Buffer.DEPTH, Buffer.ROUGHNESS}
    assert value(reader, Buffer.DEPTH) == [7.0]
    assert value(reader, Buffer.ROUGHNESS) == [0.5]


def test_buffers_in_a_capture_are_laid_over_the_layout_it_names(tmp_path: Path) -> None:
    write(tmp_path, "f", L_Combined_R=1.0, L_Combined_G=1.0, L_Combined_B=1.0, zz=7.0)
    (tmp_path / "capture.toml").write_text('layout = "blender"\n[buffers]\ndepth = "zz"')
    reader = reader_of(tmp_path)
    assert reader.stored == {Buffer.COLOR, Buffer.DEPTH}
    assert reader.conventions.motion.y_axis is YAxis.UP


def test_buffers_in_a_capture_stand_alone_where_nothing_is_detected(tmp_path: Path) -> None:
    write(tmp_path, "f", foo=1.0, bar=2.0, baz=3.0)
    (tmp_path / "capture.toml").write_text('[buffers]\ncolor = ["foo", "bar", "baz"]')
    reader = reader_of(tmp_path)
    assert reader.layout.name == "capture.toml"
    assert value(reader, Buffer.COLOR) == [1.0, 2.0, 3.0]


def test_files_that_would_be_ambiguous_can_be_told_apart_in_a_capture(tmp_path: Path) -> None:
    write(tmp_path, "beauty", R=1.0, G=1.0, B=1.0)
    write(tmp_path, "z", R=4.0, G=4.0, B=4.0)
    with pytest.raises(FrameFolderError, match=r"in 2 file sequences .*\[buffers\]"):
        reader_of(tmp_path)
    (tmp_path / "capture.toml").write_text('[buffers]\ncolor = "beauty:RGB"\ndepth = "z:R"')
    assert value(reader_of(tmp_path), Buffer.DEPTH) == [4.0]


def test_folders_of_a_layout_file_are_one_shot(tmp_path: Path) -> None:
    for name in ("farbe", "tiefe"):
        write_exr(
            tmp_path / "shot" / name / "0001.exr", {c: np.ones(SIZE, np.float16) for c in "RGB"}
        )
    layout(tmp_path, 'folders = true\n[buffers]\ncolor = "farbe:RGB"\ndepth = "tiefe:R"')
    options = ReadOptions(layout=str(tmp_path / "my.toml"))
    (shot,) = find_shots_of(tmp_path, options)
    assert shot.name == "shot"
    reader = measure_set(shot.frames, open_shot(shot, tmp_path, options), jittered=True).reader
    assert reader.stored == {Buffer.COLOR, Buffer.DEPTH}


def test_folders_that_a_capture_declares_are_one_shot(tmp_path: Path) -> None:
    for name in ("farbe", "tiefe"):
        write_exr(
            tmp_path / "shot" / name / "0001.exr", {c: np.ones(SIZE, np.float16) for c in "RGB"}
        )
    declared = '[buffers]\ncolor = "farbe:RGB"\ndepth = "tiefe:R"'
    (tmp_path / "shot" / "capture.toml").write_text(declared)
    assert [s.name for s in find_shots_of(tmp_path, ReadOptions())] == ["shot"]
    assert reader_of(tmp_path).stored == {Buffer.COLOR, Buffer.DEPTH}


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        (
            'depth = "Deepth.Z"',
            r"buffer 'depth': no channel is called 'Deepth\.Z', did you mean 'depth\.Z'",
        ),
        (
            'depth = "beauty:R"',
            r"buffer 'depth': no channel is called 'beauty:R'.*without its number, here 'f'",
        ),
        ('normal = "nrm.XYZ"', r"buffer 'normal': no channel is called 'nrm\.X'"),
    ],
)
def test_a_channel_that_matches_nothing_is_refused_with_what_there_is(
    tmp_path: Path, declared: str, message: str
) -> None:
    write(tmp_path, "f", R=1.0, G=1.0, B=1.0, depth_Z=1.0)
    (tmp_path / "capture.toml").write_text(f"[buffers]\n{declared}")
    with pytest.raises(FrameFolderError, match=message):
        reader_of(tmp_path)


def test_a_channel_needs_to_be_in_one_of_the_two_resolutions_only(tmp_path: Path) -> None:
    write(tmp_path / "lr", "f", beauty_R=1.0, beauty_G=1.0, beauty_B=1.0)
    write(tmp_path / "hr", "f", mat_R=0.5, mat_G=0.5, mat_B=0.5)
    capture = tmp_path / "capture.toml"
    capture.write_text('[buffers]\ncolor = "beauty.RGB"\nmaterial = "mat.RGB"')
    assert reader_of(tmp_path).stored == {Buffer.COLOR}
    capture.write_text('[buffers]\ncolor = "beauty.RGB"\nmaterial = "matt.RGB"')
    with pytest.raises(FrameFolderError, match=r"'material': no channel is called 'matt\.R'"):
        reader_of(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "buffers: is missing"),
        ("[buffers]", "buffers: has 0 entries (allowed: 1 or more)"),
        ('[buffers]\nnormals = "n.XYZ"', "buffers.normals: no such buffer, did you mean 'normal'?"),
        ('[buffers]\ncolor = "beauty"', "buffers: color needs 3 channels, not 1"),
        ('[buffers]\ncolor = "max(a.RGB, 0)"', "not 1; column 4: there are no parentheses"),
        ('[buffers]\ndepth = ["a", "b"]', "buffers: depth needs 1 channels, not 2"),
        ('[buffers]\nsky = "s"', "buffers: sky is not read"),
        ("[buffers]\ndepth = true", "buffers.depth: true and false are no channels"),
        ("[buffers]\ndepth = 1e13", "buffers.depth: is out of range"),
        ('[buffers]\ndepth = "1 - "', "buffers.depth: column 4: a channel or a number is missing"),
        ('[buffers]\nmotion = ["a.X", "b *"]', "buffers.motion: entry 2: column 4: a channel or"),
        ("[buffers]\ncolor = 0.5", "buffers: color is what was rendered, and no constant"),
        (
            '[buffers]\ndepth = {chanel = "a"}',
            "buffers.depth.0.chanel: no such field, did you mean 'channel'?",
        ),
        ('[buffers]\ndepth = ""', "buffers.depth.0.channel: "),
        ('folder = true\n[buffers]\ndepth = "a"', "folder: no such field, did you mean 'folders'?"),
        (
            '[buffers]\ndepth = "a"\n[motion]\nunt = "uv"',
            "motion.unt: no such field, did you mean 'unit'?",
        ),
        ("layout = ", "is not valid TOML"),
    ],
)
def test_mistakes_in_a_layout_file_are_told_with_their_place(
    tmp_path: Path, text: str, message: str
) -> None:
    assert message in refusal(tmp_path, text)


def test_all_mistakes_of_a_layout_file_are_listed_at_once(tmp_path: Path) -> None:
    text = '[buffers]\ncolour = "a.RGB"\ndepth = {factor = "x"}\n[depth]\nunit = "parsec"'
    message = refusal(tmp_path, text)
    for place in ("buffers.colour: ", "buffers.depth.0.channel: ", "depth.unit: no unit is called"):
        assert place in message


def test_a_layout_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: the layout cannot be read"):
        read_layout(tmp_path / "none.toml")


def test_the_wrong_unit_of_a_capture_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "capture.toml"
    path.write_text('[depth]\nunit = "metre"')
    with pytest.raises(ConfigError) as caught:
        read_capture(path)
    expected = "depth.unit: no unit is called 'metre' (there are: m, cm, mm, km, ft, in)"
    assert str(caught.value) == f"{path}: {expected} (got 'metre')"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("jitter_px = {perod = 8}", "jitter_px.perod: no such field, did you mean 'period'?"),
        ("[jitter_px]\n1 = [0.0, 3.0]", "jitter_px.1.1: 3.0 is out of range (allowed: 1 or less)"),
        ("jitter_px = [0.0]", "jitter_px.1: is missing"),
        ('jitter_px = "halton"', "jitter_px: 'halton' is not a list"),
    ],
)
def test_mistakes_in_jitter_speak_of_the_kind_that_was_meant(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "capture.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_capture(path)
    assert message in str(caught.value)
    assert ";" not in str(caught.value)


def test_what_a_layout_file_binds_is_part_of_what_outputs_depend_on(tmp_path: Path) -> None:
    write(tmp_path / "shot", "f", a=1.0, b=2.0, R=1.0, G=1.0, B=1.0)
    seen: list[Any] = []
    for channel in "ab":
        layout(tmp_path, f'[buffers]\ncolor = "RGB"\ndepth = "{channel}"')
        seen.append(reader_of(tmp_path / "shot", tmp_path / "my.toml").declaration)
    assert seen[0] != seen[1]
