"""What is exported of ExtraNet: all layers; past lighting is brought to the frame outside."""

from __future__ import annotations

from rtsr_cli.core.graphs import Graph, GraphTensor, NetworkGraphs, OutsideStep
from rtsr_cli.core.lighting.graph_steps import (
    DEMODULATE,
    INVERSE_DEPTH,
    MOST_LOG,
    NORMAL,
    require_own_preset,
)
from rtsr_cli.models.extranet.config import ExtraNetConfig

MULTIPLE = 8
"""Three halvings."""

COLORS = ("red", "green", "blue")

CURRENT = (
    *(f"base, e {c}" for c in COLORS),
    *(f"second, e {c}" for c in COLORS),
    *(f"base, e {c}, 0 in holes" for c in COLORS),
    *(f"second, e {c}, 0 where it is not of the surface" for c in COLORS),
    *NORMAL,
    INVERSE_DEPTH,
    "perceptual roughness",
    "metallic",
)
HISTORY = tuple(
    channel
    for age in (5, 3, 1)
    for channel in (*(f"t-{age} moved, e {c}" for c in COLORS), f"t-{age}: 1 = of the surface")
)

PAST = OutsideStep(
    name="past lighting",
    when="before",
    formula="e = log(1 + q / k), q past lighting at the current exposure, k of the last rendered "
    "frame; base: t-1 carried along surfaces, holes filled from the same surface around; second: "
    "t-3, else t-5, of the surface; moved: bilinear at p + motion from t to t-n, 0 outside",
)
COMPOSE = OutsideStep(
    name="compose",
    when="after",
    formula="radiance = k (exp(max(predicted, 0)) - 1) F + emission, F and emission of the frame "
    "that was not rendered; F = 1 where undivided",
)


def describe(config: ExtraNetConfig) -> NetworkGraphs:
    """What is exported of a config.

    Raises:
        ConfigError: it is of the publication's preset.
    """
    require_own_preset(config.preset)
    return NetworkGraphs(
        graphs=(
            Graph(
                method="correct",
                summary="moved past frames and the G-buffer of a frame -> its log lighting",
                inputs=(
                    GraphTensor(name="current", channels=CURRENT, least=-1.0, most=MOST_LOG),
                    GraphTensor(name="history", channels=HISTORY, most=MOST_LOG),
                ),
                outputs=(
                    GraphTensor(
                        name="predicted", channels=tuple(f"e {c}" for c in COLORS), most=MOST_LOG
                    ),
                ),
                multiple=MULTIPLE,
                padding="repeat the last row and column; drop them from predicted",
            ),
        ),
        outside=(DEMODULATE, PAST, COMPOSE),
    )
