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
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import click
import torch
from sections import replace_section
from tables import markdown

from rtsr_cli import api
from rtsr_cli.core.choices import JitterMode, Precision, Runtime, SystemTask
from rtsr_cli.core.export.followed_graphs import GraphsSeen, expose_tensors, follow_graphs
from rtsr_cli.core.export.frame_proof import compare_outputs
from rtsr_cli.core.network.exported import observe_networks
from rtsr_cli.core.network.manifest import read_manifest
from rtsr_cli.core.network.weights import SHIPPED, read_weights
from rtsr_cli.models import load_system

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


def follow(folders: Mapping[Precision, Path], seen: GraphsSeen) -> AbstractContextManager[None]:
    """Let networks that are loaded be followed by their exports."""
    files = {p.value: {f.method: f.path for f in read_manifest(d).files}
             for p, d in folders.items()}  # fmt: skip
    single = files[Precision.FP32.value]
    measures = {method: expose_tensors(path.read_bytes()) for method, path in single.items()}
    return observe_networks(lambda loaded: follow_graphs(loaded, files, measures, seen))


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
    seen = GraphsSeen()
    found: dict[str, list[float]] = {way: [] for way in ways}
    run = partial(run_shot, system.task, weights.scale, frames=frames)
    with tempfile.TemporaryDirectory() as scratch:
        for i, shot in enumerate(shots):
            expected = Path(scratch) / str(i) / "torch"
            with follow(folders, seen):
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


def describe(name: str, seen: GraphsSeen, frames: int) -> dict[str, Any]:
    """The figures of a network's graphs."""
    ratios = [a / b for a, b in zip(seen.exported_s, seen.own_s, strict=True)]
    return {
        "weights": name,
        "e fp32": seen.difference[Precision.FP32.value],
        "e fp16": seen.difference[Precision.FP16.value],
        "largest": seen.largest,
        "torch s": sum(seen.own_s) / frames,
        "onnx s": sum(seen.exported_s) / frames,
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
