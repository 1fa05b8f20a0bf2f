"""`rtsr export`, and `--runtime onnx` with what it wrote."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import Result

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.files.exr import read_channels
from rtsr_cli.core.network.exported import load_exported_network
from rtsr_cli.core.network.load import load_network
from rtsr_cli.core.network.manifest import read_manifest
from rtsr_cli.core.network.weights import SHIPPED, read_weights
from rtsr_cli.models import list_system_names, load_system

Run = Callable[..., Result]

VARIANT = "rt-percept-jnflip-16"
"""One of several weights of a system, called by its name."""

LEAST_DB = 60.0
"""Least PSNR of frames after c / (1 + c) by either runtime."""


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of an exported system, made when it is first asked for."""
    for library in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(library, reason="the extra export is not installed")
    from rtsr_cli.api import ExportRequest, export

    folders: dict[str, Path] = {}

    def make(name: str) -> Path:
        if name not in folders:
            folders[name] = tmp_path_factory.mktemp(name)
            list(export(ExportRequest(source=name, out_folder=folders[name])))
        return folders[name]

    return make


def read_image(path: Path) -> np.ndarray:
    planes = read_channels(path, "RGB")
    color = np.stack([planes[c].astype(np.float64) for c in "RGB"])
    return color / (1.0 + color)


def test_frames_by_onnxruntime_are_those_by_torch(
    rtsr: Run, exported: Callable[[str], Path], sample_root: Path, tmp_path: Path
) -> None:
    """A recurrent system, fed with the state that it makes itself."""
    model = exported("nsrd-4x")
    given = ("--system", "nsrd", "--frames", "1-2")
    chosen = ("--runtime", "onnx", "--model", model, "--frames", "1-2")
    by_torch = rtsr("upscale", sample_root, tmp_path / "torch", *given, "--precision", "fp32")
    by_onnx = rtsr("upscale", sample_root, tmp_path / "onnx", *chosen)
    assert (by_torch.exit_code, by_onnx.exit_code) == (0, 0), by_onnx.output
    assert "system nsrd;" in by_onnx.output
    frames = sorted((tmp_path / "torch").glob("*.exr"))
    assert len(frames) == 2
    for path in frames:
        error = np.mean((read_image(path) - read_image(tmp_path / "onnx" / path.name)) ** 2)
        assert -10.0 * np.log10(max(error, 1e-30)) >= LEAST_DB
    again = rtsr("upscale", sample_root, tmp_path / "onnx", *chosen)
    assert "0 written, 2 kept" in again.output


def test_rates_by_onnxruntime_are_those_by_torch(
    rtsr: Run, exported: Callable[[str], Path], sample_root: Path, tmp_path: Path
) -> None:
    model, given = exported(VARIANT), ("--frames", "1-2", "--no-compare")
    by_torch = rtsr("predict-vrs", sample_root, tmp_path / "torch", *given)
    by_onnx = rtsr(
        "predict-vrs", sample_root, tmp_path / "onnx", *given, "--runtime", "onnx",
        "--model", model,
    )  # fmt: skip
    assert (by_torch.exit_code, by_onnx.exit_code) == (0, 0), by_onnx.output
    for path in (tmp_path / "torch").rglob("*.exr"):
        a, b = (
            read_channels(p, ("error.1x2", "rate"))
            for p in (path, tmp_path / "onnx" / path.relative_to(tmp_path / "torch"))
        )
        np.testing.assert_allclose(a["error.1x2"], b["error.1x2"], atol=1e-3)
        np.testing.assert_array_equal(a["rate"], b["rate"])


def test_a_frame_between_by_onnxruntime_is_that_by_torch(
    rtsr: Run, exported: Callable[[str], Path], sample_root: Path, tmp_path: Path
) -> None:
    """72 rows are nine cells of eight, 120 columns are fifteen."""
    model, given = exported("extranet"), ("--frames", "4")
    by_torch = rtsr(
        "extrapolate", sample_root / "lr", tmp_path / "torch", *given, "--system", "extranet",
        "--precision", "fp32",
    )  # fmt: skip
    by_onnx = rtsr(
        "extrapolate", sample_root / "lr", tmp_path / "onnx", *given, "--runtime", "onnx",
        "--model", model,
    )  # fmt: skip
    assert (by_torch.exit_code, by_onnx.exit_code) == (0, 0), by_onnx.output
    (path,) = (tmp_path / "torch").glob("*.exr")
    error = np.mean((read_image(path) - read_image(tmp_path / "onnx" / path.name)) ** 2)
    assert -10.0 * np.log10(max(error, 1e-30)) >= LEAST_DB


def test_a_state_that_is_fed_back_stays_near_over_eight_frames(
    exported: Callable[[str], Path],
) -> None:
    """hidden and cell of the graph alone, inputs at random."""
    system = load_system("nsrd")
    manifest = read_manifest(exported("nsrd-4x"))
    networks = (
        load_network(system, 4, "cpu").network,
        load_exported_network(system, 4, manifest).network,
    )
    generator = torch.Generator().manual_seed(0)
    states = [{n: torch.zeros(1, 64, 16, 24) for n in ("hidden", "cell")} for _ in networks]
    for _ in range(8):
        frames = {"frame_0": 7, "past_1": 8, "past_2": 8}
        inputs = {n: torch.rand(1, c, 16, 24, generator=generator) for n, c in frames.items()}
        for name in ("base", "last"):
            inputs[name] = torch.rand(1, 3, 64, 96, generator=generator)
        with torch.inference_mode():
            made = [
                network.reconstruct(inputs | state)
                for network, state in zip(networks, states, strict=True)
            ]
        states = [{"hidden": m["hidden_next"], "cell": m["cell_next"]} for m in made]
        torch.testing.assert_close(made[0]["predicted"], made[1]["predicted"], atol=1e-4, rtol=1e-4)


def test_what_lies_in_the_folder(exported: Callable[[str], Path]) -> None:
    folder = exported(VARIANT)
    assert sorted(p.name for p in folder.iterdir()) == [
        "manifest.json", "report.json", "rt-percept-jnflip-16.onnx",
    ]  # fmt: skip
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    (graph,) = manifest["graphs"]
    (seen,) = graph["inputs"]
    assert seen["shape"] == [1, 4, "h", "w"]
    assert len(seen["channels"]) == 4
    assert (graph["multiple"], graph["padding"]) == (16, "fill up to whole tiles with 0")
    assert graph["outputs"][0]["shape"] == [1, 4, "h/16", "w/16"]
    assert manifest["facts"]["rates"]["4x4"] == 10
    assert manifest["facts"]["tile"] == 16
    # what predict-vrs adds: the mean underestimation on validation
    about = read_weights(SHIPPED / "rt-percept-jnflip-16.safetensors").about
    assert manifest["facts"]["margin"] == about["validation"]["under"] > 0.05
    assert {step["name"] for step in manifest["outside"]} >= {"reproject", "choose rates"}
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert report["graphs"]["rt-percept-jnflip-16.onnx"]["difference"]["predicted"] < 1e-4


def test_steps_of_every_system_are_headings_of_the_page() -> None:
    page = Path(__file__).parents[2] / "docs" / "export.md"
    text = page.read_text(encoding="utf-8")
    headings = {line.lstrip("# ") for line in text.splitlines() if line.startswith("#")}
    for name in list_system_names():
        system = load_system(name)
        if system.graphs is not None:
            steps = {step.name for step in system.graphs(system.config()).outside}
            assert steps <= {heading.lower() for heading in headings}, name


def test_a_file_loads_where_nothing_but_onnxruntime_is_installed(
    exported: Callable[[str], Path],
) -> None:
    code = (
        "import sys\n"
        "for name in ('torch', 'onnx', 'onnxscript', 'rtsr_cli'): sys.modules[name] = None\n"
        "import numpy, onnxruntime\n"
        "s = onnxruntime.InferenceSession(sys.argv[1], providers=['CPUExecutionProvider'])\n"
        "seen = numpy.zeros((1, 4, 32, 48), numpy.float32)\n"
        "print(s.run(None, {'seen': seen})[0].shape)\n"
    )
    path = exported(VARIANT) / "rt-percept-jnflip-16.onnx"
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "(1, 4, 2, 3)", done.stderr


def test_sides_that_are_no_multiple_are_written_in_operators_of_opset_15(
    rtsr: Run, exported: Callable[[str], Path], tmp_path: Path
) -> None:
    """nsrd pads inside; 480x270 is no multiple of 4 either."""
    del exported
    height, width = 15, 22
    made = rtsr("export", "nsrd", tmp_path, "--scale", 4, "--size", f"{width}x{height}")
    assert made.exit_code == 0, made.output
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["opset"] == 15
    assert "Pad" in manifest["graphs"][0]["operators"]
    system = load_system("nsrd")
    networks = (
        load_network(system, 4, "cpu").network,
        load_exported_network(system, 4, read_manifest(tmp_path)).network,
    )
    generator = torch.Generator().manual_seed(0)
    channels = {"frame_0": 7, "past_1": 8, "past_2": 8, "hidden": 64, "cell": 64}
    inputs = {n: torch.rand(1, c, height, width, generator=generator) for n, c in channels.items()}
    for name in ("base", "last"):
        inputs[name] = torch.rand(1, 3, 4 * height, 4 * width, generator=generator)
    with torch.inference_mode():
        expected, found = (network.reconstruct(inputs) for network in networks)
    for name, image in expected.items():
        torch.testing.assert_close(found[name], image, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize(("name", "shot"), [(VARIANT, "."), ("extranet", "lr")])
def test_whole_frames_are_in_the_report_where_they_are_asked_for(
    rtsr: Run,
    exported: Callable[[str], Path],
    sample_root: Path,
    tmp_path: Path,
    name: str,
    shot: str,
) -> None:
    plain = json.loads((exported(VARIANT) / "report.json").read_text(encoding="utf-8"))
    assert "--frames-of IN" in plain["frames"]
    given = ("--frames-of", sample_root / shot, "--proof-frames", "3-6", "--precision", "fp16")
    made = rtsr("export", name, tmp_path / "m", *given)
    assert made.exit_code == 0, made.output
    report = json.loads((tmp_path / "m" / "report.json").read_text(encoding="utf-8"))
    frames = report["frames"]
    assert frames["count"] == {VARIANT: 4, "extranet": 2}[name]
    assert 55.0 <= frames["least_db"] < 100.0
    assert 0.0 < frames["difference"] < 0.05
    assert 1.0 < frames["largest_inside"] < report["half_holds"] == 65504.0
    assert "compute graphs of half precision in single" in report["runtime"]
    assert f"{frames['least_db']:.1f} dB from torch's at least" in made.output


def test_frames_that_cannot_be_read_leave_nothing(
    rtsr: Run, exported: Callable[[str], Path], tmp_path: Path
) -> None:
    del exported
    refused = rtsr("export", VARIANT, tmp_path / "m", "--frames-of", tmp_path / "none")
    assert refused.exit_code == 3
    assert "none: no such folder" in refused.output
    assert not list((tmp_path / "m").glob("*"))
    assert rtsr("export", VARIANT, tmp_path / "m", "--proof-frames", "1").exit_code == 2


def test_quiet_is_quiet(rtsr: Run, exported: Callable[[str], Path], tmp_path: Path) -> None:
    del exported
    made = rtsr("export", VARIANT, tmp_path, "--size", "32x32", "-q")
    assert (made.exit_code, made.output) == (0, "")
    more = rtsr("export", VARIANT, tmp_path, "--size", "32x32", "-v", "--overwrite")
    assert "values up to" in more.output


def test_a_folder_is_named_as_one(
    rtsr: Run, exported: Callable[[str], Path], tmp_path: Path
) -> None:
    del exported
    (tmp_path / "bad").mkdir()
    for line in (("export", tmp_path / "bad", tmp_path / "m"), ("systems", "--card", tmp_path)):
        refused = rtsr(*line)
        assert refused.exit_code == 3
        assert ": a folder; " in refused.output
        assert "best.safetensors" in refused.output


def test_a_missing_model_says_what_writes_one_and_how_to_install_it(
    rtsr: Run, sample_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    line = ("upscale", sample_root, tmp_path / "o", "--runtime", "onnx", "--model", tmp_path / "m")
    refused = rtsr(*line)
    assert refused.exit_code == 3
    assert "rtsr export writes one, with the extra that is not installed: pip ins" in refused.output


def test_files_of_one_size_take_no_other(
    rtsr: Run, exported: Callable[[str], Path], sample_root: Path, tmp_path: Path
) -> None:
    del exported
    made = rtsr("export", VARIANT, tmp_path / "m", "--size", "64x48", "--opset", "18")
    assert made.exit_code == 0, made.output
    refused = rtsr(
        "predict-vrs", sample_root, tmp_path / "o", "--runtime", "onnx", "--model", tmp_path / "m"
    )
    assert refused.exit_code == 3
    assert "exported for LR frames of 64x48, these are 120x72; rtsr export" in refused.output


def test_a_model_of_another_system_is_refused(
    rtsr: Run, exported: Callable[[str], Path], sample_root: Path, tmp_path: Path
) -> None:
    model = exported(VARIANT)
    other = rtsr(
        "upscale", sample_root, tmp_path / "o", "--system", "fusesr", "--runtime", "onnx",
        "--model", model,
    )  # fmt: skip
    assert other.exit_code == 3
    assert "a network of 'rt-percept', which rtsr predict-vrs runs, and rtsr upsc" in other.output


@pytest.mark.parametrize(
    ("command", "model", "words"),
    [
        (
            "extrapolate",
            "nsrd-4x",
            "'nsrd', which rtsr upscale runs, and rtsr extrapolate does not",
        ),
        ("upscale", "extranet", "'extranet', which rtsr extrapolate runs, and rtsr upscale does"),
        ("predict-vrs", "nsrd-4x", "'nsrd', which rtsr upscale runs, and rtsr predict-vrs does no"),
    ],
)
def test_a_network_for_something_else_is_named_as_that(
    rtsr: Run, sample_root: Path, tmp_path: Path, command: str, model: str, words: str
) -> None:
    """By weights as by exported files, whose kind is told before their scale."""
    folder = sample_root if command == "upscale" else sample_root / "lr"
    refused = rtsr(command, folder, tmp_path / "o", "--weights", SHIPPED / f"{model}.safetensors")
    assert refused.exit_code == 3
    assert words in refused.output
    assert "give one of '" in refused.output
    assert len(refused.output.strip().splitlines()) == 1


def test_what_is_there_is_not_replaced(rtsr: Run, exported: Callable[[str], Path]) -> None:
    folder = exported(VARIANT)
    refused = rtsr("export", VARIANT, folder)
    assert refused.exit_code == 3
    assert f"{VARIANT}.onnx exists; choose another folder, or give --overw" in refused.output


@pytest.mark.parametrize("name", list_system_names(SystemTask.UPSCALE)[:3])
def test_a_baseline_is_refused(
    rtsr: Run, exported: Callable[[str], Path], tmp_path: Path, name: str
) -> None:
    del exported
    refused = rtsr("export", name, tmp_path / "m")
    assert refused.exit_code == 3
    assert f"system '{name}' has no network: there is nothing to export" in refused.output
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("fusesr-fast",), "comes with weights for 2x, 4x: add --scale"),
        (
            ("rt-percept",),
            "comes with several weights: give one's name in place of",
        ),
        (("fusesr-direct",), "comes without weights: train them (rtsr train fusesr-direct"),
        (("fusesr-fast", "--scale", "8"), "comes without weights for 8x: train them"),
        (("fusesr-4x", "--scale", "8"), "weights for 4x, not 8x"),
        (("fuser",), "no system is called 'fuser', did you mean 'fusesr'?"),
        (("none.safetensors",), "none.safetensors: cannot be read as weights"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_message(
    rtsr: Run,
    exported: Callable[[str], Path],
    tmp_path: Path,
    given: tuple[str, ...],
    words: str,
) -> None:
    del exported
    source, *options = given
    refused = rtsr("export", source, tmp_path / "m", *options)
    assert refused.exit_code == 3
    assert words in refused.output
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(
    "options",
    [("--size", "0x4"), ("--size", "12"), ("--precision", "bf16"), ("--opset", "16")],
)
def test_values_that_are_none_are_usage_errors(
    rtsr: Run, tmp_path: Path, options: tuple[str, ...]
) -> None:
    assert rtsr("export", "fusesr", tmp_path / "m", *options).exit_code == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--runtime", "onnx"), "--runtime onnx needs --model"),
        (("--model", "m"), "--model is read with --runtime onnx only"),
        (("--runtime", "onnx", "--model", "m", "--weights", "w"), "--weights: with --runtime"),
        (("--runtime", "onnx", "--model", "m", "--device", "cuda"), "--device: --runtime onnx"),
        (("--runtime", "onnx", "--model", "m", "--precision", "fp16"), "--precision is that of"),
        (("--runtime", "tensorrt"), "'tensorrt' is not one of 'torch', 'onnx'"),
    ],
)
def test_choices_that_do_not_go_together_are_usage_errors(
    rtsr: Run, sample_root: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    refused = rtsr("upscale", sample_root, tmp_path / "o", *options)
    assert refused.exit_code == 2
    assert words in refused.output


@pytest.mark.parametrize("library", ["onnx", "onnxscript", "onnxruntime"])
def test_a_missing_extra_is_one_line_that_says_how_to_install_it(
    rtsr: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    refused = rtsr("export", "rt-percept", tmp_path / "m")
    assert refused.exit_code == 3
    assert "is not installed: pip install 'rtsr[export]'" in refused.output
    assert len(refused.output.strip().splitlines()) == 1
