"""`rtsr upscale` as a user runs it: outputs, names, resume, refusals."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.models import PREFERENCE, load_system

Run = Callable[..., Result]
Load = Callable[[Path], NDArray[np.float32]]
Files = Callable[[Path], dict[str, bytes]]
Changed = Callable[[Path, Callable[[dict[str, Any], int], None]], Path]


BEST = next(name for name in PREFERENCE if has_weights(load_system(name), 4))
"""What 4x frames with every buffer are upscaled with by default."""


def tonemapped_psnr(test: NDArray[np.float32], reference: NDArray[np.float32]) -> float:
    difference = test / (1 + test) - reference / (1 + reference)
    return float(-10 * np.log10(np.mean(difference.astype(np.float64) ** 2)))


def test_a_shot_becomes_frames_of_the_same_names_at_the_target_size(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out")
    assert result.exit_code == 0, result.output
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == [f"frame.{n:04d}.exr" for n in range(1, 5)]
    header = read_header(tmp_path / "out" / "frame.0001.exr")
    assert header.channels == {"R", "G", "B"}
    assert (header.data_window.width, header.data_window.height) == (192, 128)
    assert f"system {BEST} (the best that these inputs allow)" in result.output


def test_outputs_say_where_they_come_from_and_keep_the_inputs_attributes(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    rtsr("upscale", small_shot, tmp_path / "out")
    attributes = read_header(tmp_path / "out" / "frame.0002.exr").attributes
    assert attributes["rtsr:system"] == BEST
    assert attributes["rtsr:sourceFrame"] == "frame.0002.exr"
    assert attributes["scene"] == "court"
    assert len(attributes["rtsr:stamp"]) == 32
    assert not any(str(tmp_path) in str(value) for value in attributes.values())


def test_multiplying_by_hr_material_beats_colour_alone(
    rtsr: Run, small_shot: Path, tmp_path: Path, load_rgb: Load
) -> None:
    for system in ("bicubic", "demod-bicubic"):
        assert rtsr("upscale", small_shot, tmp_path / system, "--system", system).exit_code == 0
    reference = load_rgb(small_shot / "reference" / "frame.0003.exr")
    plain, demodulated = (
        tonemapped_psnr(load_rgb(tmp_path / s / "frame.0003.exr"), reference)
        for s in ("bicubic", "demod-bicubic")
    )
    assert demodulated > plain + 1.0


@pytest.mark.parametrize("system", ["bicubic", "demod-bicubic", "taau"])
def test_lr_made_from_a_capture_equals_lr_frames_on_disk(
    rtsr: Run, small_shot: Path, small_capture: Path, tmp_path: Path, load_rgb: Load, system: str
) -> None:
    choice = ("--system", system)
    assert rtsr("upscale", small_shot, tmp_path / "a", *choice).exit_code == 0
    simulated = rtsr("upscale", small_capture, tmp_path / "b", "--simulate-lr", 4, *choice)
    assert simulated.exit_code == 0, simulated.output
    name = "frame.0003.exr"
    np.testing.assert_array_equal(load_rgb(tmp_path / "a" / name), load_rgb(tmp_path / "b" / name))


@pytest.mark.parametrize("system", ["bicubic", "demod-bicubic", "taau"])
def test_radiance_that_decimation_drops_changes_nothing(
    rtsr: Run, small_capture: Path, tmp_path: Path, changed: Changed, load_rgb: Load, system: str
) -> None:
    random = np.random.default_rng(1)

    def noise(planes: dict[str, Any], number: int) -> None:
        del number
        for channel in "RGB":
            kept = planes[channel][2::4, 2::4].copy()
            planes[channel] = random.uniform(0, 90, planes[channel].shape).astype(np.float16)
            planes[channel][2::4, 2::4] = kept

    noisy = changed(small_capture, noise)
    for source, out in ((small_capture, "clean"), (noisy, "noisy")):
        run = rtsr("upscale", source, tmp_path / out, "--simulate-lr", 4, "--system", system)
        assert run.exit_code == 0, run.output
    for number in range(1, 5):
        name = f"frame.{number:04d}.exr"
        np.testing.assert_array_equal(
            load_rgb(tmp_path / "clean" / name), load_rgb(tmp_path / "noisy" / name)
        )


def test_hr_radiance_is_not_needed_and_not_looked_at(
    rtsr: Run, small_shot: Path, small_capture: Path, tmp_path: Path, load_rgb: Load
) -> None:
    """`small_capture` holds radiance beside the G-buffer, `small_shot/hr` does not."""
    lr, capture_toml = small_shot / "lr", small_shot / "capture.toml"
    for hr, out in ((small_shot / "hr", "without"), (small_capture, "with")):
        run = rtsr("upscale", lr, tmp_path / out, "--hr", hr, "--capture", capture_toml)
        assert run.exit_code == 0, run.output
    name = "frame.0001.exr"
    np.testing.assert_array_equal(
        load_rgb(tmp_path / "with" / name), load_rgb(tmp_path / "without" / name)
    )


@pytest.mark.parametrize("system", ["bicubic", "demod-bicubic", "taau"])
def test_one_job_and_two_jobs_write_the_same_bytes(
    rtsr: Run, small_shot: Path, tmp_path: Path, files_of: Files, system: str
) -> None:
    for jobs in (1, 2):
        out = tmp_path / str(jobs)
        assert rtsr("upscale", small_shot, out, "--jobs", jobs, "--system", system).exit_code == 0
    assert files_of(tmp_path / "1") == files_of(tmp_path / "2")


@pytest.mark.parametrize("system", ["demod-bicubic", "taau"])
def test_a_second_run_writes_only_what_is_missing_and_the_same_bytes(
    rtsr: Run, small_shot: Path, tmp_path: Path, files_of: Files, system: str
) -> None:
    out = tmp_path / "out"
    rtsr("upscale", small_shot, out, "--system", system)
    before = files_of(out)
    (out / "frame.0003.exr").unlink()
    kept = (out / "frame.0001.exr").stat().st_mtime_ns
    result = rtsr("upscale", small_shot, out, "--system", system)
    assert "1 written, 3 kept, 0 failed" in result.output
    assert (out / "frame.0001.exr").stat().st_mtime_ns == kept
    assert files_of(out) == before


def test_outputs_of_other_settings_are_refused_unless_overwritten(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    rtsr("upscale", small_shot, out, "--system", "bicubic")
    refused = rtsr("upscale", small_shot, out)
    assert refused.exit_code == 3
    assert "frame.0001.exr and 3 more" in refused.output
    assert "--overwrite" in refused.output
    assert rtsr("upscale", small_shot, out, "--overwrite").exit_code == 0


def test_a_changed_input_makes_its_output_stale(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    shot, out = tmp_path / "shot", tmp_path / "out"
    shutil.copytree(small_shot, shot)
    # without history, so that one frame alone is stale
    alone = ("upscale", shot, out, "--system", "fusesr-fast")
    rtsr(*alone)
    # of both sizes: LR of one moment beside HR of another would be refused for that
    for size in ("lr", "hr"):
        shutil.copy(shot / size / "frame.0001.exr", shot / size / "frame.0002.exr")
    refused = rtsr(*alone)
    assert refused.exit_code == 3
    assert "frame.0002.exr: rtsr upscale did not write this" in refused.output


def test_frames_and_shards_select_outputs_that_equal_the_whole_run(
    rtsr: Run, small_shot: Path, tmp_path: Path, files_of: Files
) -> None:
    rtsr("upscale", small_shot, tmp_path / "whole")
    for index in (1, 2):
        rtsr("upscale", small_shot, tmp_path / "parts", "--shard", f"{index}/2")
    rtsr("upscale", small_shot, tmp_path / "some", "--frames", "2-4x2")
    whole = files_of(tmp_path / "whole")
    assert files_of(tmp_path / "parts") == whole
    assert sorted(files_of(tmp_path / "some")) == ["frame.0002.exr", "frame.0004.exr"]
    assert files_of(tmp_path / "some")["frame.0004.exr"] == whole["frame.0004.exr"]


def test_selected_frames_of_taau_still_have_their_history(
    rtsr: Run, small_shot: Path, tmp_path: Path, files_of: Files
) -> None:
    rtsr("upscale", small_shot, tmp_path / "whole", "--system", "taau")
    rtsr("upscale", small_shot, tmp_path / "last", "--system", "taau", "--frames", 4)
    name = "frame.0004.exr"
    assert files_of(tmp_path / "last") == {name: files_of(tmp_path / "whole")[name]}


def test_a_tree_of_shots_is_mirrored(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    tree = tmp_path / "in"
    shutil.copytree(small_shot, tree / "a" / "one")
    shutil.copytree(small_shot / "lr", tree / "b é")
    (tree / "b é" / "capture.toml").write_text("scale = 2\n", encoding="utf-8")
    result = rtsr("upscale", tree, tmp_path / "out")
    assert result.exit_code == 0, result.output
    written = {p.relative_to(tmp_path / "out").as_posix() for p in tmp_path.rglob("out/**/*.exr")}
    assert written == {
        f"{shot}/frame.{n:04d}.exr" for shot in ("a/one", "b é") for n in range(1, 5)
    }


def test_dry_run_checks_and_writes_nothing(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out", "--dry-run")
    assert result.exit_code == 0
    assert "4 to write" in result.output
    assert not (tmp_path / "out").exists()


def test_json_gives_one_event_a_line(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out", "--json", "--frames", "1-2")
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [e["event"] for e in events] == ["plan", "frame", "frame", "done"]
    assert events[0]["size"] == [192, 128]
    assert events[-1]["written"] == 2


def test_previews_and_debug_buffers_lie_beside_the_frames(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    result = rtsr("upscale", small_shot, out, "--preview", "--debug-buffers", "--frames", 1)
    assert result.exit_code == 0, result.output
    assert (out / "frame.0001.png").read_bytes().startswith(b"\x89PNG")
    assert "lighting.R" in read_header(out / "debug" / "frame.0001.exr").channels


def test_alpha_is_enlarged_and_written(
    rtsr: Run, small_shot: Path, tmp_path: Path, changed: Changed
) -> None:
    def add_alpha(planes: dict[str, Any], number: int) -> None:
        planes["A"] = np.full(planes["R"].shape, number / 8, np.float16)

    lr = changed(small_shot / "lr", add_alpha)
    result = rtsr("upscale", lr, tmp_path / "out", "--scale", 2, "--frames", 2)
    assert result.exit_code == 0, result.output
    alpha = read_channels(tmp_path / "out" / "frame.0002.exr", "A")["A"]
    np.testing.assert_allclose(alpha.astype(np.float32), 0.25, atol=1e-3)


def test_windows_survive_at_the_target_size(rtsr: Run, small_shot: Path, tmp_path: Path) -> None:
    path = small_shot / "lr" / "frame.0001.exr"
    inside = PixelWindow(left=4, top=2, width=48, height=32)
    plane = PixelWindow(left=0, top=0, width=60, height=40)
    planes = read_channels(path, "RGB")
    write_exr(tmp_path / "in" / "f.0001.exr", planes, data_window=inside, display_window=plane)
    assert rtsr("upscale", tmp_path / "in", tmp_path / "out", "--scale", 2).exit_code == 0
    header = read_header(tmp_path / "out" / "f.0001.exr")
    assert header.data_window == PixelWindow(left=8, top=4, width=96, height=64)
    assert header.display_window == PixelWindow(left=0, top=0, width=120, height=80)


def test_a_camera_side_car_replaces_the_headers_camera(
    rtsr: Run, small_capture: Path, tmp_path: Path, load_rgb: Load
) -> None:
    stripped = tmp_path / "stripped"
    rows = []
    for path in sorted(small_capture.glob("*.exr")):
        header = read_header(path)
        write_exr(stripped / path.name, read_channels(path, header.channels))
        matrices = {
            key: " ".join(repr(float(v)) for v in header.attributes[key].flatten())
            for key in ("worldToCamera", "worldToNDC")
        }
        number = int(path.stem.split(".")[-1])
        rows.append(f'{number},"{matrices["worldToCamera"]}","{matrices["worldToNDC"]}"')
    refused = rtsr("upscale", stripped, tmp_path / "no", "--simulate-lr", 4,
                   "--system", "demod-bicubic")  # fmt: skip
    assert refused.exit_code == 3
    assert "camera" in refused.output
    table = "\n".join(["frame,worldToCamera,worldToNDC", *rows])
    (stripped / "camera.csv").write_text(table, encoding="utf-8")
    (stripped / "capture.toml").write_text('camera = "camera.csv"\n', encoding="utf-8")
    for source, out in ((small_capture, "header"), (stripped, "csv")):
        run = rtsr("upscale", source, tmp_path / out, "--simulate-lr", 4,
                   "--system", "demod-bicubic")  # fmt: skip
        assert run.exit_code == 0, run.output
    for number in range(1, 5):
        header_rgb, csv_rgb = (
            load_rgb(tmp_path / out / f"frame.{number:04d}.exr") for out in ("header", "csv")
        )
        np.testing.assert_allclose(csv_rgb, header_rgb, rtol=2**-10, atol=1e-6)


def test_simulated_options_without_simulation_are_a_usage_error(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out", "--lr-filter", "box")
    assert result.exit_code == 2
    assert "--lr-filter needs --simulate-lr" in result.output


@pytest.mark.parametrize("choice", ["box", "blackman-harris"])
def test_filtered_lr_has_less_contrast_than_point_samples(
    rtsr: Run, small_capture: Path, tmp_path: Path, load_rgb: Load, choice: str
) -> None:
    spread = {}
    for name in ("none", choice):
        out = tmp_path / name
        run = rtsr("upscale", small_capture, out, "--simulate-lr", 4, "--system", "bicubic",
                   "--lr-filter", name, "--frames", 1)  # fmt: skip
        assert run.exit_code == 0, run.output
        spread[name] = np.abs(np.diff(load_rgb(out / "frame.0001.exr"), axis=-1)).mean()
    assert spread[choice] < 0.9 * spread["none"]


def test_verbose_names_channels_and_quiet_says_nothing(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    verbose = rtsr("upscale", small_shot, tmp_path / "a", "-v", "--frames", 1)
    assert "motion = frame: motion.X, frame: motion.Y" in verbose.output
    assert rtsr("upscale", small_shot, tmp_path / "b", "-q", "--frames", 1).output == ""


def test_frames_with_other_channel_names_are_upscaled_by_a_layout_file(
    rtsr: Run, small_capture: Path, changed: Callable[..., Path], tmp_path: Path, load_rgb: Any
) -> None:
    renamed = changed(
        small_capture,
        lambda planes, _: planes.update({f"mine.{c}": planes.pop(c) for c in "RGB"}),
    )
    layout = tmp_path / "my.toml"
    layout.write_text('[buffers]\ncolor = "mine.RGB"')
    options = ("--simulate-lr", 4, "--system", "bicubic")
    assert rtsr("upscale", small_capture, tmp_path / "a", *options).exit_code == 0
    result = rtsr("upscale", renamed, tmp_path / "b", *options, "--layout", layout)
    assert result.exit_code == 0, result.output
    for path in sorted((tmp_path / "a").iterdir()):
        assert np.array_equal(load_rgb(path), load_rgb(tmp_path / "b" / path.name))
