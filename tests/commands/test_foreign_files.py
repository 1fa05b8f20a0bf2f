"""Files that rtsr did not write are replaced by no command unless `--overwrite` says so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from rtsr_cli.core.files.ownership import is_own

Run = Callable[..., Result]
MINE = b"mine, and nobody else's"

WRITTEN = {
    "upscale": ("frame.0002.exr", "frame.0002.png", "debug/frame.0002.exr"),
    "demodulate": ("frame.0002.exr",),
    "label": ("frame.0002.exr", "frame.0002.png"),
    "predict-vrs": (
        "frame.0002.exr", "frame.0002.rate.png", "frame.0002.overlay.png", "summary.json",
    ),
    "synth": ("frame.0001.exr", "capture.toml"),
    "synth --layout": ("0.json",),
    "evaluate": ("r.json", "r.csv", "r.html"),
    "precompute-lut": ("lut.exr", "lut.png"),
}  # fmt: skip
"""Command -> files below OUT that it writes."""


def arguments(command: str, small_capture: Path, out: Path) -> list[object]:
    frames = [small_capture, out]
    outputs = [part for name in WRITTEN["evaluate"] for part in ("--output", out / name)]
    small = ["--size", "32x32", "--frames", "1"]
    return {
        "upscale": [
            "upscale", *frames, "--simulate-lr", 2, "--system", "bicubic", "--preview",
            "--debug-buffers",
        ],
        "demodulate": ["demodulate", *frames],
        "label": ["label", *frames, "--kind", "vrs", "--preview", "--metric", "psnr"],
        "predict-vrs": [
            "predict-vrs", *frames, "--estimator", "analytic", "--overlay", "--no-compare",
        ],
        "synth": ["synth", out, *small],
        "synth --layout": ["synth", out, *small, "--scale", 2, "--layout", "nss"],
        "evaluate": ["evaluate", small_capture, small_capture, "--metric", "psnr", *outputs],
        "precompute-lut": ["precompute-lut", out / "lut.exr", "--size", 16, "--preview"],
    }[command]  # fmt: skip


@pytest.mark.parametrize(
    ("command", "name"), [(c, name) for c, names in WRITTEN.items() for name in names]
)
def test_what_rtsr_did_not_write_is_refused_and_replaced_only_when_asked(
    rtsr: Run, small_capture: Path, tmp_path: Path, command: str, name: str
) -> None:
    foreign = tmp_path / "out" / name
    foreign.parent.mkdir(parents=True)
    foreign.write_bytes(MINE)
    asked = arguments(command, small_capture, tmp_path / "out")
    result = rtsr(*asked)
    assert result.exit_code == 3, result.output
    assert str(foreign) in result.stderr
    assert "--overwrite" in result.stderr
    assert foreign.read_bytes() == MINE
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == [foreign]
    result = rtsr(*asked, "--overwrite")
    assert result.exit_code == 0, result.output
    assert foreign.read_bytes() != MINE


@pytest.mark.parametrize("command", ["upscale", "predict-vrs", "evaluate", "synth --layout"])
def test_its_own_files_are_replaced_without_being_asked(
    rtsr: Run, small_capture: Path, tmp_path: Path, command: str
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    asked = arguments(command, small_capture, out)
    assert rtsr(*asked).exit_code == 0
    marked = [path for path in out.rglob("*") if path.suffix in {".png", ".html", ".exr"}]
    assert marked
    assert all(map(is_own, marked))
    for path in out.glob("*.exr"):
        path.unlink()
    assert rtsr(*asked).exit_code == 0


def test_a_link_that_leads_nowhere_is_not_replaced(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "frame.0001.png").symlink_to(tmp_path / "nowhere")
    result = rtsr(*arguments("upscale", small_capture, out))
    assert result.exit_code == 3
    assert "frame.0001.png" in result.stderr
    assert not (tmp_path / "nowhere").exists()


def test_no_former_copy_of_a_declaration_is_lost(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shot.mkdir()
    for path in small_capture.glob("*.exr"):
        (shot / path.name).hardlink_to(path)
    (shot / "capture.toml").write_text("# mine\n")
    assert rtsr("inspect", shot, "--write").exit_code == 3
    assert (shot / "capture.toml").read_text() == "# mine\n"
    for _ in range(2):
        assert rtsr("inspect", shot, "--write", "--overwrite").exit_code == 0
    assert (shot / "capture.toml.bak").read_text() == "# mine\n"
    assert (shot / "capture.toml.bak1").is_file()


RUN_FILES = [
    "config.toml", "log.csv", "curves.png", "best.safetensors", "last.safetensors",
    "state/state.json", "state/step-000000001.safetensors", "pictures/step-000004-one-1.png",
]  # fmt: skip


@pytest.mark.parametrize("name", RUN_FILES)
def test_a_training_replaces_nothing_in_its_folder_that_no_training_wrote(
    rtsr: Run, small_capture: Path, tmp_path: Path, name: str
) -> None:
    foreign = tmp_path / "run" / name
    foreign.parent.mkdir(parents=True)
    foreign.write_bytes(MINE)
    result = rtsr("train", "fusesr-fast", small_capture, "--out", tmp_path / "run")
    assert result.exit_code == 3, result.output
    assert f"{foreign}: rtsr train did not write this" in result.stderr
    assert [path for path in (tmp_path / "run").rglob("*") if path.is_file()] == [foreign]


def test_a_pack_replaces_packs_only(rtsr: Run, small_capture: Path, tmp_path: Path) -> None:
    pack = tmp_path / "crops.pack"
    pack.write_bytes(MINE)
    few = ("--pack-crops", 1, "--set", "training.crop=12")
    asked = ("train", "fusesr-fast", small_capture, "--pack", pack, *few)
    result = rtsr(*asked)
    assert result.exit_code == 3, result.output
    assert f"{pack}: rtsr train --pack did not write this" in result.stderr
    assert pack.read_bytes() == MINE
    for more in (["--overwrite"], []):
        assert rtsr(*asked, *more).exit_code == 0
    assert pack.read_bytes() != MINE
