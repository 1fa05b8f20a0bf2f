"""Whether a network can learn one frame by heart: its gain there says that inputs and loss fit.

    python benchmarks/overfit.py SHOT [--frame 3] [--system fusesr] [--steps 600]

Trains from fresh weights on one frame of an HR capture, whole, without augmentation, and prints the
gain over `demod-bicubic` on that frame as training goes on. A healthy network passes 8 dB.
"""

from __future__ import annotations

import csv
import re
import shutil
import tempfile
from pathlib import Path

import click
from click.testing import CliRunner

from rtsr_cli.cli import group

BASELINE = re.compile(r"demod-bicubic: psnr ([\d.]+) dB")

STILL = (
    "turns=false",
    "exposure_stops=0",
    "tint_stops=0",
    "material_share=0",
    "filtered_share=0",
)


@click.command()
@click.argument("shot", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--frame", default=3, show_default=True)
@click.option("--system", default="fusesr", show_default=True)
@click.option("--steps", default=600, show_default=True)
@click.option("--side", default=512, show_default=True, help="Of the crop: the frame's or more.")
def main(*, shot: Path, frame: int, system: str, steps: int, side: int) -> None:
    """Train and print."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "frame"
        folder.mkdir()
        [found] = [p for p in shot.glob("*.exr") if int(p.stem.split(".")[-1]) == frame]
        shutil.copy(found, folder)
        if (shot / "capture.toml").is_file():
            shutil.copy(shot / "capture.toml", folder)
        settings = [
            f"training.steps={steps}", "training.batch=1", f"training.crop={side}",
            "training.learning_rate=1e-3", "training.warmup=50", "training.ema=0.99",
            f"training.validate_every={max(1, steps // 6)}",
            *(f"training.augmentation.{part}" for part in STILL),
        ]  # fmt: skip
        given = [part for setting in settings for part in ("--set", setting)]
        run = Path(name) / "run"
        result = CliRunner().invoke(
            group, ["train", system, str(folder), "--out", str(run), *given]
        )
        baseline = BASELINE.search(result.output)
        if result.exit_code or baseline is None:
            raise click.ClickException(result.output)
        with (run / "log.csv").open(encoding="utf-8", newline="") as file:
            rows = [row for row in csv.DictReader(file) if row.get("psnr")]
    over = float(baseline.group(1))
    for row in rows:
        click.echo(f"{system}, step {row['step']}: {float(row['psnr']) - over:+.2f} dB")


if __name__ == "__main__":
    main()
