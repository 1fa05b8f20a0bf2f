"""`[buffers]` that are computed: sums, constants, `1 - x`, in every command that reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, write_exr

Run = Callable[..., Result]

HEIGHT, WIDTH = 16, 24
DIFFUSE, GLOSSY, SMOOTHNESS = 0.5, 0.25, 0.75
LAYER = "ViewLayer"

BUFFERS = """
material = "dif.RGB + gls.BGR"
roughness = "1 - smooth.R"
metallic = 0.25
"""


def write_shot(folder: Path, *, prefix: str = "", size: tuple[int, int] = (HEIGHT, WIDTH)) -> Path:
    generator = np.random.default_rng(1)
    light = generator.uniform(0.2, 1.0, (*size, 3))
    for number in (1, 2):
        planes = {
            f"{prefix}{layer}.{c}": np.full(size, value * (1.0 + i / 4.0), np.float32)
            for layer, value in (("dif", DIFFUSE), ("gls", GLOSSY))
            for i, c in enumerate("RGB")
        }
        radiance = {c: light[..., i].astype(np.float32) for i, c in enumerate("RGB")}
        color = "Combined." if prefix else ""
        planes |= {f"{prefix}{color}{c}": plane for c, plane in radiance.items()}
        planes |= {f"{prefix}{'Depth' if prefix else 'depth'}.Z": np.full(size, 3.0, np.float32)}
        planes |= {f"{prefix}smooth.R": np.full(size, SMOOTHNESS, np.float32)}
        planes |= {
            f"{prefix}{'Normal' if prefix else 'normal'}.{c}": np.full(size, v, np.float32)
            for c, v in zip("XYZ", (0, 0, 1), strict=True)
        }
        write_exr(folder / f"f.{number:04d}.exr", planes)
    return folder


def declare(folder: Path, text: str) -> None:
    (folder / "capture.toml").write_text(f"[buffers]\n{text}\n", encoding="utf-8")


def facts_of(rtsr: Run, folder: Path, *options: str) -> dict[str, dict[str, object]]:
    result = rtsr("inspect", folder, *options, "--json")
    assert result.exit_code == 0, result.output
    buffers = json.loads(result.stdout)["buffers"]
    assert isinstance(buffers, dict)
    return buffers


def test_sums_constants_and_differences_are_read_and_shown(rtsr: Run, tmp_path: Path) -> None:
    declare(write_shot(tmp_path / "in"), BUFFERS)
    found = facts_of(rtsr, tmp_path / "in")
    assert {b: found[b]["expression"] for b in ("material", "roughness", "metallic")} == {
        "material": "f:dif.RGB + f:gls.BGR",
        "roughness": "1 - f:smooth.R",
        "metallic": "0.25",
    }
    # dif.R + gls.B, and dif.B + gls.R
    assert found["material"]["min"] == DIFFUSE + 1.5 * GLOSSY
    assert found["material"]["max"] == 1.5 * DIFFUSE + GLOSSY
    assert found["roughness"]["median"] == 1.0 - SMOOTHNESS
    assert found["metallic"]["channels"] == []
    said = rtsr("inspect", tmp_path / "in").output
    assert "dif.RGB + gls.BGR" in said
    assert "1 - smooth.R" in said


def test_factors_are_shown_as_they_are_understood(rtsr: Run, tmp_path: Path) -> None:
    factors = 'roughness = "0.5 * smooth.R"\nmaterial = ["dif.R", "0 - dif.G", "dif.B"]\n'
    declare(write_shot(tmp_path / "in"), factors)
    found = facts_of(rtsr, tmp_path / "in")
    assert found["roughness"]["expression"] == "0.5 * f:smooth.R"
    said = rtsr("inspect", tmp_path / "in").output
    assert "0.5 * smooth.R" in said
    assert "dif.R, -1 * dif.G, dif.B" in said


def test_what_is_computed_divides(rtsr: Run, tmp_path: Path) -> None:
    declare(write_shot(tmp_path / "in"), BUFFERS)
    result = rtsr("demodulate", tmp_path / "in", tmp_path / "out")
    assert result.exit_code == 0, result.output
    planes = read_channels(tmp_path / "out" / "f.0001.exr", ["material.R", "material.B"])
    assert float(planes["material.R"][0, 0]) == DIFFUSE + 1.5 * GLOSSY
    assert float(planes["material.B"][0, 0]) == 1.5 * DIFFUSE + GLOSSY


def test_a_changed_expression_makes_outputs_stale(rtsr: Run, tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "in")
    run = ("demodulate", shot, tmp_path / "out")
    declare(shot, BUFFERS)
    assert rtsr(*run).exit_code == 0
    assert rtsr(*run).exit_code == 0
    for changed in (
        BUFFERS.replace("gls.BGR", "gls.RGB"),
        BUFFERS.replace('gls.BGR"', 'gls.BGR + 0.5"'),
        BUFFERS.replace("+ gls", "+ 2 * gls"),
    ):
        declare(shot, changed)
        assert rtsr(*run).exit_code == 3


def test_a_scope_may_be_left_out_where_there_is_one(rtsr: Run, tmp_path: Path) -> None:
    declare(write_shot(tmp_path / "in", prefix=f"{LAYER}."), BUFFERS)
    found = facts_of(rtsr, tmp_path / "in")
    assert found["material"]["expression"] == f"f:{LAYER}.dif.RGB + f:{LAYER}.gls.BGR"
    assert found["color"]["channels"] == [f"f:{LAYER}.Combined.{c}" for c in "RGB"]


def test_of_two_scopes_the_chosen_one_is_completed(rtsr: Run, tmp_path: Path) -> None:
    for number in (1, 2):
        planes = {}
        for layer in ("one", "two"):
            write_shot(tmp_path / layer, prefix=f"{layer}.")
            path = tmp_path / layer / f"f.{number:04d}.exr"
            names = [f"{layer}.{p}.{c}" for p in ("Combined", "dif", "gls") for c in "RGB"]
            planes |= read_channels(path, names)
        write_exr(tmp_path / "in" / f"f.{number:04d}.exr", planes)
    declare(tmp_path / "in", 'material = "dif.RGB + gls.RGB"')
    refused = rtsr("inspect", tmp_path / "in")
    assert refused.exit_code == 3
    assert "choose one with --layer" in refused.output
    found = facts_of(rtsr, tmp_path / "in", "--layer", "two")
    assert found["material"]["expression"] == "f:two.dif.RGB + f:two.gls.RGB"


def test_what_is_written_down_reads_the_same(rtsr: Run, tmp_path: Path) -> None:
    declare(write_shot(tmp_path / "in"), BUFFERS)
    before = facts_of(rtsr, tmp_path / "in")
    assert rtsr("inspect", tmp_path / "in", "--write", "--overwrite").exit_code == 0
    assert "+" in (tmp_path / "in" / "capture.toml").read_text(encoding="utf-8")
    assert facts_of(rtsr, tmp_path / "in") == before


def test_files_of_their_own_are_added_up(rtsr: Run, tmp_path: Path) -> None:
    for number in (1, 2):
        for name, value in (("beauty", 1.0), ("key", 0.5), ("fill", 0.25)):
            planes = {c: np.full((HEIGHT, WIDTH), value, np.float32) for c in "RGB"}
            write_exr(tmp_path / "in" / f"{name}.{number:04d}.exr", planes)
    declare(tmp_path / "in", 'color = "key:RGB + fill:RGB"\ndepth = 2.0')
    assert rtsr("upscale", tmp_path / "in", tmp_path / "out", "--scale", "2").exit_code == 0
    (first, *_) = sorted((tmp_path / "out").glob("*.0001.exr"))
    assert float(read_channels(first, ["G"])["G"].mean()) == pytest.approx(0.75)


def test_constants_are_there_at_both_resolutions_and_where_nothing_is(
    rtsr: Run, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    write_shot(shot / "lr")
    write_shot(shot / "hr", size=(2 * HEIGHT, 2 * WIDTH))
    declare(shot, 'material = [0.5, 0.25, 0.125]\nroughness = "0.5"')
    result = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided")
    assert result.exit_code == 0, result.output
    assert len(list((tmp_path / "out").glob("*.exr"))) == 2


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ('material = "dif.RGB + gIs.RGB"', "column 11"),
        ('material = "dif.RGB+gls.RGB"', "operators stand between spaces"),
        ('roughness = "1-smooth.R"', "operators stand between spaces"),
        ('material = "dif.RGB + "', "buffers.material: column 10"),
        ('material = "dif.RGB * gls.RGB"', "buffers.material: column 11"),
        ('roughness = "1 - smoth.R"', "did you mean 'smooth.R'?"),
    ],
)
def test_what_is_wrong_is_one_message_with_its_place(
    rtsr: Run, tmp_path: Path, declared: str, said: str
) -> None:
    declare(write_shot(tmp_path / "in"), declared)
    result = rtsr("upscale", tmp_path / "in", tmp_path / "out", "--scale", "2")
    assert result.exit_code == 3
    output = " ".join(result.output.split())
    assert said in output
    assert "capture.toml" in output
    assert "Traceback" not in output
