"""Files of several view layers, stereo views or groups of one meaning: refused, or one is read."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header

Run = Callable[..., Result]
Planes = Mapping[str, float]

HEIGHT, WIDTH = 12, 16
HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
FIRST, SECOND = 0.75, 0.25
"""Radiance of the two layers; exact in half floats."""


def fill(values: Planes) -> dict[str, Any]:
    return {name: np.full((HEIGHT, WIDTH), v, np.float32) for name, v in values.items()}


def rgb(prefix: str, value: float) -> dict[str, float]:
    return {f"{prefix}{c}": value for c in "RGB"}


def write(path: Path, values: Planes, **attributes: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File({**HEADER, **attributes}, fill(values)).write(str(path))


def write_parts(path: Path, *parts: tuple[str, Mapping[str, Any], Planes]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    made = [OpenEXR.Part({**HEADER, **head}, fill(values), name) for name, head, values in parts]
    OpenEXR.File(made).write(str(path))


def write_view_layers(path: Path) -> None:
    write(
        path,
        {
            **rgb("Fore ground.Combined.", FIRST),
            "Fore ground.Depth.Z": 2.0,
            **rgb("Back.Combined.", SECOND),
            "Back.Depth.Z": 50.0,
        },
    )


def write_stereo(path: Path) -> None:
    """As the specification has it: the first view's channels have no view in their names."""
    values = {**rgb("", FIRST), "Z": 2.0, **rgb("right.", SECOND), "right.Z": 50.0}
    write(path, values, multiView=["left", "right"])


def write_stereo_in_layers(path: Path) -> None:
    values = {**rgb("VL.Combined.left.", FIRST), **rgb("VL.Combined.right.", SECOND)}
    values |= {"VL.Depth.left.Z": 2.0, "VL.Depth.right.Z": 50.0}
    write(path, values, multiView=["left", "right"])


def write_stereo_parts(path: Path) -> None:
    write_parts(
        path,
        ("rgba_right", {"view": "right"}, rgb("", SECOND)),
        ("depth_left", {"view": "left"}, {"Z": 2.0}),
        ("rgba_left", {"view": "left"}, rgb("", FIRST)),
        ("depth_right", {"view": "right"}, {"Z": 50.0}),
    )


def write_stereo_parts_of_blender_5(path: Path) -> None:
    write_parts(
        path,
        *(
            (f"VL.{name}-{view}", {"view": view}, values)
            for view, color, depth in (("left", FIRST, 2.0), ("right", SECOND, 50.0))
            for name, values in (
                ("Combined", rgb("VL.Combined.", color)),
                ("Depth", {"VL.Depth.V": depth}),
            )
        ),
    )


def write_stereo_parts_of_short_names(path: Path) -> None:
    """Blender's parts, whose channels leave their layer and pass to the part's name."""
    write_parts(
        path,
        *(
            (f"VL.{name}.{view}", {"view": view}, values)
            for view, color, depth in (("left", FIRST, 2.0), ("right", SECOND, 50.0))
            for name, values in (("Combined", rgb("", color)), ("Depth", {"V": depth}))
        ),
    )


def write_stereo_parts_whose_names_alone_say_so(path: Path) -> None:
    write_parts(
        path,
        *(
            (f"VL.{name}.{view}", {}, values)
            for view, color, depth in (("left", FIRST, 2.0), ("right", SECOND, 50.0))
            for name, values in (("Combined", rgb("", color)), ("Depth", {"V": depth}))
        ),
    )


def write_layers_in_parts_of_short_names(path: Path) -> None:
    write_parts(
        path,
        ("A.Combined", {}, rgb("", FIRST)),
        ("B.Combined", {}, rgb("", SECOND)),
        ("A.Depth", {}, {"V": 2.0}),
        ("B.Depth", {}, {"V": 50.0}),
    )


def write_groups(path: Path) -> None:
    write(path, {**rgb("rgba.", FIRST), **rgb("beauty.", SECOND), "depth.Z": 2.0})


def write_bare_and_named(path: Path) -> None:
    write(path, {**rgb("", FIRST), **rgb("beauty.", SECOND)})


def write_bare_and_color(path: Path) -> None:
    write(path, {**rgb("", FIRST), **rgb("color.", SECOND)})


def write_stereo_without_a_word(path: Path) -> None:
    write(path, {**rgb("", FIRST), "Z": 2.0, **rgb("right.", SECOND), "right.Z": 50.0})


def write_both_views_without_a_word(path: Path) -> None:
    write(path, {**rgb("left.", FIRST), **rgb("right.", SECOND)})


KINDS = [
    (write_view_layers, "Fore ground", "Back"),
    (write_stereo, "left", "right"),
    (write_stereo_in_layers, "VL.left", "VL.right"),
    (write_stereo_parts, "left", "right"),
    (write_stereo_parts_of_blender_5, "VL.left", "VL.right"),
    (write_stereo_without_a_word, "left", "right"),
    (write_both_views_without_a_word, "left", "right"),
    (write_groups, "rgba", "beauty"),
    (write_bare_and_named, "unnamed", "beauty"),
    (write_bare_and_color, "unnamed", "color"),
    (write_stereo_parts_of_short_names, "VL.left", "VL.right"),
    (write_stereo_parts_whose_names_alone_say_so, "VL.left", "VL.right"),
    (write_layers_in_parts_of_short_names, "A", "B"),
]
kinds = pytest.mark.parametrize(("make", "first", "second"), KINDS)
Make = Callable[[Path], None]


@pytest.fixture
def upscale(rtsr: Run, tmp_path: Path) -> Run:
    def run(*options: object) -> Result:
        choice = ("--system", "bicubic", "--scale", 2)
        return rtsr("upscale", tmp_path / "in", tmp_path / "out", *choice, *options)

    return run


def test_parts_of_blender_whose_channels_have_short_names_are_read(
    upscale: Run, rtsr: Run, tmp_path: Path
) -> None:
    parts = (("ViewLayer.Combined", {}, rgb("", FIRST)), ("ViewLayer.Depth", {}, {"V": 2.0}))
    write_parts(tmp_path / "in" / "f.0001.exr", *parts)
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert facts["layout"] == "blender"
    assert upscale().exit_code == 0
    assert float(read_channels(tmp_path / "out" / "f.0001.exr", "R")["R"].mean()) == FIRST


@kinds
def test_two_layers_are_refused_with_the_choices(
    upscale: Run, tmp_path: Path, make: Make, first: str, second: str
) -> None:
    make(tmp_path / "in" / "f.0001.exr")
    result = upscale()
    assert result.exit_code == 3
    message = " ".join(result.output.split())
    for said in (str(tmp_path / "in"), "buffer 'color'", repr(first), repr(second), "--layer NAME"):
        assert said in message
    assert not (tmp_path / "out").exists()


@kinds
def test_the_layer_that_is_named_is_read_and_the_other_is_not(
    upscale: Run, tmp_path: Path, make: Make, first: str, second: str
) -> None:
    make(tmp_path / "in" / "f.0001.exr")
    for name, value in ((first, FIRST), (second, SECOND)):
        result = upscale("--layer", name, "--overwrite")
        assert result.exit_code == 0, result.output
        assert f"layer {name}," in result.output
        out = tmp_path / "out" / "f.0001.exr"
        assert read_header(out).channels == {"R", "G", "B"}
        assert {float(p.mean()) for p in read_channels(out, "RGB").values()} == {value}
        header = OpenEXR.File(str(out), header_only=True).header()
        assert not {"multiView", "view"} & set(header)


@kinds
def test_inspect_says_which_layers_there_are_and_which_is_read(
    rtsr: Run, tmp_path: Path, make: Make, first: str, second: str
) -> None:
    make(tmp_path / "in" / "f.0001.exr")
    refused = rtsr("inspect", tmp_path / "in", "--json")
    assert refused.exit_code == 3
    facts = json.loads(refused.stdout)
    assert (set(facts["layers"]), facts["layer"]) == ({first, second}, None)
    assert facts["systems"]["bicubic"]["missing"] == ["a choice of layer"]
    # what a channel is depends on the layout that is known, not on its name
    assert facts["guesses"] == {}
    assert "not understood" not in rtsr("inspect", tmp_path / "in").output
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--layer", second, "--json").stdout)
    assert (set(facts["layers"]), facts["layer"]) == ({first, second}, second)
    assert facts["buffers"]["color"]["max"] == SECOND
    said = rtsr("inspect", tmp_path / "in", "--layer", first).output
    assert f"({first} is read)" in said


def test_a_stereo_view_brings_its_own_buffers_and_its_short_name_will_do(
    rtsr: Run, tmp_path: Path
) -> None:
    for make in (write_stereo_in_layers, write_stereo_parts_of_blender_5, write_stereo_parts):
        make(tmp_path / make.__name__ / "f.0001.exr")
        chosen = ("--layer", "right", "--json")
        facts = json.loads(rtsr("inspect", tmp_path / make.__name__, *chosen).stdout)
        assert facts["buffers"]["depth"]["max"] == 50.0


def test_a_name_that_no_layer_has_is_refused_with_those_there_are(
    upscale: Run, tmp_path: Path
) -> None:
    write(tmp_path / "in" / "f.0001.exr", rgb("ViewLayer.Combined.", 0.5))
    result = upscale("--layer", "VeiwLayer")
    assert result.exit_code == 3
    assert "no layer is called 'VeiwLayer', did you mean 'ViewLayer'?" in result.output
    write_stereo(tmp_path / "in" / "f.0001.exr")
    result = upscale("--layer", "middle")
    assert result.exit_code == 3
    assert "no layer is called 'middle' (there are: left, right)" in result.output


@pytest.mark.parametrize("bare", [True, False])
def test_a_layer_that_no_layout_knows_can_be_read(
    upscale: Run, rtsr: Run, tmp_path: Path, bare: bool
) -> None:
    values = {**rgb("fg.", FIRST), "fg.depth.Z": 2.0, **rgb("bg.", SECOND)}
    write(tmp_path / "in" / "f.0001.exr", values | (rgb("", 0.5) if bare else {}))
    assert upscale().exit_code == (0 if bare else 3)
    assert upscale("--layer", "fg", "--overwrite").exit_code == 0
    out = tmp_path / "out" / "f.0001.exr"
    assert float(read_channels(out, "R")["R"].mean()) == FIRST
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--layer", "fg", "--json").stdout)
    assert (facts["layers"], facts["layer"]) == (["fg"], "fg")
    assert set(facts["buffers"]) == {"color", "depth"}


def test_files_without_layers_are_read_whatever_is_asked_for(upscale: Run, tmp_path: Path) -> None:
    write(tmp_path / "in" / "f.0001.exr", rgb("", 0.5))
    result = upscale("--layer", "left")
    assert result.exit_code == 0
    assert "layer 'left' is asked for, but these files have no layers" in result.output


def test_one_view_of_a_file_needs_no_choice(upscale: Run, tmp_path: Path) -> None:
    parts = (
        ("rgba.main", {"view": "main"}, rgb("", 0.5)),
        ("depth.main", {"view": "main"}, {"Z": 3.0}),
    )
    write_parts(tmp_path / "in" / "f.0001.exr", *parts)
    assert upscale().exit_code == 0
    write(tmp_path / "in" / "f.0001.exr", rgb("left.", 0.5), multiView=["right", "left"])
    assert upscale("--overwrite").exit_code == 0
    out = tmp_path / "out" / "f.0001.exr"
    assert float(read_channels(out, "R")["R"].mean()) == 0.5


def test_views_that_hold_different_buffers_are_read_together(rtsr: Run, tmp_path: Path) -> None:
    values = {**rgb("left.", 0.5), "right.Z": 3.0}
    write(tmp_path / "in" / "f.0001.exr", values, multiView=["left", "right"])
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert set(facts["buffers"]) == {"color", "depth"}


def test_capture_toml_names_a_layer_and_the_option_holds_over_it(
    upscale: Run, rtsr: Run, tmp_path: Path
) -> None:
    write_view_layers(tmp_path / "in" / "f.0001.exr")
    written = rtsr("inspect", tmp_path / "in", "--layer", "Back", "--write")
    assert written.exit_code == 0
    assert 'layer = "Back"' in (tmp_path / "in" / "capture.toml").read_text()
    out = tmp_path / "out" / "f.0001.exr"
    assert upscale().exit_code == 0
    assert float(read_channels(out, "R")["R"].mean()) == SECOND
    assert upscale("--layer", "Fore ground").exit_code == 3
    assert upscale("--layer", "Fore ground", "--overwrite").exit_code == 0
    assert float(read_channels(out, "R")["R"].mean()) == FIRST


def test_a_capture_toml_of_layers_to_choose_from_lists_them(rtsr: Run, tmp_path: Path) -> None:
    write_view_layers(tmp_path / "in" / "f.0001.exr")
    assert rtsr("inspect", tmp_path / "in", "--write").exit_code == 3
    path = tmp_path / "in" / "capture.toml"
    text = path.read_text()
    assert '# layer = "Back"\n# layer = "Fore ground"\n' in text
    path.write_text(text.replace("# layer", "layer", 1))
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert facts["layer"] == "Back"


def test_channels_that_are_spelled_out_are_a_choice(upscale: Run, tmp_path: Path) -> None:
    write(
        tmp_path / "in" / "f.0001.exr",
        {**rgb("", FIRST), **rgb("right.", SECOND)},
        multiView=["left", "right"],
    )
    (tmp_path / "in" / "capture.toml").write_text('[buffers]\ncolor = "right.RGB"\n')
    assert upscale().exit_code == 0
    out = tmp_path / "out" / "f.0001.exr"
    assert float(read_channels(out, "R")["R"].mean()) == SECOND


def test_frames_whose_first_views_differ_are_refused(upscale: Run, tmp_path: Path) -> None:
    values = {**rgb("", 0.5), **rgb("right.", 0.5), **rgb("left.", 0.5)}
    for number, views in enumerate((["left", "right"], ["right", "left"]), 1):
        named = {k: v for k, v in values.items() if not k.startswith(views[0])}
        write(tmp_path / "in" / f"f.000{number}.exr", named, multiView=views)
    assert upscale("--layer", "left").exit_code == 3


def test_results_are_judged_against_the_layer_that_is_named(rtsr: Run, tmp_path: Path) -> None:
    write_stereo(tmp_path / "ref" / "f.0001.exr")
    write(tmp_path / "test" / "f.0001.exr", rgb("", SECOND))
    folders = (tmp_path / "test", "--ref", tmp_path / "ref", "--metric", "psnr")
    assert rtsr("evaluate", *folders).exit_code == 3
    for layer, demand in (("right", 0), ("left", 1)):
        result = rtsr("evaluate", *folders, "--layer", layer, "--fail-under", "psnr>100")
        assert result.exit_code == demand, result.output


@pytest.mark.parametrize(
    "command", ["inspect", "upscale", "demodulate", "label", "predict-vrs", "evaluate", "train"]
)
def test_every_command_that_reads_frames_takes_a_layer(rtsr: Run, command: str) -> None:
    assert "--layer NAME" in rtsr(command, "--help").output


@pytest.mark.parametrize(
    ("options", "depth"),
    [
        (("--layer", "fg", "--view", "left"), 1.0),
        (("--layer", "fg", "--view", "right"), 2.0),
        (("--layer", "ViewLayer.right"), 4.0),
        (("--layer", "ViewLayer.right", "--view", "right"), 4.0),
    ],
)
def test_a_layer_and_a_view_are_chosen_together(
    rtsr: Run, tmp_path: Path, options: tuple[str, ...], depth: float
) -> None:
    write_layers_of_two_views(tmp_path / "in" / "f.0001.exr")
    facts = json.loads(rtsr("inspect", tmp_path / "in", *options, "--json").stdout)
    assert facts["buffers"]["depth"]["max"] == depth
    layer, view = options[1], options[3] if len(options) > 2 else ""
    text = f'layer = "{layer}"\n' + (f'view = "{view}"\n' if view else "")
    (tmp_path / "in" / "capture.toml").write_text(text)
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    assert facts["buffers"]["depth"]["max"] == depth


def test_layers_and_views_are_named_together_where_both_are_to_be_chosen(
    rtsr: Run, tmp_path: Path
) -> None:
    write_layers_of_two_views(tmp_path / "in" / "f.0001.exr")
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    choices = {f"{layer}.{view}" for layer in ("fg", "ViewLayer") for view in ("left", "right")}
    assert set(facts["layers"]) == choices
    for name in choices:
        (tmp_path / "in" / "capture.toml").write_text(f'layer = "{name}"\n')
        assert json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)["layer"] == name


@pytest.mark.parametrize(
    ("options", "meant"),
    [
        (("--layer", "gf", "--view", "left"), "fg.left"),
        (("--layer", "fg", "--view", "lfet"), "fg.left"),
        (("--view", "rigth"), "right"),
        (("--layer", "VeiwLayer"), "ViewLayer"),
    ],
)
def test_a_mistyped_layer_or_view_names_the_nearest(
    rtsr: Run, tmp_path: Path, options: tuple[str, ...], meant: str
) -> None:
    write_layers_of_two_views(tmp_path / "in" / "f.0001.exr")
    for command in (("upscale", tmp_path / "in", tmp_path / "out"), ("inspect", tmp_path / "in")):
        result = rtsr(*command, *options)
        assert result.exit_code == 3
        assert f"did you mean '{meant}" in " ".join(result.output.split())


def write_layers_of_two_views(path: Path) -> None:
    """As Blender writes them: a part a pass, with the view at the end of its name."""
    places = [(layer, view) for layer in ("fg", "ViewLayer") for view in ("left", "right")]
    parts = []
    for depth, (layer, view) in enumerate(places, start=1):
        for name, values in (
            ("Combined", rgb(f"{layer}.Combined.", depth / 8.0)),
            ("Depth", {f"{layer}.Depth.Z": float(depth)}),
        ):
            parts.append((f"{layer}.{name}.{view}", {"view": view}, values))
    write_parts(path, *parts)
