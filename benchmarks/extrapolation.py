"""Frames that are predicted between rendered ones, on sequences that no network is trained on.

    python benchmarks/extrapolation.py DATA [--system warp --system warp-guided] [--marks] [--lpips]

Every second frame of the `val` and `test` sequences of DATA is predicted at the size it has. Judged
are the predicted frames whose history is full, three rendered ones (`--all` judges every one): PSNR
after c / (1 + c) of all pixels and inside holes, which are those of `warp-guided` for every system,
those that lay off screen in the last rendered frame apart; FLIP, and LPIPS, as `rtsr evaluate` has
them. The residual temporal error is that of the sequence rendered, predicted, rendered, ...: what
its difference to the truth changes along motion (0 for the truth). Warped is what the sequence
itself changes along motion, beside what the truth does.
`--marks` adds what is compared with and is no system: `benchmarks/extrapolation_marks.py`.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path

import click
import numpy as np
import torch
from ablations import judged_sequences
from extrapolation_marks import MARKS, draw_marks, list_predicted
from numpy.typing import NDArray
from results import rtsr

from rtsr_cli.core.files.exr import read_channels
from rtsr_cli.core.imaging.warping import inside_frame

SYSTEMS = ("warp", "warp-guided", "extranet")
GUIDED = "warp-guided"
FULL_HISTORY = 6
"""First number of a sequence whose predicted frame has t-1, t-3 and t-5 before it."""

HEADS = ("PSNR dB", "in holes", "disoccluded", "off screen", "disoccluded %", "off screen %")

CHANGES = ("temporal", "warped")
TITLES = {
    "flip": "FLIP",
    "lpips": "LPIPS",
    "temporal": "residual temporal",
    "warped": "warped",
}
"""Of metrics, as the table heads them."""

Image = NDArray[np.float32]


def load(path: Path, channels: tuple[str, ...] = ("R", "G", "B")) -> Image:
    """Read planes as float, c h w."""
    planes = read_channels(path, set(channels))
    return np.stack([planes[name].astype(np.float32) for name in channels])


def psnr(test: Image, reference: Image, mask: Image) -> float:
    """After c / (1 + c), over the pixels of a mask; NaN where it holds none."""
    difference = test / (1 + test) - reference / (1 + reference)
    chosen = difference[:, mask[0] > 0.5].astype(np.float64)
    return float(-10 * np.log10(np.mean(chosen**2))) if chosen.size else float("nan")


def judge_shot(output: Path, truth: Path, holes: Path, first: int) -> list[float]:
    """Means over a shot's predicted frames, as `HEADS` names them."""
    rows = []
    for path in list_predicted(output, first):
        hole = load(holes / "debug" / path.name, ("hole.Y",))
        motion = torch.from_numpy(load(truth / path.name, ("motion.X", "motion.Y")))
        outside = 1.0 - inside_frame(motion[None])[0].float().numpy()
        masks = (np.ones_like(hole), hole, hole * (1 - outside), hole * outside)
        test, reference = load(path), load(truth / path.name)
        scores = [psnr(test, reference, mask) for mask in masks]
        rows.append([*scores, float(masks[2].mean()), float(masks[3].mean())])
    return [statistics.fmean(v for v in column if v == v) for column in zip(*rows, strict=True)]


def perceived(
    outputs: list[Path], data: Path, work: Path, first: int, metrics: str
) -> dict[str, dict[str, float]]:
    """Of each test and shot the means of `rtsr evaluate`."""
    report = work / "report.json"
    rtsr(
        "evaluate", *outputs, "--ref", data, "--metric", metrics, "--frames", f"{first}-1000",
        "--output", report, "-q",
    )  # fmt: skip
    tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    return {name: test["mean"] for name, test in tests.items()}


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--system", "systems", multiple=True, default=SYSTEMS, show_default=True)
@click.option("--marks", is_flag=True, help="Also what is no system, to compare with.")
@click.option("--lpips", is_flag=True, help="Also LPIPS, which needs its weights.")
@click.option("--all", "every", is_flag=True, help="Frames with less history, too.")
def main(*, data: Path, systems: tuple[str, ...], marks: bool, lpips: bool, every: bool) -> None:
    """Print a table of sequences by systems."""
    pictured = ("flip", "lpips") if lpips else ("flip",)
    metrics = (*pictured, *CHANGES)
    first = 0 if every else FULL_HISTORY
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        shots = judged_sequences(data, work / "data")
        for name in dict.fromkeys((GUIDED, *systems)):
            rtsr(
                "extrapolate", work / "data", work / name, "--system", name, "--debug-buffers",
                "--keep-rendered", "-q",
            )  # fmt: skip
        judged = (*systems, *(MARKS if marks else ()))
        if marks:
            draw_marks(work / "data", work, first)
        means = perceived([work / n for n in judged], work / "data", work, first, ",".join(metrics))
        titles = (*HEADS, *(TITLES[m] for m in metrics))
        print("| sequence | |", " | ".join(titles), "| of the truth |")
        print("|---|---|" + "---:|" * (len(titles) + 1))
        table: dict[str, list[list[float]]] = {name: [] for name in judged}
        for shot in shots:
            for name in judged:
                row = judge_shot(
                    work / name / shot, work / "data" / shot, work / GUIDED / shot, first
                )
                scores = means[f"{name}/{shot}" if len(shots) > 1 else name]
                table[name].append([*row, *(scores[m] for m in (*metrics, "warped-reference"))])
                print(f"| {shot} | `{name}` |", write_cells(table[name][-1]), "|")
        for name, rows in table.items():
            mean = [statistics.fmean(column) for column in zip(*rows, strict=True)]
            print(f"| mean | `{name}` |", write_cells(mean), "|")


def write_cells(values: list[float]) -> str:
    """Cells of a row."""
    decibels, shares, others = values[:4], values[4:6], values[6:]
    cells = [*(f"{v:.2f}" for v in decibels), *(f"{100 * v:.1f}" for v in shares)]
    return " | ".join([*cells, *(f"{v:.4f}" for v in others)])


if __name__ == "__main__":
    main()
