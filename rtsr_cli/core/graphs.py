"""What of a network is exported: methods of it that take and give named tensors, and nothing else.

A system declares them; core exports any, and knows none by name. What lies around a graph (warps,
demodulation, composition) stays the code of whoever runs it: here this project's, elsewhere an
engine's, by the steps that are declared beside.

Conventions: tensors are n c h w, n = 1; rows run down. A size is (height, width) of LR pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class GraphTensor:
    """A tensor that goes in or out.

    Attributes:
        name: in the exported file.
        channels: what each holds, in order: unit, formula, sign.
        least, most: between which values usually lie; what a graph is proven with.
        single: whether it keeps single precision in a file of half precision.
    """

    name: str
    channels: tuple[str, ...]
    least: float = 0.0
    most: float = 1.0
    single: bool = False


@dataclass(frozen=True, kw_only=True)
class Graph:
    """One exported file: a method of the network, (named tensors) -> named tensors.

    Attributes:
        method: its name, and what the file is called by.
        summary: one line.
        inputs: what it takes.
        outputs: what it gives.
        multiple: LR pixels that both sides of what it takes are a multiple of.
        padding: how to fill a frame up to that, as the network itself does; empty where nothing
            that is filled up gives the same.
    """

    method: str
    summary: str
    inputs: tuple[GraphTensor, ...]
    outputs: tuple[GraphTensor, ...]
    multiple: int = 1
    padding: str = ""


@dataclass(frozen=True, kw_only=True)
class CarriedTensor:
    """What goes from one frame to the next.

    Attributes:
        name: of the input that it comes in by; of what is kept outside, a name of its own.
        made: the output, or the formula, that it is of the frame before.
        reset: what stands in where there is no such frame.
        moved: how it is brought to the frame.
    """

    name: str
    made: str
    reset: str
    moved: str


@dataclass(frozen=True, kw_only=True)
class OutsideStep:
    """What whoever runs the graphs computes.

    Attributes:
        name: of the step; a heading of docs/export.md.
        when: `before` a graph of that name, or `after`.
        formula: what it is.
    """

    name: str
    when: str
    formula: str


@dataclass(frozen=True, kw_only=True)
class NetworkGraphs:
    """Everything that is exported of a network.

    Attributes:
        graphs: the files, in the order in which they run.
        outside: steps around them, in order.
        carried: state.
        values: names of buffers of the network that steps outside read.
        facts: further values for whoever runs it, plain.
    """

    graphs: tuple[Graph, ...]
    outside: tuple[OutsideStep, ...]
    carried: tuple[CarriedTensor, ...] = ()
    values: tuple[str, ...] = ()
    facts: tuple[tuple[str, Any], ...] = ()


DescribeGraphs = Callable[[Any], NetworkGraphs]
"""`graphs(config)`: what is exported of a network of a config.

Raises:
    ConfigError: it cannot be, of this config; says why.
"""
