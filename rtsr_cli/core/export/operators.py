"""Which operators runtimes document, and the check that an exported graph has no others.

Each list is what the named document says; what a runtime takes beyond it is not relied upon.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rtsr_cli.core.errors import CheckpointError


@dataclass(frozen=True, kw_only=True)
class DocumentedRuntime:
    """What a runtime says that it takes.

    Attributes:
        name: of the runtime.
        source: the document.
        operators: it lists.
        unsupported: operator -> attributes that it says are not.
    """

    name: str
    source: str
    operators: frozenset[str]
    unsupported: Mapping[str, frozenset[str]]


OPERATORS = frozenset(
    {
        "Abs",
        "Add",
        "AveragePool",
        "BatchNormalization",
        "Cast",
        "Clip",
        "Concat",
        "Conv",
        "ConvTranspose",
        "DepthToSpace",
        "Div",
        "Exp",
        "Expand",
        "Floor",
        "GlobalAveragePool",
        "GlobalMaxPool",
        "GridSample",
        "Identity",
        "LeakyRelu",
        "Log",
        "Max",
        "MaxPool",
        "Mean",
        "Min",
        "Mul",
        "Neg",
        "Pad",
        "Pow",
        "PRelu",
        "Reciprocal",
        "ReduceMax",
        "ReduceMean",
        "ReduceMin",
        "ReduceSum",
        "Relu",
        "Reshape",
        "Resize",
        "Shape",
        "Sigmoid",
        "Slice",
        "Softplus",
        "SpaceToDepth",
        "Split",
        "Sqrt",
        "Squeeze",
        "Sub",
        "Sum",
        "Tanh",
        "Tile",
        "Transpose",
        "Unsqueeze",
        "Where",
    }
)
"""Of images, which both documents list; neither a runtime nor this project needs more of them."""

UNREAL = DocumentedRuntime(
    name="Unreal NNERuntimeORT (onnxruntime, DirectML)",
    source="github.com/microsoft/onnxruntime, docs/OperatorKernels.md, DmlExecutionProvider; "
    "float and float16 images",
    operators=OPERATORS,
    unsupported={},
)

UNITY = DocumentedRuntime(
    name="Unity Inference Engine",
    source="com.unity.ai.inference, Supported ONNX operators: BackendType.GPUCompute, float",
    operators=OPERATORS,
    unsupported={
        "AveragePool": frozenset({"ceil_mode", "count_include_pad"}),
        "BatchNormalization": frozenset({"momentum", "spatial", "training_mode"}),
        "ConvTranspose": frozenset({"dilations", "group", "output_shape"}),
        "MaxPool": frozenset({"ceil_mode", "dilations", "storage_order"}),
        "Resize": frozenset({"cubic_coeff_a", "exclude_outside", "extrapolation_value"}),
    },
)

RUNTIMES = (UNREAL, UNITY)
"""Those that every exported graph has to suit."""


def check_operators(model: Any, name: str) -> tuple[str, ...]:
    """Hold a graph to operators and attributes that every runtime documents.

    Args:
        model: ONNX' ModelProto, attributes of default values left out.
        name: of the graph, for the message.

    Returns:
        Names of its operators, sorted.

    Raises:
        CheckpointError: it has others; names them and the runtime.
    """
    for runtime in RUNTIMES:
        faults = sorted({fault for node in model.graph.node for fault in _find(node, runtime)})
        if faults:
            raise CheckpointError(
                f"{name}: {', '.join(faults)}: not documented by {runtime.name} ({runtime.source})"
            )
    return tuple(sorted({node.op_type for node in model.graph.node}))


def _find(node: Any, runtime: DocumentedRuntime) -> list[str]:
    if node.domain not in {"", "ai.onnx"}:
        return [f"{node.domain}.{node.op_type}"]
    if node.op_type not in runtime.operators:
        return [node.op_type]
    refused = runtime.unsupported.get(node.op_type, frozenset())
    return [f"{node.op_type}.{a.name}" for a in node.attribute if a.name in refused]
