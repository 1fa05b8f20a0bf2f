"""`rtsr label --kind vrs` and `rtsr predict-vrs`."""

from __future__ import annotations

import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
import torch
from click.testing import Result

from rtsr_cli.core.choices import VrsMetric
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.network.weights import read_weights, save_weights
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.vrs.captured_rates import measure_true_errors
from rtsr_cli.core.vrs.rates import REDUCED, ShadingRate
from rtsr_cli.core.vrs.shading_error import ErrorConfig
from rtsr_cli.models import load_system

Run = Callable[..., Result]

CODES = {rate.code for rate in ShadingRate}


def exrs(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.exr"))


def rgb(path: Path, names: str = "RGB") -> torch.Tensor:
    planes = read_channels(path, names)
    return torch.stack([torch.from_numpy(planes[c].astype(np.float32)) for c in names])[None]


def random_weights(path: Path, **settings: object) -> Path:
    """Random weights of the network, with an underestimation on validation."""
    system = load_system("rt-percept")
    config = system.config(**{"mean": 0.5, **settings})
    torch.manual_seed(2)
    save_weights(
        path,
        system.build(config, 1).state_dict(),
        system=system.name,
        scale=1,
        config=to_plain(config),
        about={"validation": {"under": 0.05}},
    )
    return path


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    return random_weights(tmp_path / "weights.safetensors")


@pytest.fixture
def with_folders(small_capture: Path, tmp_path: Path) -> Path:
    """The capture, with radiance of 2x2 as a folder beside its frames: black."""
    folder = tmp_path / "captured"
    shutil.copytree(small_capture, folder)
    for path in sorted(folder.glob("*.exr")):
        planes = {name: np.zeros_like(p) for name, p in read_channels(path, "RGB").items()}
        beside = folder / "output_2x2" / path.name
        beside.parent.mkdir(exist_ok=True)
        write_exr(beside, planes)
    return folder


def test_captured_rates_may_be_folders_beside_the_frames(
    rtsr: Run, small_capture: Path, with_folders: Path, tmp_path: Path
) -> None:
    common = ("--kind", "vrs", "--metric", "jnyang")
    result = rtsr("label", with_folders, tmp_path / "a", *common)
    assert result.exit_code == 0, result.output
    assert "captured rates" in result.output
    rtsr("label", small_capture, tmp_path / "b", *common)
    assert len(exrs(tmp_path / "a")) == len(exrs(tmp_path / "b")) == 4
    names = ["error.2x2", "error.1x2"]
    [a, *_], [b, *_] = exrs(tmp_path / "a"), exrs(tmp_path / "b")
    black, emulated = read_channels(a, names), read_channels(b, names)
    assert black["error.2x2"].min() > 0.9
    assert np.array_equal(black["error.1x2"], emulated["error.1x2"])


def test_true_errors_of_chosen_rates_are_those_of_captured_ones(
    rtsr: Run, small_capture: Path, with_folders: Path, weights: Path, tmp_path: Path
) -> None:
    totals = []
    for name, folder in (("a", small_capture), ("b", with_folders)):
        common = ("predict-vrs", folder, tmp_path / name, "--weights", weights)
        result = rtsr(*common, "--threshold", "0.9")
        assert result.exit_code == 0, result.output
        text = (tmp_path / name / "summary.json").read_text(encoding="utf-8")
        totals.append(json.loads(text)["total"])
    emulated, black = totals
    assert emulated["shares"] == black["shares"]
    assert emulated["mae"] != black["mae"]


def test_a_network_learns_from_captured_rates_where_there_are_any(
    rtsr: Run, small_capture: Path, with_folders: Path, tmp_path: Path
) -> None:
    """Trained from the command line, cropped, brightened and used; black rates are other labels."""
    few = {
        "steps": 2, "batch": 2, "crop": 64, "log_every": 1, "validate_every": 2,
        "precision": '"fp32"', "augmentation.turns": "true", "augmentation.exposure_stops": 1,
        "augmentation.material_share": 1,
    }  # fmt: skip
    given = [part for key, v in few.items() for part in ("--set", f"training.{key}={v}")]
    given += ["--set", 'network.rates=["1x2", "2x1", "2x2"]', "--set", "network.mean=0.3"]
    losses = []
    for name, folder in (("a", small_capture), ("b", with_folders)):
        run = tmp_path / name
        result = rtsr("train", "rt-percept", folder, "--out", run, *given)
        assert result.exit_code == 0, result.output
        assert ("output_2x2" in result.output) is (folder == with_folders)
        losses.append((run / "log.csv").read_text(encoding="utf-8").splitlines()[1])
    assert losses[0].split(",")[:2] != losses[1].split(",")[:2]
    out = tmp_path / "out"
    used = rtsr("predict-vrs", with_folders, out, "--weights", tmp_path / "b" / "last.safetensors")
    assert used.exit_code == 0, used.output


def test_weights_to_start_from_do_not_say_how_large_other_errors_are(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    """mu of JNFLIP is several times that of FLIP: it is measured anew."""
    few = {
        "steps": 1, "batch": 1, "crop": 64, "validate_every": 1, "log_every": 1,
        "precision": '"fp32"',
    }  # fmt: skip
    given = [part for key, v in few.items() for part in ("--set", f"training.{key}={v}")]
    start = random_weights(tmp_path / "jnflip.safetensors", mean=7.0)
    common = ("train", "rt-percept", small_capture, "--out", tmp_path / "run", "--init", start)
    result = rtsr(*common, *given, "--set", "network.error.metric=flip")
    assert result.exit_code == 0, result.output
    weights = read_weights(tmp_path / "run" / "last.safetensors")
    assert 0.0 < float(weights.tensors["mean"]) < 1.0


def test_a_folder_of_captured_rates_that_lacks_a_frame_is_refused(
    rtsr: Run, with_folders: Path, tmp_path: Path
) -> None:
    exrs(with_folders / "output_2x2")[-1].unlink()
    result = rtsr("label", with_folders, tmp_path / "out", "--kind", "vrs")
    assert result.exit_code == 3
    assert "output_2x2: frame" in result.output
    assert "is missing" in result.output


def test_a_frame_without_the_channels_of_a_captured_rate_is_refused(
    rtsr: Run, small_capture: Path, tmp_path: Path, changed: Callable[..., Path]
) -> None:
    """Whether it is the first one or a later one; nothing is taken for emulated."""
    numbers: list[int] = []

    def all_but_the_first(planes: dict[str, np.ndarray], number: int) -> None:
        numbers.append(number)
        for component in "RGB" if number > min(numbers) else "":
            planes[f"output_2x2.{component}"] = np.zeros_like(planes[component])

    captured = changed(small_capture, all_but_the_first)
    label = ("label", captured, tmp_path / "out", "--kind", "vrs")
    result = rtsr(*label)
    assert result.exit_code == 3
    assert f"frame {min(numbers)}: channel output_2x2.B is missing" in result.output
    assert rtsr(*label, "--frames", f"{min(numbers) + 1}-{max(numbers)}").exit_code == 0


def test_a_folder_of_captured_rates_is_stored_as_the_frames_are(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "captured"
    shutil.copytree(small_capture, folder)
    for path in exrs(folder):
        beside = folder / "output_2x2" / path.name
        beside.parent.mkdir(exist_ok=True)
        write_exr(beside, read_channels(path, "RGB"))
    declared = [f'{{channel = "{name}", factor = 4.0}}' for name in "RGB"]
    toml = folder / "capture.toml"
    former = toml.read_text(encoding="utf-8") if toml.is_file() else ""
    toml.write_text(f"{former}\n[buffers]\ncolor = [{', '.join(declared)}]\n", encoding="utf-8")
    result = rtsr("label", folder, tmp_path / "out", "--kind", "vrs", "--metric", "flip")
    assert result.exit_code == 0, result.output
    for path in exrs(tmp_path / "out"):
        errors = read_channels(path, ["error.2x2", "error.1x2"])
        assert errors["error.2x2"].max() == 0.0
        assert errors["error.1x2"].max() > 0.0


def test_reuse_keeps_what_the_frame_before_shows(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    weights = random_weights(tmp_path / "reuse.safetensors", reuse=True, inputs="reuse")
    out = tmp_path / "out"
    common = ("predict-vrs", small_capture, out, "--weights", weights)
    result = rtsr(*common, "--reuse", "--threshold", "0.9", "--overlay")
    assert result.exit_code == 0, result.output
    first, second, *_ = exrs(out)
    # nothing lies before the first frame
    assert not read_channels(first, ["keep"])["keep"].any()
    kept = read_channels(second, ["keep", "error.reuse"])
    assert set(np.unique(kept["keep"])) <= {0.0, 1.0}
    assert kept["keep"].any()
    assert second.with_suffix(".keep.png").is_file()
    total = json.loads((out / "summary.json").read_text(encoding="utf-8"))["total"]
    assert total["invocations_saved"] == pytest.approx(total["shares"]["kept"])
    assert {"r2", "mae", "under", "true_error", "missed"} <= total.keys()


def test_weights_for_reuse_and_for_rates_are_not_confused(
    rtsr: Run, small_capture: Path, weights: Path, tmp_path: Path
) -> None:
    reuse = random_weights(tmp_path / "reuse.safetensors", reuse=True)
    common = ("predict-vrs", small_capture, tmp_path / "out")
    assert "add --reuse" in rtsr(*common, "--weights", reuse).output
    assert "leave --reuse out" in rtsr(*common, "--weights", weights, "--reuse").output
    refused = rtsr(*common, "--reuse", "--estimator", "analytic")
    assert refused.exit_code == 3
    assert "only networks predict it" in refused.output


def test_labels_are_the_true_errors_of_every_rate(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    result = rtsr("label", small_capture, out, "--kind", "vrs", "--metric", "jnyang", "--preview")
    assert result.exit_code == 0, result.output
    written = exrs(out)
    assert len(written) == len(exrs(small_capture)) == 4
    config = ErrorConfig(metric=VrsMetric.JNYANG)
    for source, path in zip(exrs(small_capture), written, strict=True):
        expected = measure_true_errors(rgb(source), config)
        planes = read_channels(path, [f"error.{rate.label}" for rate in REDUCED])
        for rate in REDUCED:
            found = planes[f"error.{rate.label}"]
            assert np.allclose(found, expected[rate][0, 0].numpy(), rtol=1e-5)
        assert path.with_suffix(".png").is_file()
    again = rtsr("label", small_capture, out, "--kind", "vrs", "--metric", "jnyang", "--preview")
    assert "0 to write, 4 done already" in again.output


def test_captured_rates_are_taken_where_they_are(
    rtsr: Run, small_capture: Path, tmp_path: Path, changed: Callable[..., Path]
) -> None:
    def with_black_rate(planes: dict[str, np.ndarray], number: int) -> None:
        del number
        for component in "RGB":
            planes[f"output_2x2.{component}"] = np.zeros_like(planes[component])

    captured = changed(small_capture, with_black_rate)
    common = ("--kind", "vrs", "--metric", "jnyang")
    result = rtsr("label", captured, tmp_path / "captured", *common)
    assert "captured rates" in result.output
    assert rtsr("label", small_capture, tmp_path / "emulated", *common).exit_code == 0
    [a, *_], [b, *_] = exrs(tmp_path / "captured"), exrs(tmp_path / "emulated")
    names = ["error.2x2", "error.1x2"]
    black, emulated = read_channels(a, names), read_channels(b, names)
    # against black, the error is the luma itself: at least that of the block, over its mean
    assert black["error.2x2"].min() > 0.9
    assert not np.allclose(black["error.2x2"], emulated["error.2x2"])
    assert np.array_equal(black["error.1x2"], emulated["error.1x2"])


@pytest.mark.parametrize("estimator", ["network", "analytic", "hybrid"])
def test_rates_are_chosen_and_accounted_for(
    rtsr: Run, small_capture: Path, tmp_path: Path, weights: Path, estimator: str
) -> None:
    out = tmp_path / "out"
    given = () if estimator == "analytic" else ("--weights", weights)
    result = rtsr("predict-vrs", small_capture, out, "--estimator", estimator, *given, "--overlay")
    assert result.exit_code == 0, result.output
    assert "shading invocations saved" in result.output
    header = read_header(exrs(small_capture)[0])
    height, width = header.data_window.height, header.data_window.width
    for path in exrs(out):
        planes = read_channels(path, ["rate", "seen", *(f"error.{rate.label}" for rate in REDUCED)])
        assert planes["rate"].shape == (-(-height // 16), -(-width // 16))
        assert set(np.unique(planes["rate"]).astype(int)) <= CODES
        assert all(np.isfinite(plane).all() for plane in planes.values())
        assert path.with_suffix(".rate.png").is_file()
        assert path.with_suffix(".overlay.png").is_file()
    found = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert found["total"]["frames"] == 4
    assert sum(found["total"]["shares"].values()) == pytest.approx(1.0)
    assert found["total"]["invocations_saved"] == pytest.approx(1.0 - found["total"]["shaded"])
    assert {"true_error", "missed"} <= found["total"].keys()
    # the analytic estimate has a unit of its own
    told = {"predicted_error"} if estimator == "network" else set()
    told |= set() if estimator == "analytic" else {"r2", "mae", "under"}
    assert {"predicted_error", "r2", "mae", "under"} & found["total"].keys() == told


@pytest.mark.parametrize("choice", ["network", "analytic", "hybrid", "reuse"])
def test_the_frame_before_is_moved_once_a_frame(
    rtsr: Run, small_capture: Path, tmp_path: Path, choice: str
) -> None:
    given: tuple[object, ...] = ("--estimator", choice)
    if choice == "reuse":
        given = ("--reuse",)
    if choice != "analytic":
        settings = {"inputs": "reuse", "reuse": True} if choice == "reuse" else {}
        given = (*given, "--weights", random_weights(tmp_path / "w.safetensors", **settings))
    moved: Counter[str] = Counter()

    def count(frame: FrameType, event: str, argument: object) -> None:
        del argument
        if event == "call" and frame.f_code is backward_warp.__code__:
            moved[Path(frame.f_back.f_code.co_filename).stem if frame.f_back else ""] += 1

    sys.setprofile(count)
    try:
        result = rtsr("predict-vrs", small_capture, tmp_path / "out", *given)
    finally:
        sys.setprofile(None)
    assert result.exit_code == 0, result.output
    # the first of the four frames has none before it
    assert moved["reprojection"] == 3


def test_a_run_that_goes_on_counts_what_was_there(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    common = ("predict-vrs", small_capture, out, "--estimator", "analytic")
    assert rtsr(*common).exit_code == 0
    whole = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    exrs(out)[1].unlink()
    result = rtsr(*common)
    assert "1 written, 3 kept" in result.output
    assert json.loads((out / "summary.json").read_text(encoding="utf-8")) == whole


def test_pictures_that_are_asked_for_later_or_were_deleted_are_made(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    out, labelled = tmp_path / "out", tmp_path / "labels"
    command = ["predict-vrs", small_capture, out, "--estimator", "analytic"]
    count = len(exrs(small_capture))
    assert rtsr(*command).exit_code == 0
    assert f"{count} written, 0 kept" in rtsr(*command, "--overlay").output
    assert f"0 written, {count} kept" in rtsr(*command, "--overlay").output
    codes = exrs(out)[1].with_suffix(".rate.png")
    codes.unlink()
    assert f"1 written, {count - 1} kept" in rtsr(*command).output
    assert codes.is_file()
    label = ["label", small_capture, labelled, "--kind", "vrs", "--metric", "psnr"]
    assert rtsr(*label).exit_code == 0
    assert f"{count} written" in rtsr(*label, "--preview").output
    assert len(list(labelled.glob("*.png"))) == count


def test_the_first_frame_is_shaded_in_full_by_what_knows_the_past_alone(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    rtsr("predict-vrs", small_capture, tmp_path, "--estimator", "analytic")
    first, second, *_ = exrs(tmp_path)
    assert not read_channels(first, ["rate"])["rate"].any()
    assert read_channels(second, ["rate"])["rate"].any()


def test_a_lower_threshold_saves_no_more(
    rtsr: Run, small_capture: Path, tmp_path: Path, weights: Path
) -> None:
    saved = []
    for threshold in ("0.05", "0.3", "0.9"):
        out = tmp_path / threshold
        common = ("predict-vrs", small_capture, out, "--weights", weights)
        result = rtsr(*common, "--threshold", threshold, "--no-compare")
        assert result.exit_code == 0, result.output
        total = json.loads((out / "summary.json").read_text(encoding="utf-8"))["total"]
        assert "true_error" not in total
        saved.append(total["invocations_saved"])
    assert saved == sorted(saved)
    assert saved[0] < saved[-1]


def test_a_margin_makes_predictions_more_careful(
    rtsr: Run, small_capture: Path, tmp_path: Path, weights: Path
) -> None:
    errors = {}
    for margin in ("0", "0.2", ""):
        out = tmp_path / f"margin{margin}"
        given = ("--margin", margin) if margin else ()
        rtsr("predict-vrs", small_capture, out, "--weights", weights, *given)
        errors[margin] = read_channels(exrs(out)[1], ["error.1x2"])["error.1x2"]
    # clamped, mu = 0.5: an error is what was predicted
    inside = errors[""] < 0.79
    assert np.allclose((errors["0.2"] - errors["0"])[inside], 0.2, atol=1e-5)
    assert np.allclose((errors[""] - errors["0"])[inside], 0.05, atol=1e-5)


def test_weights_that_are_not_there_are_asked_for(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    result = rtsr("predict-vrs", small_capture, tmp_path, "--metric", "lpips", "--tile", "2")
    assert result.exit_code == 3
    assert "no weights for --metric lpips --tile 2" in result.output
    assert "rtsr train rt-percept" in result.output


def test_weights_of_another_metric_are_refused(
    rtsr: Run, small_capture: Path, tmp_path: Path, weights: Path
) -> None:
    common = ("predict-vrs", small_capture, tmp_path / "out", "--weights", weights)
    assert rtsr(*common, "--metric", "flip").exit_code == 3
    assert rtsr(*common, "--tile", "8").exit_code == 3
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("--threshold", "-1"),
        ("--threshold", "0"),
        ("--threshold", "nan"),
        ("--threshold", "inf"),
        ("--margin", "nan"),
        ("--analytic-threshold", "nan"),
        ("--analytic-threshold", "0"),
        ("--tile", "65"),
        ("--tile", "12"),
        ("--tile", "big"),
    ],
)
def test_values_out_of_range_are_usage_errors(
    rtsr: Run, small_capture: Path, tmp_path: Path, arguments: tuple[str, str]
) -> None:
    result = rtsr("predict-vrs", small_capture, tmp_path, "--estimator", "analytic", *arguments)
    assert result.exit_code == 2


def test_a_threshold_that_no_prediction_reaches_is_refused(
    rtsr: Run, small_capture: Path, tmp_path: Path, weights: Path
) -> None:
    common = ("predict-vrs", small_capture, tmp_path / "out", "--weights", weights)
    result = rtsr(*common, "--threshold", "1")
    assert result.exit_code == 3
    assert "errors up to 1 (jnflip)" in result.output


def test_weights_say_the_default_threshold(rtsr: Run, small_capture: Path, tmp_path: Path) -> None:
    own = random_weights(tmp_path / "own.safetensors", threshold=0.4)
    common = ("predict-vrs", small_capture, tmp_path / "out", "--dry-run", "--weights")
    assert "jnflip below 0.4" in rtsr(*common, own).output
    usual = random_weights(tmp_path / "usual.safetensors")
    assert "jnflip below 0.25" in rtsr(*common, usual).output


def test_labels_by_width_are_the_published_codes(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    found = []
    for ppd in ("width", "67.0206"):
        out = tmp_path / ppd
        result = rtsr("label", small_capture, out, "--kind", "vrs", "--ppd", ppd)
        assert result.exit_code == 0, result.output
        found.append(read_channels(exrs(out)[0], ["error.2x2"])["error.2x2"])
    assert not np.allclose(*found)
    wrong = rtsr("label", small_capture, tmp_path, "--kind", "vrs", "--ppd", "wide")
    assert wrong.exit_code == 2
    assert "wide" in wrong.output


def test_missing_normals_are_one_message(
    rtsr: Run, small_capture: Path, tmp_path: Path, changed: Callable[..., Path]
) -> None:
    def without(planes: dict[str, np.ndarray], number: int) -> None:
        del number
        for component in "XYZ":
            del planes[f"normal.{component}"]

    folder = changed(small_capture, without)
    result = rtsr("predict-vrs", folder, tmp_path / "out", "--estimator", "analytic")
    assert result.exit_code == 3
    assert "cannot run, missing: " in result.output
    assert "normal" in result.output.split("missing: ")[1].split(". ")[0]


def test_a_tile_larger_than_the_frame_is_one_tile(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    one = tmp_path / "one"
    shutil.copytree(small_capture, one)
    out = tmp_path / "out"
    result = rtsr("predict-vrs", one, out, "--estimator", "analytic", "--tile", "64")
    assert result.exit_code == 0, result.output
    header = read_header(exrs(one)[0]).data_window
    rate = read_channels(exrs(out)[0], ["rate"])["rate"]
    assert rate.shape == (-(-header.height // 64), -(-header.width // 64))


def test_the_analytic_estimate_has_its_own_threshold(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    saved = []
    for threshold in ("0.02", "0.4"):
        out = tmp_path / threshold
        common = ("predict-vrs", small_capture, out, "--estimator", "analytic")
        result = rtsr(*common, "--analytic-threshold", threshold)
        assert f"analytic estimate below {threshold}" in result.output
        total = json.loads((out / "summary.json").read_text(encoding="utf-8"))["total"]
        saved.append(total["invocations_saved"])
    assert saved[0] < saved[1]
