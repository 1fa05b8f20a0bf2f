from __future__ import annotations

import math
import time

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.brdf_lut import (
    integrate_lut,
    integrate_split_sum,
    load_default_lut,
    lobe_parameters,
    sample_lut,
)

Array = NDArray[np.float64]
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


def alpha_and_k(roughness: float, convention: LutConvention) -> tuple[float, float]:
    if convention is LutConvention.KARIS:
        return roughness**2, roughness**2 / 2
    return roughness, (roughness + 1) ** 2 / 8


def graded_rule(low: float, high: float, centres: dict[float, float]) -> tuple[Array, Array]:
    """12 Gauss-Legendre nodes on panels that double in width away from each centre's own scale."""
    offsets = [(c, s * 2.0**j) for c, s in centres.items() for j in range(-1, 60)]
    breaks = {low, high, *centres, *(c + o for c, o in offsets), *(c - o for c, o in offsets)}
    edges = np.array(sorted(b for b in breaks if low <= b <= high))
    nodes, weights = np.polynomial.legendre.leggauss(12)
    width = np.diff(edges)[:, None]
    return (edges[:-1, None] + width * (nodes + 1) / 2).ravel(), (width * weights / 2).ravel()


def integrate_over_incident_light(nov: float, roughness: float, convention: LutConvention) -> Array:
    """A and B by integrating D G / (4 n.o) over the direction of the light, not the half vector."""
    alpha, k = alpha_and_k(roughness, convention)
    theta_o = math.acos(nov)
    theta, theta_weights = graded_rule(0, math.pi / 2, {theta_o: alpha, math.pi / 2: k})
    phi, phi_weights = graded_rule(0, math.pi, {0.0: alpha * nov})
    theta = theta[:, None]
    noi = np.cos(theta)
    hx = math.sin(theta_o) - np.sin(theta) * np.cos(phi)
    hy = np.sin(theta) * np.sin(phi)
    hz = nov + noi
    length2 = hx**2 + hy**2 + hz**2
    sin2, cos2 = (hx**2 + hy**2) / length2, hz**2 / length2
    ggx = alpha**2 / (math.pi * (cos2 * alpha**2 + sin2) ** 2)
    smith = nov / (nov * (1 - k) + k) * noi / (noi * (1 - k) + k)
    fresnel = (1 - np.sqrt(length2) / 2) ** 5
    shares = ggx * smith / (4 * nov) * np.sin(theta) * theta_weights[:, None] * phi_weights * 2
    return np.array([(shares * (1 - fresnel)).sum(), (shares * fresnel).sum()])


def bilinear(table: Array, nov: Array, roughness: Array) -> Array:
    size = table.shape[-1]
    x, y = (np.clip(v * size - 0.5, 0, size - 1) for v in (nov, roughness))
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    x1, y1 = np.minimum(x0 + 1, size - 1), np.minimum(y0 + 1, size - 1)
    fx, fy = x - x0, y - y0
    top = table[:, y0, x0] * (1 - fx) + table[:, y0, x1] * fx
    bottom = table[:, y1, x0] * (1 - fx) + table[:, y1, x1] * fx
    return np.asarray(top * (1 - fy) + bottom * fy)


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
    table = load_default_lut(convention)[0, :, row, column].double().numpy()
    np.testing.assert_allclose(table, expected, atol=2e-4)


@pytest.mark.parametrize("row", [0, 1, 4, 10, 18, 22, 30, 45, 80, 200, 350, 511])
def test_hard_rows_agree_with_an_integral_over_incident_light(
    convention: LutConvention, row: int
) -> None:
    columns = [5, 6, 8, 12, 20, 40, 90, 200, 350, 511]
    expected = [
        integrate_over_incident_light((x + 0.5) / 512, (row + 0.5) / 512, convention)
        for x in columns
    ]
    found = load_default_lut(convention)[0, :, row, columns].numpy()
    np.testing.assert_allclose(found.T, expected, rtol=0, atol=3e-5)


def test_a_rough_lobe_seen_head_on_sums_to_one_minus_ln_2(convention: LutConvention) -> None:
    """alpha = 1, k = 1/2, n.o = 1: A + B = 1/2 int_0^1 2n / (n + 1) dn."""
    terms = integrate_split_sum(np.array([1 - 1e-12]), np.ones(1), convention=convention)
    assert terms.sum() == pytest.approx(1 - math.log(2), abs=1e-9)


@pytest.mark.parametrize("nov", [0.01, 0.1, 0.5, 0.9])
def test_a_mirror_gives_the_fresnel_term_times_the_masking_of_both_sides(
    convention: LutConvention, nov: float
) -> None:
    k = {LutConvention.KARIS: 0.0, LutConvention.SEED: 0.125}[convention]
    masking = (nov / (nov * (1 - k) + k)) ** 2
    fresnel = (1 - nov) ** 5
    terms = integrate_split_sum(np.array([nov]), np.array([1e-7]), convention=convention)
    expected = [masking * (1 - fresnel), masking * fresnel]
    np.testing.assert_allclose(terms[:, 0, 0], expected, rtol=0, atol=2e-5)


@pytest.mark.parametrize("size", [2, 3, 64, 700])
def test_every_size_has_its_values_at_texel_centres(size: int) -> None:
    table = integrate_lut(size)
    assert table.shape == (1, 2, size, size)
    assert table.dtype == torch.float32
    x, y = size - 1, size // 2
    expected = integrate_over_incident_light(
        (x + 0.5) / size, (y + 0.5) / size, LutConvention.KARIS
    )
    np.testing.assert_allclose(table[0, :, y, x].numpy(), expected, rtol=0, atol=3e-5)


def test_more_samples_come_closer_to_the_integral(convention: LutConvention) -> None:
    nov, roughness = np.array([0.02, 0.3]), np.array([0.1, 0.9])
    exact = integrate_split_sum(nov, roughness, samples=8192, convention=convention)
    errors = [
        np.abs(
            integrate_split_sum(nov, roughness, samples=samples, convention=convention) - exact
        ).max()
        for samples in (16, 128, 1024)
    ]
    assert errors[0] > 4 * errors[1] > 16 * errors[2]


def test_lobe_parameters_follow_the_convention() -> None:
    half = np.array([0.5])
    assert lobe_parameters(half, LutConvention.KARIS) == (0.25, 0.125)
    assert lobe_parameters(half, LutConvention.SEED) == (0.5, 0.28125)


def test_the_default_table_is_made_within_its_time_budget() -> None:
    seconds = []
    for _ in range(3):
        started = time.perf_counter()
        integrate_lut()
        seconds.append(time.perf_counter() - started)
    assert min(seconds) < 1.5


def test_interpolating_nodes_loses_nothing_against_integrating_every_texel(
    convention: LutConvention,
) -> None:
    centres = (np.arange(512) + 0.5) / 512
    columns, rows = np.arange(5, 512, 37), np.arange(0, 512, 43)
    exact = integrate_split_sum(
        centres[columns], centres[rows], samples=8192, convention=convention
    )
    table = load_default_lut(convention)[0].double().numpy()[:, rows][:, :, columns]
    assert np.abs(table - exact).max() < 1e-4


def test_a_smooth_surface_seen_head_on_reflects_everything_without_fresnel() -> None:
    scale, bias = integrate_split_sum(np.array([1 - 1e-9]), np.array([1e-3]))[:, 0, 0]
    assert scale == pytest.approx(1.0, abs=1e-4)
    assert bias == pytest.approx(0.0, abs=1e-4)


def test_no_texel_gains_energy_or_is_negative(convention: LutConvention) -> None:
    table = load_default_lut(convention)
    assert float(table.min()) >= 0.0
    assert float(table.sum(1).max()) <= 1.0


def test_the_conventions_differ() -> None:
    karis, seed = (load_default_lut(c) for c in CONVENTIONS)
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


@pytest.mark.parametrize(
    "shape", [(1, 1, 3, 5), (2, 1, 17, 9), (1, 1, 1100, 1000), (2, 1, 2, 600000)]
)
def test_strips_of_any_shape_hold_the_bilinear_value_of_each_pixel(
    shape: tuple[int, int, int, int],
) -> None:
    random = torch.Generator().manual_seed(3)
    lut = torch.rand(1, 2, 16, 16, generator=random)
    nov, roughness = torch.rand(2, *shape, generator=random) * 1.2 - 0.1
    found = sample_lut(lut, nov, roughness)
    assert found.shape == (shape[0], 2, *shape[2:])
    expected = bilinear(lut[0].double().numpy(), nov[:, 0].numpy(), roughness[:, 0].numpy())
    np.testing.assert_allclose(found.movedim(1, 0).numpy(), expected, rtol=0, atol=1e-5)


def test_looking_up_leaves_the_planes_as_they_were() -> None:
    nov, roughness = torch.rand(2, 1, 1, 4, 4, generator=torch.Generator().manual_seed(1))
    before = nov.clone(), roughness.clone()
    sample_lut(load_default_lut(LutConvention.KARIS), nov, roughness)
    assert torch.equal(nov, before[0])
    assert torch.equal(roughness, before[1])


def test_the_look_up_in_the_default_table_is_close_to_the_integral(
    convention: LutConvention,
) -> None:
    nov, roughness = np.linspace(0.01, 0.999, 97), np.linspace(0.001, 1, 89)
    exact = integrate_split_sum(nov, roughness, convention=convention)
    columns, rows = (
        torch.from_numpy(plane.astype(np.float32))[None, None]
        for plane in np.meshgrid(nov, roughness)
    )
    found = sample_lut(load_default_lut(convention), columns, rows)[0].numpy()
    assert np.abs(found - exact).max() < 1.2e-3


def test_a_table_is_made_once() -> None:
    assert load_default_lut(LutConvention.SEED) is load_default_lut(LutConvention.SEED)


def test_a_table_first_made_under_inference_mode_can_be_trained_through() -> None:
    with torch.inference_mode():
        lut = load_default_lut(LutConvention.KARIS, torch.device("cpu", 0))
    roughness = torch.full((1, 1, 2, 2), 0.5, requires_grad=True)
    sample_lut(lut, torch.full((1, 1, 2, 2), 0.5), roughness)[:, 0].sum().backward()
    assert roughness.grad is not None
    assert bool((roughness.grad < 0).all())


def test_shapes_that_differ_are_refused() -> None:
    with pytest.raises(ShapeMismatchError, match="bring both to one resolution"):
        sample_lut(integrate_lut(4, 16), torch.zeros(1, 1, 2, 2), torch.zeros(1, 1, 2, 3))


@pytest.mark.parametrize(("size", "samples"), [(1, 64), (8, 8)])
def test_too_small_a_table_is_refused(size: int, samples: int) -> None:
    with pytest.raises(ValueError, match="size must be >= 2 and samples >= 16"):
        integrate_lut(size, samples)
