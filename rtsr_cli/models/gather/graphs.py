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
from rtsr_cli.core.imaging.camera_motion import STATIC_PX
from rtsr_cli.core.imaging.surfaces import FACING, MOVING_SHARE, PLANE_SHARE
from rtsr_cli.core.lighting.graph_steps import (
    ALIGN,
    COMPOSE,
    DEMODULATE,
    ENCODE_UNBOUNDED,
    GUIDED_BASE,
    INVERSE_DEPTH,
    NORMAL,
    UNBOUNDED_LIGHTING,
)
from rtsr_cli.core.lighting.lighting_history import (
    LEAST_COMPARED_WORTH,
    LEAST_KNOWN_SHARE,
    LEAST_SQUARE,
    OTHERS,
)
from rtsr_cli.models.gather.config import GatherConfig
from rtsr_cli.models.gather.inputs import FASTEST_PX, LEAST_SHOWN_WORTH, ROUGHNESS
from rtsr_cli.models.gather.network import (
    MOST_EMPHASIS,
    MOST_KEPT,
    MOST_LOGIT,
    MOST_WORTH,
)

SAMPLES = (
    *UNBOUNDED_LIGHTING,
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
    f"1 where worth is above {LEAST_SHOWN_WORTH:g}",
    "mean of the enlarged change",
    "root of the mean square of the enlarged change",
    "mean of history less the frame's own lighting, e; 0 without history",
    "largest |difference| of the three",
    "mean e of the frame's own lighting",
    "mean e of history; 0 without it",
    "10 (1 - |mean of 3 x 3 HR normals|)",
    f"perceptual roughness; {ROUGHNESS:g} where there is none",
    "log(mean of F + 0.01) / 4",
    f"{INVERSE_DEPTH}, HR",
    f"largest |motion component| / {FASTEST_PX:g}, at most 1; HR pixels",
    "2 (fx (1 - fx) + fy (1 - fy)), f the fraction of the motion",
    "enlarged seen",
    "x of the pixel minus that of its block's sample, LR pixels, right positive",
    "y of the pixel minus that of its block's sample, LR pixels, down positive",
)

CORRECTIONS = (
    f"r1: factor of distance in log w is exp(clamp(r1, -{MOST_EMPHASIS:g}, {MOST_EMPHASIS:g}))",
    "r2: the same of the normal",
    "r3: the same of depth",
    f"r4: worth of history times exp(clamp(r4, -{MOST_LOGIT:g}, {MOST_LOGIT:g}))",
    "r5: added to the logit of the share of change that is believed",
)
RESIDUAL = ("added to e red", "added to e green", "added to e blue")

CARRY = OutsideStep(
    name="carry history",
    when="before",
    formula="h(p), c(p) = sum_q b l v(q) / sum_q b l of the four pixels q around p + motion(p), b "
    "their bilinear weights, v history as e with the current k and exposure, and its worth; c "
    "times sum_q b l, times 1 - reactive, 0 outside; l = exp(-"
    f"{FACING:g} (1 - n(p).n(q)) - |plane(p).(P(q) - P(p))| / ({PLANE_SHARE:g} z(p))), "
    f"{MOVING_SHARE:g} z(p) where motion is not the camera's by more than {STATIC_PX:g} pixels, 0 "
    "where object, sky or being divided differ; P world position, plane the normal; seen: divided "
    f"samples whose c is above {LEAST_COMPARED_WORTH:g} there; change = e - h at these, else 0",
)


def _describe_gathering(config: GatherConfig) -> OutsideStep:
    return OutsideStep(
        name="gather",
        when="after",
        formula="all r are 0 where a pixel filter went over radiance; w as in the guided base, "
        "its terms times f1..f3, for e alone; d = guided enlargement of the change, f = 1; "
        f"t = u clamp(3 |d|^2 / max(E, {LEAST_SQUARE:g}) - 2, 0, 1), E = guided enlargement of "
        "|change|^2, u = max(change . D, 0) / (|change| max(A, "
        f"{OTHERS:g} |change|)) of the block's sample, D and A sums of change and |change| of the "
        f"eight samples around it; d and E over that of seen, d 0 where that is not above "
        f"{LEAST_KNOWN_SHARE:g}, squares as means of three; "
        f"c' = min({config.age:g} c exp(r4 - t max(r4, 0)) / "
        f"(1 + (1 + {config.change_agreed:g} t) |d|^2 / {config.change_spread:g}^2), "
        f"{MOST_KEPT:g} c); "
        f"b = sigmoid(logit({config.change:g}) + r5 - t min(r5, 0)) "
        f"max(min(1, fit / {config.change_fit:g}) min(1, {config.change_worth:g} / c'), t); "
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
        outside=(
            DEMODULATE,
            ENCODE_UNBOUNDED,
            ALIGN,
            GUIDED_BASE,
            CARRY,
            _describe_gathering(config),
            COMPOSE,
        ),
        carried=(
            CarriedTensor(
                name="history",
                made="lighting k (exp(e) - 1), worth, and the HR surfaces it lies on",
                reset="none: worth 0",
                moved="carry history",
            ),
        ),
    )
