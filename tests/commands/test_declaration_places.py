"""Which capture.toml applies: one rule for IN of every command, wherever in a shot IN is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]

DECLARED = """layout = "rtsr"
scale = 4
jitter_px = [0.25, -0.25]
[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
[buffers]
depth = "far_away.Z"
roughness = "rgh"
"""
"""Of a shot: channels that no layout knows, and what only concerns LR frames."""

RENAMED = {"depth.Z": "far_away.Z", "roughness": "rgh"}


@pytest.fixture
def hr(small_capture: Path, tmp_path: Path) -> Path:
    """The folder `hr` of a shot that declares what it holds."""
    folder = tmp_path / "shot" / "hr"
    for path in sorted(small_capture.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        named = {RENAMED.get(name, name): plane for name, plane in planes.items()}
        write_exr(folder / path.name, named, attributes=header.attributes)
    (folder.parent / "capture.toml").write_text(DECLARED)
    return folder


def inspected(rtsr: Run, folder: str | Path) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads(rtsr("inspect", folder, "--json").stdout)
    return facts


@pytest.mark.parametrize(
    "command",
    [
        ("predict-vrs", "IN", "OUT"),
        ("predict-vrs", "IN", "OUT", "--estimator", "analytic"),
        ("demodulate", "IN", "OUT"),
        ("label", "IN", "OUT", "--kind", "vrs"),
        ("upscale", "IN", "OUT", "--simulate-lr", 4, "--system", "taau"),
    ],
    ids=lambda command: " ".join(map(str, command[:1] + command[3:])),
)
def test_a_folder_of_a_shot_finds_what_its_shot_declares(
    rtsr: Run, hr: Path, tmp_path: Path, command: tuple[object, ...]
) -> None:
    places = {"IN": hr, "OUT": tmp_path / "out"}
    result = rtsr(*(places.get(str(word), word) for word in command), "--dry-run")
    assert result.exit_code == 0, result.output


def test_the_folder_that_one_is_in_finds_it_as_well(
    rtsr: Run, hr: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hr)
    assert "depth" in inspected(rtsr, ".")["buffers"]
    monkeypatch.chdir(hr.parent)
    assert "depth" in inspected(rtsr, "hr")["buffers"]


def test_its_own_capture_toml_comes_first(rtsr: Run, hr: Path) -> None:
    (hr / "capture.toml").write_text('layout = "rtsr"\n')
    assert "depth" not in inspected(rtsr, hr)["buffers"]


def test_a_folder_of_another_name_is_no_part_of_a_shot(rtsr: Run, hr: Path) -> None:
    other = hr.rename(hr.parent / "frames")
    assert "depth" not in inspected(rtsr, other)["buffers"]


def test_what_is_declared_of_lr_frames_is_not_said_of_others(
    rtsr: Run, hr: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    options = ("--system", "bicubic", "--dry-run", "--json")
    refused = rtsr("upscale", hr, out, *options)
    assert refused.exit_code != 0
    assert "--scale" in refused.output
    lr = hr.rename(hr.parent / "lr")
    plan = json.loads(rtsr("upscale", lr, out, *options).stdout.splitlines()[0])
    assert plan["scale"] == 4
