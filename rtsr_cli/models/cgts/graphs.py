"""What is exported of `cgts`: the classifier, and the composition that weighs pixel by pixel."""

from __future__ import annotations

from rtsr_cli.core.graphs import (
    CarriedTensor,
    Graph,
    GraphTensor,
    NetworkGraphs,
    OutsideStep,
)
from rtsr_cli.core.lighting.graph_steps import require_own_preset
from rtsr_cli.models.cgts.config import CgtsConfig

MULTIPLE = 8
"""LR pixels: 16 of the output's."""

LOGITS = (
    "logit of visibility ghosting",
    "logit of shading ghosting",
    "logit of no ghosting",
    "logit of geometry aliasing",
    "logit of texture aliasing",
    "logit of no aliasing",
)
RANGE = tuple(f"{end} {c} of 3 x 3, c / (1 + c)" for end in ("least", "most") for c in "RGB")
COLOR = ("R, c / (1 + c), of the samples enlarged", "G", "B")
DIFFERENCE = "(D_before - D) / max(D_before, D), D = 1 / z; 1 without history"

SEEN = (
    *COLOR,
    "D / (1 + D), D = 1 / z of the nearest sample, 1/m; 0 on sky",
    "dx / 16, output pixels, -4..4; previous position = position + motion",
    "dy / 16, output pixels, -4..4",
    "counter of frames / 16, at most 1",
    *(f"carried {channel}" for channel in RANGE),
    DIFFERENCE,
    *(f"carried {channel}" for channel in LOGITS),
)
KNOWN = (
    *(f"{channel}, -10..10" for channel in LOGITS),
    "counter of frames / 16, at most 1",
    DIFFERENCE,
    *COLOR,
    "carried R, c / (1 + c), Catmull-Rom",
    "carried G",
    "carried B",
    "samples that the frame's colour is worth",
    "log(1 + samples that history is worth) / 4",
    "largest excess of history over the frame's range",
    "largest |motion component| / 8, at most 1",
    "2 (fx (1 - fx) + fy (1 - fy)), f the fraction of the motion",
    "largest change of history by clipping",
    "deviation of Y of the samples around",
    "largest width of the frame's range",
    "largest width of the carried range",
)

ENLARGE = OutsideStep(
    name="splat samples",
    when="before",
    formula="color = (sum w c + 0.1 cubic(c)) / (sum w + 0.1), w = exp(-|p - q|^2 / (2 0.4^2)), c "
    "= radiance / (1 + radiance); worth = sum w + 0.1",
)
CARRY = OutsideStep(
    name="carry history",
    when="before",
    formula="state at x + motion(x): colour by Catmull-Rom, logits bilinearly, counter, worth, "
    "range and D of the nearest pixel; colours are relit where pre-exposure changes",
)
ACCUMULATE = OutsideStep(
    name="accumulate",
    when="after",
    formula="weight = sigmoid(given_0 + log(worth) - log(max(history worth, 0.05))); clip = "
    "sigmoid(given_1) (1 - exp(-|motion| / 0.25)); color' = lerp(lerp(history, clipped, clip), "
    "color, weight); weight 1 where there is no history; radiance = color' / (1 - color')",
)


def describe(config: CgtsConfig) -> NetworkGraphs:
    """What is exported of a config.

    Raises:
        ConfigError: it is of the publication's preset.
    """
    require_own_preset(config.preset)
    return NetworkGraphs(
        graphs=(
            Graph(
                method="classify",
                summary="frame and carried history -> classes of every output pixel",
                inputs=(GraphTensor(name="seen", channels=SEEN, least=-1.0),),
                outputs=(GraphTensor(name="logits", channels=LOGITS),),
                multiple=MULTIPLE,
                padding="repeat the last row and column; drop them from logits",
            ),
            Graph(
                method="weigh",
                summary="classes and buffers of a pixel -> weight of the frame against history",
                inputs=(GraphTensor(name="known", channels=KNOWN, least=-1.0),),
                outputs=(
                    GraphTensor(
                        name="given",
                        channels=("added to the logit of the frame's weight", "logit of clipping"),
                    ),
                ),
            ),
        ),
        outside=(ENLARGE, CARRY, ACCUMULATE),
        carried=tuple(
            CarriedTensor(name=name, made=made, reset=reset, moved="carry history")
            for name, made, reset in (
                ("color", "color' of the frame before", "the frame's own"),
                ("counter", "counter + 1, 0 where visibility ghosting is likeliest", "0"),
                ("worth", "min(worth / weight, 1000)", "0"),
                ("range", "wider of own and lerp(carried, own, 1/8)", "the frame's own"),
                ("D", "of the frame before", "none: difference 1"),
                ("logits", "clamp(logits, -10, 10)", "4, 0, 0, 0, 0, 0"),
            )
        ),
    )
