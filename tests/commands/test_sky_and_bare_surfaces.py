"""Sky that renderers write in other ways, and surfaces whose material carries no radiance."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import Plane

Change = Callable[[dict[str, Plane], int], None]
Copy = Callable[[Path, Change], Path]
Run = Callable[..., Result]
Load = Callable[[Path], NDArray[np.float32]]


def make_shot(source: Path, target: Path, changed: Copy, change: Change, declared: str) -> Path:
    """A shot whose frames are changed at both sizes, with more declared about it."""
    target.mkdir()
    for size in ("lr", "hr"):
        changed(source / size, change).rename(target / size)
    shutil.copytree(source / "reference", target / "reference")
    known = (source / "capture.toml").read_text(encoding="utf-8")
    (target / "capture.toml").write_text(f"{known}\n{declared}", encoding="utf-8")
    return target


def clear_sky(value: float) -> Change:
    def change(planes: dict[str, Plane], number: int) -> None:
        del number
        depth = planes["depth.Z"]
        depth[depth >= 65504.0] = value

    return change


def test_sky_at_depth_0_gives_the_pixels_of_sky_at_far(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, load_rgb: Load
) -> None:
    for value, declared in (
        (0.0, ""),
        (-1.0, ""),
        (0.0, "[depth]\nsky = 0.0"),
        (math.nan, ""),
        (math.nan, '[depth]\nsky = "nan"'),
        (math.inf, ""),
    ):
        shot = make_shot(
            small_shot,
            tmp_path / f"shot{value}{len(declared)}",
            changed,
            clear_sky(value),
            declared,
        )
        out = tmp_path / f"out{value}{len(declared)}"
        result = rtsr("upscale", shot, out, "--system", "demod-guided", "--frames", "2")
        assert result.exit_code == 0, result.output
        assert ("sky measured" in result.output) == (not declared and value != math.inf)
        right = tmp_path / "right"
        rtsr("upscale", small_shot, right, "--system", "demod-guided", "--frames", "2")
        ours, theirs = (next(f.rglob("*.exr")) for f in (out, right))
        assert np.array_equal(load_rgb(ours), load_rgb(theirs))


@pytest.mark.parametrize(
    ("value", "rule"),
    [
        (0.0, "depth of 0 or less, measured"),
        (math.nan, "depth of NaN, of 65504 or more, or infinite, measured"),
    ],
)
def test_inspect_says_the_share_of_the_sky_and_its_rule(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, value: float, rule: str
) -> None:
    shot = make_shot(small_shot, tmp_path / "shot", changed, clear_sky(value), "")
    plain, other = (json.loads(rtsr("inspect", s, "--json").output) for s in (small_shot, shot))
    found: dict[str, Any] = other["sky"]
    assert found["share"] == plain["sky"]["share"] > 0.0
    assert found["rule"] == rule
    assert found["impossible"] == 0.0
    text = rtsr("inspect", shot).output
    assert f"of the pixels, by {rule}" in text
    assert "sky measured: " not in text
    planned = rtsr("upscale", shot, tmp_path / "out", "--dry-run").output
    assert planned.count(f"sky measured: {rule.removesuffix(', measured')} (") == 2
    assert all(f"    {size}: sky measured: " in planned for size in ("lr", "hr"))
    assert "NaN or Inf" not in text


def test_radiance_of_nan_on_a_sky_of_nan_stays_refused(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    def change(planes: dict[str, Plane], number: int) -> None:
        clear_sky(math.nan)(planes, number)
        for name in {"R", "G", "B"} & planes.keys():
            planes[name][np.isnan(planes["depth.Z"])] = math.nan

    shot = make_shot(small_shot, tmp_path / "shot", changed, change, "")
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "bicubic", "--frames", "2")
    assert result.exit_code == 1
    assert "values of 'color' are NaN or Inf" in result.output
    assert "of 'depth'" not in result.output


def test_scattered_depth_of_0_is_warned_of(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    def change(planes: dict[str, Plane], number: int) -> None:
        depth = planes["depth.Z"]
        spoilt = np.random.default_rng(number).random(depth.shape) < 0.05
        depth[spoilt & (depth < 65504.0)] = 0.0

    shot = make_shot(small_shot, tmp_path / "shot", changed, change, "")
    text = " ".join(rtsr("inspect", shot).output.split())
    assert "of the depth values are 0, negative or no number" in text
    assert "[depth] sky" in text
    shot = make_shot(small_shot, tmp_path / "said", changed, change, '[depth]\nsky = "far"')
    assert "of the depth values are 0" not in rtsr("inspect", shot).output


def test_scattered_depth_of_0_is_warned_of_where_the_sky_is_0_too(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    def change(planes: dict[str, Plane], number: int) -> None:
        depth = planes["depth.Z"]
        spoilt = np.random.default_rng(number).random(depth.shape) < 0.03
        depth[spoilt | (depth >= 65504.0)] = 0.0

    shot = make_shot(small_shot, tmp_path / "shot", changed, change, "")
    result = rtsr("inspect", shot)
    assert result.exit_code == 0
    assert "scattered over surfaces, and read as sky" in " ".join(result.output.split())
    clean = make_shot(small_shot, tmp_path / "clean", changed, clear_sky(0.0), "")
    assert "scattered over surfaces" not in rtsr("inspect", clean).output


def test_depth_of_minus_infinity_is_warned_of_on_surfaces_and_counted_on_the_sky(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    def change(planes: dict[str, Plane], number: int) -> None:
        depth = planes["depth.Z"]
        spoilt = np.random.default_rng(number).random(depth.shape) < 0.05
        depth[spoilt & (depth < 65504.0)] = -np.inf

    shot = make_shot(small_shot, tmp_path / "shot", changed, change, "")
    assert "of the depth values are -inf" in " ".join(rtsr("inspect", shot).output.split())
    sky = make_shot(small_shot, tmp_path / "sky", changed, clear_sky(-np.inf), "")
    text = " ".join(rtsr("inspect", sky).output.split())
    assert "or infinite; -inf in " in text
    assert "of the depth values are -inf" not in text


def test_a_rule_that_does_not_exist_is_refused(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path
) -> None:
    declared = '[depth]\nsky = "fra"'
    shot = make_shot(small_shot, tmp_path / "shot", changed, lambda planes, number: None, declared)
    result = rtsr("inspect", shot)
    assert result.exit_code == 3
    assert "depth.sky" in result.output
    assert "far" in result.output


def take_material(planes: dict[str, Plane], number: int) -> None:
    """Black metal without roughness on the largest object: its material is 0."""
    del number
    ids, counts = np.unique(planes["objectid"][planes["objectid"] > 0], return_counts=True)
    chosen = planes["objectid"] == ids[np.argmax(counts)]
    for name in ("albedo.R", "albedo.G", "albedo.B"):
        planes[name][chosen] = 0.0
    planes["metallic"][chosen] = 1.0
    planes["roughness"][chosen] = 1.0


@pytest.mark.parametrize("system", ["demod-guided", "demod-bicubic"])
def test_the_share_of_surfaces_without_material_is_said(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, system: str
) -> None:
    shot = make_shot(small_shot, tmp_path / "shot", changed, take_material, "")
    result = rtsr("upscale", shot, tmp_path / "out", "--system", system)
    assert result.exit_code == 0, result.output
    assert result.output.count("surfaces whose material does not explain") == 1
    assert "; material is 0 at " in result.output or "; radiance is far too bright" in result.output
    again = rtsr("upscale", shot, tmp_path / "again", "--system", system, "--json")
    events = [json.loads(line) for line in again.output.splitlines() if line.startswith("{")]
    shares = [e["no_material"] for e in events if e["event"] == "frame"]
    assert all(0.0 < share < 1.0 for share in shares)
    assert events[-1]["no_material"] == len(shares) == 4


def test_frames_whose_material_carries_everything_say_nothing(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out", "--system", "demod-guided", "--json")
    events = [json.loads(line) for line in result.output.splitlines() if line.startswith("{")]
    assert [e["no_material"] for e in events if e["event"] == "frame"] == [0.0] * 4


COLOUR = ("albedo.R", "albedo.G", "albedo.B")
LIGHTING_SYSTEMS = (
    "demod-bicubic",
    "demod-guided",
    "demod-temporal",
    "gather",
    "fusesr",
    "fusesr-fast",
    "nsrd",
)


def list_cases() -> list[tuple[str, str, str]]:
    """Every system where a part is bare, and one where all is."""
    parts = [(size, "half", system) for size in ("lr", "hr") for system in LIGHTING_SYSTEMS]
    return [*parts, ("lr", "whole", "demod-guided"), ("hr", "whole", "demod-guided")]


@pytest.mark.parametrize(("size", "extent", "system"), list_cases())
def test_base_colour_of_one_size_alone_is_never_worse_than_bicubic(
    rtsr: Run,
    small_shot: Path,
    changed: Copy,
    tmp_path: Path,
    load_rgb: Load,
    size: str,
    extent: str,
    system: str,
) -> None:
    """Without it lighting is many times too bright, or the picture too dark."""

    def take_colour(planes: dict[str, Plane], number: int) -> None:
        del number
        for name in COLOUR:
            side = planes[name].shape[1] // 2 if extent == "half" else None
            planes[name][:, :side] = 0.0

    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    shutil.rmtree(shot / size)
    changed(small_shot / size, take_colour).rename(shot / size)
    outs = {name: tmp_path / name for name in ("bicubic", system)}
    for name, out in outs.items():
        result = rtsr("upscale", shot, out, "--system", name, "--frames", "2")
        assert result.exit_code == 0, result.output
    assert "which is enlarged as it is" in " ".join(result.output.split())
    wanted = load_rgb(shot / "reference" / "frame.0002.exr")
    side = wanted.shape[1] // 2 if extent == "half" else wanted.shape[1]
    plain, ours = (
        float(np.mean((load_rgb(out / "frame.0002.exr") - wanted)[:, :side] ** 2))
        for out in outs.values()
    )
    assert ours <= 1.001 * plain


@pytest.mark.parametrize("size", ["lr", "hr"])
def test_another_hue_of_one_size_is_never_worse_than_bicubic(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, load_rgb: Load, size: str
) -> None:
    """What it is at both sizes is said."""

    def change_hue(planes: dict[str, Plane], number: int) -> None:
        del number
        for name, value in zip(COLOUR, (0.02, 0.5, 0.9), strict=True):
            planes[name][:, : planes[name].shape[1] // 2] = value

    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    shutil.rmtree(shot / size)
    changed(small_shot / size, change_hue).rename(shot / size)
    outs = {name: tmp_path / name for name in ("bicubic", "demod-guided")}
    for name, out in outs.items():
        result = rtsr("upscale", shot, out, "--system", name, "--frames", "2")
        assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "an object's material differs between LR and HR" in said
    assert "base colour about " in said
    assert "material is 0" not in said
    assert ("about 0.02, 0.5, 0.9 at LR" in said) == (size == "lr")
    assert ("HR has 0.02, 0.5, 0.9" in said) == (size == "hr")
    wanted = load_rgb(shot / "reference" / "frame.0002.exr")
    side = wanted.shape[1] // 2
    plain, ours = (
        float(np.mean((load_rgb(out / "frame.0002.exr") - wanted)[:, :side] ** 2))
        for out in outs.values()
    )
    assert ours <= 1.01 * plain


@pytest.mark.parametrize("declared", ["", '[normal]\nspace = "world"\npacked = false'])
def test_normals_that_the_sky_was_cleared_to_tell_no_space(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, declared: str
) -> None:
    def change(planes: dict[str, Plane], number: int) -> None:
        sky = planes["depth.Z"] >= 65504.0
        sky[: sky.shape[0] // 2] = True
        planes["depth.Z"][sky] = 65504.0
        for name, value in zip("XYZ", (0.0, 0.0, 1.0), strict=True):
            planes[f"normal.{name}"][sky] = value

    shot = make_shot(small_shot, tmp_path / "shot", changed, change, declared)
    facts = json.loads(rtsr("inspect", shot, "--json").output)
    text = rtsr("inspect", shot).output
    assert "view space" not in text, text
    assert facts["sky"]["share"] > 0.0


@pytest.mark.parametrize("left", [0.0, 0.006])
@pytest.mark.parametrize("system", ["demod-guided", "gather", "fusesr-fast", "nsrd"])
def test_metal_without_base_colour_is_never_worse_than_bicubic(
    rtsr: Run,
    small_shot: Path,
    changed: Copy,
    tmp_path: Path,
    load_rgb: Load,
    system: str,
    left: float,
) -> None:
    """Its divisor is the remainder of the specular term: 0 in places, a tenth at the edges."""

    def take_colour(planes: dict[str, Plane], number: int) -> None:
        del number
        side = planes["metallic"].shape[1] // 2
        for name in COLOUR:
            planes[name][:, :side] = left
        planes["metallic"][:, :side] = 1.0
        planes["roughness"][:, :side] = 0.4

    shot = make_shot(small_shot, tmp_path / "shot", changed, take_colour, "")
    outs = {name: tmp_path / f"out-{name}" for name in ("bicubic", system)}
    for name, out in outs.items():
        result = rtsr("upscale", shot, out, "--system", name, "--frames", "2")
        assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "surfaces whose material does not explain their radiance" in said
    wanted = load_rgb(small_shot / "reference" / "frame.0002.exr")
    side = wanted.shape[2] // 2
    plain, ours = (
        float(np.mean((load_rgb(out / "frame.0002.exr") - wanted)[..., :side] ** 2))
        for out in outs.values()
    )
    assert ours <= 1.02 * plain


def test_a_diffuse_colour_of_0_on_thin_things_is_found_beside_f0(
    rtsr: Run, small_shot: Path, changed: Copy, tmp_path: Path, load_rgb: Load
) -> None:
    """Posts of one LR pixel's width before the rest; files hold diffuse colour and F0."""

    def make_change(step: int, width: int, left: float) -> Change:
        def change(planes: dict[str, Plane], number: int) -> None:
            del number
            posts = np.arange(planes["depth.Z"].shape[1]) % step < width
            metallic = planes.pop("metallic")
            for letter in "RGB":
                base = planes[f"albedo.{letter}"].astype(np.float32)
                planes[f"specular.{letter}"] = (0.04 * (1.0 - metallic) + base * metallic).astype(
                    "f4"
                )
                diffuse = base * (1.0 - metallic)
                diffuse[:, posts] *= left
                planes[f"albedo.{letter}"] = diffuse.astype(np.float32)
            depth = planes["depth.Z"]
            depth[(depth < 65504.0) & posts] *= 0.95

        return change

    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    for size, change in (("lr", make_change(6, 1, 1.0)), ("hr", make_change(24, 4, 0.0))):
        shutil.rmtree(shot / size)
        changed(small_shot / size, change).rename(shot / size)
    wanted = load_rgb(shot / "reference" / "frame.0002.exr")
    posts = np.arange(wanted.shape[2]) % 24 < 4
    errors = []
    for name in ("bicubic", "demod-guided"):
        result = rtsr("upscale", shot, tmp_path / name, "--system", name, "--frames", "2")
        assert result.exit_code == 0, result.output
        made = load_rgb(tmp_path / name / "frame.0002.exr")
        errors.append(float(np.mean((made - wanted)[..., posts] ** 2)))
    # metal among them keeps its division, for better or worse
    assert errors[1] <= 1.05 * errors[0]
