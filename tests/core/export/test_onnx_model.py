"""Models: sizes that vary, versions of operators, nothing of the machine that made them."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.export import onnx_model
from rtsr_cli.core.export.followed_graphs import expose_tensors
from rtsr_cli.core.export.onnx_model import lower_opset
from rtsr_cli.core.export.operators import check_operators
from rtsr_cli.core.export.proof import prove_graph
from rtsr_cli.core.network.onnx_graph import OnnxGraph

Trace = Callable[..., Any]
"""(dynamic, half, opset) -> a model of its own."""


def shapes_of(model: Any) -> dict[str, list[object]]:
    return {
        put.name: [d.dim_param or d.dim_value for d in put.type.tensor_type.shape.dim]
        for put in (*model.graph.input, *model.graph.output)
    }


@pytest.mark.parametrize(("opset", "ir_version"), [(15, 7), (18, 8)])
def test_a_model_of_any_size_gives_what_the_network_gives(
    traced: Any, trace: Trace, opset: int, ir_version: int
) -> None:
    model = trace(opset=opset)
    assert (model.opset_import[0].version, model.ir_version) == (opset, ir_version)
    assert shapes_of(model)["small"] == [1, 3, "h", "w"]
    assert shapes_of(model)["large"] == [1, 1, "4*h", "4*w"]
    run = OnnxGraph(model.SerializeToString())
    for height, width in ((8, 12), (20, 28), (36, 16)):
        inputs = {
            "small": torch.rand(1, 3, height, width),
            "base": torch.rand(1, 1, 4 * height, 4 * width),
        }
        expected = traced.network.enlarge(inputs)["large"]
        torch.testing.assert_close(run(inputs)["large"], expected, atol=1e-5, rtol=1e-5)


def test_a_model_of_one_size_says_so(trace: Trace) -> None:
    model = trace(dynamic=False)
    assert shapes_of(model) == {
        "small": [1, 3, 20, 28],
        "base": [1, 1, 80, 112],
        "large": [1, 1, 80, 112],
    }


def test_half_precision_leaves_out_what_is_to_be_single(traced: Any, trace: Trace) -> None:
    model = trace(half=True)
    kinds = {put.name: put.type.tensor_type.elem_type for put in model.graph.input}
    assert kinds == {"small": 10, "base": 1}
    assert all(t.data_type != 1 for t in model.graph.initializer if len(t.dims) == 4)
    measure = expose_tensors(trace().SerializeToString())
    proof = prove_graph(
        traced.network, traced.graph, model, traced.call.inputs, half=True, measure=measure
    )
    assert 1e-5 < proof.difference["large"] < 1e-2


def test_the_same_network_makes_the_same_bytes_that_name_no_place(trace: Trace) -> None:
    first, second = (trace(anew=anew).SerializeToString(deterministic=True) for anew in (0, 1))
    assert first == second
    for place in (str(Path(__file__).parents[3]), "site-packages", ".py"):
        assert place.encode() not in first


def test_an_operator_without_an_older_form_is_refused(trace: Trace) -> None:
    onnx = onnx_model.import_onnx()
    model = trace(opset=18)
    model.graph.node.append(onnx.helper.make_node("BitwiseNot", ["small"], ["other"]))
    with pytest.raises((CheckpointError, onnx.defs.SchemaError)):
        lower_opset(model, "enlarge", 15, onnx)


def test_padding_has_a_form_of_opset_15(trace: Trace) -> None:
    """All axes are padded as they were before opset 18; chosen ones only since."""
    onnx = onnx_model.import_onnx()
    for axes in ((), ("axes",)):
        model = trace(opset=18)
        inputs = ["small", "widths", "", *axes][: 2 if not axes else 4]
        model.graph.node.append(onnx.helper.make_node("Pad", inputs, ["padded"]))
        if axes:
            with pytest.raises(CheckpointError, match=r"Pad has no form of opset 15; --opset 18"):
                lower_opset(model, "enlarge", 15, onnx)
        else:
            lower_opset(model, "enlarge", 15, onnx)
            assert model.graph.node[-1].op_type == "Pad"


def test_every_documented_list_suffices(trace: Trace) -> None:
    operators = check_operators(trace(), "enlarge")
    assert {"Conv", "Split", "Resize", "ReduceMean", "AveragePool"} <= set(operators)


@pytest.mark.parametrize(
    ("operator", "attributes", "named"),
    [
        ("Einsum", {"equation": "a->a"}, "Einsum"),
        ("MaxPool", {"kernel_shape": [2, 2], "ceil_mode": 1}, "MaxPool.ceil_mode"),
    ],
)
def test_what_a_runtime_does_not_document_is_refused(
    trace: Trace, operator: str, attributes: dict[str, Any], named: str
) -> None:
    onnx = onnx_model.import_onnx()
    model = trace()
    model.graph.node.append(onnx.helper.make_node(operator, ["small"], ["other"], **attributes))
    with pytest.raises(CheckpointError, match=f"enlarge: {named}: not documented by U"):
        check_operators(model, "enlarge")


def test_operators_of_other_domains_are_refused(trace: Trace) -> None:
    onnx = onnx_model.import_onnx()
    model = trace()
    model.graph.node.append(onnx.helper.make_node("Gelu", ["small"], ["o"], domain="com.microsoft"))
    with pytest.raises(CheckpointError, match=r"com\.microsoft\.Gelu"):
        check_operators(model, "enlarge")


def test_a_model_that_is_not_the_network_is_refused(traced: Any, trace: Trace) -> None:
    model = trace()
    other = copy.deepcopy(traced.network)
    other.last.bias.add_(0.01)
    measure = expose_tensors(model.SerializeToString())
    with pytest.raises(CheckpointError, match=r"enlarge: the exported graph is 0\.0\d+ from"):
        prove_graph(other, traced.graph, model, traced.call.inputs, half=False, measure=measure)


def test_what_half_does_not_hold_is_refused_with_what_to_do(traced: Any, trace: Trace) -> None:
    """The last layer's inputs overflow; nothing of it is seen in a difference on processors."""
    model = trace(half=True)
    call, graph = traced.call.inputs, traced.graph
    with pytest.raises(CheckpointError, match=r"reach 7e\+04 on random inputs, .*fp32"):
        prove_graph(traced.network, graph, model, call, half=True, measure=lambda _: 7e4)
    other = copy.deepcopy(traced.network)
    other.last.bias.add_(0.5)
    with pytest.raises(CheckpointError, match=r"too few digits for these weights, whose values re"):
        prove_graph(other, graph, model, call, half=True, measure=lambda _: 3.0)


def test_the_largest_value_inside_is_that_of_any_tensor(traced: Any, trace: Trace) -> None:
    measure = expose_tensors(trace().SerializeToString())
    inputs = {name: tensor.clone() for name, tensor in traced.call.inputs.items()}
    small = measure(inputs)
    features = traced.network.first(inputs["small"]).abs().max()
    assert small >= float(features)
    inputs["small"] = inputs["small"] * 1000.0
    assert measure(inputs) > 100.0 * small


def test_a_missing_library_is_named_with_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "onnx", None)
    with pytest.raises(ConfigError, match=r"onnx is not installed: pip install 'rtsr\[export\]'"):
        onnx_model.import_onnx()
    for name in ("onnxscript", "onnxruntime"):
        monkeypatch.setitem(__import__("sys").modules, name, None)
    with pytest.raises(ConfigError, match=r"onnx, onnxscript and onnxruntime are not installed: "):
        onnx_model.import_onnx()
