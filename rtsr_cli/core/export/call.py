"""`export`: from weights to ONNX files, a manifest, and a report of the proof."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.export.exported_graph import ExportedGraph, export_graphs
from rtsr_cli.core.export.frame_proof import FrameProof, FrameRun, RunFrames, prove_on_frames
from rtsr_cli.core.export.manifest_facts import describe_export, describe_proofs
from rtsr_cli.core.export.onnx_model import import_onnx
from rtsr_cli.core.export.operators import RUNTIMES
from rtsr_cli.core.export.proof import GraphProof
from rtsr_cli.core.export.request import ExportRequest
from rtsr_cli.core.export.source import ExportSource, load_source
from rtsr_cli.core.files.atomic_write import check_writable, write_atomically, write_text_atomically
from rtsr_cli.core.network.manifest import MANIFEST
from rtsr_cli.core.network.onnx_graph import import_onnxruntime
from rtsr_cli.core.system import System

REPORT = "report.json"


@dataclass(frozen=True, kw_only=True)
class GraphWritten:
    """A graph's file is there.

    Attributes:
        path: of it.
        operators: that it has.
        proof: how far it is from the network.
    """

    path: Path
    operators: tuple[str, ...]
    proof: GraphProof


@dataclass(frozen=True, kw_only=True)
class ExportDone:
    """The summary.

    Attributes:
        system: name.
        scale: S.
        manifest: path.
        report: path.
        runtimes: that document every operator.
        frames: what whole frames proved; None where none were run.
    """

    system: str
    scale: int
    manifest: Path
    report: Path
    runtimes: tuple[str, ...]
    frames: FrameProof | None


ExportEvent = GraphWritten | ExportDone


def export_network(
    request: ExportRequest, load: Callable[[str], System], run: RunFrames
) -> Iterator[ExportEvent]:
    """Trace and prove every graph of a network, then write all files, the manifest last.

    Args:
        request: what is asked for.
        load: name -> system.
        run: runs frames, where some are asked for.

    Yields:
        Every graph's file, then the summary.

    Raises:
        RtsrError: there is nothing to export, the extra is not installed, a file is in the way, or
            what was exported is not the network.
    """
    import_onnx()
    import_onnxruntime()
    source, folder = load_source(request, load), request.out_folder
    files = [source.name_file(graph.method) for graph in source.graphs.graphs]
    refuse_existing(folder, (*files, MANIFEST, REPORT), overwrite=request.overwrite)
    check_writable(folder)
    graphs = export_graphs(request, source)
    frames = None if request.frames_of is None else _prove_frames(request, source, graphs, run)
    for graph in graphs:
        write_bytes_atomically(folder / graph.file, graph.content)
        yield GraphWritten(path=folder / graph.file, operators=graph.operators, proof=graph.proof)
    write_json_atomically(folder / REPORT, describe_proofs(request, graphs, frames))
    write_json_atomically(folder / MANIFEST, describe_export(request, source, graphs))
    yield ExportDone(
        system=source.system.name,
        scale=source.scale,
        manifest=folder / MANIFEST,
        report=folder / REPORT,
        runtimes=tuple(runtime.name for runtime in RUNTIMES),
        frames=frames,
    )


def _prove_frames(
    request: ExportRequest,
    source: ExportSource,
    graphs: Sequence[ExportedGraph],
    run: RunFrames,
) -> FrameProof:
    """Run whole frames with the files before any is written where it is asked for."""
    assert request.frames_of is not None
    with tempfile.TemporaryDirectory() as scratch:
        model = Path(scratch)
        for graph in graphs:
            write_bytes_atomically(model / graph.file, graph.content)
        write_json_atomically(model / MANIFEST, describe_export(request, source, graphs))
        given = FrameRun(
            task=source.system.task,
            system=source.system.name,
            scale=source.scale,
            in_folder=request.frames_of,
            out_folder=model,
            frames=request.proof_frames,
            weights=source.weights.path,
            model=model,
        )
        measures = {graph.graph.method: graph.measure for graph in graphs}
        half = request.precision is Precision.FP16
        return prove_on_frames(run, given, measures, half=half)


def refuse_existing(folder: Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse before anything is computed.

    Raises:
        OutputError: a file is in the way.
    """
    there = [folder / name for name in names if os.path.lexists(folder / name)]
    if there and not overwrite:
        raise OutputError(
            f"{there[0]} exists; choose another folder, or give --overwrite to replace it"
        )


def write_bytes_atomically(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all.

    Raises:
        OutputError: it cannot be written; names the file.
    """

    def write(part: Path) -> None:
        part.write_bytes(content)

    write_atomically(path, write)


def write_json_atomically(path: Path, facts: dict[str, Any]) -> None:
    """Write facts, whole or not at all.

    Raises:
        OutputError: they cannot be written; names the file.
    """
    write_text_atomically(path, json.dumps(facts, indent=2) + "\n")
