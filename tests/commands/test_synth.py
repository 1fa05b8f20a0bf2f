"""`rtsr synth`: files, declarations, resuming, and what other commands make of them."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

from rtsr_cli.core.files.exr import read_channels, read_header

SMALL = ("--size", "96x64")
CHANNELS = {
    *"RGB",
    *(f"albedo.{c}" for c in "RGB"),
    *(f"emission.{c}" for c in "RGB"),
    *(f"{n}.{c}" for n in ("normal", "geonormal") for c in "XYZ"),
    *(f"{n}.{c}" for n in ("motion", "forward") for c in "XY"),
    "depth.Z",
    "metallic",
    "roughness",
    "objectid",
}


@pytest.fixture(scope="session")
def pair(tmp_path_factory):
    """A pair of three frames at 4x with jitter."""
    from click.testing import CliRunner

    from rtsr_cli.cli import group

    out = tmp_path_factory.mktemp("synth") / "pair"
    arguments = ["synth", str(out), "--size", "192x128", "--frames", "1-3", "--seed", "1"]
    result = CliRunner().invoke(group, [*arguments, "--scale", "4", "--jitter", "halton"])
    assert result.exit_code == 0, result.output
    return out


def test_frames_hold_every_buffer_and_the_camera(rtsr, tmp_path):
    result = rtsr("synth", tmp_path / "out", *SMALL, "--frames", "3")
    assert result.exit_code == 0, result.output
    path = tmp_path / "out" / "frame.0003.exr"
    header = read_header(path)
    assert header.channels == CHANNELS
    assert header.attributes["frame"] == 3
    assert header.attributes["horizontalFov"] > 0
    matrices = [header.attributes[name] for name in ("worldToCamera", "worldToNDC")]
    assert all(m.shape == (4, 4) and m.dtype == np.float32 for m in matrices)
    types = {name: plane.dtype for name, plane in read_channels(path, header.channels).items()}
    assert types["objectid"] == np.uint32
    for name in ("depth.Z", "motion.X", "forward.Y"):
        assert types[name] == np.float32
    for name in ("R", "albedo.G", "normal.X", "geonormal.Z", "metallic", "roughness"):
        assert types[name] == np.float16


def test_a_pair_upscales_without_further_options(rtsr, pair, tmp_path):
    result = rtsr("upscale", pair, tmp_path / "up")
    assert result.exit_code == 0, result.output
    assert len(list((tmp_path / "up").glob("*.exr"))) == 3


def test_a_pair_has_no_radiance_at_high_resolution_and_nothing_else_in_its_reference(pair):
    header = {r: read_header(pair / r / "frame.0002.exr") for r in ("lr", "hr", "reference")}
    assert header["lr"].channels == CHANNELS
    assert header["hr"].channels == CHANNELS - set("RGB")
    assert header["reference"].channels == set("RGB")
    sizes = {role: (h.data_window.width, h.data_window.height) for role, h in header.items()}
    assert sizes == {"lr": (48, 32), "hr": (192, 128), "reference": (192, 128)}


def test_declared_jitter_is_where_the_samples_of_a_pair_lie(pair):
    from rtsr_cli.core.captures.capture_file import read_capture
    from rtsr_cli.core.frames.buffers import Buffer
    from rtsr_cli.core.synth.exposure import draw_scene
    from rtsr_cli.core.synth.render import render_frame

    capture = read_capture(pair / "capture.toml")
    assert capture.scale == 4
    scene = draw_scene(1)
    for number in (1, 2, 3):
        stored = read_channels(pair / "lr" / f"frame.{number:04d}.exr", ["depth.Z"])["depth.Z"]
        jitter = capture.jitter(number)
        assert jitter != (0.0, 0.0)
        for offset, same in ((jitter, True), ((-jitter[0], -jitter[1]), False)):
            frame = render_frame(scene, number, (32, 48), jitter_px=offset)
            depth = frame.gbuffer[Buffer.DEPTH][0, 0].numpy()
            assert np.allclose(stored, depth, rtol=1e-5) == same


def test_samples_make_a_capture_that_upscale_simulates_from(rtsr, tmp_path):
    shot = tmp_path / "shot"
    result = rtsr("synth", shot, *SMALL, "--frames", "1-2", "--samples", "2", "--static-camera")
    assert result.exit_code == 0, result.output
    assert read_header(shot / "frame.0001.exr").data_window.width == 192
    result = rtsr(
        "upscale", shot, tmp_path / "up", "--simulate-lr", "2", "--samples-per-pixel", "2"
    )
    assert result.exit_code == 0, result.output
    assert read_header(tmp_path / "up" / "frame.0001.exr").data_window.width == 96


def test_finished_files_are_kept_and_the_rest_is_added(rtsr, tmp_path, files_of):
    out = tmp_path / "out"
    assert rtsr("synth", out, *SMALL, "--frames", "1-2").exit_code == 0
    first = files_of(out)
    result = rtsr("synth", out, *SMALL, "--frames", "1-3", "--json")
    assert result.exit_code == 0, result.output
    done = json.loads(result.output.splitlines()[-1])
    assert (done["written"], done["kept"]) == (1, 2)
    again = files_of(out)
    assert {name: again[name] for name in first} == first
    assert rtsr("synth", tmp_path / "whole", *SMALL, "--frames", "3").exit_code == 0
    alone = (tmp_path / "whole" / "frame.0003.exr").read_bytes()
    assert again["frame.0003.exr"] == alone


@pytest.mark.parametrize("change", [("--seed", "9"), ("--jitter", "halton")])
def test_other_settings_do_not_replace_what_is_there(rtsr, tmp_path, files_of, change):
    out = tmp_path / "out"
    assert rtsr("synth", out, *SMALL, "--frames", "1").exit_code == 0
    before = files_of(out)
    result = rtsr("synth", out, *SMALL, "--frames", "1", *change)
    assert result.exit_code == 3
    assert "--overwrite" in result.output
    assert files_of(out) == before
    assert rtsr("synth", out, *SMALL, "--frames", "1", *change, "--overwrite").exit_code == 0
    assert files_of(out) != before


def test_a_foreign_capture_toml_is_not_replaced(rtsr, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "capture.toml").write_text("scale = 2\n")
    result = rtsr("synth", out, *SMALL, "--frames", "1")
    assert result.exit_code == 3
    assert "capture.toml" in result.output
    assert (out / "capture.toml").read_text() == "scale = 2\n"


def test_shots_are_seeds_in_folders_of_their_own(rtsr, tmp_path):
    out = tmp_path / "out"
    arguments = ("--size", "32x24", "--frames", "1", "--seed", "5")
    assert rtsr("synth", out, *arguments, "--shots", "2").exit_code == 0
    assert rtsr("synth", tmp_path / "six", "--size", "32x24", "--frames", "1", "--seed", "6")
    listed = sorted(p.relative_to(out).as_posix() for p in out.rglob("*.exr"))
    assert listed == ["0000/frame.0001.exr", "0001/frame.0001.exr"]
    single = (tmp_path / "six" / "frame.0001.exr").read_bytes()
    assert (out / "0001" / "frame.0001.exr").read_bytes() == single


def test_the_declaration_says_how_motion_is_stored(rtsr, tmp_path):
    assert rtsr("synth", tmp_path, "--size", "32x24", "--frames", "1").exit_code == 0
    declared = tomllib.loads((tmp_path / "capture.toml").read_text())
    assert declared["layout"] == "rtsr"
    assert declared["motion"] == {
        "unit": "pixels",
        "direction": "previous-minus-current",
        "y_axis": "down",
        "jittered": False,
    }


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("--size", "100"), 2, "write 1920x1080"),
        (("--size", "100x64", "--scale", "3"), 3, "cannot be divided by --scale 3"),
        (("--layout", "blendr"), 2, "no layout is called 'blendr'"),
        (("--layout", "nss"), 2, "keeps two resolutions apart; give --scale"),
        (("--layout", "nsrd"), 2, "keeps two resolutions apart; give --scale"),
        (("--samples", "2", "--jitter", "halton"), 2, "leave --jitter out"),
    ],
)
def test_options_that_make_no_sense_are_refused(rtsr, tmp_path, arguments, code, message):
    result = rtsr("synth", tmp_path / "out", *arguments)
    assert result.exit_code == code
    assert message in result.output
    assert not (tmp_path / "out").exists()
