from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.load import load_network
from rtsr_cli.core.network.precision import resolve_precision
from rtsr_cli.core.network.weights import (
    FORMAT,
    KEY,
    fill_network,
    find_shipped,
    read_weights,
    save_weights,
)
from rtsr_cli.core.settings import to_plain
from rtsr_cli.models import load_system

SYSTEM = load_system("fusesr-fast")


def write(
    path: Path, *, scale: int = 4, system: str = "fusesr-fast", half: bool = False
) -> nn.Module:
    torch.manual_seed(2)
    network = SYSTEM.build(SYSTEM.config(), scale)
    for buffer in network.buffers():
        if buffer.is_floating_point():
            buffer.uniform_(0.5, 1.5)
    for parameter in network.parameters():
        parameter.data.uniform_(-0.2, 0.2)
    save_weights(
        path,
        network.state_dict(),
        system=system,
        scale=scale,
        config=to_plain(SYSTEM.config()),
        about={"step": 7},
        half=half,
    )
    return network


def test_weights_are_read_back_with_what_made_them(tmp_path: Path) -> None:
    network = write(tmp_path / "w.safetensors")
    weights = read_weights(tmp_path / "w.safetensors")
    assert (weights.system, weights.scale, weights.about["step"]) == ("fusesr-fast", 4, 7)
    other = SYSTEM.build(SYSTEM.config(), 4)
    fill_network(other, weights)
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, other.state_dict()[name]), name


def test_the_same_weights_give_the_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "a.safetensors")
    write(tmp_path / "b.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


def test_half_weights_are_half_the_size(tmp_path: Path) -> None:
    write(tmp_path / "f.safetensors")
    write(tmp_path / "h.safetensors", half=True)
    ratio = (tmp_path / "h.safetensors").stat().st_size / (
        tmp_path / "f.safetensors"
    ).stat().st_size
    assert ratio < 0.56
    assert load_network(SYSTEM, 4, "cpu", tmp_path / "h.safetensors").digest


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("absent", "cannot be read as weights"),
        ("text", "cannot be read as weights"),
        ("foreign", "no weights of rtsr"),
        ("scale", "weights for 2x, the frames ask for 4x"),
        ("system", "weights of 'nsrd', not of 'fusesr-fast'"),
    ],
)
def test_what_are_no_fitting_weights_is_said(tmp_path: Path, kind: str, said: str) -> None:
    path = tmp_path / "w.safetensors"
    if kind == "text":
        path.write_text("hello")
    elif kind == "foreign":
        save_file({"a": torch.zeros(1)}, path)
    elif kind == "scale":
        write(path, scale=2)
    elif kind == "system":
        write(path, system="nsrd")
    with pytest.raises(CheckpointError, match=said):
        load_network(SYSTEM, 4, "cpu", path)


def change_bit(path: Path) -> None:
    """Flip one in the last tensor's data, which stays a finite number."""
    content = bytearray(path.read_bytes())
    content[-4] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("half", [False, True])
def test_a_changed_number_is_told(tmp_path: Path, half: bool) -> None:
    path = tmp_path / "w.safetensors"
    write(path, half=half)
    read_weights(path)
    change_bit(path)
    with pytest.raises(CheckpointError, match=r"damaged: .*checksum.*copy it again"):
        read_weights(path)


def test_a_changed_setting_is_told(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    write(path)
    content = path.read_bytes()
    changed = content.replace(b'\\"base\\": \\"guided\\"', b'\\"base\\": \\"cubic_\\"')
    assert changed != content
    path.write_bytes(changed)
    with pytest.raises(CheckpointError, match=r"numbers or settings are not those"):
        read_weights(path)


def test_weights_of_before_checksums_are_read(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    write(path)
    weights = read_weights(path)
    facts = {"format": FORMAT, "system": weights.system, "scale": 4, "about": {}}
    facts["config"] = dict(weights.config)
    save_file(dict(weights.tensors), path, {KEY: json.dumps(facts)})
    assert read_weights(path).config == weights.config


def test_a_folder_is_no_file_of_weights(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"a folder, no file of weights; give .*/best\.safet"):
        read_weights(tmp_path)


def test_parameters_that_do_not_fit_are_named(tmp_path: Path) -> None:
    write(tmp_path / "w.safetensors", scale=2)
    with pytest.raises(CheckpointError, match="other shapes"):
        fill_network(SYSTEM.build(SYSTEM.config(), 4), read_weights(tmp_path / "w.safetensors"))


def test_a_system_without_weights_says_how_to_get_them() -> None:
    with pytest.raises(CheckpointError, match="rtsr train fusesr-fast DATA --scale 8"):
        load_network(SYSTEM, 8, "cpu")


def test_a_baseline_takes_no_weights(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="takes no weights"):
        load_network(load_system("bicubic"), 4, "cpu", tmp_path / "w.safetensors")


def test_what_is_not_shipped_is_none() -> None:
    assert find_shipped(None, 4) is None
    assert find_shipped("nothing-{scale}x.safetensors", 4) is None


@pytest.mark.parametrize("name", ["fusesr", "fusesr-fast"])
def test_an_accelerated_network_is_the_same_function(name: str) -> None:
    system = load_system(name)
    torch.manual_seed(1)
    network = system.build(system.config(), 4).eval()
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.running_mean.uniform_(-0.5, 0.5)  # type: ignore[union-attr]
            module.running_var.uniform_(0.5, 2.0)  # type: ignore[union-attr]
            module.weight.data.uniform_(0.5, 2.0)
    for parameter in network.decoder.parameters():  # type: ignore[union-attr]
        parameter.data.normal_(0.0, 0.05)
    inputs = {f"frame_{i}": torch.rand(1, 7, 9, 11) for i in range(3)}
    inputs |= {f"motion_{i}": torch.randn(1, 2, 9, 11) for i in (1, 2)}
    inputs |= {f"motion_ndc_{i}": torch.randn(1, 2, 9, 11) * 0.1 for i in (1, 2)}
    inputs |= {"hr": torch.rand(1, network.config.hr_channels, 36, 44)}  # type: ignore[union-attr]
    inputs |= {"base": torch.rand(1, 3, 36, 44)}
    fast = accelerate_network(network)
    assert not any(isinstance(m, nn.BatchNorm2d) for m in fast.modules())
    with torch.inference_mode():
        slow_out, fast_out = network(inputs, None)[0], fast(inputs, None)[0]
    assert torch.allclose(slow_out["predicted"], fast_out["predicted"], atol=2e-5, rtol=1e-4)


def test_auto_is_settled_by_the_device() -> None:
    cpu = torch.device("cpu")
    assert resolve_precision(Precision.FP16, cpu) is Precision.FP16
    assert resolve_precision(Precision.AUTO, cpu) in (Precision.FP32, Precision.BF16)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
@pytest.mark.parametrize("half", [False, True])
def test_weights_that_are_no_numbers_are_refused(tmp_path: Path, bad: float, half: bool) -> None:
    network = SYSTEM.build(SYSTEM.config(), 4)
    tensors = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    spoilt = [name for name, tensor in tensors.items() if tensor.is_floating_point()][1:3]
    for name in spoilt:
        tensors[name].view(-1)[0] = bad
    path = tmp_path / "bad.safetensors"
    config = to_plain(SYSTEM.config())
    save_weights(path, tensors, system="fusesr-fast", scale=4, config=config, about={}, half=half)
    with pytest.raises(CheckpointError, match=r"bad\.safetensors: 1 of the .* NaN or Inf") as told:
        read_weights(path)
    assert any(f"tensor '{name}'" in str(told.value) for name in spoilt)
    assert "1 other tensors hold some" in str(told.value)


def test_large_weights_whose_sum_overflows_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "large.safetensors"
    config = to_plain(SYSTEM.config())
    large = {"a": torch.full((64,), 3e38)}
    save_weights(path, large, system="fusesr-fast", scale=4, config=config, about={})
    assert torch.equal(read_weights(path).tensors["a"], large["a"])
