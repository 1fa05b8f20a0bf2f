"""What an engine computes around a network that predicts lighting: the steps of docs/export.md.

The formulas are those of `lighting`, `demodulation`, `alignment`, `guided_kernel`, `enlargement`
and `radiance`, where they are computed; every number in them is a constant of these modules.
"""

from __future__ import annotations

from rtsr_cli.core.choices import MATERIAL_EPSILON, DemodulationMode, LutConvention, Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.graphs import GraphTensor, OutsideStep
from rtsr_cli.core.imaging import guided_kernel as kernel
from rtsr_cli.core.imaging.demodulation import (
    ALBEDO_FLOOR,
    DIELECTRIC_F0,
    GLOSSY_SPECULAR,
    LIGHTING_FLOOR,
    SOFTPLUS_BETA,
)
from rtsr_cli.core.imaging.resampling import KEYS_A, MIN_FILTERED_MASK
from rtsr_cli.core.lighting.lighting import FADING_SHARE, MAX_LIGHTING, EnlargementBase
from rtsr_cli.core.lighting.radiance import EMISSION_SHARE

MOST_LOG = 6.0
"""Log lighting that a graph is proven up to: 400 times k."""

LIGHTING = (
    f"e red, e = log(1 + min(max(lighting, 0), {MAX_LIGHTING:g}) / k); 0 where undivided",
    "e green",
    "e blue",
)
UNBOUNDED_LIGHTING = (
    "e red, e = log(1 + max(lighting, 0) / k); 0 where undivided",
    "e green",
    "e blue",
)
INVERSE_DEPTH = "1 / (1 + z), z view depth in metres; 0 on sky"
NORMAL = ("normal x, world space, of unit length; 0 on sky", "normal y", "normal z")

BRDF = (
    "F = (1 - metallic) albedo + F0 A(NoV, roughness) + B(NoV, roughness), "
    f"F0 = {DIELECTRIC_F0:g} (1 - metallic) + albedo metallic"
)

DIVISORS = {
    DemodulationMode.BRDF: BRDF,
    DemodulationMode.SOFTPLUS: f"log(1 + exp({SOFTPLUS_BETA:g} F)) / {SOFTPLUS_BETA:g} in place of "
    f"F, on sky, too; {BRDF}",
    DemodulationMode.ALBEDO: f"F = max(albedo, {ALBEDO_FLOOR:g})",
    DemodulationMode.GLOSSY_ALBEDO: f"F = max(albedo + min(F0, {GLOSSY_SPECULAR:g}) (1 - metallic),"
    f" {ALBEDO_FLOOR:g}), least channel of F0",
    DemodulationMode.NONE: "F = 1, emission not taken out",
}
"""What radiance is divided by."""


def describe_demodulation(mode: DemodulationMode, lut: LutConvention) -> OutsideStep:
    """The division by a term, with the table of a convention."""
    return OutsideStep(
        name="demodulate",
        when="before",
        formula=f"lighting = max(radiance - E, 0) / F, E = min(max(emission, 0), radiance), "
        f"{DIVISORS[mode]}; undivided, radiance - E, where a channel of F is not above "
        f"{MATERIAL_EPSILON:g} and on sky, z >= {SKY_DEPTH_M:g}; NoV of normals made of unit "
        f"length, rays through the samples; A, B: rtsr precompute-lut --convention {lut.value}",
    )


K = (
    f"k = exp(mean(log(max(lighting, 0) + {LIGHTING_FLOOR:g}))) over the divided samples of the "
    "frame, 1 if there is none"
)

DEMODULATE = describe_demodulation(DemodulationMode.BRDF, LutConvention.KARIS)
ENCODE = OutsideStep(
    name="encode",
    when="before",
    formula=f"e = log(1 + max(lighting, 0) / k), which the enlargements below take; frames that a "
    f"network sees have min(lighting, {MAX_LIGHTING:g}) in place of lighting, and 0 where "
    f"undivided; {K}",
)
ENCODE_UNBOUNDED = OutsideStep(
    name="encode",
    when="before",
    formula=f"e = log(1 + max(lighting, 0) / k), 0 where undivided; {K}",
)
ALIGN = OutsideStep(
    name="align",
    when="before",
    formula="HR(p) is fetched at p + shift, borders replicated, "
    "shift = floor((0.5 + jitter) S - floor(S / 2) + 1e-6) per axis; undone after",
)
CUBIC = (
    f"Keys' kernel, a = {KEYS_A:g}, over 4 x 4 samples at their places, q + 0.5 + jitter - "
    f"shift / S, borders replicated: cubic(e m) / cubic(m) where cubic(m) >= {MIN_FILTERED_MASK:g} "
    "(m: 1 = divided), else the block's own sample, 3 x 3 mean of the divided ones where it is "
    "none, log 2 where there are none of these either"
)
GUIDED_BASE = OutsideStep(
    name="guided base",
    when="before",
    formula=f"base(p) = ({kernel.FALLBACK_WEIGHT:g} cubic(p) + sum_q w m e(q)) / "
    f"({kernel.FALLBACK_WEIGHT:g} + sum_q w m) over {2 * kernel.REACH + 1} x "
    f"{2 * kernel.REACH + 1} samples q, m: 1 = divided, e of all of lighting; log w = "
    f"-a^2 / (2 {kernel.SPREAD:g}^2) - {kernel.FACING:g} (1 - n(p).n(q)) - max(0, |z(p) - z(q)| - "
    f"{kernel.SLOPE:g} g(p) a) / ({kernel.DEPTH_SHARE:g} z(p)); a = |p - q| in LR pixels, beyond "
    "the frame, too, where the border's sample is q; samples with exp(-a^2 / (2 "
    f"{kernel.SPREAD:g}^2)) below {kernel.LEAST_WEIGHT:g} at every pixel of a block are left out; "
    "n(p).n(q) = 1 where p or q is a surface of normal 0; g(p): lesser of the absolute differences "
    "of z to both sides, the larger one of both axes, an LR pixel (S times that of HR pixels); z "
    f"within {kernel.MIN_DEPTH:g}..{kernel.MAX_DEPTH:g}; cubic: {CUBIC}",
)
KEEP_UNSEEN = OutsideStep(
    name="keep unseen",
    when="after",
    formula="predicted = base + w (predicted - base), w = min(max(("
    f"{MAX_LIGHTING:g} - L) / {(1.0 - FADING_SHARE) * MAX_LIGHTING:g}, 0), 1), L the largest "
    "channel of k (exp(max(base, 0)) - 1)",
)
COMPOSE = OutsideStep(
    name="compose",
    when="after",
    formula="radiance = max(k (exp(max(predicted, 0)) - 1) F + emission, 0), F and emission of the "
    f"HR G-buffer; on sky, z >= {SKY_DEPTH_M:g}, LR radiance of the sky is enlarged (cubic, in "
    f"c / (1 + c)); so is all LR radiance where F is not above {MATERIAL_EPSILON:g} or samples "
    "around are undivided, HR emission put in for LR's where it is more than "
    f"{EMISSION_SHARE:g} of that",
)

CUBIC_BASE = OutsideStep(name="cubic base", when="before", formula=f"base = e enlarged by {CUBIC}")
BASES = {EnlargementBase.GUIDED: GUIDED_BASE, EnlargementBase.CUBIC: CUBIC_BASE}


def list_steps_before(
    mode: DemodulationMode, lut: LutConvention, base: EnlargementBase
) -> tuple[OutsideStep, ...]:
    """Steps before a network that corrects an enlargement of log lighting."""
    return (describe_demodulation(mode, lut), ENCODE, ALIGN, BASES[base])


BASE = GraphTensor(
    name="base",
    channels=("e red of the guided base, aligned", "e green", "e blue"),
    most=MOST_LOG,
)
PREDICTED = GraphTensor(
    name="predicted",
    channels=("e red of the HR lighting, aligned", "e green", "e blue"),
    most=MOST_LOG,
)
MATERIAL = ("F red of the HR G-buffer, aligned, linear", "F green", "F blue")


def require_own_preset(preset: Preset) -> None:
    """Refuse to describe what the publication surrounds a network with.

    Raises:
        ConfigError: it is not this project's preset.
    """
    if preset is not Preset.RTSR:
        raise ConfigError(
            f"only networks of preset {Preset.RTSR} can be exported, not {preset}; train one "
            f"(--set network.preset={Preset.RTSR})"
        )
