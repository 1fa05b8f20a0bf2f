"""Lines that provide what is missing, and none where they would be guesses."""

from __future__ import annotations

import tomllib

import pytest

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.inspect.fixes import Hints, list_fixes
from rtsr_cli.core.inspect.readiness import SystemReadiness
from rtsr_cli.core.pairs.sources import FITTING_HR


def lines(missing: tuple[str, ...], hints: Hints | None = None) -> list[str]:
    systems = {"a": SystemReadiness(ready=False, missing=missing)}
    return [fix.line for fix in list_fixes({"upscale": systems}, hints or Hints())]


@pytest.mark.parametrize(
    ("missing", "line"),
    [
        ("metallic", "metallic = 0.0"),
        ("hr metallic", "metallic = 0.0"),
        ("lr roughness", "roughness = 0.5"),
        ("camera", 'camera = "camera.csv"'),
        ("lr camera of frame 7 (to convert depth from ray distance)", 'camera = "camera.csv"'),
        ("hr frames", "--hr DIR"),
    ],
)
def test_what_is_missing_has_a_line(missing: str, line: str) -> None:
    assert lines((missing,)) == [line]


@pytest.mark.parametrize(
    "missing", ["motion", "lr normal", "albedo", "a declared motion convention", "a pair of 4x"]
)
def test_what_no_line_provides_has_none(missing: str) -> None:
    assert lines((missing,)) == []


def test_matrices_of_another_convention_are_declared() -> None:
    hints = Hints(camera="column-vectors")
    assert lines(("lr camera", "hr camera"), hints) == ['convention = "column-vectors"']


def test_a_file_of_cameras_is_declared_where_it_lies_and_else_has_to_be_written() -> None:
    lacking = {"a": SystemReadiness(ready=False, missing=("camera",))}
    (bare,) = list_fixes({"upscale": lacking}, Hints())
    assert "a row a frame" in bare.write
    (there,) = list_fixes({"upscale": lacking}, Hints(undeclared="poses.json"))
    assert (there.line, there.write) == ('camera = "poses.json"', "")


def test_a_side_car_that_is_declared_is_not_offered_again() -> None:
    assert lines(("camera",), Hints(side_car="poses.csv")) == []
    hints = Hints(side_car="poses.csv", camera="mitsuba")
    (line,) = lines(("camera",), hints)
    assert tomllib.loads(line) == {"camera": {"file": "poses.csv", "convention": "mitsuba"}}


@pytest.mark.parametrize("bare", ["metallic", "roughness", "hr frames", "camera"])
def test_what_would_unlock_nothing_is_not_offered(bare: str) -> None:
    assert len(lines((bare,))) == 1
    assert lines((bare, "normal")) == []
    hints = Hints(guessed={Buffer.ALBEDO: ("base.R", "base.G", "base.B")})
    assert len(lines((bare, "albedo"), hints)) == 2
    assert len(lines((bare, "albedo", "normal"), hints)) == 1


def test_a_channel_goes_before_a_constant_and_smoothness_is_turned() -> None:
    hints = Hints(guessed={Buffer.METALLIC: ("mtl",), Buffer.ROUGHNESS: ("Smoothness.R",)})
    assert lines(("metallic", "roughness"), hints) == [
        'metallic = "mtl"',
        'roughness = "1 - Smoothness.R"',
    ]


def test_one_line_is_for_both_sizes() -> None:
    assert lines(("lr metallic", "hr metallic")) == ["metallic = 0.0"]


def test_layers_and_layouts_are_named() -> None:
    layers = Hints(layers=("left", "right"))
    assert lines(("a choice of layer",), layers) == ['layer = "left"', 'layer = "right"']
    assert lines(("a named layout",), Hints(layout="mitsuba")) == ['layout = "mitsuba"']


def test_a_sum_of_colours_stands_for_the_parts_of_material() -> None:
    hints = Hints(material="a.RGB + b.RGB")
    found = lines(("albedo", "metallic", "roughness"), hints)
    assert set(found) == {'material = "a.RGB + b.RGB"'}


def test_guesses_are_offered_where_nothing_can_be_read() -> None:
    hints = Hints(guessed={Buffer.COLOR: ("hdr.R", "hdr.G", "hdr.B")})
    assert lines(("a known layout",), hints) == ['color = ["hdr.R", "hdr.G", "hdr.B"]']


def test_one_line_provides_all_that_it_can() -> None:
    missing = (
        "lr camera",
        "lr camera (to convert depth from ray distance)",
        "hr camera of frame 3",
    )
    assert lines(missing) == ['camera = "camera.csv"']


def test_no_constant_stands_for_a_channel_that_is_named_like_the_buffer() -> None:
    named = frozenset({Buffer.METALLIC})
    assert lines(("metallic",), Hints(named=named)) == []
    assert lines(("roughness",), Hints(named=named)) == ["roughness = 0.5"]


def test_no_constant_contradicts_what_passes_say_of_metal() -> None:
    assert lines(("metallic",), Hints(divided=True)) == []
    # neither is one offered that alone would gain nothing
    assert lines(("metallic", "roughness"), Hints(divided=True)) == []
    assert lines(("roughness",), Hints(divided=True)) == ["roughness = 0.5"]


def test_base_colour_alone_is_offered_as_material_once() -> None:
    hints = Hints(base_colour="albedo.RGB")
    found = lines(("metallic", "roughness", "camera"), hints)
    assert found == ['material = "albedo.RGB"', 'camera = "camera.csv"']


def test_a_line_says_what_would_run_with_it() -> None:
    lacking = {
        "a": SystemReadiness(ready=False, missing=("lr camera",)),
        "b": SystemReadiness(ready=False, missing=("camera (to convert depth from ray distance)",)),
        "c": SystemReadiness(ready=False, missing=("camera", "motion")),
    }
    (fix,) = list_fixes({"upscale": lacking}, Hints())
    assert fix.serves == ("a", "b")
    assert fix.missing == "camera (to convert depth from ray distance)"


def test_no_line_that_files_say_nothing_of_while_both_sizes_do_not_fit() -> None:
    unfit = SystemReadiness(ready=False, missing=(FITTING_HR,))
    commands = {
        "upscale": {"demod-guided": unfit},
        "predict-vrs": {"rt-percept": SystemReadiness(ready=False, missing=("camera",))},
    }
    assert list_fixes(commands, Hints()) == ()
    assert len(list_fixes({"predict-vrs": commands["predict-vrs"]}, Hints())) == 1


def test_what_single_frames_lack_is_declared_for_none() -> None:
    hints = Hints(material="a.RGB + b.RGB", base_colour="albedo.RGB")
    assert lines(("lr material of frame 3", "lr roughness of frames 2, 4"), hints) == []
