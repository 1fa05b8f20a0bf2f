"""What an engine computes around a network that predicts lighting: the steps of docs/export.md.

The formulas are those of `lighting`, `demodulation`, `alignment`, `guided_enlargement` and
`radiance`, where they are computed.
"""

from __future__ import annotations

from rtsr_cli.core.choices import DemodulationMode, LutConvention, Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.graphs import GraphTensor, OutsideStep
from rtsr_cli.core.lighting.lighting import EnlargementBase

MOST_LOG = 6.0
"""Log lighting that a graph is proven up to: 400 times k."""

LIGHTING = ("e red, e = log(1 + lighting / k)", "e green", "e blue")
INVERSE_DEPTH = "1 / (1 + z), z view depth in metres; 0 on sky"
NORMAL = ("normal x, world space, -1..1; 0 on sky", "normal y", "normal z")

BRDF = "F = (1 - metallic) albedo + F0 A(NoV, roughness) + B(NoV, roughness)"

DIVISORS = {
    DemodulationMode.BRDF: BRDF,
    DemodulationMode.SOFTPLUS: f"log(1 + exp(100 F)) / 100 in place of F, {BRDF}",
    DemodulationMode.ALBEDO: "F = max(albedo, 0.05)",
    DemodulationMode.GLOSSY_ALBEDO: "F = max(albedo + min(F0, 0.08) (1 - metallic), 0.05), "
    "least channel of F0",
    DemodulationMode.NONE: "F = 1, emission not taken out",
}
"""What radiance is divided by."""


def describe_demodulation(mode: DemodulationMode, lut: LutConvention) -> OutsideStep:
    """The division by a term, with the table of a convention."""
    return OutsideStep(
        name="demodulate",
        when="before",
        formula=f"lighting = max(radiance - emission, 0) / F, {DIVISORS[mode]}; undivided where a "
        "channel of F is not above 0.004 and on sky; A, B: rtsr precompute-lut --convention "
        f"{lut.value}",
    )


DEMODULATE = describe_demodulation(DemodulationMode.BRDF, LutConvention.KARIS)
ENCODE = OutsideStep(
    name="encode",
    when="before",
    formula="e = log(1 + min(lighting, 64) / k), 0 where undivided; "
    "k = exp(mean(log(lighting + 0.001))) over the divided samples of the frame",
)
ALIGN = OutsideStep(
    name="align",
    when="before",
    formula="HR(p) is fetched at p + shift, borders replicated, "
    "shift = floor((0.5 + jitter) S - floor(S / 2)) per axis; undone after",
)
GUIDED_BASE = OutsideStep(
    name="guided base",
    when="before",
    formula="base(p) = sum_q w m e(q) / sum_q w m over 5 x 5 samples q; log w = "
    "-|p - q|^2 / (2 0.7^2) - 32 (1 - n(p).n(q)) - max(0, |z(p) - z(q)| - 1.5 |grad z(p)| |p - q|)"
    " / (0.02 z(p)); 0.0001 of the cubic enlargement joins in",
)
COMPOSE = OutsideStep(
    name="compose",
    when="after",
    formula="radiance = k (exp(max(predicted, 0)) - 1) F + emission, F and emission of the HR "
    "G-buffer; sky and undivided surfaces are enlarged from the LR radiance",
)

CUBIC_BASE = OutsideStep(
    name="cubic base",
    when="before",
    formula="base = e enlarged by Keys' cubic kernel, a = -1/2, holes filled",
)
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
