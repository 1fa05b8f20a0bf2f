"""Recomposition error of `rtsr demodulate` and its inverse, every mode, every sequence.

    python benchmarks/recomposition.py ../shared/data

Runs the two commands through half and float files and compares the radiance that comes back.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import click
import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels

MODES = ("brdf", "softplus", "albedo", "glossy-albedo")


def run(*args: object) -> str:
    """Run rtsr and return what it printed."""
    result = CliRunner().invoke(group, [str(a) for a in args])
    if result.exit_code:
        raise click.ClickException(result.output)
    return result.output


def radiance(path: Path) -> NDArray[np.float64]:
    """Load R, G, B."""
    planes = read_channels(path, "RGB")
    return np.stack([planes[c].astype(np.float64) for c in "RGB"])


def round_trip(folder: Path, mode: str, flags: tuple[str, ...]) -> tuple[float, str]:
    """Largest error relative to max(|c|, 1e-3) over a sequence, and the command's own report."""
    with tempfile.TemporaryDirectory() as scratch:
        parts, back = Path(scratch) / "parts", Path(scratch) / "back"
        report = run("demodulate", folder, parts, "--mode", mode, *flags).splitlines()[-1]
        run("demodulate", parts, back, "--inverse", *flags)
        errors = []
        for path in sorted(folder.glob("*.exr")):
            original = radiance(path)
            difference = np.abs(radiance(back / path.name) - original)
            errors.append(float((difference / np.maximum(np.abs(original), 1e-3)).max()))
    return max(errors), report


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--mode", "modes", type=click.Choice(MODES), multiple=True, default=MODES)
def main(data: Path, modes: tuple[str, ...]) -> None:
    """Print a line a sequence, mode and file type."""
    worst = {"half": 0.0, "float": 0.0}
    for sequence in sorted({p.parent for p in data.glob("*/*/*.exr") if p.parts[-3] != "dumps"}):
        for mode in modes:
            for kind, flags in (("half", ()), ("float", ("--float",))):
                error, report = round_trip(sequence, mode, flags)
                worst[kind] = max(worst[kind], error)
                print(f"{sequence.relative_to(data)} {mode} {kind}: {error:.2e}; {report}")
    print(f"worst: half {worst['half']:.2e}, float {worst['float']:.2e}")


if __name__ == "__main__":
    main()
