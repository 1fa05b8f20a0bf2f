"""Graphs of networks: recorded while they run, replaced, and run from files."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
import torch

from rtsr_cli.core.choices import Preset
from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.network.exported import describe_graphs, load_exported_network
from rtsr_cli.core.network.graphs import record_graphs, record_uniform_frame, replace_graph
from rtsr_cli.core.network.manifest import MANIFEST, Manifest, read_manifest, sum_manifest
from rtsr_cli.models import list_trainable_names, load_system


@pytest.mark.parametrize("name", list_trainable_names())
def test_what_is_declared_is_what_goes_in_and_out(name: str) -> None:
    system = load_system(name)
    config, scale = system.config(), system.scales[0]
    graphs = describe_graphs(system, config)
    network = system.build(config, scale).eval()
    multiple = max(graph.multiple for graph in graphs.graphs)
    size = (2 * multiple, 3 * multiple)
    calls = record_uniform_frame(system, network, graphs, scale, size)
    assert list(calls) == [graph.method for graph in graphs.graphs]
    for graph in graphs.graphs:
        call = calls[graph.method]
        assert [put.name for put in graph.inputs] == list(call.inputs)
        assert {put.name for put in graph.outputs} == set(call.outputs)
        for put in (*graph.inputs, *graph.outputs):
            tensor = {**call.inputs, **call.outputs}[put.name]
            count = tensor.shape[1]
            assert len(put.channels) == count or len(put.channels) == 1 < count
    assert all(network.get_buffer(value) is not None for value in graphs.values)
    assert not set(calls) & set(vars(network)), "what recorded is gone"


@pytest.mark.parametrize("name", ["fusesr", "fusesr-fast", "nsrd", "cgts", "extranet"])
def test_networks_of_the_published_presets_are_refused(name: str) -> None:
    system = load_system(name)
    with pytest.raises(ConfigError, match="only networks of preset rtsr can be exported, not pap"):
        describe_graphs(system, system.config(preset=Preset.PAPER))


def test_a_system_without_a_network_has_nothing_to_export() -> None:
    system = load_system("bicubic")
    with pytest.raises(CheckpointError, match="'bicubic' has no network: there is nothing to"):
        describe_graphs(system, system.config())


def test_a_function_stands_in_for_a_graph() -> None:
    system = load_system("rt-percept")
    config = system.config()
    network = system.build(config, 1).eval()
    replace_graph(network, "estimate", lambda tensors: {"predicted": tensors["seen"][:, :1] + 5.0})
    outputs, _ = network({"seen": torch.zeros(1, 4, 16, 16)}, None)
    assert torch.equal(outputs["predicted"], torch.full((1, 1, 16, 16), 5.0))


def test_the_first_call_of_a_graph_is_recorded() -> None:
    system = load_system("rt-percept")
    config = system.config()
    network = system.build(config, 1).eval()
    with torch.no_grad(), record_graphs(network, describe_graphs(system, config)) as calls:
        network({"seen": torch.zeros(1, 4, 16, 16)}, None)
        network({"seen": torch.ones(1, 4, 32, 16)}, None)
    assert torch.equal(calls["estimate"].inputs["seen"], torch.zeros(1, 4, 16, 16))


def write_manifest(folder: Path, **changed: Any) -> Path:
    content = b"a graph"
    (folder / "a.onnx").write_bytes(content)
    graph = {
        "method": "estimate",
        "file": "a.onnx",
        "sha256": sha256(content).hexdigest(),
        "multiple": 16,
        "padding": "",
    }
    facts = {
        "format": "rtsr-export-2",
        "system": "rt-percept",
        "scale": 1,
        "config": {},
        "graphs": [graph],
        "values": {"mean": [0.25]},
        "weights": {"about": {"step": 3}},
        "size": None,
    } | changed
    facts = {"checksum": sum_manifest(facts)} | facts
    path = folder / MANIFEST
    path.write_text(json.dumps(facts), encoding="utf-8")
    return path


def test_a_manifest_is_read_from_its_folder(tmp_path: Path) -> None:
    path = write_manifest(tmp_path, size=[48, 32])
    manifest = read_manifest(tmp_path)
    assert manifest == read_manifest(path)
    assert (manifest.system, manifest.scale, manifest.size) == ("rt-percept", 1, (32, 48))
    assert manifest.about == {"step": 3}
    assert manifest.files[0].path == tmp_path / "a.onnx"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"format": "other"}, "this is no manifest of rtsr export"),
        ({"format": "rtsr-export-1"}, "of an older rtsr, which wrote no checksum .*; export again"),
        ({"checksum": "0" * 64}, "damaged or changed: what it says is not what was written"),
        ({"scale": "2"}, r"damaged \(scale\)"),
        ({"size": [1]}, r"damaged \(size\)"),
        ({"graphs": [3]}, r"damaged \(graphs\)"),
        ({"graphs": [{"method": "estimate"}]}, r"damaged \(file, sha256, multiple\)"),
    ],
)
def test_a_damaged_manifest_is_refused(tmp_path: Path, changed: dict[str, Any], words: str) -> None:
    write_manifest(tmp_path, **changed)
    with pytest.raises(CheckpointError, match=words):
        read_manifest(tmp_path)


@pytest.mark.parametrize("name", ["config", "values", "weights", "facts"])
def test_settings_that_steer_the_surroundings_are_those_that_were_written(
    tmp_path: Path, name: str
) -> None:
    path = write_manifest(tmp_path, facts={"margin": 0.05}, config={"base": "guided"})
    facts = json.loads(path.read_text(encoding="utf-8"))
    facts[name] = {"base": "cubic"}
    path.write_text(json.dumps(facts, indent=4), encoding="utf-8")
    with pytest.raises(CheckpointError, match=r"damaged or changed: what it says is not what was"):
        read_manifest(tmp_path)


def test_how_a_manifest_is_laid_out_changes_nothing(tmp_path: Path) -> None:
    path = write_manifest(tmp_path, values={"mean": [0.1, 1e-9]})
    facts = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(dict(reversed(facts.items())), indent=3), encoding="utf-8")
    assert read_manifest(tmp_path).values == {"mean": [0.1, 1e-9]}


def test_a_folder_without_a_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"manifest\.json: cannot be read .*rtsr export wri"):
        read_manifest(tmp_path)


def test_a_file_that_is_not_the_exported_one_is_refused(tmp_path: Path) -> None:
    write_manifest(tmp_path)
    (tmp_path / "a.onnx").write_bytes(b"another graph")
    with pytest.raises(CheckpointError, match=r"a\.onnx: not the file that .* was written with"):
        read_manifest(tmp_path)
    (tmp_path / "a.onnx").unlink()
    with pytest.raises(CheckpointError, match=r"a\.onnx: cannot be read"):
        read_manifest(tmp_path)


def test_a_manifest_leads_to_no_file_outside_of_its_folder(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "b.onnx").write_bytes(b"b")
    graph = {"method": "m", "file": "../b.onnx", "sha256": "0", "multiple": 1}
    write_manifest(tmp_path / "in", graphs=[graph])
    with pytest.raises(CheckpointError, match=r"in/b\.onnx: cannot be read"):
        read_manifest(tmp_path / "in")


def manifest_of(folder: Path, **changed: Any) -> Manifest:
    write_manifest(folder, **changed)
    return read_manifest(folder)


def test_sizes_that_files_do_not_take_are_refused(tmp_path: Path) -> None:
    anything = manifest_of(tmp_path)
    anything.check_size((32, 48))
    with pytest.raises(CheckpointError, match=r"multiples of 16, these are 50x32; .*--size 50x32"):
        anything.check_size((32, 50))
    one = manifest_of(tmp_path, size=[50, 32])
    one.check_size((32, 50))
    with pytest.raises(CheckpointError, match="exported for LR frames of 50x32, these are 48x32"):
        one.check_size((32, 48))


def test_a_network_of_another_system_or_scale_is_refused(tmp_path: Path) -> None:
    manifest = manifest_of(tmp_path)
    with pytest.raises(CheckpointError, match="of 'rt-percept', not of 'fusesr'"):
        load_exported_network(load_system("fusesr"), 1, manifest)
    with pytest.raises(CheckpointError, match="a network for 1x, the frames ask for 2x"):
        load_exported_network(load_system("rt-percept"), 2, manifest)


def test_a_file_that_is_no_graph_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="the extra export is not installed")
    with pytest.raises(CheckpointError, match=r"a\.onnx: cannot be read as a graph"):
        load_exported_network(load_system("rt-percept"), 1, manifest_of(tmp_path))


def test_values_that_are_missing_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"damaged \(values\.mean\)"):
        load_exported_network(load_system("rt-percept"), 1, manifest_of(tmp_path, values={}))
