"""Classifier guided supersampling from the command line: trained, gone on with, run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner, Result
from safetensors.torch import load_file

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.network.weights import read_weights

Run = Callable[..., Result]

SMALL = {
    "training.steps": 2,
    "training.batch": 1,
    "training.crop": 12,
    "training.warmup": 1,
    "training.validate_every": 2,
    "training.save_every": 1,
    "training.log_every": 1,
    "training.validation_frames": 1,
    "training.precision": '"fp32"',
}

SIMULATION = ("--simulate-lr", 2, "--samples-per-pixel", 2, "--jitter", "halton")


def settings(**changed: object) -> list[str]:
    names = {key.replace("__", "."): value for key, value in changed.items()}
    return [part for k, v in {**SMALL, **names}.items() for part in ("--set", f"{k}={v}")]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine frames of 48 x 32 pixels, 2 x 2 samples each."""
    shot = tmp_path_factory.mktemp("capture") / "shot"
    named = ("--size", "48x32", "--samples", "2", "--frames", "1-9")
    made = CliRunner().invoke(group, ["synth", str(shot), *named])
    assert made.exit_code == 0, made.output
    return shot


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def train(rtsr: Run, capture: Path, cache: Path) -> Callable[..., Result]:
    def run(out: Path, *more: object) -> Result:
        result = rtsr("train", "cgts", capture, "--out", out, "--cache", cache, *more)
        assert result.exit_code == 0, result.output
        return result

    return run


@pytest.fixture
def weights(train: Callable[..., Result], tmp_path: Path) -> Path:
    train(tmp_path / "run", *settings())
    return tmp_path / "run" / "last.safetensors"


def test_a_run_that_was_ended_goes_on_exactly(
    train: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rtsr_cli.core.training.trainer import Trainer

    train(tmp_path / "whole", *settings())
    advance = Trainer.advance

    def stop(self: Trainer, batches: object) -> object:
        if self.step == 1:
            raise KeyboardInterrupt
        return advance(self, batches)  # type: ignore[arg-type]

    monkeypatch.setattr(Trainer, "advance", stop)
    with pytest.raises(AssertionError):
        train(tmp_path / "parts", *settings())
    monkeypatch.undo()
    train(tmp_path / "parts", *settings())
    whole, parts = (load_file(tmp_path / n / "last.safetensors") for n in ("whole", "parts"))
    assert all(torch.equal(tensor, parts[name]) for name, tensor in whole.items())


def test_the_composition_is_trained_by_a_classifier_that_stays(
    train: Callable[..., Result], tmp_path: Path
) -> None:
    train(tmp_path / "first", *settings(network__stage='"classifier"'))
    given = tmp_path / "first" / "last.safetensors"
    train(tmp_path / "second", "--init", given, *settings(network__stage='"composition"'))
    first, second = (load_file(tmp_path / n / "last.safetensors") for n in ("first", "second"))
    changed = {name.partition(".")[0] for name, t in first.items() if not t.equal(second[name])}
    assert changed == {"composition"}


def test_trained_weights_upscale_and_show_what_they_decide(
    rtsr: Run, weights: Path, capture: Path, tmp_path: Path
) -> None:
    assert read_weights(weights).system == "cgts"
    named = ("--weights", weights, *SIMULATION, "--debug-buffers")
    result = rtsr("upscale", capture, tmp_path / "out", *named)
    assert result.exit_code == 0, result.output
    assert "system cgts" in result.output
    path = tmp_path / "out" / "frame.0009.exr"
    assert read_header(path).attributes["rtsr:system"] == "cgts"
    shown = read_channels(
        tmp_path / "out" / "debug" / "frame.0009.exr",
        {*(f"{k}.{c}" for k in ("ghosting", "aliasing") for c in "RGB"), "weight.Y", "counter.Y"},
    )
    for kind in ("ghosting", "aliasing"):
        total = sum(shown[f"{kind}.{c}"].astype(np.float32) for c in "RGB")
        assert np.allclose(total, 1.0, atol=2e-3)
    assert float(shown["weight.Y"].max()) <= 1.0
    again = rtsr("upscale", capture, tmp_path / "out", *named)
    assert "0 written, 9 kept" in again.output


def test_a_shard_replays_what_it_needs(
    rtsr: Run, weights: Path, capture: Path, tmp_path: Path
) -> None:
    """Nine frames are fewer than are replayed: parts are the whole."""
    named = ("--weights", weights, *SIMULATION)
    for out, shards in (("whole", [()]), ("parts", [("--shard", "1/2"), ("--shard", "2/2")])):
        for shard in shards:
            result = rtsr("upscale", capture, tmp_path / out, *named, *shard)
            assert result.exit_code == 0, result.output
    for path in sorted((tmp_path / "whole").glob("*.exr")):
        whole, part = (read_channels(p, "RGB") for p in (path, tmp_path / "parts" / path.name))
        assert all(np.array_equal(whole[c], part[c]) for c in "RGB")


def test_another_scale_is_refused(rtsr: Run, weights: Path, capture: Path, tmp_path: Path) -> None:
    result = rtsr(
        "upscale", capture, tmp_path / "out", "--weights", weights, "--simulate-lr", 4,
        "--jitter", "halton",
    )  # fmt: skip
    assert result.exit_code in (2, 3)
    assert "Traceback" not in result.output
    assert "4x" in result.output
    assert not (tmp_path / "out").exists()
