"""Exported networks beside torch's, on whole frames: parity, fp16's range, seconds a frame.

    python benchmarks/export_parity.py DATA [--weights fusesr-fast-4x ...] [--frames 8] [--out DIR]

Exports every shipped file of weights, fp32 and fp16, and runs the `val` sequences of DATA (its
`manifest.json` says which) three times: with torch in fp32, and with each export in place of the
network by `--runtime onnx`, each with the state that it makes itself. Printed a file of weights:

    e         largest difference of a graph's outputs, the same inputs given: log lighting, or what
              the graph gives; of fp32, of fp16
    fp32 dB,  PSNR of the frames written after c / (1 + c), of errors and tiles as they are: the
    fp16 dB   least of all frames; the last of `--frames` has as much history as there is
    largest   absolute value that any tensor inside the graphs takes; half holds 65504
    seconds   of the graphs a frame: torch, onnxruntime fp32; median of the ratios of single frames

onnxruntime's processor kernels compute fp16 graphs in fp32 and round weights, inputs and outputs;
"fp16 layers dB" is what torch makes with every layer in half precision.
With --out the exports stay there, each with a `parity.json` of these figures beside it. With all
weights, the default, the table is written into `docs/export.md`.
"""

from __future__ import annotations

import os

os.environ.setdefault("GOMP_SPINCOUNT", "0")

import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import click
import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from sections import replace_section
from tables import markdown
from torch import Tensor

from rtsr_cli import api
from rtsr_cli.core.choices import JitterMode, Precision, Runtime, SystemTask
from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.network import exported
from rtsr_cli.core.network.graphs import replace_graph
from rtsr_cli.core.network.load import LoadedNetwork
from rtsr_cli.core.network.manifest import read_manifest
from rtsr_cli.core.network.onnx_graph import OnnxGraph, import_onnxruntime
from rtsr_cli.core.network.weights import SHIPPED, read_weights
from rtsr_cli.core.system import Tensors
from rtsr_cli.models import load_system

CALLERS = (
    "rtsr_cli.core.upscale.call",
    "rtsr_cli.core.extrapolate.call",
    "rtsr_cli.core.vrs.predictor",
)
"""Modules that load networks."""

PRECISIONS = (Precision.FP32, Precision.FP16)

LAYERS = "fp16 layers dB"
"""Of torch with half layers, which shading rates have no option for."""

COLUMNS = {
    "weights": "{}",
    "e fp32": "{:.1e}",
    "e fp16": "{:.1e}",
    "fp32 dB": "{:.1f}",
    "fp16 dB": "{:.1f}",
    LAYERS: "{:.1f}",
    "largest": "{:.0f}",
    "torch s": "{:.3f}",
    "onnx s": "{:.3f}",
    "ratio": "{:.2f}",
}
"""Of the table, and how figures are written."""

PAGE = Path(__file__).resolve().parents[1] / "docs" / "export.md"


@dataclass(kw_only=True)
class Watched:
    """What was seen of a network's graphs."""

    difference: dict[Precision, float] = field(
        default_factory=lambda: dict.fromkeys(PRECISIONS, 0.0)
    )
    largest: float = 0.0
    torch_s: list[float] = field(default_factory=list)
    onnx_s: list[float] = field(default_factory=list)


def expose_tensors(path: Path) -> Callable[[Tensors], float]:
    """Return what runs a graph and gives the largest absolute value of any tensor in it."""
    model = onnx.load(str(path))
    known = {put.name for put in model.graph.output}
    for node in model.graph.node:
        for name in node.output:
            if name and name not in known:
                model.graph.output.append(onnx.ValueInfoProto(name=name))
    runtime = import_onnxruntime()
    options = runtime.SessionOptions()
    options.log_severity_level = 3
    session = runtime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    names = [put.name for put in session.get_inputs()]

    def run(tensors: Tensors) -> float:
        made = session.run(None, {name: tensors[name].contiguous().numpy() for name in names})
        return max(float(np.abs(t).max()) for t in made if t.dtype == np.float32 and t.size)

    return run


def watch_graphs(loaded: LoadedNetwork, folders: Mapping[Precision, Path], seen: Watched) -> None:
    """Let every graph of torch's network be followed by its exports on the same inputs."""
    files = {p: {f.method: f.path for f in read_manifest(d).files} for p, d in folders.items()}
    network = loaded.network
    for method in files[Precision.FP32]:
        own = getattr(network, method)
        runs = {p: OnnxGraph(files[p][method]) for p in PRECISIONS}
        measure = expose_tensors(files[Precision.FP32][method])

        def call(tensors: Tensors, own=own, runs=runs, measure=measure) -> Tensors:
            started = time.perf_counter()
            outputs = own(tensors)
            between = time.perf_counter()
            found = {Precision.FP32: runs[Precision.FP32](tensors)}
            seen.onnx_s.append(time.perf_counter() - between)
            seen.torch_s.append(between - started)
            found[Precision.FP16] = runs[Precision.FP16](tensors)
            for precision, made in found.items():
                apart = find_difference(outputs, made)
                seen.difference[precision] = max(seen.difference[precision], apart)
            seen.largest = max(seen.largest, measure(tensors))
            return outputs

        replace_graph(network, method, call)


def find_difference(outputs: Tensors, found: Mapping[str, Tensor]) -> float:
    """Largest difference of any output."""
    return max(float((found[n].float() - t.float()).abs().max()) for n, t in outputs.items())


@contextmanager
def followed(folders: Mapping[Precision, Path], seen: Watched) -> Iterator[None]:
    """Let networks that are loaded be watched."""

    def load(*given: Any) -> LoadedNetwork:
        loaded = exported.load_chosen_network(*given)
        watch_graphs(loaded, folders, seen)
        return loaded

    patches = [mock.patch(f"{caller}.load_chosen_network", load) for caller in CALLERS]
    for patch in patches:
        patch.start()
    try:
        yield
    finally:
        for patch in patches:
            patch.stop()


def run_shot(
    task: SystemTask, scale: int, folder: Path, out: Path, *, frames: int, **network: Any
) -> None:
    """Run the command of a task on a shot."""
    given = {"in_folder": folder, "out_folder": out, "frames": frozenset(range(1, frames + 1))}
    given |= {"overwrite": True, **network}
    if task is SystemTask.UPSCALE:
        request: Any = api.UpscaleRequest(simulate_lr=scale, jitter=JitterMode.HALTON, **given)
        events: Any = api.upscale(request)
    elif task is SystemTask.EXTRAPOLATE:
        events = api.extrapolate(api.ExtrapolateRequest(**given))
    else:
        given.pop("precision", None)
        events = api.predict_vrs(api.PredictVrsRequest(no_compare=True, **given))
    for event in events:
        if message := getattr(event, "message", ""):
            raise click.ClickException(message)


def read_frame(path: Path, *, shown: bool) -> NDArray[np.float64]:
    """Channels of a file, after c / (1 + c) where they are radiance."""
    channels = [c for c in read_header(path).channels if c in "RGB" or c.startswith("error")]
    planes = read_channels(path, channels)
    image = np.stack([planes[c].astype(np.float64) for c in channels])
    return image / (1.0 + image) if shown else image


def compare_outputs(expected: Path, found: Path, *, shown: bool) -> list[float]:
    """PSNR of every frame written, the others in its place being torch's."""
    values = []
    for path in sorted(expected.rglob("*.exr")):
        a, b = (read_frame(p, shown=shown) for p in (path, found / path.relative_to(expected)))
        error = float(np.mean((a - b) ** 2))
        values.append(float("inf") if error == 0 else -10.0 * np.log10(error))
    return values


def measure(name: str, shots: Sequence[Path], work: Path, frames: int) -> dict[str, Any]:
    """Export a file of weights and compare."""
    weights = read_weights(SHIPPED / f"{name}.safetensors")
    system = load_system(weights.system)
    folders = {p: work / f"{name}-{p.value}" for p in PRECISIONS}
    for precision, folder in folders.items():
        request = api.ExportRequest(
            source=name, out_folder=folder, precision=precision, overwrite=True
        )
        list(api.export(request))
    named = {"system": system.name, "weights_file": weights.path}
    ways: dict[str, dict[str, Any]] = {
        f"{p.value} dB": {"runtime": Runtime.ONNX, "model": folder} for p, folder in folders.items()
    }
    if system.task is not SystemTask.PREDICT_VRS:
        ways[LAYERS] = {**named, "precision": Precision.FP16}
    seen, found = Watched(), {way: [] for way in ways}
    run = partial(run_shot, system.task, weights.scale, frames=frames)
    with tempfile.TemporaryDirectory() as scratch:
        for i, shot in enumerate(shots):
            expected = Path(scratch) / str(i) / "torch"
            with followed(folders, seen):
                run(shot, expected, precision=Precision.FP32, **named)
            for way, given in ways.items():
                run(shot, expected.parent / way, **given)
                shown = system.task is not SystemTask.PREDICT_VRS
                found[way] += compare_outputs(expected, expected.parent / way, shown=shown)
    figures = describe(name, seen, frames * len(shots))
    figures |= {way: min(values) for way, values in found.items()}
    for folder in folders.values():
        (folder / "parity.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return figures


def describe(name: str, seen: Watched, frames: int) -> dict[str, Any]:
    """The figures of a network's graphs."""
    ratios = [a / b for a, b in zip(seen.onnx_s, seen.torch_s, strict=True)]
    return {
        "weights": name,
        "e fp32": seen.difference[Precision.FP32],
        "e fp16": seen.difference[Precision.FP16],
        "largest": seen.largest,
        "torch s": sum(seen.torch_s) / frames,
        "onnx s": sum(seen.onnx_s) / frames,
        "ratio": statistics.median(ratios),
    }


def list_val(data: Path) -> list[Path]:
    """Folders of the `val` sequences."""
    known = json.loads((data / "manifest.json").read_text(encoding="utf-8"))["sequences"]
    return [data / s["scene"] / s["sequence"] for s in known if s["split"] == "val"]


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--weights", "names", multiple=True, help="Names of shipped files; all by default.")
@click.option("--frames", default=8, show_default=True)
@click.option("--threads", default=os.cpu_count(), show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Where the exports stay.")
def main(
    *, data: Path, names: tuple[str, ...], frames: int, threads: int, out: Path | None
) -> None:
    """Print the table."""
    torch.set_num_threads(threads)
    shots = list_val(data)
    chosen = names or tuple(sorted(path.stem for path in SHIPPED.glob("*.safetensors")))
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in chosen:
            figures = measure(name, shots, out or Path(scratch), frames)
            rows.append(write_row(figures))
            click.echo(", ".join(f"{c} {v}" for c, v in zip(COLUMNS, rows[-1], strict=True)))
    if not names:
        replace_section(PAGE, "parity", markdown(list(COLUMNS), rows))


def write_row(figures: Mapping[str, Any]) -> list[str]:
    """Figures of a file of weights as cells."""
    return [form.format(figures[c]) if c in figures else "-" for c, form in COLUMNS.items()]


if __name__ == "__main__":
    main()
