"""`rtsr inspect`, and how measured conventions reach every other command."""

from __future__ import annotations

import json
import re
import shutil
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
Changed = Callable[[Path, Callable[[Planes, int], None]], Path]

MOTION = ("motion.X", "motion.Y")


@pytest.fixture
def changed(tmp_path: Path) -> Changed:
    """Copy frames with `change(planes, number)` applied to each, windows and cameras kept."""

    def copy(source: Path, change: Callable[[Planes, int], None]) -> Path:
        target = tmp_path / "changed"
        for path in sorted(source.glob("*.exr")):
            header = read_header(path)
            planes = {k: v.copy() for k, v in read_channels(path, header.channels).items()}
            change(planes, int(path.stem.split(".")[-1]))
            write_exr(
                target / path.name,
                planes,
                attributes=header.attributes,
                data_window=header.data_window,
                display_window=header.display_window,
            )
        return target

    return copy


def facts(rtsr: Run, *args: object) -> dict[str, Any]:
    result = rtsr("inspect", *args, "--json")
    assert result.exit_code in {0, 1, 3}, result.output
    loaded: dict[str, Any] = json.loads(result.stdout)
    return loaded


def rescaled(x: float, y: float) -> Callable[[Planes, int], None]:
    def change(planes: Planes, _: int) -> None:
        for name, factor in zip(MOTION, (x, y), strict=True):
            planes[name] = (planes[name] * np.float32(factor)).astype(np.float32)

    return change


def swapped(planes: Planes, _: int) -> None:
    planes["motion.X"], planes["motion.Y"] = planes["motion.Y"], planes["motion.X"]


def centred(planes: Planes, _: int) -> None:
    planes["motion.X"] = (planes["motion.X"] / 480 + 0.5).astype(np.float16)
    planes["motion.Y"] = (planes["motion.Y"] / 288 + 0.5).astype(np.float16)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (rescaled(1, 1), {"direction": "previous-minus-current", "y_axis": "down"}),
        (rescaled(-1, -1), {"direction": "current-minus-previous", "y_axis": "down"}),
        (rescaled(-1, 1), {"direction": "current-minus-previous", "y_axis": "up"}),
        (rescaled(1, -1), {"direction": "previous-minus-current", "y_axis": "up"}),
        (rescaled(1 / 480, 1 / 288), {"unit": "uv", "scale": 1.0}),
        (rescaled(2 / 480, -2 / 288), {"unit": "ndc", "y_axis": "up"}),
        (rescaled(0.25, 0.25), {"unit": "pixels", "scale": 4.0}),
        (swapped, {"axes": "yx"}),
        (centred, {"unit": "uv", "zero": 0.5}),
    ],
    ids=["as it is", "negated", "x", "y", "uv", "ndc y up", "a quarter", "swapped", "centred"],
)
def test_motion_is_found_whatever_it_is_stored_as(
    rtsr: Run,
    textured: Path,
    changed: Changed,
    change: Callable[[Planes, int], None],
    expected: dict[str, Any],
) -> None:
    motion = facts(rtsr, changed(textured, change))["motion"]
    winner = motion["candidates"][0]
    assert {key: winner[key] for key in expected} == expected
    # the coarse steps of centred half vectors may leave it tied
    if change is not centred:
        assert {key: motion["best"][key] for key in expected} == expected
        assert motion["best"]["margin"] == motion["margin"] > 0.02
        assert not motion["best"]["tied"]
        assert not motion["best"]["jittered"]


def test_the_sample_is_understood_and_ready(rtsr: Run, sample_root: Path) -> None:
    found = facts(rtsr, sample_root)
    assert found["layout"] == "rtsr"
    assert found["frames"] == [1, 2, 3, 4, 5, 6]
    assert found["missing"] == {}
    assert found["size"] == [120, 72]
    assert found["hr"]["size"] == [480, 288]
    assert found["depth"]["kind"] == "planar"
    assert found["depth"]["measured"]
    assert found["normal"] == {
        "space": "world",
        "packed": False,
        "measured": True,
        "facing": found["normal"]["facing"],
    }
    assert found["nonfinite"] == {}
    assert found["problems"] == []
    assert found["systems"]["taau"] == {"ready": True, "missing": [], "how": ""}


def test_the_report_says_what_is_read_and_how(rtsr: Run, sample_root: Path) -> None:
    result = rtsr("inspect", sample_root)
    assert result.exit_code == 0
    for text in ("layout", "1-6 (6), none missing", "120 x 72", "previous-minus-current", "ready"):
        assert text in result.output


def test_a_wrong_declaration_is_named_with_its_margin_and_obeyed(
    rtsr: Run, sample_root: Path, tmp_path: Path
) -> None:
    wrong = sample_root / "wrong-sign.toml"
    inspected = rtsr("inspect", sample_root, "--capture", wrong)
    assert inspected.exit_code == 0
    # commands run, and say the same
    assert "  warning     motion is declared as" in inspected.output
    assert "PROBLEM" not in inspected.output
    assert "current-minus-previous" in inspected.output
    assert "lower" in inspected.output
    run = rtsr("upscale", sample_root, tmp_path / "out", "--capture", wrong, "--frames", "1-2")
    assert run.exit_code == 0
    warnings = [line for line in run.stderr.splitlines() if line.startswith("Warning")]
    assert len(warnings) == 1
    assert "obeyed" in warnings[0]


def test_a_right_declaration_is_not_warned_about(
    rtsr: Run, sample_root: Path, tmp_path: Path
) -> None:
    run = rtsr("upscale", sample_root, tmp_path / "out", "--frames", 1)
    assert run.exit_code == 0
    assert "Warning" not in run.output


def test_measured_motion_gives_the_bytes_that_declared_motion_gives(
    rtsr: Run, textured: Path, changed: Changed, tmp_path: Path
) -> None:
    negated = changed(textured, rescaled(-1, -1))
    options = ("--simulate-lr", 4, "--system", "taau")
    measured = rtsr("upscale", negated, tmp_path / "measured", *options)
    assert measured.exit_code == 0
    assert "motion measured: current-minus-previous" in measured.output
    plain = rtsr("upscale", textured, tmp_path / "plain", *options)
    assert plain.exit_code == 0
    for path in sorted((tmp_path / "plain").glob("*.exr")):
        expected = read_channels(path, "RGB")
        found = read_channels(tmp_path / "measured" / path.name, "RGB")
        assert all(np.array_equal(expected[c], found[c]) for c in "RGB")


def test_shards_of_measured_motion_demand_a_capture_and_inspect_writes_it(
    rtsr: Run, textured: Path, changed: Changed, tmp_path: Path
) -> None:
    negated = changed(textured, rescaled(-1, -1))
    run = ("upscale", negated, tmp_path / "out", "--simulate-lr", 4, "--shard", "1/2")
    refused = rtsr(*run)
    assert refused.exit_code == 3
    assert "inspect --write" in refused.output
    assert not (tmp_path / "out").exists()
    written = rtsr("inspect", negated, "--write")
    assert written.exit_code == 0
    text = (negated / "capture.toml").read_text()
    assert 'direction = "current-minus-previous"' in text
    assert 'layout = "rtsr"' in text
    again = rtsr(*run)
    assert again.exit_code == 0, again.output
    assert "Warning" not in again.output


def test_inspect_never_replaces_a_capture_unasked(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "shot"
    folder.mkdir()
    for name in ("lr", "hr", "capture.toml"):
        (folder / name).symlink_to(small_shot / name)
    before = (small_shot / "capture.toml").read_bytes()
    result = rtsr("inspect", folder, "--write")
    assert result.exit_code == 3
    assert "--overwrite" in result.output
    assert (small_shot / "capture.toml").read_bytes() == before


def test_what_write_puts_down_keeps_what_was_declared(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "shot"
    folder.mkdir()
    for name in ("lr", "hr"):
        (folder / name).symlink_to(small_shot / name)
    declared = "scale = 4\njitter_px = {1 = [0.125, 0.1], 2 = [0.125, 0.1], 3 = [0.1, 0.1], "
    declared += "4 = [0.125, 0.1]}\ncamera_cuts = [3]\n"
    (folder / "capture.toml").write_text(declared)
    assert rtsr("inspect", folder, "--write", "--overwrite").exit_code == 0
    text = (folder / "capture.toml").read_text()
    assert "scale = 4" in text
    assert "camera_cuts = [3]" in text
    assert rtsr("upscale", folder, tmp_path / "out", "--frames", 1).exit_code == 0


def renamed(source: Path, target: Path, names: dict[str, str]) -> Path:
    """Copy frames with other channel names and no camera."""
    for path in sorted(source.glob("*.exr")):
        planes = read_channels(path, read_header(path).channels)
        write_exr(target / path.name, {names.get(k, k): v for k, v in planes.items()})
    return target


OTHER_NAMES = {
    **{c: f"hdr.{c}" for c in "RGB"},
    **{f"albedo.{c}": f"base_col.{c}" for c in "RGB"},
    **{f"normal.{c}": f"nrm.{c}" for c in "XYZ"},
    "depth.Z": "viewz.V",
    "motion.X": "flow.U",
    "motion.Y": "flow.V",
    "roughness": "rgh",
    "metallic": "mtl",
    "objectid": "inst",
    **{f"emission.{c}": f"emis.{c}" for c in "RGB"},
}


def test_unknown_channels_are_listed_with_guesses_and_exit_3(
    rtsr: Run, textured: Path, tmp_path: Path
) -> None:
    dump = renamed(textured, tmp_path / "dump", OTHER_NAMES)
    result = rtsr("inspect", dump)
    assert result.exit_code == 3
    assert "base_col.R" in result.output
    assert 'motion = ["flow.U", "flow.V"]' in result.output
    assert 'albedo = ["base_col.R", "base_col.G", "base_col.B"]' in result.output


def test_a_capture_started_by_write_and_completed_by_hand_works(
    rtsr: Run, textured: Path, tmp_path: Path
) -> None:
    dump = renamed(textured, tmp_path / "dump", OTHER_NAMES)
    assert rtsr("inspect", dump, "--write").exit_code == 3
    path = dump / "capture.toml"
    path.write_text(re.sub(r"^# (\w+ = )", r"\1", path.read_text(), flags=re.MULTILINE))
    found = facts(rtsr, dump)
    assert {"color", "albedo", "motion", "normal"} <= set(found["buffers"])
    assert found["motion"]["best"]["direction"] == "previous-minus-current"
    run = rtsr("upscale", dump, tmp_path / "out", "--simulate-lr", 4, "--system", "taau")
    assert run.exit_code == 0, run.output


@pytest.fixture
def undecided(textured: Path, tmp_path: Path) -> Path:
    """A dump of other names, whose vectors are all zero, so that nothing tells what they mean."""
    dump = renamed(textured, tmp_path / "dump", OTHER_NAMES)
    for path in sorted(dump.glob("*.exr")):
        planes = dict(read_channels(path, read_header(path).channels))
        planes["flow.U"] = np.zeros_like(planes["flow.U"])
        planes["flow.V"] = np.zeros_like(planes["flow.V"])
        write_exr(path, planes)
    (dump / "capture.toml").write_text(
        '[buffers]\ncolor = "hdr.RGB"\nalbedo = "base_col.RGB"\nmotion = "flow.UV"\n'
        'normal = "nrm.XYZ"\ndepth = "viewz.V"\nroughness = "rgh"\nmetallic = "mtl"\n'
    )
    return dump


def test_motion_that_nothing_decides_is_refused_with_the_choices_until_one_is_pasted(
    rtsr: Run, undecided: Path, tmp_path: Path
) -> None:
    run = ("upscale", undecided, tmp_path / "out", "--simulate-lr", 4, "--system", "taau")
    refused = rtsr(*run)
    assert refused.exit_code == 3
    assert "system 'taau' reads motion" in refused.stderr
    (line,) = (line.strip() for line in refused.stderr.splitlines() if line.startswith("    "))
    assert not (tmp_path / "out").exists()
    capture = undecided / "capture.toml"
    capture.write_text(f"{line}\n{capture.read_text()}")
    assert rtsr(*run).exit_code == 0


@pytest.mark.parametrize(
    "command",
    [
        ("upscale", "--simulate-lr", 4, "--system", "bicubic"),
        ("upscale", "--simulate-lr", 4),
        ("demodulate", "--mode", "albedo"),
    ],
    ids=["bicubic", "default", "demodulate"],
)
def test_what_reads_no_motion_runs_whatever_it_may_mean(
    rtsr: Run, undecided: Path, tmp_path: Path, command: tuple[str, ...]
) -> None:
    name, *options = command
    result = rtsr(name, undecided, tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    assert result.output.count("motion is not read") == 1
    assert result.stderr == ""


def test_readiness_knows_which_system_reads_motion(rtsr: Run, undecided: Path) -> None:
    found = facts(rtsr, undecided)
    assert found["systems"]["bicubic"]["ready"]
    assert not found["systems"]["taau"]["ready"]
    assert "a declared motion convention" in found["systems"]["taau"]["missing"]
    assert found["motion"]["undecided"] in found["problems"]


@pytest.fixture
def captures(textured: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(textured, tmp_path / "captures"))


def spoil(path: Path) -> None:
    header = read_header(path)
    planes = {k: v.copy() for k, v in read_channels(path, header.channels).items()}
    planes["R"][2, 6], planes["B"][2, 2] = np.nan, np.inf
    write_exr(
        path,
        planes,
        attributes=header.attributes,
        data_window=header.data_window,
        display_window=header.display_window,
    )


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 400] = bytes(400)
    path.write_bytes(content)


def as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("number", "harm", "code", "said", "ready"),
    [
        (2, spoil, 1, "2 values of 'color' are NaN or Inf in frame 2", "--simulate-lr S"),
        (2, damage, 1, "its pixels are damaged", "--simulate-lr S"),
        (3, Path.unlink, 3, "lacks frame 3", "--simulate-lr S --on-missing skip"),
        (3, lambda p: p.write_text("text"), 3, "it is another kind of file", None),
        (4, lambda p: p.write_bytes(p.read_bytes()[:9999]), 3, "the file ends too early", None),
        (4, as_folder, 3, "is a folder that is named like a frame", None),
        (4, lambda p: p.write_text(""), 3, "the file is empty", None),
    ],
    ids=["nan", "damaged", "gap", "text", "cut", "folder", "empty"],
)
def test_what_commands_would_do_is_the_exit_code_and_the_readiness(
    rtsr: Run,
    captures: Path,
    tmp_path: Path,
    number: int,
    harm: Callable[[Path], object],
    code: int,
    said: str,
    ready: str | None,
) -> None:
    (path,) = (p for p in captures.iterdir() if f"{number:04d}" in p.name)
    harm(path)
    result = rtsr("inspect", captures, "--json")
    assert result.exit_code == code
    found = json.loads(result.stdout)
    assert said in "\n".join(found["problems"])
    assert found["frames"][:2] == [1, 2]
    system = found["systems"]["demod-bicubic"]
    assert (system["how"] if system["ready"] else None) == ready
    text = rtsr("inspect", captures)
    assert text.exit_code == code
    assert said in text.stdout
    run = ("upscale", captures, tmp_path / "out", "--simulate-lr", 4)
    assert rtsr(*run).exit_code == code
    if ready:
        assert rtsr(*run[:3], *ready.replace("S", "4", 1).split()).exit_code == code % 3


def test_hr_frames_that_do_not_match_are_a_problem(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    shot = Path(shutil.copytree(small_shot, tmp_path / "shot"))
    (shot / "hr" / "frame.0004.exr").unlink()
    found = facts(rtsr, shot)
    assert found["systems"]["bicubic"]["how"] == "--on-missing skip"
    # beside that the crop's camera is of the whole frame
    assert any("HR lacks frame 4" in problem for problem in found["hr"]["problems"])
    shutil.rmtree(shot / "hr")
    shutil.copytree(shot / "lr", shot / "hr")
    (shot / "hr" / "frame.0001.exr").unlink()
    for path in sorted((shot / "hr").iterdir()):
        planes = read_channels(path, read_header(path).channels)
        write_exr(path, {k: np.repeat(v, 2, axis=0) for k, v in planes.items()})
    result = rtsr("inspect", shot, "--json")
    assert result.exit_code == 3
    found = json.loads(result.stdout)
    assert found["systems"]["bicubic"] == {
        "ready": False,
        "missing": ["HR frames that match"],
        "how": "",
    }


@pytest.mark.parametrize("name", ["nosuch", "empty"])
def test_a_folder_without_frames_is_an_object_with_its_problem(
    rtsr: Run, tmp_path: Path, name: str
) -> None:
    (tmp_path / "empty").mkdir()
    result = rtsr("inspect", tmp_path / name, "--json")
    assert result.exit_code == 3
    found = json.loads(result.stdout)
    assert found["problems"] == [result.stderr.removeprefix("Error: ").rstrip("\n")]
    assert not found["systems"]["bicubic"]["ready"]


def test_a_declared_channel_that_is_not_there_is_a_problem_with_the_nearest_name(
    rtsr: Run, captures: Path
) -> None:
    (captures / "capture.toml").write_text('[buffers]\nalbedo = "albdo.RGB"\n')
    result = rtsr("inspect", captures)
    assert result.exit_code == 3
    (problem,) = (line for line in result.stdout.splitlines() if "PROBLEM" in line)
    assert "buffer 'albedo': no channel is called 'albdo.R', did you mean 'albedo.R'?" in problem
    assert "missing: the declared channels" in result.stdout


def test_a_capture_that_is_no_toml_leaves_the_report_whole(rtsr: Run, captures: Path) -> None:
    (captures / "capture.toml").write_text("[buffers\n")
    result = rtsr("inspect", captures, "--json")
    assert result.exit_code == 3
    found = json.loads(result.stdout)
    assert len(found["problems"]) == 1
    assert "is not valid TOML" in found["problems"][0]


def test_the_number_that_rules_readings_out_is_in_the_report(rtsr: Run, textured: Path) -> None:
    assert re.search(r"\d% lower, \d+\.\d\d standard errors", rtsr("inspect", textured).stdout)


def test_a_capture_that_is_replaced_is_kept(rtsr: Run, captures: Path) -> None:
    before = "# mine\nscale = 4\n"
    (captures / "capture.toml").write_text(before)
    result = rtsr("inspect", captures, "--write", "--overwrite")
    assert result.exit_code == 0
    assert "capture.toml: written; the former one is kept as capture.toml.bak" in result.stdout
    assert (captures / "capture.toml.bak").read_text() == before
    assert "# mine" not in (captures / "capture.toml").read_text()


def test_a_capture_in_the_way_does_not_keep_the_report_back(rtsr: Run, captures: Path) -> None:
    (captures / "capture.toml").write_text("scale = 4\n")
    result = rtsr("inspect", captures, "--write", "--json")
    assert result.exit_code == 3
    assert "--overwrite" in json.loads(result.stdout)["problems"][-1]


def test_motion_that_is_all_zero_is_said(rtsr: Run, textured: Path, changed: Changed) -> None:
    found = facts(rtsr, changed(textured, rescaled(0, 0)))
    assert any("motion is zero in every pixel" in problem for problem in found["problems"])
    assert found["motion"]["best"] is None


def test_coarse_steps_of_centred_half_vectors_are_said(
    rtsr: Run, sample_root: Path, tmp_path: Path
) -> None:
    dump = tmp_path / "dump"
    for path in sorted((sample_root / "hr").glob("*.exr"))[:4]:
        planes = dict(read_channels(path, read_header(path).channels))
        planes |= read_channels(sample_root / "reference" / path.name, "RGB")
        height, width = planes["R"].shape
        # 0.5 + v / 2 with v across the whole screen: half a step is a quarter of a pixel
        planes["motion.X"] = (planes["motion.X"] / (2 * width) + 0.5).astype(np.float16)
        planes["motion.Y"] = (planes["motion.Y"] / (2 * height) + 0.5).astype(np.float16)
        write_exr(dump / path.name, planes, attributes=read_header(path).attributes)
    found = facts(rtsr, dump)
    assert found["motion"]["best"]["zero"] == 0.5
    assert found["motion"]["best"]["scale"] == 2.0
    assert any("sub-pixel motion is lost" in problem for problem in found["problems"])


def test_a_tree_of_shots_is_reported_by_relative_path(
    rtsr: Run, textured: Path, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).symlink_to(textured)
    shots = facts(rtsr, tmp_path)["shots"]
    assert set(shots) == {"a", "b"}
    assert shots["a"]["layout"] == "rtsr"


def test_vectors_to_the_next_frame_are_forward_vectors(
    rtsr: Run, data_root: Path, tmp_path: Path
) -> None:
    dump = tmp_path / "dump"
    for path in sorted((data_root / "dumps" / "multilayer").glob("*.exr")):
        planes = read_channels(path, read_header(path).channels)
        plain = {k.removeprefix("ViewLayer."): v for k, v in planes.items()}
        kept = {c: plain[f"Combined.{c}"] for c in "RGB"}
        kept |= {f"albedo.{c}": plain[f"albedo.{c}"] for c in "RGB"}
        kept |= {"motion.X": plain["Vector.Z"], "motion.Y": plain["Vector.W"]}
        write_exr(dump / path.name, kept)
    found = facts(rtsr, dump)
    best = found["motion"]["best"] or {"direction": found["motion"]["ties"][0].split(",")[0]}
    assert best["direction"] == "current-minus-next"
    if found["motion"]["best"]:
        assert found["motion"]["best"]["y_axis"] == "up"
    assert "lr motion" in found["systems"]["taau"]["missing"]


def test_the_folder_dump_is_read_by_measurement_not_by_its_names(
    rtsr: Run, data_root: Path, tmp_path: Path
) -> None:
    standard = tmp_path / "standard"
    for path in sorted((data_root / "dumps" / "standard").glob("*.exr")):
        header = read_header(path)
        kept = [c for c in header.channels if not c.startswith("emission")]
        write_exr(standard / path.name, read_channels(path, kept), attributes=header.attributes)
    outputs = {}
    for name, folder in (("folders", data_root / "dumps" / "folders"), ("standard", standard)):
        out = tmp_path / f"out_{name}"
        result = rtsr("upscale", folder, out, "--simulate-lr", 2, "--system", "demod-bicubic")
        assert result.exit_code == 0, result.output
        outputs[name] = {
            int(p.stem.split(".")[-1]): read_channels(p, "RGB") for p in sorted(out.glob("*.exr"))
        }
    assert set(outputs["folders"]) == {5, 6, 7, 8}
    for number, planes in outputs["standard"].items():
        capture = read_channels(standard / f"frame.{number:04d}.exr", "RGB")
        for channel, plane in planes.items():
            expected = plane.astype(np.float32)
            error = np.abs(outputs["folders"][number][channel].astype(np.float32) - expected)
            largest = np.maximum(largest_around(capture[channel][1::2, 1::2]), expected)
            assert (error <= ROUNDINGS * 2.0**-11 * largest + 2.0**-24).all()


ROUNDINGS = 8
"""Relative steps of half precision by which the dumps' outputs may lie apart: 7 were measured. One
dump stores the view cosine as half, the other leaves it to be derived; where the negative lobes of
the kernel cancel, the rounding of a bright neighbour stands beside a dark pixel."""


def largest_around(lr: NDArray[Any]) -> NDArray[np.float32]:
    """Largest of the 5 x 5 samples that hold an output pixel's 4 x 4, at twice the size."""
    padded = np.pad(lr.astype(np.float32), 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (5, 5))
    largest: NDArray[np.float32] = windows.max((-2, -1)).repeat(2, 0).repeat(2, 1)
    return largest


def test_zero_motion_under_a_moving_camera_is_warned_about_by_every_command(
    rtsr: Run, textured: Path, changed: Changed, tmp_path: Path
) -> None:
    still = changed(textured, rescaled(0, 0))
    run = rtsr("upscale", still, tmp_path / "out", "--simulate-lr", 4, "--system", "bicubic")
    assert run.exit_code == 0
    assert "motion pass is missing" in run.stderr


def test_names_that_tell_nothing_leave_a_skeleton_to_start_from(
    rtsr: Run, textured: Path, tmp_path: Path
) -> None:
    dump = renamed(textured, tmp_path / "dump", {c: f"qq.{c}" for c in "RGB"})
    for path in sorted(dump.glob("*.exr")):
        planes = read_channels(path, read_header(path).channels)
        write_exr(path, {f"zz{i}.K": plane for i, plane in enumerate(planes.values())})
    assert rtsr("inspect", dump, "--write").exit_code == 3
    text = (dump / "capture.toml").read_text()
    for part in ("color (3)", "motion (2)", "zz0.K", '["mv:R", "mv:G"]'):
        assert part in text


def test_a_truncated_hr_frame_is_no_hole_that_could_be_skipped(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    shutil.copytree(small_shot, shot)
    cut = shot / "hr" / "frame.0002.exr"
    cut.write_bytes(cut.read_bytes()[:2000])
    said = rtsr("inspect", shot)
    assert said.exit_code == 3
    assert f"{cut}: cannot be read" in " ".join(said.output.split())
    assert "--on-missing skip" not in said.output
    # what is not there is named beside it, and the file that is there not as missing
    beside = shot / "hr" / "frame.0003.exr"
    kept = beside.read_bytes()
    beside.unlink()
    said = " ".join(rtsr("inspect", shot).output.split())
    assert f"{cut}: cannot be read" in said
    assert "HR lacks frame 3 that LR has" in said
    refused = " ".join(rtsr("upscale", shot, tmp_path / "out").output.split())
    for text in (f"{cut}: cannot be read", "'frame' lacks 3"):
        assert text in refused
    beside.write_bytes(kept)
    (shot / "lr" / "frame.0002.exr").unlink()
    refused = " ".join(rtsr("upscale", shot, tmp_path / "out").output.split())
    for text in (f"{cut}: cannot be read", "'frame' lacks 2"):
        assert text in refused
    shutil.copy(small_shot / "lr" / "frame.0002.exr", shot / "lr")
    cut.unlink()
    assert "--on-missing skip" in rtsr("inspect", shot).output


def test_ids_that_are_all_0_are_said(rtsr: Run, small_capture: Path, changed: Changed) -> None:
    def unnumber(planes: Planes, _: int) -> None:
        planes["objectid"][:] = 0

    said = "0 in every pixel: no object was given a number"
    assert said in rtsr("inspect", changed(small_capture, unnumber)).output
    assert said not in rtsr("inspect", small_capture).output
