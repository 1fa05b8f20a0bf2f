"""The graphs of a network, each as a checked and proven model."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from torch import Tensor

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.export.followed_graphs import MeasureGraph, expose_tensors
from rtsr_cli.core.export.onnx_model import TracedSizes, trace_graph
from rtsr_cli.core.export.operators import check_operators
from rtsr_cli.core.export.proof import GraphProof, prove_graph
from rtsr_cli.core.export.request import ExportRequest
from rtsr_cli.core.export.source import ExportSource
from rtsr_cli.core.graphs import Graph, GraphTensor
from rtsr_cli.core.network.graphs import record_uniform_frame

CELLS = (5, 7)
"""Rows and columns of cells that graphs of any size are traced with: no side is like another."""


@dataclass(frozen=True, kw_only=True)
class ExportedGraph:
    """A graph and its file.

    Attributes:
        graph: that it is of.
        file: name.
        content: of it.
        operators: that it has.
        proof: how far it is from the network.
        sides: of each tensor, (height, width) in numbers or by those of the LR frame.
        channels: of each tensor, how many.
        types: of each tensor, as onnxruntime has them.
        measure: what measures its tensors in single precision.
    """

    graph: Graph
    file: str
    content: bytes
    operators: tuple[str, ...]
    proof: GraphProof
    sides: Mapping[str, tuple[str | int, str | int]]
    channels: Mapping[str, int]
    types: Mapping[str, str]
    measure: MeasureGraph


def export_graphs(request: ExportRequest, source: ExportSource) -> list[ExportedGraph]:
    """Trace, check and prove every graph of a network.

    Raises:
        CheckpointError: a graph has operators that runtimes do not document, or its model is not
            the network.
    """
    network, half = source.network, request.precision is Precision.FP16
    lr_cell = max(graph.multiple for graph in source.graphs.graphs)
    lr_size = request.size or (CELLS[0] * lr_cell, CELLS[1] * lr_cell)
    calls = record_uniform_frame(source.system, network, source.graphs, source.scale, lr_size)
    sizes = TracedSizes(cells=CELLS, lr_cell=lr_cell, dynamic=request.size is None)
    exported = []
    for graph in source.graphs.graphs:
        call = calls[graph.method]
        # a model of half precision is traced of a copy
        traced = copy.deepcopy(network) if half else network
        trace = partial(trace_graph, graph=graph, call=call, sizes=sizes, opset=request.opset)
        model = trace(traced, half=half)
        # what half would hold is told by single precision
        single = trace(network, half=False) if half else model
        measure = expose_tensors(single.SerializeToString())
        tensors: dict[str, Tensor] = {**call.inputs, **call.outputs}
        exported.append(
            ExportedGraph(
                graph=graph,
                file=source.name_file(graph.method),
                operators=check_operators(model, graph.method),
                proof=prove_graph(network, graph, model, call.inputs, half=half, measure=measure),
                content=model.SerializeToString(deterministic=True),
                sides={name: sizes.name_sides(tensor) for name, tensor in tensors.items()},
                channels={name: tensor.shape[1] for name, tensor in tensors.items()},
                types=_list_types(model),
                measure=measure,
            )
        )
    return exported


def _list_types(model: Any) -> dict[str, str]:
    names = {1: "float32", 10: "float16"}
    puts = [*model.graph.input, *model.graph.output]
    return {put.name: names[put.type.tensor_type.elem_type] for put in puts}


def describe_tensor(tensor: GraphTensor, graph: ExportedGraph) -> dict[str, Any]:
    """What a manifest says of a tensor."""
    height, width = graph.sides[tensor.name]
    return {
        "name": tensor.name,
        "shape": [1, graph.channels[tensor.name], height, width],
        "type": graph.types[tensor.name],
        "channels": list(tensor.channels),
    }
