"""Dividing radiance by its material term and back, to the rules of masked demodulation.

    radiance = lighting * material + emission

Where the division is not safe (sky, black metal) the mask is 0, lighting holds the undivided
radiance and material is 1, so that the same product recomposes every pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.imaging.brdf_lut import sample_lut
from rtsr_cli.core.shapes import Color, Mask, Plane

MAX_FLOAT = torch.finfo(torch.float32).max
"""No quotient is above it."""

DIELECTRIC_F0 = 0.04
"""Reflectance at normal incidence of a common dielectric [Karis 2013; NSRD suppl.]."""

F0_ROUNDING = 1e-3
"""A sum of F0 that is so little above a dielectric's is one that 8 bits or half rounded."""

NO_REFLECTANCE = 1e-6
"""Keeps a quotient finite where surfaces are black."""

LIGHTING_FLOOR = 1e-3
"""Keeps the log of black lighting finite in `lighting_scale`."""

SOFTPLUS_BETA = 100.0
"""Sharpness of FuseSR's material floor: softplus(F) = ln(1 + exp(beta F)) / beta."""

GLOSSY_SPECULAR = 0.08
"""Share of an engine's specular level that ExtraNet's glossy divisor adds."""

ALBEDO_FLOOR = 0.05
"""Smallest divisor of the albedo modes: measured 0.4 to 2.2 dB better than 1e-3."""


@dataclass(frozen=True, kw_only=True)
class Demodulated:
    """`lighting * material + emission` is the radiance of every pixel; `mask` 1 = divided."""

    lighting: Color
    material: Color
    mask: Mask
    emission: Color | None


def specular_f0(albedo: Color, metallic: Plane) -> Color:
    """F0 = lerp(0.04, c, m)."""
    return DIELECTRIC_F0 * (1.0 - metallic) + albedo * metallic


def find_base_color(diffuse: Color, f0: Color) -> tuple[Color, Plane]:
    """Base colour c and metallic m of surfaces that are stored as diffuse colour d and F0.

        d = q c,  F0 = 0.04 q + (1 - q) c,  m = 1 - q
        => 0.12 q^2 - (D + S) q + D = 0,    D, S sums of the channels of d, F0
        => q = 2 D / (D + S + sqrt((D + S)^2 - 0.48 D)),  c = d + F0 - 0.04 q

    Of the two solutions that of the brighter base colour; surfaces that reflect no more than a
    dielectric are none of metal.
    """
    d, s = diffuse.sum(1, keepdim=True), f0.sum(1, keepdim=True)
    both, dielectric = d + s, 3.0 * DIELECTRIC_F0
    root = (both.square() - 4.0 * dielectric * d).clamp(min=0.0).sqrt()
    share = (2.0 * d / (both + root).clamp(min=NO_REFLECTANCE)).clamp(max=1.0)
    share = torch.where(s <= dielectric + F0_ROUNDING, 1.0, share)
    return (diffuse + f0 - DIELECTRIC_F0 * share).clamp_(min=0.0), 1.0 - share


def material_term(
    albedo: Color, f0: Color, *, metallic: Plane, roughness: Plane, nov: Plane, lut: Tensor
) -> Color:
    """F = (1 - m) c + F0 A(NoV, r) + B(NoV, r), the pre-integrated BRDF [NSRD suppl.].

    Args:
        albedo: base colour, linear.
        f0: specular reflectance at normal incidence.
        metallic: 0..1.
        roughness: perceptual, 0..1.
        nov: cosine between view and normal, 0..1.
        lut: table of A and B, see `brdf_lut`.
    """
    terms = sample_lut(lut, nov, roughness)
    specular = torch.addcmul(terms[:, 1:], f0, terms[:, :1])
    return specular.addcmul_(1.0 - metallic, albedo)


def metallic_material_term(
    albedo: Color, *, metallic: Plane, roughness: Plane, nov: Plane, lut: Tensor
) -> Color:
    """`material_term` with F0 of `specular_f0` put in: half the operations on colours.

    F = c (1 - m + m A) + 0.04 (1 - m) A + B
    """
    terms = sample_lut(lut, nov, roughness)
    a, b = terms[:, :1], terms[:, 1:]
    dielectric = 1.0 - metallic
    constant = torch.addcmul(b, dielectric, a, value=DIELECTRIC_F0)
    return torch.addcmul(constant, dielectric.addcmul_(metallic, a), albedo)


def glossy_albedo(albedo: Color, f0: Color, metallic: Plane) -> Color:
    """Return c + 0.08 s (1 - m) [ExtraNet]; s is the level whose F0 is 0.08 s for dielectrics."""
    dielectric = f0.amin(dim=1, keepdim=True).clamp(max=GLOSSY_SPECULAR)
    return albedo + dielectric * (1.0 - metallic)


def floor_material(material: Color) -> Color:
    """max(F, 0.05): the divisor of the albedo modes."""
    return material.clamp(min=ALBEDO_FLOOR)


def soften_material(material: Color) -> Color:
    """ln(1 + exp(beta F)) / beta: a smooth floor of 0.0069 instead of a mask [FuseSR]."""
    return F.softplus(material, beta=SOFTPLUS_BETA)


def demodulate(
    radiance: Color,
    material: Color,
    *,
    sky: Mask,
    emission: Color | None = None,
    epsilon: float = MATERIAL_EPSILON,
    stored: Callable[[Color], Color] | None = None,
) -> Demodulated:
    """Divide radiance, less its emission, by the material term where that is safe.

        lighting = max(radiance - emission, 0) / F,  mask = 1,  where every channel of F > epsilon
        lighting = radiance - emission, material = 1, mask = 0,  elsewhere and on sky

    Emission is bounded by the radiance: noise leaves radiance < emission in places, and the sum
    must still recompose. Non-finite pixels are not divided, nor are those whose quotient no
    half file could hold; of radiance that itself is too large for half, no float could.

    Args:
        radiance: linear HDR.
        material: divisor F.
        sky: 1 = sky.
        emission: part of the radiance that no light and no material explains.
        epsilon: smallest divisor.
        stored: rounding that emission will undergo; done here, lighting makes up for it. Where it
            lifts emission above radiance the difference is below the file's precision.
    """
    bounded = None if emission is None else torch.minimum(emission.clamp(min=0.0), radiance)
    if bounded is not None and stored is not None:
        bounded = stored(bounded)
    reflected = radiance if bounded is None else (radiance - bounded).clamp_(min=0.0)
    divisible = (material.amin(1, keepdim=True) > epsilon) & (sky < 0.5)
    lowest, highest = (float(value) for value in torch.aminmax(reflected))
    # one fast pass tells most frames: finite, and no quotient too large where F > epsilon
    if not (math.isfinite(lowest) and highest <= MAX_HALF * epsilon):
        most = MAX_FLOAT if MAX_HALF < highest < math.inf else MAX_HALF
        divisible &= (reflected <= most * material).all(1, keepdim=True)
        divisible &= torch.isfinite(radiance).all(1, keepdim=True)
    divisor = material.masked_fill(~divisible, 1.0)
    return Demodulated(
        lighting=reflected / divisor,
        material=divisor,
        mask=divisible.to(radiance.dtype),
        emission=bounded,
    )


def remodulate(lighting: Color, material: Color, emission: Color | None = None) -> Color:
    """radiance = lighting * material + emission."""
    if emission is None:
        return lighting * material
    return torch.addcmul(emission, lighting, material)


def lighting_scale(lighting: Color, mask: Mask) -> float:
    """k = exp(mean(log(lighting + 1e-3))) over mask = 1 of the whole frame; 1 if nothing is.

    Summed by NumPy, in one thread and in one order, so that the number of threads changes no bit.
    """
    known = mask > 0.5
    # a sum that is finite has finite terms only: then pixels are taken whole, which is far cheaper
    if len(lighting) == 1 and bool(torch.isfinite(lighting.sum())):
        pixels = known.flatten().nonzero()[:, 0]
        values = lighting[0].flatten(1).index_select(1, pixels).flatten()
    else:
        values = lighting[known.expand_as(lighting) & torch.isfinite(lighting)]
    if not len(values):
        return 1.0
    logs = values.clamp_(min=0.0).add_(LIGHTING_FLOOR).log_()
    return math.exp(logs.double().cpu().numpy().mean())


def recomposition_error(radiance: Color, recomposed: Color) -> float:
    """Largest |difference| relative to max(|radiance|, 1e-3) over finite radiance."""
    difference = (recomposed - radiance).div_(radiance.abs().clamp_(min=1e-3))
    largest = max(abs(float(bound)) for bound in torch.aminmax(difference))
    if math.isfinite(largest):
        return largest
    finite = torch.isfinite(radiance)
    worst = float(difference.abs_().masked_fill_(~finite, 0.0).max())
    # what recomposes to no number at all is as wrong as can be
    return math.inf if math.isnan(worst) else worst
