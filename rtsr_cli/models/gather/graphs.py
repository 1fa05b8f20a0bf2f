"""What is exported of `gather`: trunk and head as one graph; what fetches lighting stays outside.

The channels are those of `inputs`, in its order.
"""

from __future__ import annotations

from rtsr_cli.core.graphs import (
    CarriedTensor,
    Graph,
    GraphTensor,
    NetworkGraphs,
    OutsideStep,
)
from rtsr_cli.core.lighting.graph_steps import (
    ALIGN,
    COMPOSE,
    DEMODULATE,
    ENCODE,
    INVERSE_DEPTH,
    LIGHTING,
    NORMAL,
)
from rtsr_cli.models.gather.config import GatherConfig
from rtsr_cli.models.gather.network import MOST_WORTH

SAMPLES = (
    *LIGHTING,
    "mask, 1 = divided",
    *NORMAL,
    INVERSE_DEPTH,
    "change red: e less history where the sample's surface was seen before",
    "change green",
    "change blue",
    "seen: share of history that is of the sample's surface",
    "largest |change| of the three",
    "mean of e less its mean of 3 x 3 samples",
    "1 / S",
)

PIXELS = (
    "fit: weight of the best sample",
    "log(fit + 0.001) / 4",
    "log(1 + worth) / 2, worth of history in samples",
    "1 where worth is above 0.0001",
    "mean of the enlarged change",
    "root of the mean square of the enlarged change",
    "mean of history less the frame's own lighting, e; 0 without history",
    "largest |difference| of the three",
    "mean e of the frame's own lighting",
    "mean e of history; 0 without it",
    "10 (1 - |mean of 3 x 3 HR normals|)",
    "perceptual roughness; 0.5 where there is none",
    "log(mean of F + 0.01) / 4",
    f"{INVERSE_DEPTH}, HR",
    "largest |motion component| / 8, at most 1; HR pixels",
    "2 (fx (1 - fx) + fy (1 - fy)), f the fraction of the motion",
    "enlarged seen",
    "x of the pixel minus that of its block's sample, LR pixels, right positive",
    "y of the pixel minus that of its block's sample, LR pixels, down positive",
)

CORRECTIONS = (
    "r1: factor of distance in log w is exp(clamp(r1, -3, 3))",
    "r2: the same of the normal",
    "r3: the same of depth",
    "r4: worth of history times exp(clamp(r4, -6, 6))",
    "r5: added to the logit of the share of change that is believed",
)
RESIDUAL = ("added to e red", "added to e green", "added to e blue")

CARRY = OutsideStep(
    name="carry history",
    when="before",
    formula="h(p), c(p) = history and its worth where p's surface was (bilinear, samples of other "
    "surfaces weigh 0); change = e - h at samples that were seen",
)


def _describe_gathering(config: GatherConfig) -> OutsideStep:
    return OutsideStep(
        name="gather",
        when="after",
        formula="all r are 0 where a pixel filter went over radiance; w as in the guided base, "
        "its terms times f1..f3; d = guided enlargement of the change; "
        "t = clamp(3 |d|^2 / E - 2, 0, 1), E = guided enlargement of |change|^2, squares as means "
        f"of three; c' = {config.age:g} c exp(r4) / (1 + (1 + {config.change_agreed:g} t) |d|^2 / "
        f"{config.change_spread:g}^2); b = sigmoid(logit({config.change:g}) + r5) "
        f"min(1, fit / {config.change_fit:g}) max(min(1, {config.change_worth:g} / c'), t); "
        f"h' = h + b d; n = fit^{config.fit_power:g}; e = (c' h' + n g) / (c' + n), g = guided "
        f"enlargement of e; worth = c' + n, at most {MOST_WORTH:g}",
    )


def describe(config: GatherConfig) -> NetworkGraphs:
    """What is exported of a config."""
    return NetworkGraphs(
        graphs=(
            Graph(
                method="correct",
                summary="what samples and pixels say -> how far each weight is to be believed",
                inputs=(
                    GraphTensor(name="samples", channels=SAMPLES, least=-1.0, most=3.0),
                    GraphTensor(name="pixels", channels=PIXELS, least=-1.0, most=3.0),
                ),
                outputs=(
                    GraphTensor(
                        name="corrections",
                        channels=CORRECTIONS + (RESIDUAL if config.residual else ()),
                    ),
                ),
            ),
        ),
        outside=(DEMODULATE, ENCODE, ALIGN, CARRY, _describe_gathering(config), COMPOSE),
        carried=(
            CarriedTensor(
                name="history",
                made="lighting k (exp(e) - 1), worth, and the HR surfaces it lies on",
                reset="none: worth 0",
                moved="carry history",
            ),
        ),
    )
