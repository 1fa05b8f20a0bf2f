"""PSNR of the baselines on decimated captures, beside the figures of the data's manifest.

    python benchmarks/baselines.py ../shared/data

Protocol: `--simulate-lr S` without jitter, PSNR after c/(1+c), peak 1, 16 px border left out,
mean over frames from the third on.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import torch

from rtsr_cli.core.choices import JitterMode, NonfinitePolicy
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import FrameSequence
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.sliding_window import SlidingWindow
from rtsr_cli.core.run.system_inputs import resolve_system_inputs
from rtsr_cli.core.shapes import Color
from rtsr_cli.core.system import State, System
from rtsr_cli.models import load_system

BORDER_PX = 16
SKIPPED_FRAMES = 2


def psnr(test: Color, reference: Color) -> float:
    """PSNR in dB of c/(1+c), peak 1, border left out."""
    inner = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))
    difference = (encode_reinhard(test) - encode_reinhard(reference))[inner]
    return float(-10.0 * torch.log10(difference.double().square().mean()))


def scores(system: System, source: PairSource) -> Iterator[tuple[int, float]]:
    """Yield frame number and PSNR of every frame of a shot."""
    inputs = resolve_system_inputs(system, NonfinitePolicy.ERROR)
    network = system.build(system.config(), source.scale)
    reader = source.reader
    sequence = FrameSequence(numbers=reader.numbers, step=reader.step, cuts=reader.resets)
    window = SlidingWindow(sequence, history_frames=system.history_frames, scale=source.scale)
    state: State = None
    for number in reader.numbers:
        state = state if window.follows(number) else None
        with torch.inference_mode():
            prediction = system.predict(network, window.slide(source.load(number, inputs)), state)
        state = prediction.state
        reference = reader.read(number, [Buffer.COLOR]).gbuffer[Buffer.COLOR]
        assert prediction.image is not None
        yield number, psnr(prediction.image, reference)


def sequence_score(system: System, folder: Path, simulation: Simulation) -> float:
    """Mean PSNR of a sequence from its third frame on."""
    [(_, source)] = open_pairs(folder, ReadOptions(), simulation=simulation)
    values = [value for _, value in scores(system, source)]
    return statistics.fmean(values[SKIPPED_FRAMES:])


def rows(data: Path, scale: int, names: list[str], jitter: str) -> Iterator[dict[str, Any]]:
    """Measure every sequence of the manifest."""
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    simulation = Simulation(scale=scale, jitter=JitterMode(jitter))
    for entry in manifest["sequences"]:
        folder = data / entry["scene"] / entry["sequence"]
        measured = {name: sequence_score(load_system(name), folder, simulation) for name in names}
        yield {
            "sequence": f"{entry['scene']}/{entry['sequence']}",
            "split": entry["split"],
            "manifest": entry["baselines"][f"{scale}x"],
            "measured": measured,
        }


def print_row(row: Mapping[str, Any]) -> None:
    """One line of the table: measured, and the manifest's figure where there is one."""
    cells = [
        f"{value:6.2f} ({row['manifest'][name]:.2f})"
        if name in row["manifest"]
        else f"{value:6.2f}"
        for name, value in row["measured"].items()
    ]
    print(f"| {row['sequence']:16} | {row['split']:5} | " + " | ".join(cells) + " |", flush=True)


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--scale", "scales", type=int, multiple=True, default=(2, 4), show_default=True)
@click.option("--system", "names", multiple=True, default=("bicubic", "demod-bicubic"))
@click.option("--jitter", type=click.Choice(["none", "halton"]), default="none")
def main(data: Path, scales: tuple[int, ...], names: tuple[str, ...], jitter: str) -> None:
    """Print a table for each scale: measured dB (manifest's dB)."""
    for scale in scales:
        print(f"\n{scale}x, jitter {jitter}: measured dB (manifest)")
        print("| sequence | split | " + " | ".join(names) + " |")
        print("|---|---|" + "---|" * len(names))
        table = []
        for row in rows(data, scale, list(names), jitter):
            print_row(row)
            table.append(row)
        means = {n: statistics.fmean(r["measured"][n] for r in table) for n in names}
        print("mean: " + ", ".join(f"{n} {v:.2f} dB" for n, v in means.items()))
        for name in names[1:]:
            print(f"mean gain of {name} over {names[0]}: {means[name] - means[names[0]]:+.2f} dB")
        if jitter == "none":
            lows = [
                r["measured"][n] - r["manifest"][n]
                for r in table
                for n in names
                if n in r["manifest"]
            ]
            if lows:
                print(f"lowest difference to the manifest: {min(lows):+.3f} dB")


if __name__ == "__main__":
    main()
