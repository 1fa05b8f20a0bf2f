"""What each part of a network is worth: small trainings that differ in one setting.

    python benchmarks/ablations.py DATA [MORE ...] [--system fusesr] [--steps 500] [--work FOLDER]

Trains a system on the `train` sequences of DATA (and on MORE) from the same seed with the same
samples, once a row, and judges every `val` and `test` sequence as `benchmarks/results.py` does.
Writes a section of docs/results.md. `--work` keeps runs and goes on with those that are there.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from results import BORDER, SKIP_FIRST, STRAIGHT, gain, rtsr
from sections import replace_section

SCALE = 4
METRICS = ("psnr", "flip", "lpips", "temporal")

ROWS: dict[str, dict[str, tuple[str, ...]]] = {
    "fusesr": {
        "as shipped": (),
        "lighting enlarged cubically": ("network.base=cubic",),
        "no demodulation": ("network.demodulation=none",),
        "demodulation by albedo": ("network.demodulation=albedo",),
        "no history": ("network.history=false",),
        "HR buffers pooled to LR": ("network.fusion=pool",),
        "HR buffers at the last layer": ("network.fusion=upsample",),
        "no HR buffers in the network": ("network.fusion=none",),
        "HR material alone (first release)": ("network.variant=first-release",),
    },
    "nsrd": {
        "as shipped": (),
        "lighting enlarged cubically": ("network.base=cubic",),
        "no demodulation": ("network.demodulation=none",),
        "no dual vectors (plain mask, in the loss, too)": ("network.dual_vectors=false",),
        "no feedback": ("network.feedback=false",),
        "no LSTM": ("network.lstm=false",),
        "LSTM's state not moved (as published)": ("network.warp_state=false",),
    },
    "gather": {
        "as shipped": (),
        "kernel not weighed": ("network.kernel=false",),
        "history not weighed": ("network.history=false",),
        "a residual beside": ("network.residual=true",),
        "a residual in place of the kernel": ("network.kernel=false", "network.residual=true"),
    },
}
"""System -> row -> settings that differ from the default."""

SHIPPED_WITH = {
    "nsrd": ("network.gradient_frames=4",),
    "gather": ("training.augmentation.turns=false",),
}
"""System -> settings that its weights were trained with and that are no defaults."""

HEAD = """## What is each part of {system} worth?

`{system}` {scale}x after {steps} steps of {batch} crops of {crop} x {crop} LR pixels, one setting
changed a row, the same seed and samples in each. Short trainings: rows compare with each other, not
with the shipped weights. Means over the `val` and `test` sequences of the gain over the better of
{baselines}, protocol `rtsr` without jitter. Written by
`python benchmarks/ablations.py DATA [MORE ...] --system {system} --steps {steps} --batch {batch}`.

| | PSNR gain dB | FLIP lower by | LPIPS lower by | temporal lower by | lowest PSNR gain dB |
| --- | ---: | ---: | ---: | ---: | ---: |"""


def trained(
    system: str, data: Sequence[Path], out: Path, cache: Path, settings: Sequence[str]
) -> Path:
    """Train, unless the run is there; return the weights."""
    given = [part for setting in settings for part in ("--set", setting)]
    where = ("--out", out, "--cache", cache)
    rtsr("train", system, *data, *where, "--scale", SCALE, *given, "-q")
    return out / "last.safetensors"


def judged_sequences(data: Path, tree: Path) -> list[str]:
    """Link what is not trained on into a folder of its own; return the shots' names."""
    manifest = json.loads((data / "manifest.json").read_text(encoding="utf-8"))
    names = []
    for s in (s for s in manifest["sequences"] if s["split"] != "train"):
        link = tree / s["scene"] / s["sequence"]
        link.parent.mkdir(parents=True, exist_ok=True)
        if not link.exists():
            link.symlink_to((data / s["scene"] / s["sequence"]).resolve())
        names.append(f"{s['scene']}/{s['sequence']}")
    return names


def line(title: str, tests: dict[str, Any], folder: str, shots: Sequence[str]) -> str:
    """One row of the table."""
    gains = []
    for shot in shots:
        means = {n: tests[f"{n}/{shot}"]["mean"] for n in (*STRAIGHT, folder)}
        gains.append(gain(means, folder))
    mean = [statistics.fmean(column) for column in zip(*gains, strict=True)]
    cells = [f"{value:+.3f}" for value in (*mean, min(g[0] for g in gains))]
    return f"| {title} | " + " | ".join(cells) + " |"


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("more", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("--system", default="fusesr", show_default=True, type=click.Choice(tuple(ROWS)))
@click.option("--steps", default=500, show_default=True)
@click.option("--batch", default=4, show_default=True)
@click.option("--crop", default=48, show_default=True)
@click.option("--work", type=click.Path(path_type=Path), help="Keep runs and frames here.")
@click.option("--cache", type=click.Path(path_type=Path), help="Keep decoded frames here.")
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/results.md"))
def main(
    *,
    data: Path,
    more: tuple[Path, ...],
    system: str,
    steps: int,
    batch: int,
    crop: int,
    work: Path | None,
    cache: Path | None,
    output: Path,
) -> None:
    """Write the section."""
    common = (
        f"training.steps={steps}", f"training.batch={batch}", f"training.crop={crop}",
        "training.learning_rate=5e-4", "training.warmup=50", "training.ema=0.99",
        f"training.validate_every={steps}", *SHIPPED_WITH.get(system, ()),
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = work or Path(name)
        tree = folder / "data"
        shots = judged_sequences(data, tree)
        made = ("--simulate-lr", SCALE, "--jitter", "none", "-q")
        outputs = [folder / "frames" / baseline for baseline in STRAIGHT]
        for output_folder in outputs:
            rtsr("upscale", tree, output_folder, "--system", output_folder.name, *made)
        for number, (title, own) in enumerate(ROWS[system].items()):
            run = folder / "runs" / str(number)
            kept = cache or folder / "cache"
            weights = trained(system, (data, *more), run, kept, (*common, *own))
            outputs.append(folder / "frames" / f"row-{number}")
            rtsr("upscale", tree, outputs[-1], "--weights", weights, "--system", system, *made)
            click.echo(f"{title}: trained")
        report = folder / "report.json"
        rtsr(
            "evaluate", *outputs, "--ref", tree, "--metric", ",".join(METRICS), "--border", BORDER,
            "--skip-first", SKIP_FIRST, "--output", report, "-q",
        )  # fmt: skip
        tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    head = HEAD.format(
        system=system,
        scale=SCALE,
        steps=steps,
        batch=batch,
        crop=crop,
        baselines=" and ".join(f"`{b}`" for b in STRAIGHT),
    )
    rows = [line(title, tests, f"row-{i}", shots) for i, title in enumerate(ROWS[system])]
    replace_section(output, f"ablations-{system}", "\n".join([head, *rows]))
    click.echo("\n".join([head, *rows]))


if __name__ == "__main__":
    main()
