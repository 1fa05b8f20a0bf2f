"""What `manifest.json` and `report.json` of an export say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256
from typing import Any

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.export.exported_graph import ExportedGraph, describe_tensor
from rtsr_cli.core.export.frame_proof import LEAST_DB, FrameProof
from rtsr_cli.core.export.onnx_model import IR_VERSIONS
from rtsr_cli.core.export.operators import RUNTIMES
from rtsr_cli.core.export.proof import DRAWS, MOST_DIFFERENCE, SEED
from rtsr_cli.core.export.request import ExportRequest
from rtsr_cli.core.export.source import ExportSource
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.marks import MARKED
from rtsr_cli.core.network.manifest import CHECKSUM, FORMAT, sum_manifest
from rtsr_cli.core.network.weights import find_margin
from rtsr_cli.core.settings import to_plain

OLDEST_ONNXRUNTIME = {15: "1.9", 18: "1.14"}
"""First release with an opset [onnxruntime, docs/Versioning.md]."""

HALF_ON_PROCESSORS = (
    ", whose kernels compute graphs of half precision in single between rounded weights, inputs "
    "and outputs: no overflow shows in the difference, and largest_inside tells of it"
)

NO_FRAMES = "none were run; --frames-of IN gives figures of whole frames"

CONVENTIONS = {
    "tensors": "n c h w, n = 1, rows run down; h and w are sides of the LR frame",
    "radiance": "linear, scene-referred, Rec. 709 primaries",
    "motion": "(dx, dy), x right, y down, pixels of its own frame; previous position = position + "
    "motion; surface motion without jitter, to which jitter(now) - jitter(before) is added",
    "jitter": "sample position minus pixel centre, pixels of its own frame, x right, y down",
    "depth": "z, distance along the view axis, metres",
    "normal": "world space, unit length; 0 on sky",
    "roughness": "perceptual: GGX alpha = roughness^2",
    "logarithm": "natural",
}
"""Of all inputs; the steps are docs/export.md's."""


def describe_export(
    request: ExportRequest, source: ExportSource, graphs: Sequence[ExportedGraph]
) -> dict[str, Any]:
    """What the manifest says."""
    facts = _list_facts(request, source, graphs)
    return {**facts, CHECKSUM: sum_manifest(facts)}


def _list_facts(
    request: ExportRequest, source: ExportSource, graphs: Sequence[ExportedGraph]
) -> dict[str, Any]:
    weights, declared = source.weights, source.graphs
    width_height = None if request.size is None else list(reversed(request.size))
    return {
        **MARKED,
        "format": FORMAT,
        "system": source.system.name,
        "summary": source.system.summary,
        "citation": source.system.citation,
        "task": source.system.task.value,
        "scale": source.scale,
        "config": to_plain(source.config),
        "weights": {
            "file": weights.path.name,
            "sha256": sha256(weights.path.read_bytes()).hexdigest(),
            "about": dict(weights.about),
        },
        "precision": request.precision.value,
        "opset": request.opset,
        "ir_version": IR_VERSIONS[request.opset],
        "oldest_onnxruntime": OLDEST_ONNXRUNTIME[request.opset],
        "documented_by": {runtime.name: runtime.source for runtime in RUNTIMES},
        "size": width_height,
        "conventions": CONVENTIONS,
        "graphs": [_describe_graph(graph) for graph in graphs],
        "state": [asdict(carried) for carried in declared.carried],
        "outside": [asdict(step) for step in declared.outside],
        "values": {
            name: source.network.get_buffer(name).flatten().tolist() for name in declared.values
        },
        "facts": dict(declared.facts) | _describe_margin(source),
        "report": "report.json",
    }


def _describe_frames(request: ExportRequest, frames: FrameProof) -> dict[str, Any]:
    """What the report says of whole frames."""
    half = request.precision is Precision.FP16
    return {
        "of": None if request.frames_of is None else request.frames_of.name,
        "count": frames.frames,
        "least_db": frames.least_db,
        "allowed_db": LEAST_DB[half],
        "difference": frames.difference,
        "largest_inside": frames.largest,
        "compared": "frames written by torch in single precision and with these files, each with "
        "its own state: PSNR after c / (1 + c) where they are radiance, 200 where they are equal; "
        "difference of the graphs' outputs and largest value inside on torch's inputs",
    }


def _describe_margin(source: ExportSource) -> dict[str, float]:
    """What is added to predicted errors before they are transformed back."""
    return {} if source.system.tiles is None else {"margin": find_margin(source.weights.about)}


def _describe_graph(exported: ExportedGraph) -> dict[str, Any]:
    graph = exported.graph
    return {
        "method": graph.method,
        "file": exported.file,
        "sha256": sha256(exported.content).hexdigest(),
        "summary": graph.summary,
        "multiple": graph.multiple,
        "padding": graph.padding,
        "inputs": [describe_tensor(tensor, exported) for tensor in graph.inputs],
        "outputs": [describe_tensor(tensor, exported) for tensor in graph.outputs],
        "operators": list(exported.operators),
    }


def describe_proofs(
    request: ExportRequest, graphs: Sequence[ExportedGraph], frames: FrameProof | None
) -> dict[str, Any]:
    """What the report says."""
    half = request.precision is Precision.FP16
    return {
        **MARKED,
        "compared": f"onnxruntime's output with torch's in single precision, {DRAWS} random "
        f"inputs (seed {SEED}) of the ranges below, largest difference; relative where values are "
        "above 1",
        "runtime": "onnxruntime on the processor" + (HALF_ON_PROCESSORS if half else ""),
        "allowed": MOST_DIFFERENCE[half],
        "half_holds": MAX_HALF,
        "frames": NO_FRAMES if frames is None else _describe_frames(request, frames),
        "graphs": {
            exported.file: {
                "inputs": {put.name: [put.least, put.most] for put in exported.graph.inputs},
                "difference": dict(exported.proof.difference),
                "largest_output": dict(exported.proof.largest),
                "largest_inside": exported.proof.inside,
            }
            for exported in graphs
        },
    }
