"""A graph of a network as an ONNX model: traced by torch, made plain, in the operators' version.

Conventions: a frame consists of cells, as large as its sides have to be multiples of; a tensor's
side is a factor times their number, and only that number is free while a graph is traced.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from rtsr_cli import __version__
from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.graphs import Graph
from rtsr_cli.core.marks import MARK
from rtsr_cli.core.network.graphs import RecordedCall
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.wording import join_names

LIBRARIES = ("onnx", "onnxscript", "onnxruntime")
"""Of the extra `export`; torch's exporter asks for the second."""

TRACED_OPSET = 18
"""Of torch's exporter."""

IR_VERSIONS = {15: 7, 18: 8}
"""Version of the file format by that of the operators: of the oldest runtimes that have these."""

MOST_CELLS = 1 << 14

EQUAL_SINCE = {"LeakyRelu": 6, "Pad": 13, "ReduceMean": 13, "Resize": 13, "Split": 13}
"""Operators of opset 18 whose form of another version is the same but for what `lower` changes."""

PAD_INPUTS = 3
"""Of opset 15's Pad: data, widths, value."""

NEWER_ATTRIBUTES = {
    "Resize": ("antialias", "axes", "keep_aspect_ratio_policy"),
    "Split": ("num_outputs",),
}
"""Attributes that opset 15 has not: those of default value, and what follows from the outputs."""


@dataclass(frozen=True, kw_only=True)
class TracedSizes:
    """Sizes of the tensors of a graph while it is traced.

    Attributes:
        cells: (rows, columns) of the frame that was recorded.
        lr_cell: LR pixels of a cell's side.
        dynamic: whether the model takes any number of cells.
    """

    cells: Size
    lr_cell: int
    dynamic: bool

    def find_factors(self, tensor: Tensor) -> tuple[int, int]:
        """Pixels of a cell's sides."""
        rows, columns = self.cells
        return tensor.shape[2] // rows, tensor.shape[3] // columns

    def name_sides(self, tensor: Tensor) -> tuple[str | int, str | int]:
        """Height and width, as numbers or by those of the LR frame, h and w."""
        if not self.dynamic:
            return tensor.shape[2], tensor.shape[3]
        down, across = self.find_factors(tensor)
        return _name_side(down, self.lr_cell, "h"), _name_side(across, self.lr_cell, "w")


def _name_side(factor: int, lr_cell: int, letter: str) -> str:
    if factor % lr_cell == 0:
        return letter if factor == lr_cell else f"{factor // lr_cell}*{letter}"
    return f"{letter}/{lr_cell // factor}"


def import_onnx() -> Any:
    """Import the libraries of the extra `export`.

    Raises:
        ConfigError: they are not installed; names all that are not, and how they get there.
    """
    missing = [name for name in LIBRARIES if importlib.util.find_spec(name) is None]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise ConfigError(f"{join_names(missing)} {verb} not installed: pip install 'rtsr[export]'")
    return importlib.import_module("onnx")


class _GraphModule(nn.Module):
    """A graph of a network as a module of tensors in order."""

    def __init__(self, network: nn.Module, graph: Graph) -> None:
        super().__init__()
        self.network = network
        self._graph = graph

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        named = {put.name: t for put, t in zip(self._graph.inputs, tensors, strict=True)}
        made = getattr(self.network, self._graph.method)(named)
        return tuple(made[put.name] for put in self._graph.outputs)


def trace_graph(
    network: nn.Module,
    graph: Graph,
    call: RecordedCall,
    *,
    sizes: TracedSizes,
    half: bool,
    opset: int,
) -> Any:
    """Make a model of a graph.

    Args:
        network: in eval mode, on the processor, of single precision; of half precision after,
            where that is asked for.
        graph: of it.
        call: what went in and out of it on a frame.
        sizes: of that frame.
        half: of half precision.
        opset: 15 or 18.

    Returns:
        ONNX' ModelProto, without traces of the machine that made it.

    Raises:
        ConfigError: the extra is not installed.
        CheckpointError: an operator has no form in that opset.
    """
    onnx = import_onnx()
    inputs = {
        put.name: _cast(call.inputs[put.name], half and not put.single) for put in graph.inputs
    }
    module = _GraphModule(network.half() if half else network, graph).eval()
    with _quiet():
        program = torch.onnx.export(
            module,
            tuple(inputs.values()),
            dynamo=True,
            opset_version=TRACED_OPSET,
            input_names=list(inputs),
            output_names=[put.name for put in graph.outputs],
            dynamic_shapes=(_list_dynamic(inputs, sizes),) if sizes.dynamic else None,
            verbose=False,
            external_data=False,
        )
    assert program is not None
    model = program.model_proto
    _make_plain(model, onnx)
    if opset < TRACED_OPSET:
        lower_opset(model, graph.method, opset, onnx)
    model.ir_version = IR_VERSIONS[opset]
    _name_sizes(model, {**call.inputs, **call.outputs}, sizes)
    onnx.checker.check_model(model)
    return model


def _cast(tensor: Tensor, half: bool) -> Tensor:
    return tensor.clone().half() if half else tensor.clone().float()


def _list_dynamic(inputs: Mapping[str, Tensor], sizes: TracedSizes) -> tuple[Any, ...]:
    """Which sides vary, as multiples of the cells."""
    rows, columns = (torch.export.Dim(n, min=2, max=MOST_CELLS) for n in ("rows", "columns"))

    def multiply(cells: Any, factor: int) -> Any:
        return cells if factor == 1 else factor * cells

    factors = (sizes.find_factors(tensor) for tensor in inputs.values())
    return tuple({2: multiply(rows, d), 3: multiply(columns, a)} for d, a in factors)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep to itself what torch's exporter says of its own libraries."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)


def _make_plain(model: Any, onnx: Any) -> None:
    """Drop what tells of the machine, what others infer anew, and attributes of default value."""
    graph = model.graph
    del graph.value_info[:]
    for part in (model, graph, *graph.node, *graph.input, *graph.output, *graph.initializer):
        del part.metadata_props[:]
        part.doc_string = ""
    for node in graph.node:
        kept = [a for a in node.attribute if not _says_nothing(node, a, onnx)]
        del node.attribute[:]
        node.attribute.extend(kept)
    graph.name = "rtsr"
    model.producer_name, model.producer_version = "rtsr", __version__
    mark = model.metadata_props.add()
    mark.key, mark.value = MARK, __version__


def _says_nothing(node: Any, attribute: Any, onnx: Any) -> bool:
    """Tell whether an attribute changes nothing."""
    value = onnx.helper.get_attribute_value(attribute)
    known = onnx.defs.get_schema(node.op_type, TRACED_OPSET).attributes.get(attribute.name)
    default = known.default_value if known is not None else None
    if default is not None and default.type and onnx.helper.get_attribute_value(default) == value:
        return True
    pads = [a for a in node.attribute if a.name == "pads"]
    unpadded = all(not any(onnx.helper.get_attribute_value(a)) for a in pads)
    return (attribute.name == "dilations" and set(value) == {1}) or (
        attribute.name == "count_include_pad" and unpadded
    )


def lower_opset(model: Any, name: str, opset: int, onnx: Any) -> None:
    """Write operators of opset 18 in the form of an older one.

    Raises:
        CheckpointError: one has none; says what is left.
    """
    constants = {tensor.name: tensor for tensor in model.graph.initializer}
    for node in model.graph.node:
        since = [onnx.defs.get_schema(node.op_type, v).since_version for v in (18, opset)]
        # padding of chosen axes came with opset 18
        newer = node.op_type == "Pad" and len(node.input) > PAD_INPUTS
        if newer or (since[0] != since[1] and EQUAL_SINCE.get(node.op_type) != since[1]):
            raise CheckpointError(
                f"{name}: operator {node.op_type} has no form of opset {opset}; --opset 18 writes "
                "files that onnxruntime takes from 1.14 on, and Unity does not; for opset "
                f"{opset}, try sides of other multiples (--size), or none"
            )
        for attribute in list(node.attribute):
            if attribute.name in NEWER_ATTRIBUTES.get(node.op_type, ()):
                node.attribute.remove(attribute)
        if node.op_type == "ReduceMean" and len(node.input) > 1:
            axes = onnx.numpy_helper.to_array(constants[node.input[1]])
            del node.input[1:]
            node.attribute.append(onnx.helper.make_attribute("axes", [int(a) for a in axes]))
    _drop_unused(model)
    model.opset_import[0].version = opset


def _drop_unused(model: Any) -> None:
    used = {name for node in model.graph.node for name in node.input}
    unused = [tensor for tensor in model.graph.initializer if tensor.name not in used]
    for tensor in unused:
        model.graph.initializer.remove(tensor)


def _name_sizes(model: Any, tensors: Mapping[str, Tensor], sizes: TracedSizes) -> None:
    """Write the sides of what goes in and out by those of the LR frame."""
    puts: Sequence[Any] = [*model.graph.input, *model.graph.output]
    for put in puts:
        for place, side in zip((2, 3), sizes.name_sides(tensors[put.name]), strict=True):
            dim = put.type.tensor_type.shape.dim[place]
            dim.Clear()
            if isinstance(side, int):
                dim.dim_value = side
            else:
                dim.dim_param = side
