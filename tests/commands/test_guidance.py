"""What can run, what is missing, and lines to paste: said before anything is tried."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Planes = dict[str, Any]
Copy = Callable[..., Path]

SURFACE = ("metallic", "roughness")
MOTION = ("motion.X", "motion.Y")
DECLARED_MOTION = (
    '[motion]\nunit = "pixels"\ndirection = "previous-minus-current"\ny_axis = "down"\n'
)


@pytest.fixture
def capture(small_capture: Path, tmp_path: Path) -> Copy:
    """Four frames of an HR capture, without some channels, others under another name."""

    def copy(drop: tuple[str, ...] = (), renamed: dict[str, str] | None = None) -> Path:
        folder = tmp_path / "shot"
        for path in sorted(small_capture.glob("*.exr")):
            header = read_header(path)
            kept = [name for name in header.channels if name not in drop]
            planes = read_channels(path, kept)
            named = {(renamed or {}).get(n, n): plane for n, plane in planes.items()}
            write_exr(folder / path.name, named, attributes=header.attributes)
        (folder / "capture.toml").write_text(f'layout = "rtsr"\n{DECLARED_MOTION}')
        return folder

    return copy


def inspected(rtsr: Run, folder: Path) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads(rtsr("inspect", folder, "--json").stdout)
    return facts


def planned(rtsr: Run, folder: Path, *options: object) -> dict[str, Any]:
    result = rtsr("upscale", folder, folder.parent / "out", *options, "--dry-run", "--json")
    assert result.exit_code == 0, result.output
    plan: dict[str, Any] = json.loads(result.stdout.splitlines()[0])
    return plan


def test_upscale_says_in_one_line_why_better_systems_cannot_run(rtsr: Run, capture: Copy) -> None:
    folder = capture(SURFACE)
    result = rtsr("upscale", folder, folder.parent / "out", "--simulate-lr", 4, "--dry-run")
    (line,) = [line for line in result.output.splitlines() if "buffers found" in line]
    said = "demod-* and networks need metallic and roughness: declare constants or material"
    assert said in line
    count = len(inspected(rtsr, folder)["buffers"])
    assert line.strip().startswith(f"{count} buffers found; ")


def test_nothing_that_is_missing_is_hidden_and_no_advice_said_twice(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    """Of colour alone the better systems lack eight things, motion the last of them."""
    for path in sorted(small_capture.glob("*.exr")):
        write_exr(tmp_path / "shot" / path.name, read_channels(path, ["R", "G", "B"]))
    better = planned(rtsr, tmp_path / "shot", "--scale", 4)["better"]
    best, guided, plain, *_ = better.split("; ")[1:]
    for name in ("albedo", "metallic", "roughness", "normal", "camera", "depth", "motion"):
        assert name in best
    assert "and hr frames: give G-buffers" in best
    assert guided.endswith("demod-guided need all of that but motion")
    assert plain == "demod-bicubic needs all of that but depth and motion"
    assert "more" not in better
    assert better.count("--hr DIR") == better.count("file that capture.toml names") == 1


@pytest.mark.parametrize(
    ("size", "channels", "said"),
    [
        ("hr", ("normal.X", "normal.Y", "normal.Z"), "need hr normal: the other size has it"),
        ("lr", ("motion.X", "motion.Y"), "need lr motion: the other size has it"),
    ],
)
def test_what_one_size_lacks_is_named_with_the_size(
    rtsr: Run, small_shot: Path, tmp_path: Path, size: str, channels: tuple[str, ...], said: str
) -> None:
    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    for path in (shot / size).iterdir():
        header = read_header(path)
        planes = read_channels(path, sorted(header.channels.difference(channels)))
        write_exr(path, planes, attributes=header.attributes)
    assert said in planned(rtsr, shot)["better"]


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        (("albedo.R", "albedo.G", "albedo.B"), ""),
        (("motion.X", "motion.Y"), "something is wrong with it, see the warning"),
    ],
)
def test_empty_passes_are_no_reason_that_is_not_true(
    rtsr: Run,
    small_shot: Path,
    changed: Callable[..., Path],
    tmp_path: Path,
    channels: tuple[str, ...],
    said: str,
) -> None:
    """Base colours of 0 are no pixel filter, and motion of 0 is declared well enough."""

    def empty(planes: dict[str, Any], number: int) -> None:
        del number
        for name in channels:
            planes[name][:] = 0.0

    shot = tmp_path / "shot"
    shot.mkdir()
    for size in ("lr", "hr"):
        changed(small_shot / size, empty).rename(shot / size)
    shutil.copy(small_shot / "capture.toml", shot)
    better = planned(rtsr, shot)["better"]
    assert said in better
    assert "pixel filter" not in better


def test_where_the_best_runs_nothing_is_said(rtsr: Run, small_shot: Path) -> None:
    assert planned(rtsr, small_shot)["better"] == ""
    named = planned(rtsr, small_shot, "--system", "bicubic")
    assert named["better"] == ""


def test_taau_is_preferred_where_motion_and_jitter_can_be_relied_upon(
    rtsr: Run, capture: Copy
) -> None:
    folder = capture(SURFACE)
    jittered = ("--simulate-lr", 4, "--jitter", "halton")
    assert planned(rtsr, folder, *jittered)["system"] == "taau"
    still = planned(rtsr, folder, "--simulate-lr", 4)
    assert still["system"] == "bicubic"
    assert "taau: preferred only with jitter" in still["better"]
    text = (folder / "capture.toml").read_text()
    turned = text.replace("previous-minus-current", "current-minus-previous")
    (folder / "capture.toml").write_text(turned)
    contradicted = planned(rtsr, folder, *jittered)
    assert contradicted["system"] == "bicubic"
    assert "taau: preferred only with motion" in contradicted["better"]


def test_without_motion_bicubic_remains(rtsr: Run, capture: Copy) -> None:
    plan = planned(rtsr, capture((*SURFACE, *MOTION)), "--simulate-lr", 4, "--jitter", "halton")
    assert plan["system"] == "bicubic"
    assert "taau needs motion" in plan["better"]


def test_inspect_covers_every_command_that_reads_frames(
    rtsr: Run, small_shot: Path, capture: Copy
) -> None:
    commands = inspected(rtsr, small_shot)["commands"]
    assert set(commands) == {
        *("upscale", "extrapolate", "predict-vrs", "label", "train", "evaluate")
    }
    assert commands["train"]["nsrd"]["ready"], "reference/ holds the radiance"
    (one_size,) = commands["train"]["rt-percept"]["missing"]
    assert one_size.startswith("frames of one size")
    assert commands["upscale"]["fusesr-direct"]["missing"] == [
        "weights for 4x (rtsr train makes them)"
    ]
    lacking = inspected(rtsr, capture(("normal.X", "normal.Y", "normal.Z")))["commands"]
    assert lacking["predict-vrs"]["analytic"] == {"ready": False, "missing": ["normal"], "how": ""}
    assert lacking["label"]["holes"]["ready"]
    assert lacking["evaluate"]["pictures"]["ready"]
    assert lacking["evaluate"]["along motion"]["ready"]
    assert lacking["evaluate"]["by region"]["missing"] == ["normal"]
    assert not lacking["train"]["fusesr-fast"]["ready"]


def test_the_report_has_the_same_and_the_lines_to_paste(rtsr: Run, capture: Copy) -> None:
    output = rtsr("inspect", capture(SURFACE)).output
    lines = [line.strip() for line in output.splitlines()]
    assert any(line.startswith("predict-vrs rt-percept") for line in lines)
    assert any(line.startswith("evaluate    pictures        ready") for line in lines)
    assert any(line.startswith("to paste    metallic = 0.0  ") for line in lines)
    assert any(line.startswith("roughness = 0.5  ") for line in lines)


def test_lines_to_paste_are_toml_with_their_notes(rtsr: Run, capture: Copy) -> None:
    lines = [line.strip() for line in rtsr("inspect", capture(SURFACE)).output.splitlines()]
    shown = [line.removeprefix("to paste").strip() for line in lines if "# [buffers]" in line]
    assert tomllib.loads("\n".join(shown)) == {"metallic": 0.0, "roughness": 0.5}


@pytest.mark.parametrize("line", ["metallic = 0.0", "roughness = 0.5", 'depth = "Z"'])
def test_a_line_of_buffers_above_its_table_is_told_where_it_belongs(
    rtsr: Run, capture: Copy, line: str
) -> None:
    folder = capture(())
    path = folder / "capture.toml"
    path.write_text(f"{line}\n")
    result = rtsr("upscale", folder, folder.parent / "out", "--simulate-lr", 4, "--dry-run")
    assert result.exit_code == 3
    name = line.partition(" ")[0]
    assert f"{name}: what a buffer is made of belongs below a line [buffers]" in result.stderr


def paste(folder: Path, fixes: list[dict[str, Any]]) -> None:
    """Put lines where they say that they belong."""
    path = folder / "capture.toml"
    head = "".join(f"{fix['line']}\n" for fix in fixes if fix["where"].startswith("the head"))
    own = "".join(f"{fix['line']}\n" for fix in fixes if fix["where"].startswith("[buffers]"))
    path.write_text(f"{head}{path.read_text()}{'[buffers]' if own else ''}\n{own}")
    tomllib.loads(path.read_text())


@pytest.mark.parametrize(
    ("drop", "renamed"),
    [
        ((), {"metallic": "mtl", "roughness": "rgh"}),
        ((), {"albedo.R": "basecol.R", "albedo.G": "basecol.G", "albedo.B": "basecol.B"}),
        ((), {"normal.X": "nml.X", "normal.Y": "nml.Y", "normal.Z": "nml.Z"}),
        (("metallic",), {"roughness": "surface_rough"}),
        (SURFACE, {}),
    ],
    ids=["numbers", "colour", "vectors", "a constant and a channel", "constants"],
)
def test_pasted_lines_make_the_systems_ready(
    rtsr: Run, capture: Copy, drop: tuple[str, ...], renamed: dict[str, str]
) -> None:
    folder = capture(drop, renamed)
    before = inspected(rtsr, folder)
    assert not before["systems"]["demod-guided"]["ready"]
    paste(folder, before["fixes"])
    after = inspected(rtsr, folder)
    assert after["systems"]["demod-guided"]["ready"], after["problems"]
    assert after["fixes"] == []
    plan = planned(rtsr, folder, "--simulate-lr", 4)
    assert plan["system"].startswith(("gather", "fusesr", "demod"))


@pytest.mark.parametrize(
    ("renamed", "line"),
    [
        ({f"normal.{c}": f"nrm.{c}" for c in "XYZ"}, 'normal = ["nrm.X", "nrm.Y", "nrm.Z"]'),
        ({f"albedo.{c}": f"alb.{c}" for c in "RGB"}, 'albedo = ["alb.R", "alb.G", "alb.B"]'),
        ({"depth.Z": "Zeta"}, 'depth = "Zeta"'),
        ({"metallic": "mtl"}, 'metallic = "mtl"'),
        ({"roughness": "gloss"}, 'roughness = "1 - gloss"'),
    ],
    ids=["normals", "base colour", "depth", "metal", "roughness"],
)
def test_what_one_size_has_under_another_name_is_named_with_the_line(
    rtsr: Run, small_shot: Path, tmp_path: Path, renamed: dict[str, str], line: str
) -> None:
    """The line is for that size alone: the other one's channels stay the layout's own."""
    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    for path in (shot / "hr").iterdir():
        header = read_header(path)
        planes = read_channels(path, sorted(header.channels))
        named = {renamed.get(name, name): plane for name, plane in planes.items()}
        write_exr(path, named, attributes=header.attributes)
    words = ("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    refused = rtsr(*words)
    assert refused.exit_code == 3
    assert f"; perhaps, below [buffers] in capture.toml:\n    {line}\n" in refused.output
    assert line in planned(rtsr, shot)["better"]
    with (shot / "capture.toml").open("a") as file:
        file.write(f"\n[buffers]\n{line}\n")
    mended = rtsr(*words)
    assert mended.exit_code == 0, mended.output
    own = f"'{line.partition(' ')[0]}' of {shot / 'lr'} is read as layout 'rtsr"
    assert own in mended.output


@pytest.mark.parametrize(
    ("renamed", "line"),
    [
        (dict(zip(MOTION, ("mv.X", "mv.Y"), strict=True)), 'motion = ["mv.X", "mv.Y"]'),
        ({f"albedo.{c}": f"mat.{c}" for c in "RGB"}, 'material = ["mat.R", "mat.G", "mat.B"]'),
    ],
    ids=["motion", "material"],
)
def test_what_a_capture_has_under_another_name_is_named_with_the_line(
    rtsr: Run, capture: Copy, renamed: dict[str, str], line: str
) -> None:
    folder = capture(SURFACE if "mat.R" in renamed.values() else (), renamed)
    assert line in planned(rtsr, folder, "--simulate-lr", 4)["better"]
    assert line in {fix["line"] for fix in inspected(rtsr, folder)["fixes"]}


@pytest.mark.parametrize("options", [("--system", "demod-guided"), ("--dry-run",)])
def test_the_lines_of_a_refusal_and_of_the_hint_can_be_pasted_together(
    rtsr: Run, capture: Copy, options: tuple[str, ...]
) -> None:
    renamed = {f"albedo.{c}": f"basecol.{c}" for c in "RGB"} | {"metallic": "mtl"}
    folder = capture((), renamed)
    run = ("upscale", folder, folder.parent / "out", "--simulate-lr", 4)
    said = rtsr(*run, *options).output
    _, _, pasted = said.partition("perhaps, below [buffers] in capture.toml:\n")
    lines = list(takewhile(lambda line: " = " in line, pasted.splitlines()))
    assert set(tomllib.loads("\n".join(lines))) == {"albedo", "metallic"}
    path = folder / "capture.toml"
    path.write_text("\n".join((path.read_text(), "[buffers]", *lines)))
    mended = rtsr(*run, "--system", "demod-guided", "--dry-run")
    assert mended.exit_code == 0, mended.output


def test_base_colour_alone_is_offered_as_material_to_what_is_refused(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "plain"
    for path in sorted(small_capture.glob("*.exr")):
        kept = [n for n in read_header(path).channels if n not in ("metallic", "roughness")]
        write_exr(folder / path.name, read_channels(path, kept))
    run = ("upscale", folder, tmp_path / "out", "--simulate-lr", 4)
    refused = rtsr(*run, "--system", "demod-guided")
    assert refused.exit_code == 3
    line = 'material = "albedo.RGB"  # base colour alone: '
    assert f"perhaps, below [buffers] in capture.toml:\n    {line}" in refused.output
    assert line in planned(rtsr, folder, "--simulate-lr", 4)["better"]
    (said,) = (text for text in refused.output.splitlines() if line in text)
    (folder / "capture.toml").write_text(f'layout = "rtsr"\n{DECLARED_MOTION}[buffers]\n{said}\n')
    mended = rtsr(*run, "--system", "demod-guided", "--dry-run")
    assert mended.exit_code == 0, mended.output


COLOURS = ("albedo.R", "albedo.G", "albedo.B")


@pytest.mark.parametrize(
    ("drop", "renamed"),
    [
        # a colour under a name of roughness, of metal, and of depth
        (("roughness",), {c: c.replace("albedo", "Glossy") for c in COLOURS}),
        (("metallic",), {c: c.replace("albedo", "metal_tint") for c in COLOURS}),
        (("depth.Z",), {c: c.replace("albedo", "depth_colour") for c in COLOURS}),
        # a normal under a name of motion, and motion under that of a normal
        (MOTION, {f"normal.{c}": f"vector.{c}" for c in "XYZ"}),
        (("normal.X", "normal.Y", "normal.Z"), {"motion.X": "norm.X", "motion.Y": "norm.Y"}),
        # light under the name of a surface
        (COLOURS, {f"emission.{c}": f"diffuse_light.{c}" for c in "RGB"}),
    ],
)
def test_a_wrong_guess_is_never_offered(
    rtsr: Run, capture: Copy, drop: tuple[str, ...], renamed: dict[str, str]
) -> None:
    found = inspected(rtsr, capture(drop, renamed))
    right = {"normal"} if "vector.X" in renamed.values() else set()
    assert set(found["guesses"]) <= right
    lines = [fix["line"] for fix in found["fixes"]]
    assert not any(name in line for line in lines for name in renamed.values() if not right)


def test_roughness_that_is_declared_is_not_doubted(rtsr: Run, capture: Copy) -> None:
    folder = capture()
    for path in sorted(folder.glob("*.exr")):
        header = read_header(path)
        planes = dict(read_channels(path, header.channels))
        planes["roughness"] = planes["roughness"] * 0.01
        write_exr(path, planes, attributes=header.attributes)
    assert "GGX alpha, perhaps?" in rtsr("inspect", folder).output
    declared = folder / "capture.toml"
    declared.write_text(f'roughness = "perceptual"\n{declared.read_text()}')
    said = rtsr("inspect", folder).output
    assert "perhaps?" not in said
    assert "perceptual, declared" in said


def test_two_colours_are_offered_as_material(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "shot"
    for path in sorted(small_capture.glob("*.exr")):
        header = read_header(path)
        planes = dict(read_channels(path, header.channels))
        for name in (*SURFACE, *COLOURS):
            plane = planes.pop(name)
            if name in COLOURS:
                planes[f"Diff Col{name[-2:]}"] = plane * 0.5
                planes[f"Gloss Col{name[-2:]}"] = plane * 0.25
        write_exr(folder / path.name, planes, attributes=header.attributes)
    (folder / "capture.toml").write_text(f'layout = "rtsr"\n{DECLARED_MOTION}')
    lines = {fix["line"] for fix in inspected(rtsr, folder)["fixes"]}
    assert 'material = "Diff Col.RGB + Gloss Col.RGB"' in lines
    assert "metallic = 0.0" not in lines


def test_evaluate_names_what_it_did_not_search(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    test = tmp_path / "test"
    test.mkdir()
    for path in sorted((small_shot / "reference").glob("*.exr")):
        (test / path.name).write_bytes(path.read_bytes())
    (test / "again").symlink_to(test)
    line = ("evaluate", test, small_shot, "--metric", "psnr", "--dry-run")
    result = rtsr(*line)
    assert result.exit_code == 0, result.output
    assert f"Warning: {test}: not searched: {test / 'again'}" in result.output
    (plan,) = (json.loads(text) for text in rtsr(*line, "--json").stdout.splitlines())
    assert "not searched" in plan["remarks"][0]


def test_a_mistyped_channel_is_said_once(rtsr: Run, capture: Copy) -> None:
    folder = capture()
    declared = 'layout = "rtsr"\n[buffers]\nalbedo = "albdo.RGB"\n'
    (folder / "capture.toml").write_text(declared)
    report = rtsr("inspect", folder).output
    assert "no channel is called 'albdo.R'" in report
    assert "holds what is declared" not in report


@pytest.mark.parametrize(
    ("declared", "meant"),
    [('normal = "normal.RGB"', "normal.XYZ"), ('albedo = "albedo.XYZ"', "albedo.RGB")],
)
def test_other_letters_of_the_same_channels_are_offered(
    rtsr: Run, capture: Copy, declared: str, meant: str
) -> None:
    folder = capture()
    (folder / "capture.toml").write_text(f'layout = "rtsr"\n[buffers]\n{declared}\n')
    refused = rtsr("upscale", folder, folder.parent / "out", "--simulate-lr", 4)
    assert refused.exit_code == 3
    assert f"did you mean '{meant}'?" in refused.output


@pytest.mark.parametrize(("lacks", "offered"), [(("albedo.G",), True), (MOTION, False)])
def test_predict_vrs_offers_the_estimate_that_needs_less(
    rtsr: Run, capture: Copy, lacks: tuple[str, ...], offered: bool
) -> None:
    folder = capture(lacks)
    refused = rtsr("predict-vrs", folder, folder.parent / "out", "--dry-run")
    assert refused.exit_code == 3
    assert ("--estimator analytic" in refused.output) is offered
