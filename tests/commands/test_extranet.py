"""ExtraNet from the command line: trained, gone on with, packed, run; and what it was made for."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from click.testing import Result
from safetensors.torch import load_file

from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.network.weights import read_weights
from rtsr_cli.core.training.clips import read_clips

Run = Callable[..., Result]

SMALL = {
    "training.steps": 3,
    "training.batch": 2,
    "training.crop": 16,
    "training.warmup": 1,
    "training.validate_every": 3,
    "training.save_every": 1,
    "training.log_every": 1,
    "training.validation_frames": 1,
    "training.precision": '"fp32"',
}


def settings(**changed: object) -> list[str]:
    names = {key.replace("__", "."): value for key, value in changed.items()}
    return [part for k, v in {**SMALL, **names}.items() for part in ("--set", f"{k}={v}")]


@pytest.fixture(scope="module")
def sequence(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames with radiance and G-buffer, of one size."""
    shot = tmp_path_factory.mktemp("sequence") / "shot"
    shutil.copytree(sample_root / "lr", shot)
    return shot


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def train(rtsr: Run, sequence: Path, cache: Path) -> Callable[..., Result]:
    def run(out: Path, *more: object) -> Result:
        result = rtsr("train", "extranet", sequence, "--out", out, "--cache", cache, *more)
        assert result.exit_code == 0, result.output
        return result

    return run


@pytest.fixture
def weights(train: Callable[..., Result], tmp_path: Path) -> Path:
    train(tmp_path / "run", *settings())
    return tmp_path / "run" / "last.safetensors"


def test_training_judges_predicted_frames_beside_the_untrained_system(
    train: Callable[..., Result], tmp_path: Path
) -> None:
    result = train(tmp_path / "run", *settings())
    # the first of six frames has nothing before it
    assert "5 frames of 1 shot to train on" in result.output
    assert "warp-guided: psnr" in result.output
    assert "hole_psnr" in result.output
    assert read_weights(tmp_path / "run" / "best.safetensors").system == "extranet"


def test_a_run_that_was_ended_goes_on_exactly(
    train: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rtsr_cli.core.training.trainer import Trainer

    train(tmp_path / "whole", *settings())
    advance = Trainer.advance

    def stop(self: Trainer, batches: object) -> object:
        if self.step == 2:
            raise KeyboardInterrupt
        return advance(self, batches)  # type: ignore[arg-type]

    monkeypatch.setattr(Trainer, "advance", stop)
    with pytest.raises(AssertionError):
        train(tmp_path / "parts", *settings())
    monkeypatch.undo()
    train(tmp_path / "parts", *settings())
    whole, parts = (load_file(tmp_path / n / "last.safetensors") for n in ("whole", "parts"))
    assert all(torch.equal(tensor, parts[name]) for name, tensor in whole.items())


def test_packs_hold_whole_frames(rtsr: Run, sequence: Path, cache: Path, tmp_path: Path) -> None:
    pack = tmp_path / "frames.rtsr-clips"
    named = ("--pack", pack, "--pack-crops", 2, "--cache", cache)
    assert rtsr("train", "extranet", sequence, *named, *settings()).exit_code == 0
    clips, _ = read_clips(pack)
    assert all(clip.is_whole and clip.facts.cameras for clip in clips)
    result = rtsr("train", "extranet", pack, "--out", tmp_path / "run", *settings())
    assert result.exit_code == 0, result.output


def test_trained_weights_predict(rtsr: Run, weights: Path, sequence: Path, tmp_path: Path) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out", "--weights", weights)
    assert result.exit_code == 0, result.output
    assert "system extranet" in result.output
    header = read_header(tmp_path / "out" / "frame.0006.exr")
    assert header.attributes["rtsr:system"] == "extranet"
    assert int(header.attributes["rtsr:predicted"]) == 1
    again = rtsr("extrapolate", sequence, tmp_path / "out", "--weights", weights)
    assert "0 written, 3 kept" in again.output


def test_shards_write_what_the_whole_run_writes(
    rtsr: Run, weights: Path, sequence: Path, tmp_path: Path
) -> None:
    named = ("--weights", weights)
    assert rtsr("extrapolate", sequence, tmp_path / "whole", *named).exit_code == 0
    for shard in ("1/2", "2/2"):
        result = rtsr("extrapolate", sequence, tmp_path / "parts", "--shard", shard, *named)
        assert result.exit_code == 0, result.output
    for path in (tmp_path / "whole").glob("*.exr"):
        whole, part = (
            read_channels(p, {"R", "G", "B"}) for p in (path, tmp_path / "parts" / path.name)
        )
        assert all((whole[name] == part[name]).all() for name in whole)


def test_seconds_of_each_stage_are_told(
    rtsr: Run, weights: Path, sequence: Path, tmp_path: Path
) -> None:
    result = rtsr("extrapolate", sequence, tmp_path / "out", "--weights", weights, "--json")
    events = [json.loads(line) for line in result.output.splitlines()]
    stages = [event["stages"] for event in events if event.get("status") == "written"]
    assert len(stages) == 3
    assert all(set(stage) == {"prepare", "network", "compose"} for stage in stages)
    assert all(seconds > 0 for stage in stages for seconds in stage.values())


@pytest.mark.parametrize("cadence", [("--every", "3"), ("--rendered", "1,4-6")])
def test_it_is_made_for_every_second_frame(
    rtsr: Run, weights: Path, sequence: Path, tmp_path: Path, cadence: tuple[str, str]
) -> None:
    out = tmp_path / "out"
    result = rtsr("extrapolate", sequence, out, *cadence, "--weights", weights)
    assert result.exit_code == 3
    assert "'extranet' is made for frames of which one in 2 is rendered" in result.output
    result = rtsr("extrapolate", sequence, out, *cadence)
    assert result.exit_code == 0, result.output
    assert "system warp-guided" in result.output
    assert "extranet: made for frames of which one in 2 is rendered" in result.output
