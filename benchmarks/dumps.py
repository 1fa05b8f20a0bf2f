"""Agreement of the same frames dumped in two layouts, through `rtsr upscale` without an option.

    python benchmarks/dumps.py ../shared/data

Prints PSNR after c/(1+c) between the outputs of `dumps/standard` and `dumps/multilayer`.
"""

from __future__ import annotations

import math
import statistics
import tempfile
from pathlib import Path

import click
import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels


def outputs(folder: Path, out: Path, system: str, scale: int) -> dict[int, NDArray[np.float64]]:
    """Upscale a dump and load the results by frame number, tone-mapped."""
    result = CliRunner().invoke(
        group,
        ["upscale", str(folder), str(out), "--simulate-lr", str(scale), "--system", system],
    )
    if result.exit_code:
        raise click.ClickException(result.output)
    images = {}
    for path in sorted(out.glob("*.exr")):
        planes = read_channels(path, "RGB")
        color = np.stack([planes[c].astype(np.float64) for c in "RGB"])
        images[int(path.stem.split(".")[-1])] = color / (1 + color)
    return images


def psnr(error: float) -> float:
    """PSNR in dB, peak 1; inf for identical images."""
    return math.inf if error == 0 else -10 * math.log10(error)


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
def main(data: Path) -> None:
    """Print one line a system and scale: worst and mean PSNR over the frames."""
    for system in ("demod-bicubic", "taau"):
        for scale in (2, 4):
            with tempfile.TemporaryDirectory() as folder:
                standard, multilayer = (
                    outputs(data / "dumps" / name, Path(folder) / name, system, scale)
                    for name in ("standard", "multilayer")
                )
            errors = [float(np.mean((standard[n] - multilayer[n]) ** 2)) for n in standard]
            print(
                f"{system} {scale}x: lowest {psnr(max(errors)):.2f} dB, "
                f"of the mean error {psnr(statistics.fmean(errors)):.2f} dB, {len(errors)} frames"
            )


if __name__ == "__main__":
    main()
