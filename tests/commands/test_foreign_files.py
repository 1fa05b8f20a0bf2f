"""Files that rtsr did not write are replaced by no command unless `--overwrite` says so."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from click.testing import Result

from rtsr_cli.core.files.ownership import is_own
from rtsr_cli.core.files.png import encode_png

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


def begin_exr(size: int) -> bytes:
    """The first bytes of an EXR that another program wrote."""
    stream = io.BytesIO()
    planes = {"Y": np.zeros((8, 8), np.float16)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes).write(stream)
    return stream.getvalue()[:size]


def begin_png(size: int) -> bytes:
    """The first bytes of a PNG without rtsr's mark: signature, IHDR, and zeros."""
    head = encode_png(np.zeros((8, 8, 3), np.uint8))[:33]
    return (head + bytes(size))[:size]


BEGINNINGS = [
    *((f"frame.0002{suffix}", begin_exr(n)) for suffix in (".exr",) for n in (1, 4, 20, 100)),
    ("debug/frame.0002.exr", begin_exr(100)),
    *(("frame.0002.png", begin_png(n)) for n in (1, 8, 33, 56)),
]


@pytest.mark.parametrize(("name", "content"), BEGINNINGS)
def test_the_beginning_of_a_file_of_others_is_not_taken_for_a_cut_output(
    rtsr: Run, small_capture: Path, tmp_path: Path, name: str, content: bytes
) -> None:
    foreign = tmp_path / "out" / name
    foreign.parent.mkdir(parents=True)
    foreign.write_bytes(content)
    result = rtsr(*arguments("upscale", small_capture, tmp_path / "out"))
    assert result.exit_code == 3, result.output
    assert f"{foreign}: rtsr upscale did not write this" in result.stderr
    assert "--overwrite" in result.stderr
    assert foreign.read_bytes() == content


@pytest.mark.parametrize(
    ("command", "name"), [(c, name) for c, names in WRITTEN.items() for name in names]
)
def test_an_empty_file_holds_nothing_to_lose_and_is_written(
    rtsr: Run, small_capture: Path, tmp_path: Path, command: str, name: str
) -> None:
    empty = tmp_path / "out" / name
    empty.parent.mkdir(parents=True)
    empty.touch()
    result = rtsr(*arguments(command, small_capture, tmp_path / "out"))
    if command == "precompute-lut":
        # replaces nothing at all without --overwrite
        assert result.exit_code == 3, result.output
        assert "--overwrite" in result.stderr
        assert not empty.stat().st_size
        return
    assert result.exit_code == 0, result.output
    assert empty.stat().st_size
    if command == "upscale":
        assert f"Warning: {empty}: an empty file; its content is made" in result.stderr


def test_outputs_of_every_kind_that_were_emptied_are_made_again(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    asked = arguments("predict-vrs", small_capture, tmp_path / "out")
    assert rtsr(*asked).exit_code == 0
    files = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {path.suffix for path in files} == {".exr", ".png", ".json"}
    for path in files:
        path.write_bytes(b"")
    assert rtsr(*asked).exit_code == 0
    assert {path: path.read_bytes() for path in files} == files


@pytest.mark.parametrize(
    ("command", "name"),
    [(c, n) for c, names in WRITTEN.items() for n in names if c != "precompute-lut"],
)
def test_a_link_is_neither_followed_nor_replaced(
    rtsr: Run, small_capture: Path, tmp_path: Path, command: str, name: str
) -> None:
    out = tmp_path / "out"
    asked = arguments(command, small_capture, out)
    out.mkdir()
    assert rtsr(*asked).exit_code == 0
    victim = tmp_path / "victim"
    # what it leads to would be replaced if it lay there itself
    content = (out / name).read_bytes()[: -9 if name.endswith((".exr", ".png")) else None]
    victim.write_bytes(content)
    (out / name).unlink()
    (out / name).symlink_to(victim)
    result = rtsr(*asked)
    assert result.exit_code == 3, result.output
    assert str(out / name) in result.stderr
    assert (out / name).is_symlink()
    assert victim.read_bytes() == content


def test_a_link_to_a_finished_output_stays(rtsr: Run, small_capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked = arguments("upscale", small_capture, out)
    assert rtsr(*asked).exit_code == 0
    for path in sorted(out.rglob("frame.0002.*")):
        kept = tmp_path / f"store-{path.parent.name}-{path.name}"
        path.rename(kept)
        path.symlink_to(kept)
    result = rtsr(*asked)
    assert result.exit_code == 0, result.output
    assert "0 written, 4 kept" in result.stdout


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


def test_a_training_replaces_nothing_in_its_cache_that_no_training_wrote(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    few = ("--set", "training.crop=12", "--pack-crops", 1)
    cache = tmp_path / "recordings"
    asked = ("train", "fusesr-fast", small_capture, "--cache", cache, "--out", tmp_path / "run")
    packed = ("train", "fusesr-fast", small_capture, "--cache", cache, *few)
    assert rtsr(*packed, "--pack", tmp_path / "one.pack").exit_code == 0
    recorded = sorted(path for path in cache.iterdir() if path.is_file())
    assert {path.suffix for path in recorded} == {".json", ".rtsr-clips"}
    for path in recorded:
        kept = {other: other.read_bytes() for other in recorded}
        path.write_bytes(MINE)
        for command in (asked, (*packed, "--pack", tmp_path / "two.pack")):
            result = rtsr(*command)
            assert result.exit_code == 3, result.output
            assert f"{path}: rtsr train did not write this" in result.stderr
            assert path.read_bytes() == MINE
        path.write_bytes(b"")
        assert rtsr(*packed, "--pack", tmp_path / f"{path.suffix}.pack").exit_code == 0
        assert path.read_bytes() == kept[path]
        path.write_bytes(MINE)
        again = ("--pack", tmp_path / f"{path.suffix}.pack", "--overwrite")
        assert rtsr(*packed, *again).exit_code == 0
        assert path.read_bytes() == kept[path]


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
