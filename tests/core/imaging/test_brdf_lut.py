from __future__ import annotations

import numpy as np
import pytest
import torch

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.brdf_lut import (
    LutConvention,
    integrate_lut,
    integrate_split_sum,
    lut_for,
    sample_lut,
)

CONVENTIONS = list(LutConvention)
HARD_TEXELS = [
    (5, 0), (5, 40), (5, 511), (60, 3), (60, 256), (256, 0), (256, 511), (511, 100), (511, 511),
]  # fmt: skip
"""(column, row): grazing and facing, smooth and rough."""


def textbook(nov: float, alpha: float, k: float, grid: int = 1000) -> np.ndarray:
    """Karis' loop over GGX half vectors, on the midpoints of a grid instead of random numbers.

    v = 1 - (1 - t)^3 crowds the midpoints into the tail of the lobe, dv = 3 (1 - t)^2 dt.
    """
    u, t = np.meshgrid((np.arange(grid) + 0.5) / grid, (np.arange(grid) + 0.5) / grid)
    v = 1 - (1 - t) ** 3
    cos_h = np.sqrt((1 - v) / (1 + (alpha**2 - 1) * v))
    h = np.stack(
        [
            np.sqrt(1 - cos_h**2) * np.cos(2 * np.pi * u),
            np.sqrt(1 - cos_h**2) * np.sin(2 * np.pi * u),
            cos_h,
        ]
    )
    o = np.array([np.sqrt(1 - nov**2), 0.0, nov])
    voh = np.tensordot(o, h, 1)
    nol = 2 * voh * h[2] - o[2]
    seen = (nol > 0) & (voh > 0)
    nol = np.where(seen, nol, 1.0)
    g = (nol / (nol * (1 - k) + k)) * (nov / (nov * (1 - k) + k))
    weight = np.where(seen, g * voh / (h[2] * nov), 0.0) * 3 * (1 - t) ** 2
    fresnel = (1 - voh) ** 5
    return np.array([((1 - fresnel) * weight).mean(), (fresnel * weight).mean()])


@pytest.fixture(scope="module", params=CONVENTIONS)
def convention(request: pytest.FixtureRequest) -> LutConvention:
    return LutConvention(request.param)


@pytest.mark.parametrize(("column", "row"), HARD_TEXELS)
def test_the_default_table_holds_the_converged_integral(
    convention: LutConvention, column: int, row: int
) -> None:
    nov, roughness = (column + 0.5) / 512, (row + 0.5) / 512
    alpha = roughness**2 if convention is LutConvention.KARIS else roughness
    k = alpha / 2 if convention is LutConvention.KARIS else (alpha + 1) ** 2 / 8
    expected = textbook(nov, alpha, k)
    table = lut_for(convention)[0, :, row, column].double().numpy()
    np.testing.assert_allclose(table, expected, atol=2e-4)


def test_interpolating_nodes_loses_nothing_against_integrating_every_texel(
    convention: LutConvention,
) -> None:
    centres = (np.arange(512) + 0.5) / 512
    columns, rows = np.arange(5, 512, 37), np.arange(0, 512, 43)
    exact = integrate_split_sum(
        centres[columns], centres[rows], samples=8192, convention=convention
    )
    table = lut_for(convention)[0].double().numpy()[:, rows][:, :, columns]
    assert np.abs(table - exact).max() < 1e-4


def test_a_smooth_surface_seen_head_on_reflects_everything_without_fresnel() -> None:
    scale, bias = integrate_split_sum(np.array([1 - 1e-9]), np.array([1e-3]))[:, 0, 0]
    assert scale == pytest.approx(1.0, abs=1e-4)
    assert bias == pytest.approx(0.0, abs=1e-4)


def test_no_texel_gains_energy_or_is_negative(convention: LutConvention) -> None:
    table = lut_for(convention)
    assert float(table.min()) >= 0.0
    assert float(table.sum(1).max()) <= 1.0


def test_the_conventions_differ() -> None:
    karis, seed = (lut_for(c) for c in CONVENTIONS)
    assert float((karis - seed).abs().max()) > 0.05


def test_texel_centres_are_looked_up_exactly() -> None:
    lut = integrate_lut(8, 64)
    centres = (torch.arange(8) + 0.5) / 8
    rows, columns = torch.meshgrid(centres, centres, indexing="ij")
    found = sample_lut(lut, columns[None, None], rows[None, None])
    torch.testing.assert_close(found, lut, atol=1e-6, rtol=0)


def test_between_centres_the_look_up_is_bilinear_and_outside_it_clamps() -> None:
    lut = torch.zeros(1, 2, 2, 2)
    lut[0, 0] = torch.tensor([[0.0, 1.0], [2.0, 3.0]])
    nov = torch.tensor([0.5, 0.0, 1.0]).view(1, 1, 1, 3)
    roughness = torch.tensor([0.5, 0.0, 1.0]).view(1, 1, 1, 3)
    found = sample_lut(lut, nov, roughness)[0, 0, 0]
    torch.testing.assert_close(found, torch.tensor([1.5, 0.0, 3.0]))


def test_strips_join_without_a_seam() -> None:
    lut = lut_for(LutConvention.KARIS)
    random = torch.Generator().manual_seed(1)
    nov, roughness = torch.rand(2, 1, 1, 700, 600, generator=random)
    whole = sample_lut(lut, nov, roughness)
    torch.testing.assert_close(
        whole[..., 300:500, :], sample_lut(lut, nov[..., 300:500, :], roughness[..., 300:500, :])
    )


def test_shapes_that_differ_are_refused() -> None:
    with pytest.raises(ShapeMismatchError, match="bring both to one resolution"):
        sample_lut(integrate_lut(4, 16), torch.zeros(1, 1, 2, 2), torch.zeros(1, 1, 2, 3))


@pytest.mark.parametrize(("size", "samples"), [(1, 64), (8, 8)])
def test_too_small_a_table_is_refused(size: int, samples: int) -> None:
    with pytest.raises(ValueError, match="size must be >= 2 and samples >= 16"):
        integrate_lut(size, samples)
