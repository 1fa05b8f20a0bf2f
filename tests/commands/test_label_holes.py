"""`rtsr label --kind holes` as a user runs it."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Planes = dict[str, NDArray[Any]]

HOLES = ("--kind", "holes")


def load(path: Path) -> Planes:
    return read_channels(path, read_header(path).channels)


def change(source: Path, target: Path, edit: Callable[[Planes, int], None]) -> Path:
    """Copy frames with other pixels."""
    for path in sorted(source.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        edit(planes, int(path.stem.split(".")[-1]))
        write_exr(target / path.name, planes, attributes=header.attributes)
    return target


def names_in(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.suffix == ".exr")


@pytest.fixture(scope="module")
def sequence(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames of one size."""
    shot = tmp_path_factory.mktemp("sequence") / "shot"
    shutil.copytree(sample_root / "lr", shot)
    return shot


@pytest.fixture(scope="module")
def labelled(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labels of every frame, with pictures."""
    out = tmp_path_factory.mktemp("labels") / "out"
    result = CliRunner().invoke(group, ["label", str(sequence), str(out), *HOLES, "--preview"])
    assert result.exit_code == 0, result.output
    assert "holes by stencil, normal, position;" in result.output
    assert "past1: holes " in result.output
    return out


def test_each_test_of_each_past_frame_is_a_channel(labelled: Path, sequence: Path) -> None:
    assert names_in(labelled) == names_in(sequence)
    planes = load(labelled / "frame.0006.exr")
    parts = ("stencil", "normal", "position", "outside", "holes")
    assert set(planes) == {"holes", *(f"past{i}.{part}" for i in (1, 2, 3) for part in parts)}
    for i in (1, 2, 3):
        tests = [planes[f"past{i}.{part}"] for part in parts[:4]]
        assert np.array_equal(np.maximum.reduce(tests), planes[f"past{i}.holes"])
        # outside of a frame it shows nothing, so that nothing is disoccluded
        assert not any((mask * tests[3]).any() for mask in tests[:3])
    assert np.array_equal(planes["holes"], planes["past1.holes"])
    assert set(np.unique(planes["holes"])) == {0.0, 1.0}


def test_what_has_no_past_frame_is_a_hole_as_a_whole(labelled: Path) -> None:
    first, third = (load(labelled / f"frame.000{n}.exr") for n in (1, 3))
    assert all(first[f"past{i}.holes"].min() == 1.0 for i in (1, 2, 3))
    assert first["past1.outside"].max() == 0.0
    assert third["past1.holes"].min() == 0.0
    assert third["past2.holes"].min() == 1.0


def test_shares_are_in_the_header_and_of_all_frames_in_the_summary(labelled: Path) -> None:
    path = labelled / "frame.0006.exr"
    shares = json.loads(read_header(path).attributes["rtsr:holes"])
    assert [shares[f"past{i}"]["step"] for i in (1, 2, 3)] == [1, 3, 5]
    mean = float(load(path)["past2.stencil"].astype(np.float64).mean())
    assert shares["past2"]["stencil"] == pytest.approx(mean, abs=1e-5)
    summary = json.loads((labelled / "summary.json").read_text(encoding="utf-8"))
    assert summary["shots"]["."]["frames"]["6"] == shares
    assert summary["total"]["frames"] == 6
    assert summary["total"]["past1"]["frames"] == 5
    each = [f["past1"]["holes"] for f in summary["shots"]["."]["frames"].values()]
    assert summary["total"]["past1"]["holes"] == pytest.approx(np.mean(each[1:]), abs=1e-6)


def test_pictures_show_the_past_frames_side_by_side(labelled: Path) -> None:
    height, width = load(labelled / "frame.0006.exr")["holes"].shape
    size = struct.unpack(">II", (labelled / "frame.0006.png").read_bytes()[16:24])
    assert size == (3 * width, height)


def test_frames_that_are_not_rendered_are_held_against_those_that_are(
    rtsr: Run, sequence: Path, tmp_path: Path
) -> None:
    result = rtsr("label", sequence, tmp_path / "two", *HOLES, "--every", "2")
    assert result.exit_code == 0, result.output
    assert "3 rendered, holes by" in result.output
    assert names_in(tmp_path / "two") == [f"frame.{n:04d}.exr" for n in (2, 4, 6)]
    result = rtsr("label", sequence, tmp_path / "some", *HOLES, "--rendered", "1,2,4")
    assert result.exit_code == 0, result.output
    steps = {}
    for n in (3, 5, 6):
        attributes = read_header(tmp_path / "some" / f"frame.{n:04d}.exr").attributes
        steps[n] = [past["step"] for past in json.loads(attributes["rtsr:holes"]).values()]
    assert steps == {3: [1, 2, None], 5: [1, 3, 4], 6: [2, 4, 5]}


def test_radiance_is_never_read(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    def drop(planes: Planes, number: int) -> None:
        del number
        for channel in "RGB":
            planes.pop(channel)

    dark = change(sequence, tmp_path / "dark", drop)
    one = ("--frames", "6")
    assert rtsr("label", dark, tmp_path / "a", *HOLES, *one).exit_code == 0
    assert rtsr("label", sequence, tmp_path / "b", *HOLES, *one).exit_code == 0
    a, b = (load(tmp_path / name / "frame.0006.exr") for name in "ab")
    assert all(np.array_equal(a[name], b[name]) for name in b)


def test_a_second_run_keeps_what_is_there_and_parts_make_the_whole(
    rtsr: Run, sequence: Path, labelled: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    for part in ("1/2", "2/2"):
        result = rtsr("label", sequence, out, *HOLES, "--preview", "--shard", part)
        assert result.exit_code == 0, result.output
    (out / "frame.0004.exr").unlink()
    assert "1 written, 5 kept" in rtsr("label", sequence, out, *HOLES, "--preview").output
    for name in [*names_in(labelled), "summary.json"]:
        assert (out / name).read_bytes() == (labelled / name).read_bytes()
    # other holes are other labels
    assert rtsr("label", sequence, out, *HOLES, "--paper").exit_code == 3


def test_events_end_with_the_figures(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    result = rtsr("label", sequence, tmp_path / "out", *HOLES, "--frames", "2", "--json")
    last = json.loads(result.output.splitlines()[-1])
    assert last["event"] == "figures"
    assert 0.0 < last["total"]["past1"]["holes"] < 1.0


@pytest.mark.parametrize(
    ("dropped", "told"),
    [
        ("objectid", "no object ids: the depth along motion stands in"),
        ("normal", "no normals: the depth along motion stands in"),
    ],
)
def test_what_stands_in_for_a_missing_buffer_is_said(
    rtsr: Run, sequence: Path, tmp_path: Path, dropped: str, told: str
) -> None:
    def drop(planes: Planes, number: int) -> None:
        del number
        for channel in [name for name in planes if name.partition(".")[0] == dropped]:
            planes.pop(channel)

    fewer = change(sequence, tmp_path / "fewer", drop)
    result = rtsr("label", fewer, tmp_path / "out", *HOLES, "--frames", "6")
    assert result.exit_code == 0, result.output
    assert told in result.output
    assert "past1.depth" in load(tmp_path / "out" / "frame.0006.exr")


def test_without_a_camera_depth_and_normals_tell(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    for path in sorted(sequence.glob("*.exr")):
        write_exr(tmp_path / "in" / path.name, load(path), attributes={})
    result = rtsr("label", tmp_path / "in", tmp_path / "out", *HOLES, "--frames", "6")
    assert result.exit_code == 0, result.output
    assert "holes by stencil, normal, depth (no camera: the depth" in result.output


@pytest.mark.parametrize("channel", ["motion", "depth"])
def test_without_motion_or_depth_nothing_is_labelled(
    rtsr: Run, sequence: Path, tmp_path: Path, channel: str
) -> None:
    def drop(planes: Planes, number: int) -> None:
        del number
        for name in [name for name in planes if name.partition(".")[0] == channel]:
            planes.pop(name)

    fewer = change(sequence, tmp_path / "fewer", drop)
    result = rtsr("label", fewer, tmp_path / "out", *HOLES)
    assert result.exit_code == 3
    assert "label --kind holes cannot run, missing:" in result.output
    assert channel in result.output


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ((*HOLES, "--metric", "flip"), 2, "--metric is of --kind vrs, not of --kind holes"),
        (("--every", "2"), 2, "--every is of --kind holes, not of --kind vrs"),
        ((*HOLES, "--every", "1"), 2, "none left to predict"),
        ((*HOLES, "--every", "2", "--rendered", "1"), 2, "--every and --rendered"),
        ((*HOLES, "--rendered", "1-6"), 3, "none is left to predict"),
    ],
)
def test_what_does_not_go_together_is_refused(
    rtsr: Run, sequence: Path, tmp_path: Path, options: tuple[str, ...], code: int, said: str
) -> None:
    result = rtsr("label", sequence, tmp_path / "out", *options)
    assert result.exit_code == code, result.output
    assert said in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()


def test_a_foreign_summary_is_not_replaced(rtsr: Run, sequence: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "summary.json").write_text("{}")
    result = rtsr("label", sequence, out, *HOLES)
    assert result.exit_code == 3
    assert "summary.json" in result.output
    assert (out / "summary.json").read_text() == "{}"
