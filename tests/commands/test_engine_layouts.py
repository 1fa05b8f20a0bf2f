"""Frames as engines write them, without a declaration: what is understood, and every system run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from rtsr_cli.cli import group
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of, measure_set, open_shot
from tests.commands.letter_true import WRITERS, read_made, write_engine_shot, write_nss_shot

Run = Callable[..., Result]
LAYOUT_OF = {
    "mitsuba": "mitsuba",
    "mitsuba-positions": "mitsuba",
    "falcor": "falcor",
    "mrq-layers": "unreal-mrq",
    "mrq-files": "unreal-mrq",
    "mrq-folders": "unreal-mrq",
    "extranet": "extranet",
}
NEEDS_CAMERA = {"mitsuba": {Buffer.DEPTH}}
"""Buffers that nothing brings to memory without matrices."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pair of a made scene: 256 x 160 and a quarter of it."""
    out = tmp_path_factory.mktemp("made") / "shot"
    arguments = ["synth", out, "--size", "256x160", "--scale", 4, "--frames", "1-4", "--seed", 5]
    assert CliRunner().invoke(group, [str(a) for a in arguments]).exit_code == 0
    return out


def open_hr(root: Path) -> FrameReader:
    (shot,) = find_shots_of(root, ReadOptions())
    assert shot.hr is not None
    return measure_set(shot.hr, open_shot(shot, root, ReadOptions()), jittered=False).reader


@pytest.mark.parametrize("engine", WRITERS)
def test_frames_of_an_engine_are_the_made_ones(engine: str, made: Path, tmp_path: Path) -> None:
    write_engine_shot(engine, made, tmp_path)
    reader = open_hr(tmp_path)
    assert reader.layout.name == LAYOUT_OF[engine]
    assert reader.layout.verified
    names = {
        Buffer.ALBEDO: [f"albedo.{c}" for c in "RGB"],
        Buffer.NORMAL: [f"normal.{c}" for c in "XYZ"],
        Buffer.DEPTH: ["depth.Z"],
        Buffer.METALLIC: ["metallic"],
        Buffer.ROUGHNESS: ["roughness"],
        Buffer.MOTION: ["motion.X", "motion.Y"],
        Buffer.OBJECT_ID: ["objectid"],
    }
    number, truth, _ = next(read_made(made / "hr"))
    held = (set(names) & reader.readable) - NEEDS_CAMERA.get(engine, set())
    assert len(held) >= (2 if engine in NEEDS_CAMERA else 3 if "mitsuba" in engine else 4)
    frame = reader.read(number, held)
    # half files hold no more centimetres
    surface = truth["depth.Z"] < 600.0
    for buffer in held:
        expected = np.stack([truth[name] for name in names[buffer]])
        if buffer is Buffer.ALBEDO and engine == "falcor":
            expected = expected * (1.0 - truth["metallic"])
        found = frame.gbuffer[buffer][0].numpy()
        apart = np.abs(found - expected)[:, surface]
        assert apart.max() <= 2e-3 * max(1.0, np.abs(expected[:, surface]).max()), buffer


@pytest.mark.parametrize("engine", ["mitsuba", "falcor", "mrq-layers", "extranet"])
def test_every_untrained_system_that_can_runs_or_says_what_is_missing(
    rtsr: Run, engine: str, made: Path, tmp_path: Path
) -> None:
    write_engine_shot(engine, made, tmp_path / "in")
    facts = json.loads(rtsr("inspect", tmp_path / "in", "--json").stdout)
    systems = facts["systems"]
    assert systems["bicubic"]["ready"]
    assert systems["taau"]["ready"] is (engine != "mitsuba")
    for system in ("bicubic", "taau", "demod-guided"):
        result = rtsr("upscale", tmp_path / "in", tmp_path / system, "--system", system)
        if systems[system]["ready"]:
            assert result.exit_code == 0, result.output
            judged = rtsr("evaluate", tmp_path / system, "--ref", made, "--metric", "psnr")
            assert judged.exit_code == 0, judged.output
        else:
            assert result.exit_code == 3
            assert "missing: lr m" in result.output or "missing: lr camera" in result.output


def test_ray_distances_with_positions_need_no_camera(rtsr: Run, made: Path, tmp_path: Path) -> None:
    shot = tmp_path / "in"
    write_engine_shot("mitsuba-positions", made, shot)
    (shot / "capture.toml").write_text('[buffers]\nmaterial = "albedo.RGB"\n')
    facts = json.loads(rtsr("inspect", shot, "--json").stdout)["systems"]
    assert facts["demod-guided"]["ready"]
    assert facts["fusesr-fast"]["ready"]
    assert "made planar by the world positions" in rtsr("inspect", shot).stdout
    for system in ("bicubic", "demod-guided"):
        result = rtsr("upscale", shot, tmp_path / system, "--system", system)
        assert result.exit_code == 0, result.output
    tests = (tmp_path / "bicubic", tmp_path / "demod-guided")
    scores = tmp_path / "scores.json"
    judged = rtsr("evaluate", *tests, "--ref", made, "--metric", "psnr", "--output", scores)
    assert judged.exit_code == 0, judged.output
    found = json.loads(scores.read_text())["tests"]
    plain, guided = (found[path.name]["mean"]["psnr"] for path in tests)
    assert guided > plain


@pytest.mark.parametrize(("subtracts", "motion"), [(1, "motion"), (-1, "motion_m1")])
def test_arms_captures_with_lr_motion_alone_run_whichever_way_they_subtract(
    rtsr: Run, made: Path, tmp_path: Path, subtracts: int, motion: str
) -> None:
    write_nss_shot(made, tmp_path / "in", subtracts=subtracts, motion=motion)
    options = ReadOptions()
    (shot,) = find_shots_of(tmp_path / "in", options)
    reader = measure_set(shot.frames, open_shot(shot, tmp_path / "in", options), jittered=True)
    vectors = reader.reader.read(2, (Buffer.MOTION,)).gbuffer[Buffer.MOTION][0].numpy()
    truth = {number: planes for number, planes, _ in read_made(made / "lr")}[2]
    expected = np.stack([truth["motion.X"], truth["motion.Y"]])
    assert np.abs(vectors - expected).max() < 0.01
    for system in ("bicubic", "taau"):
        done = rtsr("upscale", tmp_path / "in", tmp_path / system, "--system", system)
        assert done.exit_code == 0, done.output


def test_arms_captures_run_from_inspection_to_figures(
    rtsr: Run, made: Path, tmp_path: Path
) -> None:
    """No HR buffers but radiance, a cut, and vectors that nothing decides where they are few."""
    shot = tmp_path / "in"
    write_nss_shot(made, shot, subtracts=1, cuts=(3,))
    (found,) = find_shots_of(shot, ReadOptions())
    reader = measure_set(found.frames, open_shot(found, shot, ReadOptions()), jittered=True).reader
    assert reader.resets == {3}
    systems = json.loads(rtsr("inspect", shot, "--json").stdout)["systems"]
    ready = [name for name, facts in systems.items() if facts["ready"]]
    assert {"bicubic"} <= set(ready) <= {"bicubic", "taau"}
    for words in ((), *(("--system", name) for name in ready)):
        out = tmp_path / "-".join(("out", *words))
        done = rtsr("upscale", shot, out, *words)
        assert done.exit_code == 0, done.output
        judged = rtsr("evaluate", out, "--ref", shot, "--metric", "psnr")
        assert judged.exit_code == 0, judged.output
        assert "PSNR" in judged.output


@pytest.mark.parametrize("motion", ["motion", "motion_m1"])
def test_vectors_that_skip_a_frame_are_named_and_not_read(
    rtsr: Run, made: Path, tmp_path: Path, motion: str
) -> None:
    write_nss_shot(made, tmp_path / "in", subtracts=1, motion=motion)
    text = " ".join(rtsr("inspect", tmp_path / "in").output.split())
    assert f"motion {motion}/: R G" in text
    assert "not used motion_m2/: G R" in text
    assert "'motion_m2' is not read: its vectors lead two frames back" in text


def test_planes_of_a_clip_are_those_of_its_frames(made: Path, tmp_path: Path) -> None:
    write_nss_shot(made, tmp_path, subtracts=1)
    path = tmp_path / "0000.json"
    content = json.loads(path.read_text())
    for frame in content["Frames"]:
        content["NearPlane"] = frame.pop("CameraNearPlane")
        content["FarPlane"] = frame.pop("CameraFarPlane")
    path.write_text(json.dumps(content))
    (shot,) = find_shots_of(tmp_path, ReadOptions())
    opened = open_shot(shot, tmp_path, ReadOptions())
    depth = measure_set(shot.frames, opened, jittered=True).reader.read(1, (Buffer.DEPTH,))
    truth = next(read_made(made / "lr"))[1]["depth.Z"]
    surface = truth < SKY_DEPTH_M
    found = depth.gbuffer[Buffer.DEPTH][0, 0].numpy()
    assert np.allclose(found[surface], truth[surface], rtol=1e-3)


def test_lr_motion_serves_where_hr_frames_have_none(rtsr: Run, made: Path, tmp_path: Path) -> None:
    shot = tmp_path / "in"
    shutil.copytree(made, shot)
    for number, planes, attributes in read_made(made / "hr"):
        path = shot / "hr" / f"frame.{number:04d}.exr"
        path.unlink()
        kept = {n: p for n, p in planes.items() if not n.startswith(("motion", "forward"))}
        cameras = {n: attributes[n] for n in ("worldToCamera", "worldToNDC")}
        write_exr(path, kept, attributes=cameras)
    assert rtsr("upscale", shot, tmp_path / "out", "--system", "taau").exit_code == 0
    output = tmp_path / "scores.json"
    told = ("--ref", shot, "--metric", "psnr", "--output", output)
    result = rtsr("evaluate", tmp_path / "out", *told)
    assert result.exit_code == 0, result.output
    assert "motion is that of" in result.output
    (test,) = json.loads(output.read_text())["tests"].values()
    assert "disoccluded" in json.dumps(test["frames"])


def test_undecided_vectors_stop_only_what_reads_them(rtsr: Run, made: Path, tmp_path: Path) -> None:
    shot = tmp_path / "in"
    shutil.copytree(made, shot)
    for path in shot.rglob("*.exr"):
        if ".0001." not in path.name:
            path.unlink()
    # vectors that the user names, and of whose sense one frame tells nothing
    declared = 'layout = "rtsr"\nscale = 4\n[buffers]\nmotion = "motion.XY"\n'
    (shot / "capture.toml").write_text(declared)
    for system in ("bicubic", "demod-bicubic", "demod-guided"):
        out = tmp_path / system
        done = rtsr("upscale", shot, out, "--system", system)
        assert done.exit_code == 0, done.output
        assert rtsr("evaluate", out, "--ref", shot, "--metric", "psnr").exit_code == 0
    assert rtsr("demodulate", shot, tmp_path / "divided").exit_code == 0
    refused = rtsr("upscale", shot, tmp_path / "taau", "--system", "taau")
    assert refused.exit_code == 3
    assert "reads motion, but" in refused.output


def test_of_a_layout_that_nothing_proves_radiance_is_read(rtsr: Run, tmp_path: Path) -> None:
    shot = tmp_path / "in"
    size = ("--size", "64x48", "--frames", "1-2", "--seed", 5, "--layout", "unity")
    assert rtsr("synth", shot, *size).exit_code == 0
    (shot / "capture.toml").unlink()
    for path in shot.rglob("*MotionVectors*.exr"):
        path.unlink()
    done = rtsr("upscale", shot, tmp_path / "out", "--system", "bicubic", "--scale", 2)
    assert done.exit_code == 0, done.output
    assert "nothing but radiance is read" in done.output
    refused = rtsr("upscale", shot, tmp_path / "t", "--system", "taau", "--scale", 2)
    assert refused.exit_code == 3
    assert "--layout unity" in refused.output
    facts = json.loads(rtsr("inspect", shot, "--json").stdout)
    assert facts["systems"]["bicubic"]["ready"]
    assert facts["systems"]["taau"]["missing"] == ["a named layout"]


def test_positions_that_do_not_lie_at_the_distances_are_said_once_and_before(
    rtsr: Run, made: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "in"
    write_engine_shot("mitsuba-positions", made, shot)
    declared = '[buffers]\nmaterial = "albedo.RGB"\n[position]\nunit = "cm"\n'
    (shot / "capture.toml").write_text(declared)
    planned = rtsr("upscale", shot, tmp_path / "out", "--system", "demod-guided", "--dry-run")
    assert planned.exit_code == 3
    assert planned.output.count("do not lie at these distances") == 1
    done = rtsr("upscale", shot, tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "Failed" not in done.output
