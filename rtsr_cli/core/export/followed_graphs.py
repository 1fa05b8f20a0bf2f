"""Exported graphs beside a network's own, on the inputs that a run of frames gives them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from torch import Tensor

from rtsr_cli.core.export.onnx_model import import_onnx
from rtsr_cli.core.network.graphs import replace_graph
from rtsr_cli.core.network.load import LoadedNetwork
from rtsr_cli.core.network.onnx_graph import QUIET, OnnxGraph, import_onnxruntime
from rtsr_cli.core.system import Tensors

MeasureGraph = Callable[[Tensors], float]
"""Inputs of a graph -> largest absolute value of any tensor inside."""


@dataclass(kw_only=True)
class GraphsSeen:
    """What was seen of a network's graphs.

    Attributes:
        difference: of each set of exported files, the largest of any output.
        largest: absolute value that any tensor inside took, in single precision.
        own_s, exported_s: seconds of each call, of torch and of the first set.
    """

    difference: dict[str, float] = field(default_factory=dict)
    largest: float = 0.0
    own_s: list[float] = field(default_factory=list)
    exported_s: list[float] = field(default_factory=list)


def expose_tensors(content: bytes) -> MeasureGraph:
    """Return what runs a graph of single precision and measures every tensor in it."""
    onnx = import_onnx()
    model = onnx.load_from_string(content)
    known = {put.name for put in model.graph.output}
    for node in model.graph.node:
        for name in node.output:
            if name and name not in known:
                model.graph.output.append(onnx.ValueInfoProto(name=name))
    runtime = import_onnxruntime()
    options = runtime.SessionOptions()
    options.log_severity_level = QUIET
    session = runtime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    names = [put.name for put in session.get_inputs()]

    def measure(tensors: Tensors) -> float:
        fed = {name: tensors[name].float().contiguous().numpy() for name in names}
        made = session.run(None, fed)
        return max(float(np.abs(t).max()) for t in made if t.dtype == np.float32 and t.size)

    return measure


def follow_graphs(
    loaded: LoadedNetwork,
    exported: Mapping[str, Mapping[str, Path]],
    measures: Mapping[str, MeasureGraph],
    seen: GraphsSeen,
) -> None:
    """Let every graph of torch's network be followed by exported ones on the same inputs.

    Args:
        loaded: network of torch's layers.
        exported: name of a set -> method -> file.
        measures: method -> what measures its tensors.
        seen: what is seen goes there.
    """
    first = next(iter(exported))
    for method, measure in measures.items():
        own: Callable[[Tensors], dict[str, Tensor]] = getattr(loaded.network, method)
        runs = {name: OnnxGraph(files[method]) for name, files in exported.items()}

        def call(
            tensors: Tensors,
            own: Callable[[Tensors], dict[str, Tensor]] = own,
            runs: Mapping[str, OnnxGraph] = runs,
            measure: MeasureGraph = measure,
        ) -> dict[str, Tensor]:
            started = time.perf_counter()
            outputs = own(tensors)
            seen.own_s.append(time.perf_counter() - started)
            for name, run in runs.items():
                started = time.perf_counter()
                found = run(tensors)
                if name == first:
                    seen.exported_s.append(time.perf_counter() - started)
                apart = find_difference(outputs, found)
                seen.difference[name] = max(seen.difference.get(name, 0.0), apart)
            seen.largest = max(seen.largest, measure(tensors))
            return outputs

        replace_graph(loaded.network, method, call)


def find_difference(outputs: Tensors, found: Mapping[str, Tensor]) -> float:
    """Largest difference of any output."""
    return max(float((found[n].float() - t.float()).abs().max()) for n, t in outputs.items())
