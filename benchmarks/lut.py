"""Error and time of the split-sum table.

    python benchmarks/lut.py

Error: the largest difference of A or B over the texels with NoV >= 0.01 from (1) the integral
computed at every texel by itself with 8 times the nodes, and (2) the textbook estimate, GGX half
vectors on a grid of the unit square, crowded into the lobe's tail, at a spread of texels. Time:
median of 7 tables.
"""

from __future__ import annotations

import statistics
import time

import click
import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.imaging.brdf_lut import integrate_lut, integrate_split_sum, lobe_parameters

MIN_NOV = 0.01
Array = NDArray[np.float64]


def textbook(nov: float, roughness: float, convention: LutConvention, grid: int) -> Array:
    """Split sum by importance sampling of half vectors [Karis 2013], midpoints of a square grid.

    v = 1 - (1 - t)^3 puts more of them where few half vectors have most of the slope.
    """
    alpha, k = (float(v) for v in lobe_parameters(np.array(roughness), convention))
    u = (np.arange(grid) + 0.5) / grid
    cos_phi = np.cos(2 * np.pi * u)
    total = np.zeros(2)
    sin_o = np.sqrt(1 - nov * nov)
    for t in u:
        v, density = 1 - (1 - t) ** 3, 3 * (1 - t) ** 2
        cos_h = np.sqrt((1 - v) / (1 + (alpha * alpha - 1) * v))
        sin_h = np.sqrt(1 - cos_h * cos_h)
        voh = sin_o * sin_h * cos_phi + nov * cos_h
        nol = 2 * voh * cos_h - nov
        seen = (nol > 0) & (voh > 0)
        voh, nol = voh[seen], nol[seen]
        visible = nol / (nol * (1 - k) + k) * nov / (nov * (1 - k) + k) * voh / (cos_h * nov)
        fresnel = (1 - voh) ** 5
        total += density * np.array([((1 - fresnel) * visible).sum(), (fresnel * visible).sum()])
    return total / (grid * grid)


def largest_error(table: Array, convention: LutConvention) -> float:
    """Largest difference from the integral at every texel with NoV >= 0.01."""
    size = table.shape[-1]
    centres = (np.arange(size) + 0.5) / size
    columns = np.flatnonzero(centres >= MIN_NOV)
    worst = 0.0
    for rows in np.array_split(np.arange(size), 32):
        exact = integrate_split_sum(
            centres[columns], centres[rows], samples=8192, convention=convention
        )
        worst = max(worst, float(np.abs(table[:, rows][..., columns] - exact).max()))
    return worst


def textbook_error(table: Array, convention: LutConvention, grid: int) -> float:
    """Largest difference from the textbook estimate at a spread of texels."""
    size = table.shape[-1]
    texels = [0, 5, size // 8, size // 2, size - 1]
    worst = 0.0
    for row in texels:
        for column in (t for t in texels if (t + 0.5) / size >= MIN_NOV):
            exact = textbook((column + 0.5) / size, (row + 0.5) / size, convention, grid)
            worst = max(worst, float(np.abs(table[:, row, column] - exact).max()))
    return worst


@click.command()
@click.option("--size", default=512, show_default=True)
@click.option("--samples", default=1024, show_default=True)
@click.option("--grid", default=2048, show_default=True, help="Side of the textbook's grid.")
def main(size: int, samples: int, grid: int) -> None:
    """Print one line a convention."""
    for convention in LutConvention:
        seconds = []
        for _ in range(7):
            started = time.perf_counter()
            table = integrate_lut(size, samples, convention)[0].double().numpy()
            seconds.append(time.perf_counter() - started)
        print(
            f"{convention}: {size} x {size}, {samples} samples: "
            f"median {statistics.median(seconds):.2f} s; largest error "
            f"{largest_error(table, convention):.1e} (every texel), "
            f"{textbook_error(table, convention, grid):.1e} (textbook, {grid} x {grid})",
            flush=True,
        )


if __name__ == "__main__":
    main()
