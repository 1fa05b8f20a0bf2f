"""A small system whose network is one graph, traced in a moment."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
import torch
import torch.nn.functional as F
from torch import nn

from rtsr_cli.core.graphs import Graph, GraphTensor
from rtsr_cli.core.network.graphs import RecordedCall
from rtsr_cli.core.system import Tensors

SMALL, LARGE = (20, 28), (80, 112)
"""Sides of 5 x 7 cells of 4 pixels, and four times them."""


class Enlarger(nn.Module):
    """Every operator whose form differs between opsets, on two sizes."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.first = nn.Conv2d(3, 8, 3, padding=1)
        self.last = nn.Conv2d(8, 16, 3, padding=1)

    def enlarge(self, tensors: Tensors) -> Tensors:
        features = F.leaky_relu(self.first(tensors["small"]), 0.2)
        left, right = features.chunk(2, dim=1)
        features = torch.cat([left * right.mean((2, 3), keepdim=True), left], dim=1)
        halved = F.max_pool2d(F.avg_pool2d(features, 2), 2)
        features = features + F.interpolate(halved, scale_factor=4.0, mode="nearest")
        return {"large": F.pixel_shuffle(self.last(features), 4) + tensors["base"]}


@dataclass(frozen=True, kw_only=True)
class Traced:
    """A network, its graph, and what went in and out."""

    network: Any
    graph: Graph
    call: RecordedCall


def make_graph(least: float = 0.0) -> Graph:
    large = GraphTensor(name="large", channels=("value",))
    return Graph(
        method="enlarge",
        summary="four times the size",
        inputs=(
            GraphTensor(name="small", channels=("r", "g", "b"), least=least),
            GraphTensor(name="base", channels=("value",), single=True),
        ),
        outputs=(large,),
        multiple=4,
    )


@pytest.fixture(scope="session")
def traced() -> Traced:
    """A network and its graph, where the extra is installed."""
    for library in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(library, reason="the extra export is not installed")
    network = Enlarger().eval().requires_grad_(False)
    inputs = {"small": torch.rand(1, 3, *SMALL), "base": torch.rand(1, 1, *LARGE)}
    call = RecordedCall(inputs=inputs, outputs=network.enlarge(inputs))
    return Traced(network=network, graph=make_graph(), call=call)


@pytest.fixture(scope="session")
def trace(traced: Traced) -> Callable[..., Any]:
    """Models of it; each is traced once."""
    from rtsr_cli.core.export.onnx_model import TracedSizes, trace_graph

    known: dict[tuple[Any, ...], Any] = {}

    def make(*, dynamic: bool = True, half: bool = False, opset: int = 15, anew: int = 0) -> Any:
        key = (dynamic, half, opset, anew)
        if key not in known:
            sizes = TracedSizes(cells=(5, 7), lr_cell=4, dynamic=dynamic)
            network = copy.deepcopy(traced.network)
            known[key] = trace_graph(
                network, traced.graph, traced.call, sizes=sizes, half=half, opset=opset
            )
        return copy.deepcopy(known[key])

    return make
