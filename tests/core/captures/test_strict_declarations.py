"""True and false are no numbers, and constants are values that their buffers may have."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtsr_cli.core.captures.buffer_expressions import explain_quotes
from rtsr_cli.core.captures.capture_file import CaptureDeclaration, read_capture
from rtsr_cli.core.errors import ConfigError


def read(tmp_path: Path, text: str) -> CaptureDeclaration:
    path = tmp_path / "capture.toml"
    path.write_text(text, encoding="utf-8")
    return read_capture(path)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("[depth]\nsky = true", "depth.sky"),
        ("[depth]\nunit = true", "depth.unit"),
        ("[depth]\nnear = true", "depth.near"),
        ("[position]\nunit = false", "position.unit"),
        ("[motion]\nscale = true", "motion.scale"),
        ("[motion]\nzero = false", "motion.zero"),
        ("[motion]\nfile_offset = true", "motion.file_offset"),
        ("[normal]\nsky = [true, 0, 0]", "normal.sky"),
        ("jitter_px = [true, 0.0]", "jitter_px"),
        ("[jitter_px]\n1 = [0.0, false]", "jitter_px.1"),
        ("scale = true", "scale"),
        ("frame_step = true", "frame_step"),
        ("camera_cuts = [true]", "camera_cuts"),
        ("filter_width_px = true", "filter_width_px"),
        ("layout = true", "layout"),
        ("[buffers]\nroughness = true", "buffers.roughness"),
        ("[buffers]\nalbedo = [1.0, true, 1.0]", "buffers.albedo"),
        ('[buffers]\nroughness = {channel = "R", factor = true}', "buffers.roughness"),
        ('[buffers]\nroughness = {channel = "R", zero = true}', "buffers.roughness"),
    ],
)
def test_true_and_false_are_no_numbers(tmp_path: Path, text: str, field: str) -> None:
    with pytest.raises(ConfigError, match=field.replace(".", r"\.")):
        read(tmp_path, text)


def test_switches_keep_theirs(tmp_path: Path) -> None:
    text = "[motion]\njittered = true\n[depth]\nreversed = false\n[normal]\npacked = true"
    capture = read(tmp_path, text)
    assert (capture.motion.jittered, capture.depth.reversed) == (True, False)
    assert capture.normal.packed


@pytest.mark.parametrize(
    ("line", "allowed"),
    [
        ("metallic = 2.0", "0 to 1"),
        ("roughness = -3", "0 to 1"),
        ('roughness = "1.5"', "0 to 1"),
        ("nov = 1.01", "0 to 1"),
        ("albedo = [0.5, -0.1, 0.5]", "0 to 2"),
        ("material = 3.0", "0 to 2"),
        ("emission = -1.0", "0 or more"),
        ("normal = [0.0, 0.0, 2.0]", "-1 to 1"),
    ],
)
def test_constants_are_held_to_what_the_buffer_may_be(
    tmp_path: Path, line: str, allowed: str
) -> None:
    name = line.split(" ")[0]
    with pytest.raises(ConfigError, match=f"{name} = .* is out of range .allowed: {allowed}"):
        read(tmp_path, f"[buffers]\n{line}")


def test_constants_in_range_are_taken(tmp_path: Path) -> None:
    text = (
        "[buffers]\nmetallic = 1.0\nroughness = 0\nalbedo = 0.5\nnormal = [0, 1, -1]\nmotion = -3"
    )
    assert len(read(tmp_path, text).buffers) == 5


def test_a_name_of_too_many_letters_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"'\.RGBA' is 4: end the name in 3 \(\.RGB\)"):
        read(tmp_path, '[buffers]\nalbedo = "albedo.RGBA"')


def test_of_a_buffer_that_is_none_nothing_else_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        read(tmp_path, '[buffers]\nrougness = "1 - x"')
    assert "did you mean 'roughness'" in str(refused.value)
    assert "is not a list" not in str(refused.value)


def test_a_part_of_a_name_with_an_operator_tells_how_to_quote_it() -> None:
    said = explain_quotes("Key", ("Key - rim.R", "R"))
    assert "single quotes: \"'Key - rim.R'\"" in said
    assert explain_quotes("Kay", ("Key - rim.R", "R")) == ""
    assert explain_quotes("R", ("R", "G")) == ""
