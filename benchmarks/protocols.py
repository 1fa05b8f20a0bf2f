"""Networks judged as their papers' code judges: figures that may stand beside published ones.

    python benchmarks/protocols.py DATA [--output docs/results.md]

Upscales the `val` and `test` sequences of DATA at 4x from decimated frames and judges each network,
and `demod-bicubic`, by the protocol of its publication. Writes a section of docs/results.md.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from pathlib import Path

import click
from ablations import judged_sequences
from results import BORDER, SKIP_FIRST, rtsr
from sections import replace_section

SCALE = 4
BASELINE = "demod-bicubic"
METRICS = ("psnr", "ssim")

PUBLISHED = {
    "nsrd": ("nsrd", "26.43 dB, 0.8739 (Bistro)"),
    "fusesr": ("fusesr", "-"),
}
"""System -> protocol, and what the paper reports at 4x."""

HEAD = f"""## What do the papers' protocols say?

PSNR dB and SSIM at {SCALE}x, means over the `val` and `test` sequences, border {BORDER} pixels,
first {SKIP_FIRST} frames left out. Published figures are of other data, rendered in an engine: they
stand beside ours for orientation, they do not compare. Written by
`python benchmarks/protocols.py DATA`.

| protocol | system | PSNR dB | SSIM | `{BASELINE}` PSNR dB | SSIM | published |
| --- | --- | ---: | ---: | ---: | ---: | --- |"""


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--output", type=click.Path(path_type=Path), default=Path("docs/results.md"))
def main(*, data: Path, output: Path) -> None:
    """Print and write."""
    lines = [HEAD]
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        shots = judged_sequences(data, work / "data")
        for system in (BASELINE, *PUBLISHED):
            made = ("--simulate-lr", SCALE, "--system", system, "-q")
            rtsr("upscale", work / "data", work / system, *made)
        for system, (protocol, published) in PUBLISHED.items():
            report = work / f"{system}.json"
            rtsr(
                "evaluate", work / system, work / BASELINE, "--ref", work / "data", "--metric",
                ",".join(METRICS), "--protocol", protocol, "--border", BORDER, "--skip-first",
                SKIP_FIRST, "--output", report, "-q",
            )  # fmt: skip
            tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
            cells = [
                f"{statistics.fmean(tests[f'{n}/{shot}']['mean'][m] for shot in shots):.{digits}f}"
                for n in (system, BASELINE)
                for m, digits in zip(METRICS, (2, 4), strict=True)
            ]
            lines.append(f"| `{protocol}` | `{system}` | {' | '.join(cells)} | {published} |")
            click.echo(lines[-1])
    replace_section(output, "protocols", "\n".join(lines))


if __name__ == "__main__":
    main()
