"""What is exported of ExtraNet: all layers; past lighting is brought to the frame outside."""

from __future__ import annotations

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.graphs import Graph, GraphTensor, NetworkGraphs, OutsideStep
from rtsr_cli.core.imaging.camera_motion import STATIC_PX
from rtsr_cli.core.imaging.surface_history import ENOUGH, REACHES, RING_DECAY, UNLIKE
from rtsr_cli.core.imaging.surfaces import FACING, MOVING_SHARE, PLANE_SHARE
from rtsr_cli.core.lighting.graph_steps import (
    DEMODULATE,
    INVERSE_DEPTH,
    MOST_LOG,
    NORMAL,
    require_own_preset,
)
from rtsr_cli.core.lighting.past_lighting import LEAST_RADIANCE_WEIGHT, LEAST_WEIGHT
from rtsr_cli.core.lighting.unseen_lighting import GRID_PIXELS, NEAR_SHARE
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
    formula="e = log(1 + q / k), q lighting, or radiance less emission where undivided, at the "
    "exposure of the last rendered frame t-1, k of it; base: sum_q b l e(q) / sum_q b l of the "
    "four pixels q around p + motion(p), b bilinear, l = exp(-"
    f"{FACING:g} (1 - n(p).n(q)) - |plane(p).(P(q) - P(p))| / ({PLANE_SHARE:g} z(p))), "
    f"{MOVING_SHARE:g} z(p) where motion is not the camera's by more than {STATIC_PX:g} pixels, 0 "
    "where object, sky or being divided differ; a hole where sum_q b l is below "
    f"{LEAST_WEIGHT:g}, {LEAST_RADIANCE_WEIGHT:g} of what is undivided; holes: sum w e / sum w of "
    "rings of 24 pixels around that are none, at spacings "
    f"{', '.join(map(str, REACHES))}, w = l exp(-|step|^2 / 4) {RING_DECAY:g}^ring, up to a ring "
    f"of weight {ENOUGH:g}; where sum w <= {UNLIKE:g}, (sum w sqrt(e) / sum w)^2 of pixels that "
    f"are divided and no holes on a grid of about {GRID_PIXELS}, "
    f"w = exp(-{FACING:g} (1 - n(p).n(q))) / ({NEAR_SHARE:g}^2 + |P(q) - P(p)|^2 / z(p)^2) "
    "(bilinear t-1 where undivided); "
    "second: t-3, else t-5, where of the surface, else t-1's, holes fetched by occlusion vectors; "
    "moved: bilinear at p + motion from t to t-n, 0 outside; of the surface: sum_q b l at least "
    f"{LEAST_WEIGHT:g}, of t-1 where there is no hole",
)
COMPOSE = OutsideStep(
    name="compose",
    when="after",
    formula="radiance = k (exp(max(predicted, 0)) - 1) F + emission, F and emission of the frame "
    f"that was not rendered, at its exposure; F = 1 where a channel is not above "
    f"{MATERIAL_EPSILON:g} and on sky",
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
