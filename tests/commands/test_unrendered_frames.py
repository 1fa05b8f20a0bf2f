"""Sequences whose predicted steps hold no radiance: as good as any that does, and never guessed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Planes = dict[str, NDArray[Any]]
Load = Callable[[Path], NDArray[np.float32]]

COLOR = ("R", "G", "B")
FOLDERS = {
    "PreTonemapHDRColor": COLOR,
    "BaseColor": ("albedo.R", "albedo.G", "albedo.B"),
    "WorldNormal": ("normal.X", "normal.Y", "normal.Z"),
    "SceneDepth": ("depth.Z",) * 3,
    "Roughness": ("roughness",) * 3,
    "Metallic": ("metallic",) * 3,
    "MotionVector": ("motion.X", "motion.Y"),
    "Stencil": ("objectid",) * 3,
}
"""Buffers of a layout that keeps each in a folder of its own, and our channels that they hold."""


def copy(source: Path, target: Path, edit: Callable[[Planes, int], None]) -> Path:
    for path in sorted(source.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        edit(planes, int(path.stem.split(".")[-1]))
        write_exr(target / path.name, planes, attributes=header.attributes)
    return target


def drop(channels: tuple[str, ...], numbers: tuple[int, ...]) -> Callable[[Planes, int], None]:
    def edit(planes: Planes, number: int) -> None:
        if number in numbers:
            for channel in channels:
                planes.pop(channel, None)

    return edit


def names_in(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.suffix == ".exr")


@pytest.fixture(scope="module")
def sequence(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six small frames with radiance and G-buffer."""

    def crop(planes: Planes, number: int) -> None:
        del number
        for name, plane in planes.items():
            planes[name] = plane[:48, :64]

    return copy(sample_root / "lr", tmp_path_factory.mktemp("sequence") / "shot", crop)


@pytest.fixture(scope="module")
def bare(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same frames; 2, 4, 6 hold no radiance."""
    return copy(sequence, tmp_path_factory.mktemp("bare") / "shot", drop(COLOR, (2, 4, 6)))


def spread(sequence: Path, shot: Path, without: tuple[int, ...]) -> Path:
    """Write a folder a buffer; some frames have no file of radiance."""
    for path in sorted(sequence.glob("*.exr")):
        number = int(path.stem.split(".")[-1])
        header = read_header(path)
        planes = read_channels(path, header.channels)
        for folder, channels in FOLDERS.items():
            if folder == "PreTonemapHDRColor" and number in without:
                continue
            named = zip(COLOR, channels, strict=False)
            held = {c: planes[name].astype(np.float32) for c, name in named}
            write_exr(shot / folder / f"{number:04d}.exr", held, attributes=header.attributes)
    (shot / "capture.toml").write_text(
        '[motion]\nunit = "pixels"\ndirection = "previous-minus-current"\ny_axis = "down"\n'
    )
    return shot


@pytest.fixture(scope="module")
def folders(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a folder a buffer; radiance has the files 1, 3, 5 alone."""
    return spread(sequence, tmp_path_factory.mktemp("folders") / "shot", (2, 4, 6))


@pytest.mark.parametrize("system", ["warp", "warp-guided"])
@pytest.mark.parametrize("options", [(), ("--every", "3", "--frames", "2")])
def test_frames_without_radiance_are_predicted_as_those_that_hold_some(
    rtsr: Run,
    load_rgb: Load,
    sequence: Path,
    bare: Path,
    tmp_path: Path,
    system: str,
    options: tuple[str, ...],
) -> None:
    for shot, out in ((sequence, "full"), (bare, "bare")):
        result = rtsr("extrapolate", shot, tmp_path / out, "--system", system, *options)
        assert result.exit_code == 0, result.output
    names = names_in(tmp_path / "full")
    assert names_in(tmp_path / "bare") == names
    for name in names:
        full, made = (tmp_path / out / name for out in ("full", "bare"))
        assert np.array_equal(load_rgb(full), load_rgb(made))
        assert read_header(made).data_window == read_header(full).data_window


def test_a_folder_of_radiance_need_not_have_the_other_steps(
    rtsr: Run, load_rgb: Load, sequence: Path, folders: Path, tmp_path: Path
) -> None:
    run = ("extrapolate", folders, tmp_path / "out", "--keep-rendered")
    assert "3 rendered, 3 to predict" in rtsr(*run, "--dry-run").output
    assert not (tmp_path / "out").exists()
    result = rtsr(*run)
    assert result.exit_code == 0, result.output
    assert names_in(tmp_path / "out") == [f"{n:04d}.exr" for n in range(1, 7)]
    rtsr("extrapolate", spread(sequence, tmp_path / "full", ()), tmp_path / "all")
    for name in names_in(tmp_path / "all"):
        assert np.array_equal(load_rgb(tmp_path / "out" / name), load_rgb(tmp_path / "all" / name))
    assert "0 written, 6 kept" in rtsr(*run).output


def test_radiance_in_files_of_its_own_names_the_outputs(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    for path in sorted(sequence.glob("*.exr")):
        number = int(path.stem.split(".")[-1])
        header = read_header(path)
        planes = read_channels(path, header.channels)
        color = {c: planes.pop(c) for c in COLOR}
        write_exr(shot / f"gbuffer.{number:04d}.exr", planes, attributes=header.attributes)
        if number % 2:
            write_exr(shot / f"beauty.{number:04d}.exr", color, attributes=header.attributes)
    result = rtsr("extrapolate", shot, tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert names_in(tmp_path / "out") == [f"beauty.{n:04d}.exr" for n in (2, 4, 6)]


def test_the_first_frame_need_not_be_a_rendered_one(
    rtsr: Run, sequence: Path, load_rgb: Load, tmp_path: Path
) -> None:
    late = copy(sequence, tmp_path / "late", drop(COLOR, (1, 3, 5)))
    result = rtsr("extrapolate", late, tmp_path / "out", "--rendered", "2,4,6", "--frames", "3-6")
    assert result.exit_code == 0, result.output
    assert names_in(tmp_path / "out") == ["frame.0003.exr", "frame.0005.exr"]
    rtsr("extrapolate", sequence, tmp_path / "full", "--rendered", "2,4,6", "--frames", "3-6")
    for name in names_in(tmp_path / "out"):
        assert np.array_equal(load_rgb(tmp_path / "out" / name), load_rgb(tmp_path / "full" / name))


def test_rendered_frames_without_radiance_are_named_with_those_that_have_it(
    rtsr: Run, bare: Path, tmp_path: Path
) -> None:
    result = rtsr("extrapolate", bare, tmp_path / "out", "--every", "3")
    assert result.exit_code == 3
    assert "frame 4: buffer 'color' is missing" in result.output
    assert "--rendered 1,3,5" in result.output
    assert not (tmp_path / "out").exists()
    # what lies behind the frames that are wanted does not matter
    part = rtsr("extrapolate", bare, tmp_path / "out", "--every", "3", "--frames", "2-3")
    assert part.exit_code == 0, part.output


def test_channels_that_one_kind_of_frames_has_alone_are_left_out_and_said(
    rtsr: Run, sequence: Path, bare: Path, load_rgb: Load, tmp_path: Path
) -> None:
    """Rendered frames with more passes, and others with more: both are what they share."""

    def alter(planes: Planes, number: int) -> None:
        if number % 2:
            planes |= {f"position.{c}": np.zeros_like(planes["depth.Z"]) for c in "XYZ"}
            planes["preview.R"] = planes["R"]
        else:
            planes["ao"] = np.ones_like(planes["depth.Z"])

    mixed = copy(bare, tmp_path / "mixed", alter)
    result = rtsr("extrapolate", mixed, tmp_path / "out", "-v")
    assert result.exit_code == 0, result.output
    rtsr("extrapolate", sequence, tmp_path / "full")
    for name in names_in(tmp_path / "full"):
        assert np.array_equal(load_rgb(tmp_path / "out" / name), load_rgb(tmp_path / "full" / name))
    told = rtsr("inspect", mixed)
    assert "buffer 'position' is not read: frames 2, 4, 6 have none" in told.output


def test_what_one_frame_lacks_is_named(rtsr: Run, bare: Path, tmp_path: Path) -> None:
    broken = copy(bare, tmp_path / "broken", drop(("motion.X", "motion.Y"), (4,)))
    result = rtsr("extrapolate", broken, tmp_path / "out")
    assert result.exit_code == 3
    assert "missing: motion of frame 4" in result.output
    kinds = copy(bare, tmp_path / "kinds", drop(("motion.X", "motion.Y"), (2, 4, 6)))
    result = rtsr("extrapolate", kinds, tmp_path / "out")
    assert result.exit_code == 3
    assert "missing: motion of frames 2, 4, 6" in result.output


def test_other_commands_want_radiance_of_every_frame(
    rtsr: Run, bare: Path, folders: Path, tmp_path: Path
) -> None:
    result = rtsr("upscale", bare, tmp_path / "out", "--scale", "2", "--system", "bicubic")
    assert result.exit_code == 3
    assert "frames 2, 4, 6: buffer 'color' is missing" in result.output
    result = rtsr("upscale", folders, tmp_path / "out", "--scale", "2", "--system", "bicubic")
    assert result.exit_code == 3
    assert "'PreTonemapHDRColor/' lacks 2, 4, 6" in result.output


@pytest.mark.parametrize("kind", ["bare", "folders"])
def test_inspect_says_what_can_run_and_what_cannot(
    rtsr: Run, request: pytest.FixtureRequest, kind: str
) -> None:
    shot = request.getfixturevalue(kind)
    result = rtsr("inspect", shot, "--json")
    facts = next(json.loads(x) for x in result.output.splitlines() if '"layout"' in x)
    assert facts["frames"] == [1, 2, 3, 4, 5, 6]
    assert facts["commands"]["extrapolate"]["warp-guided"] == {
        "ready": True,
        "missing": [],
        "how": "",
    }
    bicubic = facts["commands"]["upscale"]["bicubic"]
    assert not bicubic["ready"] or "--on-missing skip" in bicubic["how"]
    assert any("frames 2, 4, 6" in text for text in facts["problems"])


@pytest.mark.parametrize(("without", "code"), [((), 0), ((2,), 3)])
def test_inspect_exits_as_upscale_does_where_hr_frames_lie_beside(
    rtsr: Run, sequence: Path, tmp_path: Path, without: tuple[int, ...], code: int
) -> None:
    def enlarge(planes: Planes, number: int) -> None:
        del number
        for name, plane in planes.items():
            factor = 2 if name.startswith("motion") else 1
            planes[name] = (plane * factor).astype(plane.dtype).repeat(2, 0).repeat(2, 1)

    shot = tmp_path / "shot"
    copy(sequence, shot / "lr", drop(COLOR, without))
    copy(sequence, shot / "hr", enlarge)
    result = rtsr("inspect", shot)
    assert ("buffer 'color' is missing" in result.output) == bool(without)
    assert result.exit_code == code, result.output
    run = rtsr("upscale", shot, tmp_path / "out", "--system", "bicubic")
    assert run.exit_code == code, run.output
    if without:
        assert rtsr("inspect", shot / "lr").exit_code == 0


def test_inspect_names_the_frames_that_are_rendered(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    late = copy(sequence, tmp_path / "late", drop(COLOR, (1, 3, 5)))
    result = rtsr("inspect", late)
    assert "warp-guided     ready with --rendered 2,4,6" in result.output


def test_labels_of_holes_are_those_of_frames_that_hold_radiance(
    rtsr: Run, sequence: Path, bare: Path, tmp_path: Path
) -> None:
    for shot, out in ((sequence, "full"), (bare, "bare")):
        result = rtsr("label", shot, tmp_path / out, "--kind", "holes", "--every", "2")
        assert result.exit_code == 0, result.output
    names = names_in(tmp_path / "full")
    assert names_in(tmp_path / "bare") == names
    for name in names:
        full, made = (
            read_channels(tmp_path / out / name, {"holes"})["holes"] for out in ("full", "bare")
        )
        assert np.array_equal(full, made)


def test_channels_that_are_handed_on_let_upscale_go_on(
    rtsr: Run, sequence: Path, bare: Path, tmp_path: Path
) -> None:
    """The whole sequence at LR with its G-buffer is what `upscale` takes."""
    run = ("extrapolate", bare, tmp_path / "lr", "--keep-rendered", "--passthrough", "*")
    result = rtsr(*run)
    assert result.exit_code == 0, result.output
    for path in sorted((tmp_path / "lr").glob("*.exr")):
        known, made = (
            read_channels(p, {"depth.Z", "motion.X"}) for p in (sequence / path.name, path)
        )
        assert all(np.array_equal(known[name], made[name]) for name in known)
    result = rtsr("upscale", tmp_path / "lr", tmp_path / "up", "--scale", "2")
    assert result.exit_code == 0, result.output
    header = read_header(tmp_path / "up" / "frame.0004.exr")
    assert int(header.attributes["rtsr:predicted"]) == 1
    # rendered frames at one size beside G-buffers of the steps between are a sequence, too
    for number in (2, 4, 6):
        (tmp_path / "lr" / f"frame.{number:04d}.exr").unlink()
        name = f"frame.{number:04d}.exr"
        (tmp_path / "lr" / name).write_bytes((bare / name).read_bytes())
    result = rtsr("extrapolate", tmp_path / "lr", tmp_path / "again")
    assert result.exit_code == 0, result.output
    assert names_in(tmp_path / "again") == [f"frame.{n:04d}.exr" for n in (2, 4, 6)]


def test_radiance_is_not_among_what_is_handed_on(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out", "--passthrough", "R")
    assert result.exit_code == 3
    assert "--passthrough R would replace" in result.output


def test_frames_of_two_sizes_are_refused_by_name(rtsr: Run, bare: Path, tmp_path: Path) -> None:
    def cut(planes: Planes, number: int) -> None:
        if number == 4:
            for name, plane in planes.items():
                planes[name] = plane[:40, :60]

    result = rtsr("extrapolate", copy(bare, tmp_path / "cut", cut), tmp_path / "out")
    assert result.exit_code == 3
    assert "sizes differ" in result.output
    assert "'frame' frame 4 is 60 x 40" in result.output


def test_a_run_that_was_cut_off_ends_in_the_bytes_of_a_whole_one(
    rtsr: Run, bare: Path, tmp_path: Path
) -> None:
    run = ("extrapolate", bare)
    rtsr(*run, tmp_path / "whole", "--keep-rendered")
    rtsr(*run, tmp_path / "parts", "--keep-rendered", "--frames", "1-3")
    (tmp_path / "parts" / "frame.0002.exr").write_bytes(b"")
    for part in ("2/3", "1/3", "3/3"):
        result = rtsr(*run, tmp_path / "parts", "--keep-rendered", "--shard", part)
        assert result.exit_code == 0, result.output
    names = names_in(tmp_path / "whole")
    assert names_in(tmp_path / "parts") == names
    for name in names:
        whole, made = ((tmp_path / out / name).read_bytes() for out in ("whole", "parts"))
        assert whole == made


def test_a_frame_that_cannot_be_read_fails_and_the_others_go_on(
    rtsr: Run, bare: Path, tmp_path: Path
) -> None:
    damaged = copy(bare, tmp_path / "damaged", drop((), ()))
    path = damaged / "frame.0003.exr"
    path.write_bytes(path.read_bytes()[:-4000])
    result = rtsr("extrapolate", damaged, tmp_path / "out")
    assert result.exit_code == 1
    assert "frame.0003.exr" in result.output
    assert "frame.0004.exr: no rendered frame" in result.output
    assert names_in(tmp_path / "out") == ["frame.0002.exr", "frame.0006.exr"]
