"""What bf16 layers cost in quality: PSNR of the shipped networks against fp32.

    python benchmarks/precision.py DATA [--system fusesr --system fusesr-fast --system nsrd]

Upscales the `val` and `test` sequences of DATA at 4x in both precisions and judges them as
`benchmarks/results.py` does.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import click
from ablations import judged_sequences
from results import BORDER, SKIP_FIRST, rtsr

SCALE = 4
PRECISIONS = ("fp32", "bf16")


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--system", "systems", multiple=True, default=("fusesr", "fusesr-fast", "nsrd"))
def main(*, data: Path, systems: tuple[str, ...]) -> None:
    """Print PSNR a precision and sequence, and the differences."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        shots = judged_sequences(data, work / "data")
        for system in systems:
            outputs = [work / system / precision for precision in PRECISIONS]
            for output in outputs:
                made = ("--simulate-lr", SCALE, "--system", system, "--precision", output.name)
                rtsr("upscale", work / "data", output, *made, "-q")
            report = work / f"{system}.json"
            rtsr(
                "evaluate", *outputs, "--ref", work / "data", "--metric", "psnr", "--border",
                BORDER, "--skip-first", SKIP_FIRST, "--output", report, "-q",
            )  # fmt: skip
            tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
            for shot in shots:
                full, half = (tests[f"{p}/{shot}"]["mean"]["psnr"] for p in PRECISIONS)
                click.echo(
                    f"{system} {shot}: fp32 {full:.3f} dB, bf16 {half:.3f} dB, {half - full:+.4f}"
                )


if __name__ == "__main__":
    main()
