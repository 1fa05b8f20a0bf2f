"""NaN and Inf are in no output: weights with any are refused, a frame that would hold any fails."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from click.testing import Result

from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.network.weights import save_weights
from rtsr_cli.core.settings import to_plain
from rtsr_cli.models import load_system

Run = Callable[..., Result]


def events_of(result: Result) -> list[dict[str, Any]]:
    return [json.loads(line) for line in result.stdout.splitlines()]


def write_weights(path: Path, name: str, scale: int, change: Callable[[torch.Tensor], None]) -> str:
    """Weights of a network, one tensor of them changed; returns that one's name."""
    system = load_system(name)
    config = system.config(mean=0.5) if name == "rt-percept" else system.config()
    torch.manual_seed(2)
    tensors = {k: t.clone() for k, t in system.build(config, scale).state_dict().items()}
    first = next(k for k, t in tensors.items() if t.is_floating_point() and t.dim() > 1)
    change(tensors[first])
    save_weights(
        path, tensors, system=name, scale=scale, config=to_plain(config), about={"step": 1}
    )
    return first


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("system", "scale", "command"),
    [
        ("fusesr-fast", 4, ("upscale",)),
        ("rt-percept", 1, ("predict-vrs",)),
        ("fusesr-fast", 4, ("train", "fusesr-fast")),
    ],
)
def test_weights_that_are_no_numbers_are_refused(
    rtsr: Run,
    small_shot: Path,
    tmp_path: Path,
    system: str,
    scale: int,
    command: tuple[str, ...],
    bad: float,
) -> None:
    def spoil(tensor: torch.Tensor) -> None:
        tensor.view(-1)[-1] = bad

    path = tmp_path / "bad.safetensors"
    tensor = write_weights(path, system, scale, spoil)
    out = ("--out", tmp_path / "out", "--init", path) if command[0] == "train" else ()
    choice = out or (tmp_path / "out", "--weights", path)
    result = rtsr(*command, small_shot, *choice)
    assert result.exit_code == 3, result.output
    assert f"Error: {path}: 1 of the " in result.output
    assert f"values of tensor '{tensor}' are NaN or Inf" in result.output
    assert not list((tmp_path / "out").rglob("*.exr"))


def overflow(tensor: torch.Tensor) -> None:
    tensor.fill_(3e38)


def test_a_picture_that_is_not_finite_fails_and_is_counted(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    path = tmp_path / "huge.safetensors"
    write_weights(path, "fusesr-fast", 4, overflow)
    run = ("upscale", small_shot, tmp_path / "out", "--weights", path, "--frames", "1-2")
    result = rtsr(*run, "--json", "--preview")
    assert result.exit_code == 1, result.output
    first, second, done = events_of(result)[-3:]
    assert first["status"] == second["status"] == "failed"
    assert "system 'fusesr-fast' gave" in first["message"]
    assert first["nonfinite"] > 0
    assert done["nonfinite"] == first["nonfinite"] + second["nonfinite"]
    assert (done["written"], done["failed"]) == (0, 2)
    assert not [p for p in (tmp_path / "out").rglob("*") if p.is_file()]
    assert "NaN or Inf values, and nothing is written" in rtsr(*run).output


def test_errors_of_tiles_that_are_not_finite_fail(
    rtsr: Run, small_shot: Path, tmp_path: Path
) -> None:
    path = tmp_path / "huge.safetensors"
    write_weights(path, "rt-percept", 1, overflow)
    lr = small_shot / "lr"
    result = rtsr("predict-vrs", lr, tmp_path / "out", "--weights", path, "--json")
    assert result.exit_code == 1, result.output
    done = next(e for e in events_of(result) if e["event"] == "done")
    assert (done["written"], done["failed"]) == (0, 4)
    assert done["nonfinite"] > 0
    # figures of nothing say nothing
    assert not (tmp_path / "out" / "summary.json").exists()
    assert not list((tmp_path / "out").rglob("*.exr"))


def test_a_product_that_no_float_holds_fails_and_the_others_are_made(
    rtsr: Run, tmp_path: Path
) -> None:
    for number, value in ((1, 2.0), (2, 1e30), (3, 2.0)):
        planes = {
            f"{part}.{c}": np.full((8, 8), value, np.float32)
            for part in ("lighting", "material")
            for c in "RGB"
        }
        write_exr(tmp_path / "in" / f"f.{number:04d}.exr", planes)
    result = rtsr("demodulate", tmp_path / "in", tmp_path / "out", "--inverse", "--json")
    assert result.exit_code == 1, result.output
    done = events_of(result)[-1]
    assert (done["written"], done["failed"], done["nonfinite"]) == (2, 1, 3 * 64)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["f.0001.exr", "f.0003.exr"]
