"""The graphs of a network as functions: seen while they are called, and put in their place.

A network calls its graphs as methods of its own, so that another function may stand there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from rtsr_cli.core.graphs import NetworkGraphs
from rtsr_cli.core.network.cost import make_uniform_window
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import System, Tensors

GraphCall = Callable[[Tensors], Tensors]
"""(named tensors) -> named tensors."""


@dataclass(frozen=True, kw_only=True)
class RecordedCall:
    """What went in and out of a graph."""

    inputs: Mapping[str, Tensor]
    outputs: Mapping[str, Tensor]


def is_exporting() -> bool:
    """Tell whether a graph is traced for export: it knows no sizes then, and needs no strips."""
    return bool(torch.compiler.is_exporting())


def is_replaced(network: nn.Module, method: str) -> bool:
    """Tell whether a graph is watched or replaced; a network need not call it as one else."""
    return method in vars(network)


def replace_graph(network: nn.Module, method: str, call: GraphCall) -> None:
    """Let another function stand for a graph of a network.

    Args:
        network: that calls its graphs as methods.
        method: name of the graph.
        call: what stands there.
    """
    # a method is looked up on the instance first
    object.__setattr__(network, method, call)


@contextmanager
def record_graphs(network: nn.Module, graphs: NetworkGraphs) -> Iterator[dict[str, RecordedCall]]:
    """Record the first call of each graph while a network runs."""
    calls: dict[str, RecordedCall] = {}

    def watch(method: str) -> GraphCall:
        own: GraphCall = getattr(network, method)

        def call(tensors: Tensors) -> Tensors:
            outputs = own(tensors)
            calls.setdefault(method, RecordedCall(inputs=dict(tensors), outputs=dict(outputs)))
            return outputs

        return call

    methods = [graph.method for graph in graphs.graphs]
    watched = {method: watch(method) for method in methods}
    for method, call in watched.items():
        replace_graph(network, method, call)
    try:
        yield calls
    finally:
        for method in methods:
            object.__delattr__(network, method)


def record_uniform_frame(
    system: System, network: nn.Module, graphs: NetworkGraphs, scale: int, size: Size
) -> dict[str, RecordedCall]:
    """Record what goes in and out of a network's graphs on a uniform frame of a size.

    Args:
        system: whose network it is.
        network: in eval mode, on the processor.
        graphs: of it.
        scale: S.
        size: (height, width) of the LR frame.
    """
    with torch.inference_mode(), record_graphs(network, graphs) as calls:
        system.predict(network, make_uniform_window(system, scale, size), None)
    return calls
