"""Systems that see no buffers at the target size, on sequences that no network is trained on.

    python benchmarks/supersampling.py DATA [--weights FILE] [--lpips] [--classes]

2x, `--simulate-lr 2 --samples-per-pixel 2 --jitter halton`: the reference is the mean of 2 x 2
samples a pixel. Judged are the `val` and `test` sequences of DATA from their fourth frame on: PSNR
after c / (1 + c) of all pixels and of disoccluded ones, which are those that `label --kind cgts`
marks as visibility ghosting and that were in the frame before; FLIP and temporal errors as `rtsr
evaluate` has them. `oracle` is what the weights of `cgts` could reach: each pixel takes the weight
of the frame against its history that comes nearest to the truth.
`--classes` adds how often the classifier is right: F1 of each class, strictly and with labels and
predictions within one pixel of each other, macro-F1 beside that of taking the commonest class
always, and the confusion of classes. `truth before` is the truth of the frame before, fetched along
the motion as history is, and the frame's own colour where it comes from outside: how well a history
without fault would do alone.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch
from ablations import judged_sequences
from numpy.typing import NDArray
from results import rtsr
from torch import Tensor
from torch.nn import functional

from rtsr_cli.core.choices import JitterMode, NonfinitePolicy
from rtsr_cli.core.files.exr import read_channels, write_exr
from rtsr_cli.core.frames.storage import split_image
from rtsr_cli.core.imaging.auxiliary_buffers import span_colors
from rtsr_cli.core.imaging.color import decode_reinhard, encode_reinhard
from rtsr_cli.core.imaging.pixel_classes import Aliasing, Ghosting
from rtsr_cli.core.imaging.warping import inside_frame
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.run.system_inputs import resolve_system_inputs
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.models import load_system
from rtsr_cli.models.cgts.config import CgtsConfig
from rtsr_cli.models.cgts.inputs import CgtsState, carry_history, prepare

SYSTEMS = ("bicubic", "taau", "cgts")
ORACLE, BEFORE = "oracle", "truth before"
SCALE, SAMPLES = 2, 2
SIMULATION = ("--simulate-lr", SCALE, "--samples-per-pixel", SAMPLES, "--jitter", "halton")
FIRST = 4
"""First frame of a sequence that is judged."""

HEADS = ("PSNR dB", "disoccluded dB", "disoccluded %", "FLIP", "residual temporal", "LPIPS")

GHOSTING = (Ghosting.VISIBILITY, Ghosting.SHADING, Ghosting.NONE)
ALIASING = (Aliasing.GEOMETRY, Aliasing.TEXTURE, Aliasing.NONE)
"""Classes in the order in which the classifier tells them."""

Image = NDArray[np.float32]


def load(path: Path, channels: tuple[str, ...] = ("R", "G", "B")) -> Image:
    """Read planes as float, c h w."""
    planes = read_channels(path, set(channels))
    return np.stack([planes[name].astype(np.float32) for name in channels])


def average(capture: Image) -> Image:
    """Mean of the samples of a pixel."""
    c, h, w = capture.shape
    return capture.reshape(c, h // SAMPLES, SAMPLES, w // SAMPLES, SAMPLES).mean(axis=(2, 4))


def psnr(test: Image, reference: Image, mask: NDArray[np.bool_]) -> float:
    """After c / (1 + c), over the pixels of a mask; NaN where it holds none."""
    difference = test / (1 + test) - reference / (1 + reference)
    chosen = difference[:, mask].astype(np.float64)
    return float(-10 * np.log10(np.mean(chosen**2))) if chosen.size else float("nan")


def find_disoccluded(label: Path, capture: Path) -> NDArray[np.bool_]:
    """Visibility ghosting of what was in the frame before."""
    motion = load(capture, ("motion.X", "motion.Y"))[:, 1::SAMPLES, 1::SAMPLES] / SAMPLES
    inside = inside_frame(torch.from_numpy(motion)[None])[0, 0].numpy() > 0
    found: NDArray[np.bool_] = (load(label, ("ghosting",))[0] == Ghosting.VISIBILITY) & inside
    return found


def list_frames(folder: Path) -> list[Path]:
    """Frames that are judged."""
    return sorted(folder.glob("*.exr"))[FIRST - 1 :]


def draw_marks(data: Path, oracle: Path, before: Path) -> None:
    """Write a sequence by weights that know the truth, and by the truth of the frame before."""
    system, config = load_system("cgts"), CgtsConfig()
    simulation = Simulation(scale=SCALE, samples_per_pixel=SAMPLES, jitter=JitterMode.HALTON)
    [(_, source)] = open_pairs(data, ReadOptions(), simulation=simulation)
    inputs = resolve_system_inputs(system, NonfinitePolicy.ERROR)
    state: CgtsState | None = None
    known: CgtsState | None = None
    for number, path in zip(source.reader.numbers, sorted(data.glob("*.exr")), strict=True):
        window = FrameWindow(lr=(source.load(number, inputs).lr,), scale=SCALE)
        seen = prepare(config, window)
        history = carry_history(state, seen, span_colors(seen["color"]))
        truth = encode_reinhard(torch.from_numpy(average(load(path)))[None])
        # the point of the line from history to frame that is nearest to the truth
        step = seen["color"] - history.color
        along = ((truth - history.color) * step).sum(1, keepdim=True)
        weight = (along / step.square().sum(1, keepdim=True).clamp(min=1e-9)).clamp(0.0, 1.0)
        weight = torch.where(history.inside > 0, weight, 1.0)
        color = torch.lerp(history.color, seen["color"], weight)
        state = CgtsState(
            color=color,
            counter=history.counter,
            worth=history.worth,
            span=history.span,
            depth=seen["depth"],
            logits=history.logits,
            exposure=seen["exposure"],
            linked=0,
        )
        carried = carry_history(known, seen, span_colors(seen["color"]))
        known = replace(state, color=truth)
        for out, image in ((oracle, color), (before, carried.color)):
            write_exr(out / path.name, split_image("", decode_reinhard(image), "RGB"))


def judge_shot(out: Path, data: Path, labels: Path) -> list[float]:
    """PSNR of all pixels and of disoccluded ones, and their share: means over a shot's frames."""
    rows = []
    for path in list_frames(out):
        reference, test = average(load(data / path.name)), load(path)
        disoccluded = find_disoccluded(labels / path.name, data / path.name)
        masks = (np.ones_like(disoccluded), disoccluded)
        rows.append([*(psnr(test, reference, mask) for mask in masks), float(disoccluded.mean())])
    return [statistics.fmean(v for v in column if v == v) for column in zip(*rows, strict=True)]


def evaluate(outputs: list[Path], data: Path, work: Path, metrics: str) -> dict[str, Any]:
    """Of each test and shot the means of `rtsr evaluate`."""
    report = work / "report.json"
    rtsr(
        "evaluate", *outputs, "--ref", data, "--samples-per-pixel", SAMPLES, "--metric", metrics,
        "--frames", f"{FIRST}-1000", "--output", report, "-q",
    )  # fmt: skip
    tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    return {name: test["mean"] for name, test in tests.items()}


def count_classes(out: Path, labels: Path) -> Iterator[tuple[str, Tensor, Tensor]]:
    """Of each frame and kind, its true and its predicted classes, 0 to 2 as logits have them."""
    for path in list_frames(out):
        for kind, order in (("ghosting", GHOSTING), ("aliasing", ALIASING)):
            told = load(out / "debug" / path.name, tuple(f"{kind}.{c}" for c in "RGB"))
            true = load(labels / path.name, (kind,))[0]
            places = np.argsort(np.array(order))[true.astype(np.int64)]
            yield kind, torch.from_numpy(places), torch.from_numpy(told).argmax(0)


def tally(true: Tensor, told: Tensor) -> tuple[Tensor, Tensor]:
    """Confusion, true by told; and of each class hits and misses of either within one pixel."""
    confusion = torch.bincount(3 * true.flatten() + told.flatten(), minlength=9).view(3, 3)
    near = []
    for place in range(3):
        own = [(m == place).float()[None, None] for m in (true, told)]
        wide = [functional.max_pool2d(m, 3, stride=1, padding=1) for m in own]
        found, right = (own[0] * wide[1]).sum(), (own[1] * wide[0]).sum()
        near.append(torch.stack([found, own[0].sum(), right, own[1].sum()]))
    return confusion, torch.stack(near)


def score_f1(precision: float, recall: float) -> float:
    """2 p r / (p + r)."""
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def print_classes(shots: list[str], work: Path) -> None:
    """Print F1 and confusion over all judged frames."""
    totals: dict[str, list[Tensor]] = {}
    for shot in shots:
        for kind, true, told in count_classes(work / "cgts" / shot, work / "labels" / shot):
            counts = tally(true, told)
            known = totals.setdefault(kind, [torch.zeros(3, 3), torch.zeros(3, 4)])
            totals[kind] = [a + b for a, b in zip(known, counts, strict=True)]
    for kind, order in (("ghosting", GHOSTING), ("aliasing", ALIASING)):
        confusion, near = totals[kind]
        names = [c.name.lower() for c in order]
        hits, true, told = confusion.diag(), confusion.sum(1), confusion.sum(0)
        f1 = [float(2 * h / (a + b).clamp(min=1)) for h, a, b in zip(hits, true, told, strict=True)]
        within = [score_f1(float(n[2] / n[3].clamp(min=1)), float(n[0] / n[1].clamp(min=1)))
                  for n in near]  # fmt: skip
        share = float(true.max() / true.sum())
        majority = 2 * share / (1 + share) / 3
        print(f"\n{kind}: macro-F1 {statistics.fmean(f1):.3f}, of the commonest class always "
              f"{majority:.3f}\n")  # fmt: skip
        print(f"| true | F1 | within 1 px | share % | told {' | told '.join(names)} |")
        print("|---|" + "---:|" * 6)
        for i, name in enumerate(names):
            row = confusion[i] / true[i].clamp(min=1)
            cells = " | ".join(f"{float(v):.3f}" for v in row)
            share = 100 * float(true[i] / true.sum())
            print(f"| {name} | {f1[i]:.3f} | {within[i]:.3f} | {share:.2f} | {cells} |")


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--weights", type=click.Path(path_type=Path, exists=True), help="Of cgts.")
@click.option("--lpips", is_flag=True, help="Also LPIPS, which needs its weights.")
@click.option("--classes", is_flag=True, help="Also how often the classifier is right.")
@click.option("--work", type=click.Path(path_type=Path), help="Keep frames here.")
def main(
    *, data: Path, weights: Path | None, lpips: bool, classes: bool, work: Path | None
) -> None:
    """Print a table of sequences by systems."""
    metrics = ("flip", "temporal", *(("lpips",) if lpips else ()))
    heads = HEADS[: len(HEADS) - (not lpips)]
    with tempfile.TemporaryDirectory() as folder:
        work = work or Path(folder)
        shots = judged_sequences(data, work / "data")
        for name in SYSTEMS:
            own = ("--weights", weights) if weights and name == "cgts" else ("--system", name)
            shown = ("--debug-buffers",) if name == "cgts" else ()
            rtsr("upscale", work / "data", work / name, *own, *SIMULATION, *shown, "-q")
        rtsr(
            "label", work / "data", work / "labels", "--kind", "cgts", "--samples-per-pixel",
            SAMPLES, "-q",
        )  # fmt: skip
        for shot in shots:
            marks = [work / name / shot for name in (ORACLE, BEFORE)]
            for folder in marks:
                folder.mkdir(parents=True, exist_ok=True)
            draw_marks(work / "data" / shot, *marks)
        judged = (*SYSTEMS, ORACLE, BEFORE)
        means = evaluate([work / n for n in judged], work / "data", work, ",".join(metrics))
        print("| sequence | |", " | ".join(heads), "|")
        print("|---|---|" + "---:|" * len(heads))
        table: dict[str, list[list[float]]] = {name: [] for name in judged}
        for shot in shots:
            for name in judged:
                row = judge_shot(work / name / shot, work / "data" / shot, work / "labels" / shot)
                scores = means[f"{name}/{shot}" if len(shots) > 1 else name]
                table[name].append([*row, *(scores[m] for m in metrics)])
                print(f"| {shot} | `{name}` |", write_cells(table[name][-1]), "|")
        for name, rows in table.items():
            mean = [statistics.fmean(column) for column in zip(*rows, strict=True)]
            print(f"| mean | `{name}` |", write_cells(mean), "|")
        if classes:
            print_classes(shots, work)


def write_cells(values: list[float]) -> str:
    """Cells of a row."""
    decibels, share, others = values[:2], values[2], values[3:]
    cells = [*(f"{v:.2f}" for v in decibels), f"{100 * share:.1f}"]
    return " | ".join([*cells, *(f"{v:.4f}" for v in others)])


if __name__ == "__main__":
    main()
