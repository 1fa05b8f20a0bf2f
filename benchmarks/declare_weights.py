"""Write into shipped weights what is known of their data, and figures that anyone can repeat.

    python benchmarks/declare_weights.py [NAME ...]

Weights that were trained before trainings recorded their data hold names or a number of shots. What
this project's own pages say of them, and what is not known, is written beside (`about.declared`),
and figures on a scene of `rtsr synth` with the lines that make them (`about.measured`). A checksum
joins in where there is none. Tensors stay as they are: the script stops where a hash of them
changes. Then write the cards again (`docs/cards.md`).
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import click
from torch import Tensor

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.network.weights import SHIPPED, SavedWeights, read_weights, save_weights
from rtsr_cli.models import load_system

SCENE = "rtsr synth shot --seed 9002 --size 480x288 --frames 1-8"
"""A street that no training saw (docs/pictures.md)."""

SHARED = (
    "TPS demo CC BY 3.0, Poly Haven CC0, Amazon Lumberyard Bistro CC BY 4.0, Godot Material "
    "Testers MIT"
)
"""Sources of nearly every rendered sequence."""

SEQUENCES = (
    ("atrium/walk", 10, f"Sponza (published for rendering research, no licence text); {SHARED}"),
    ("bath/wash", 5, f"Contemporary Bathroom CC0, The Breakfast Room CC BY 3.0; {SHARED}"),
    ("court/fly", 10, "CC0"),
    ("dining/round", 5, f"The Breakfast Room CC BY 3.0; {SHARED}"),
    ("greyroom/enter", 10, f"The Grey & White Room CC BY 3.0; {SHARED}"),
    ("yard/stroll", 5, f"tree low-poly CC BY 4.0, Lowpoly lamp CC BY 4.0; {SHARED}"),
)
"""The `train` sequences: name, frames, licences of their sources as the data's page lists them."""

JUDGED = (
    ("atrium/drop", 8, SEQUENCES[0][2]),
    ("lounge/tour", None, f"The White Room CC BY 3.0; {SHARED}"),
)
"""The `val` sequences, by the split of the data's manifest; the second is longer now."""

OWN = "made by rtsr itself, MIT"


@dataclass(frozen=True, kw_only=True)
class Declared:
    """What is known of the data of some weights.

    Attributes:
        scenes: shots of `rtsr synth`; None where their number is not known.
        source: pages that say so.
        unknown: what no record holds.
        trained: False where not even the sequences are known.
    """

    scenes: int | None
    source: str
    unknown: str
    trained: bool = True


EARLY = Declared(
    scenes=150,
    source="the file (156 shots); README.md of 2026-11-23: six sequences and 150 to 400 scenes of "
    "rtsr synth",
    unknown="seeds and frames of the scenes: docs/train-your-own.md of that time makes 150 by "
    "`rtsr synth synth --shots 150 --frames 1-4 --size 480x288 --seed 1000`, and no record says "
    "that these are the ones; whether other processes had others; the revision",
)

RATES = Declared(
    scenes=None,
    source="the file (636 shots)",
    unknown="which 636 shots they are, their frames and licences, and what they were judged on "
    "in training: no page or revision of this "
    "project names them, and trainings did not record it then",
    trained=False,
)

SHORT = Declared(
    scenes=44,
    source="the file (50 shots), docs/train-your-own.md",
    unknown="seeds and frames of the scenes",
)

DECLARED: Mapping[str, Declared] = {
    **dict.fromkeys(("fusesr-8x", "nsrd-2x"), SHORT),
    "fusesr-4x": EARLY,
    "fusesr-fast-2x": EARLY,
    "fusesr-fast-4x": EARLY,
    "nsrd-4x": EARLY,
    "extranet": Declared(
        scenes=44,
        source="the file (50 shots); docs/extrapolate.md (44 scenes, and 24 more of the weights "
        "that the training began with)",
        unknown="seeds and frames of the scenes that it began with",
    ),
    "gather-2x": Declared(
        scenes=17,
        source="the file, which names those of the first of two processes; docs/gather.md (forty "
        "scenes in all)",
        unknown="seeds and frames of the scenes, and which of them the other process had",
    ),
    **dict.fromkeys(
        # weights of 4x serve these, too
        ("gather-3x", "gather-4x", "gather-6x", "gather-8x"),
        Declared(
            scenes=40,
            source="the file (46 shots), docs/gather.md (the train sequences and forty scenes)",
            unknown="seeds and frames of the scenes",
        ),
    ),
    "cgts-2x": Declared(
        scenes=44,
        source="the file (50 shots); docs/supersampling.md (six captures and 44 scenes; 3,000 "
        "steps, by a loop outside rtsr, on the captures and 18 of the scenes, then 3,600 on all)",
        unknown="seeds and frames of the scenes",
    ),
    "rt-percept-flip-16": RATES,
    "rt-percept-jnflip-16": RATES,
    "rt-percept-jnflip-8": RATES,
    "rt-percept-jnyang-16": RATES,
}


def describe(declared: Declared) -> dict[str, Any]:
    """What is written of the data."""
    training = list_parts(SEQUENCES) if declared.trained else []
    if declared.scenes is not None:
        made = {"name": "scenes of rtsr synth", "shots": declared.scenes, "frames": None}
        training.append({**made, "licence": OWN})
    return {
        "training": training,
        "validation": list_parts(JUDGED) if declared.trained else [],
        "source": declared.source,
        "unknown": declared.unknown,
    }


def list_parts(sequences: Sequence[tuple[str, int | None, str]]) -> list[dict[str, Any]]:
    """Sequences as parts of the data."""
    return [{"name": n, "shots": 1, "frames": f, "licence": says} for n, f, says in sequences]


def list_lines(weights: SavedWeights) -> tuple[str, ...]:
    """Lines that measure weights, as they are typed."""
    system = load_system(weights.system)
    named = f"--system {system.name}"
    if system.task is SystemTask.PREDICT_VRS:
        error = weights.config["error"]
        return (f"rtsr predict-vrs shot out --metric {error['metric']} --tile {error['tile']}",)
    if system.task is SystemTask.EXTRAPOLATE:
        return (f"rtsr extrapolate shot out {named}", "rtsr evaluate out shot")
    simulated = f"--simulate-lr {weights.scale} --jitter halton"
    return (f"rtsr upscale shot out {simulated} {named}", "rtsr evaluate out shot")


def run(line: str, folder: Path) -> list[dict[str, Any]]:
    """Run a line in a folder; return its events."""
    words = [sys.executable, "-m", "rtsr_cli", *shlex.split(line)[1:], "--json"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise click.ClickException(f"{line}: {done.stderr.strip() or done.stdout.strip()}")
    return [json.loads(event) for event in done.stdout.splitlines()]


def measure(weights: SavedWeights, folder: Path) -> dict[str, Any]:
    """Figures on the scene, with the lines that made them."""
    lines = list_lines(weights)
    if not (folder / "shot").exists():
        run(SCENE, folder)
    (last,) = [run(line, folder)[-1] for line in lines][-1:]
    scores = last["total"] if "total" in last else next(iter(last["tests"].values()))["mean"]
    kept = ("psnr", "ssim", "flip", "r2", "mae", "under", "missed", "invocations_saved")
    shutil.rmtree(folder / "out")
    return {"lines": [SCENE, *lines], "scores": {n: scores[n] for n in kept if n in scores}}


def hash_tensors(tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of names, types and bytes."""
    total = sha256()
    for name in sorted(tensors):
        total.update(f"{name} {tensors[name].dtype} {tuple(tensors[name].shape)}".encode())
        total.update(tensors[name].contiguous().numpy().tobytes())
    return total.hexdigest()


@click.command()
@click.argument("names", nargs=-1)
def main(names: tuple[str, ...]) -> None:
    """Write metadata again."""
    with tempfile.TemporaryDirectory() as scratch:
        for name in names or sorted(DECLARED):
            path = SHIPPED / f"{name}.safetensors"
            weights = read_weights(path)
            before = hash_tensors(weights.tensors)
            about = {**weights.about, "declared": describe(DECLARED[name])}
            about["measured"] = measure(weights, Path(scratch))
            written = path.with_suffix(".part")
            save_weights(
                written,
                weights.tensors,
                system=weights.system,
                scale=weights.scale,
                config=weights.config,
                about=about,
            )
            after = hash_tensors(read_weights(written).tensors)
            if after != before:
                written.unlink()
                raise click.ClickException(f"{name}: tensors changed ({before}, {after})")
            written.replace(path)
            click.echo(f"{name}: tensors {after[:16]} as before; {about['measured']['scores']}")


if __name__ == "__main__":
    main()
