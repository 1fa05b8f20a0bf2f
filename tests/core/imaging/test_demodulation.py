from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.imaging.demodulation import (
    MATERIAL_EPSILON,
    Demodulated,
    demodulate,
    find_base_color,
    floor_material,
    glossy_albedo,
    lighting_scale,
    material_term,
    recomposition_error,
    remodulate,
    soften_material,
    specular_f0,
)

SHAPE = (1, 3, 2, 3)


def colors(*special: float, top: float) -> st.SearchStrategy[np.ndarray]:
    return hnp.arrays(
        np.float32,
        SHAPE,
        elements=st.one_of(st.sampled_from(special), st.floats(0.0, top, width=32)),
    )


RADIANCE = colors(0.0, 1e-8, 1e-3, 1.0, 65504.0, top=MAX_HALF)
MATERIAL = colors(0.0, 1e-9, MATERIAL_EPSILON, 4.001e-3, 1.0, top=2.0)
SKY = hnp.arrays(np.float32, (1, 1, 2, 3), elements=st.sampled_from([0.0, 1.0]))


def pixel(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32).view(1, 3, 1, 1)


def not_sky() -> torch.Tensor:
    return torch.zeros(1, 1, 1, 1)


def recompose(parts: Demodulated) -> torch.Tensor:
    return remodulate(parts.lighting, parts.material, parts.emission)


@settings(max_examples=150, deadline=None)
@given(radiance=RADIANCE, material=MATERIAL, sky=SKY, emission=st.none() | RADIANCE)
def test_every_pixel_recomposes_whatever_radiance_material_and_emission(
    radiance: np.ndarray, material: np.ndarray, sky: np.ndarray, emission: np.ndarray | None
) -> None:
    color = torch.from_numpy(radiance)
    parts = demodulate(
        color,
        torch.from_numpy(material),
        sky=torch.from_numpy(sky),
        emission=None if emission is None else torch.from_numpy(emission),
    )
    tolerance = 1e-5 * np.maximum(radiance, 1e-3)
    assert (np.abs(recompose(parts).numpy() - radiance) <= tolerance).all()
    assert torch.isfinite(parts.lighting).all()
    assert (parts.lighting >= 0).all()


@settings(max_examples=100, deadline=None)
@given(radiance=RADIANCE, material=MATERIAL, sky=SKY)
def test_the_mask_is_one_exactly_where_every_channel_is_above_epsilon_and_no_sky(
    radiance: np.ndarray, material: np.ndarray, sky: np.ndarray
) -> None:
    parts = demodulate(
        torch.from_numpy(radiance), torch.from_numpy(material), sky=torch.from_numpy(sky)
    )
    for row in range(2):
        for column in range(3):
            f, c = material[0, :, row, column], radiance[0, :, row, column]
            fits_half = bool((c <= np.float32(MAX_HALF) * f).all())
            safe = bool((f > np.float32(MATERIAL_EPSILON)).all()) and sky[0, 0, row, column] == 0
            assert float(parts.mask[0, 0, row, column]) == float(safe and fits_half)
            if not (safe and fits_half):
                assert parts.lighting[0, :, row, column].tolist() == c.tolist()
                assert parts.material[0, :, row, column].tolist() == [1.0, 1.0, 1.0]


def test_lighting_is_radiance_less_emission_over_the_material() -> None:
    parts = demodulate(
        pixel(1.0, 2.0, 3.0),
        pixel(0.5, 0.25, 1.0),
        sky=not_sky(),
        emission=pixel(0.5, 0.0, 1.0),
    )
    assert parts.lighting.flatten().tolist() == [1.0, 8.0, 2.0]
    assert float(parts.mask) == 1.0


def test_black_metal_is_not_divided_even_if_one_channel_could_be() -> None:
    parts = demodulate(pixel(0.1, 0.2, 0.3), pixel(0.5, 0.5, 0.0), sky=not_sky())
    assert float(parts.mask) == 0.0
    assert torch.equal(parts.lighting, pixel(0.1, 0.2, 0.3))


def test_nothing_is_divided_by_epsilon_itself() -> None:
    at = torch.full((1, 3, 1, 1), MATERIAL_EPSILON)
    above = at * 1.01
    assert float(demodulate(pixel(1, 1, 1), at, sky=not_sky()).mask) == 0.0
    assert float(demodulate(pixel(1, 1, 1), above, sky=not_sky()).mask) == 1.0


def test_the_smallest_divisor_is_the_callers_choice() -> None:
    parts = demodulate(pixel(1, 1, 1), pixel(0.1, 0.1, 0.1), sky=not_sky(), epsilon=0.2)
    assert float(parts.mask) == 0.0


def test_emission_above_the_radiance_is_bounded_by_it() -> None:
    parts = demodulate(
        pixel(0.2, 0.2, 0.2), pixel(1, 1, 1), sky=not_sky(), emission=pixel(0.5, 0.1, -1.0)
    )
    assert parts.emission is not None
    assert parts.emission.flatten().tolist() == pytest.approx([0.2, 0.1, 0.0])
    assert parts.lighting.flatten().tolist() == pytest.approx([0.0, 0.1, 0.2])


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_pixel_that_is_not_finite_is_masked_and_harms_no_other(bad: float) -> None:
    radiance = torch.ones(1, 3, 1, 3)
    material = torch.full((1, 3, 1, 3), 0.5)
    radiance[0, 1, 0, 0] = bad
    material[0, 2, 0, 1] = math.nan
    parts = demodulate(radiance, material, sky=torch.zeros(1, 1, 1, 3))
    assert parts.mask.flatten().tolist() == [0.0, 0.0, 1.0]
    assert parts.lighting[..., 2].flatten().tolist() == [2.0, 2.0, 2.0]
    assert torch.isfinite(parts.material).all()


def test_a_quotient_that_no_half_file_could_hold_is_not_made() -> None:
    bright = pixel(60000.0, 60000.0, 60000.0)
    parts = demodulate(bright, pixel(0.5, 0.5, 0.5), sky=not_sky())
    assert float(parts.mask) == 0.0
    assert torch.equal(parts.lighting, bright)


def test_the_lighting_scale_is_the_geometric_mean_of_lighting_plus_a_thousandth() -> None:
    lighting = torch.tensor([[1.0, 2.0], [4.0, 8.0], [16.0, 32.0]]).reshape(1, 3, 1, 2)
    expected = math.exp(sum(math.log(2.0**i + 1e-3) for i in range(6)) / 6)
    assert lighting_scale(lighting, torch.ones(1, 1, 1, 2)) == pytest.approx(expected, rel=1e-6)


def test_the_lighting_scale_ignores_masked_and_non_finite_pixels() -> None:
    lighting = torch.full((1, 3, 1, 3), 2.0)
    lighting[..., 1] = 1e9
    lighting[0, 0, 0, 2] = math.nan
    mask = torch.tensor([1.0, 0.0, 1.0]).view(1, 1, 1, 3)
    assert lighting_scale(lighting, mask) == pytest.approx(2.001, rel=1e-6)


def test_the_lighting_scale_of_a_frame_without_divided_pixels_is_one() -> None:
    assert lighting_scale(torch.full((1, 3, 2, 2), 5.0), torch.zeros(1, 1, 2, 2)) == 1.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_lighting_scale_does_not_depend_on_the_number_of_threads(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    lighting = torch.rand(1, 3, 541, 967, generator=generator) * 10
    mask = (torch.rand(1, 1, 541, 967, generator=generator) > 0.3).float()
    threads = torch.get_num_threads()
    found = set()
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            found.add(lighting_scale(lighting, mask))
    finally:
        torch.set_num_threads(threads)
    assert len(found) == 1


def constant_lut(a: float, b: float) -> torch.Tensor:
    return torch.tensor([a, b]).view(1, 2, 1, 1).expand(1, 2, 4, 4)


def plane(value: float) -> torch.Tensor:
    return torch.full((1, 1, 1, 1), value)


@pytest.mark.parametrize(
    ("metallic", "expected"),
    [
        # dielectric: c and 0.02 of the first term, 0.1 of the second
        (0.0, [0.2 + 0.12, 0.4 + 0.12, 0.8 + 0.12]),
        # metal: half of c, and 0.1
        (1.0, [0.2, 0.3, 0.5]),
        # half of either: c / 2 diffuse, (0.02 + c / 2) / 2 specular, and 0.1
        (0.5, [0.26, 0.41, 0.71]),
    ],
)
def test_the_material_term_by_hand(metallic: float, expected: list[float]) -> None:
    albedo = pixel(0.2, 0.4, 0.8)
    term = material_term(
        albedo,
        specular_f0(albedo, plane(metallic)),
        metallic=plane(metallic),
        roughness=plane(0.3),
        nov=plane(0.6),
        lut=constant_lut(0.5, 0.1),
    )
    assert term.flatten().tolist() == pytest.approx(expected, abs=1e-6)


def test_stored_f0_takes_the_place_of_the_one_from_albedo() -> None:
    term = material_term(
        pixel(0.2, 0.4, 0.8),
        pixel(0.1, 0.2, 0.3),
        metallic=plane(0.0),
        roughness=plane(0.3),
        nov=plane(0.6),
        lut=constant_lut(0.5, 0.0),
    )
    assert term.flatten().tolist() == pytest.approx([0.25, 0.5, 0.95], abs=1e-6)


def test_a_metal_of_black_albedo_has_a_material_of_the_second_term_alone() -> None:
    black = pixel(0.0, 0.0, 0.0)
    term = material_term(
        black,
        specular_f0(black, plane(1.0)),
        metallic=plane(1.0),
        roughness=plane(0.3),
        nov=plane(0.6),
        lut=constant_lut(0.5, 0.002),
    )
    assert term.flatten().tolist() == pytest.approx([0.002] * 3, abs=1e-6)


def test_the_glossy_divisor_adds_the_dielectric_reflectance() -> None:
    albedo = pixel(0.2, 0.4, 0.8)
    dielectric = glossy_albedo(albedo, specular_f0(albedo, plane(0.0)), plane(0.0))
    metal = glossy_albedo(albedo, specular_f0(albedo, plane(1.0)), plane(1.0))
    assert dielectric.flatten().tolist() == pytest.approx([0.24, 0.44, 0.84], abs=1e-6)
    assert metal.flatten().tolist() == pytest.approx([0.2, 0.4, 0.8], abs=1e-6)


def test_albedo_divisors_have_a_floor() -> None:
    assert floor_material(pixel(0.0, 0.05, 0.6)).flatten().tolist() == pytest.approx(
        [0.05, 0.05, 0.6]
    )


def test_the_soft_floor_is_log_two_over_beta_at_zero_and_the_material_far_from_it() -> None:
    soft = soften_material(pixel(0.0, 0.02, 0.7)).flatten().tolist()
    expected = [math.log(2) / 100, math.log(1 + math.exp(2)) / 100, 0.7]
    assert soft == pytest.approx(expected, abs=1e-6)


def test_the_recomposition_error_is_relative_above_a_thousandth_and_absolute_below() -> None:
    radiance = torch.tensor([2.0, 1e-4, math.inf]).view(1, 3, 1, 1)
    recomposed = torch.tensor([2.1, 2e-4, 5.0]).view(1, 3, 1, 1)
    assert recomposition_error(radiance, recomposed) == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize(
    ("diffuse", "f0", "base", "metallic"),
    [
        # gold; a red plastic; half of each in one pixel: q = 0.5, c = (0.9, 0.6, 0.2)
        ((0.0, 0.0, 0.0), (1.0, 0.77, 0.34), (1.0, 0.77, 0.34), 1.0),
        ((0.6, 0.1, 0.1), (0.04, 0.04, 0.04), (0.6, 0.1, 0.1), 0.0),
        ((0.45, 0.3, 0.1), (0.47, 0.32, 0.12), (0.9, 0.6, 0.2), 0.5),
        # soot, and a pixel of nothing, are no metal
        ((0.0, 0.0, 0.0), (0.04, 0.04, 0.04), (0.0, 0.0, 0.0), 0.0),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0),
    ],
)
def test_diffuse_colour_and_f0_are_a_base_colour_and_a_metallic(
    diffuse: tuple[float, ...], f0: tuple[float, ...], base: tuple[float, ...], metallic: float
) -> None:
    found, share = find_base_color(pixel(*diffuse), pixel(*f0))
    assert torch.allclose(found, pixel(*base), atol=1e-4)
    assert share.item() == pytest.approx(metallic, abs=1e-4)
