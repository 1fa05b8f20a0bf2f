"""Proving a graph's file: what it gives on random inputs, beside what the network gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.export.followed_graphs import MeasureGraph
from rtsr_cli.core.export.frame_proof import require_half_holds
from rtsr_cli.core.graphs import Graph
from rtsr_cli.core.network.onnx_graph import OnnxGraph

DRAWS = 3
"""Random inputs that a file is held against."""

SEED = 0
"""Of the draws."""

MOST_DIFFERENCE = {False: 1e-4, True: 5e-2}
"""Of an output's values beyond 1 relative to them, of single and of half precision."""


@dataclass(frozen=True, kw_only=True)
class GraphProof:
    """How far a file is from the network.

    Attributes:
        difference: largest, of each output; relative where values are above 1.
        largest: absolute value that an output took.
        inside: largest absolute value of any tensor in the graph, in single precision.
    """

    difference: Mapping[str, float]
    largest: Mapping[str, float]
    inside: float


def prove_graph(
    network: nn.Module,
    graph: Graph,
    model: Any,
    shapes: Mapping[str, Tensor],
    *,
    half: bool,
    measure: MeasureGraph,
) -> GraphProof:
    """Hold a file to give what the network gives.

    Args:
        network: of single precision.
        graph: of it.
        model: ONNX' ModelProto.
        shapes: tensors of the shapes of the graph's inputs.
        half: whether the model is of half precision.
        measure: what measures the tensors of the same graph in single precision.

    Raises:
        CheckpointError: it does not; says by how much, and what to do.
    """
    exported = OnnxGraph(model.SerializeToString())
    generator = torch.Generator().manual_seed(SEED)
    difference = dict.fromkeys((put.name for put in graph.outputs), 0.0)
    largest, inside = dict(difference), 0.0
    for _ in range(DRAWS):
        drawn = {
            put.name: torch.rand(shapes[put.name].shape, generator=generator)
            * (put.most - put.least)
            + put.least
            for put in graph.inputs
        }
        with torch.inference_mode():
            expected = getattr(network, graph.method)(drawn)
        found, inside = exported(drawn), max(inside, measure(drawn))
        for name in difference:
            wanted = expected[name].float()
            apart = (found[name] - wanted).abs() / wanted.abs().clamp(min=1.0)
            difference[name] = max(difference[name], float(apart.max()))
            largest[name] = max(largest[name], float(wanted.abs().max()))
    require_half_holds(inside, half=half, where="on random inputs")
    worst = max(difference.values())
    # not a number is worse than any
    if not worst <= MOST_DIFFERENCE[half]:
        remedy = (
            f"half precision has too few digits for these weights, whose values reach {inside:.3g} "
            "inside: export --precision fp32"
            if half
            else f"values inside reach {inside:.3g}; train other weights where that is extreme, "
            "else please report it"
        )
        raise CheckpointError(
            f"{graph.method}: the exported graph is {worst:.2g} from the network, more than "
            f"{MOST_DIFFERENCE[half]:g}; {remedy}"
        )
    return GraphProof(difference=difference, largest=largest, inside=inside)
