"""What is exported of the visual-error network: all layers; T^-1 and rates are outside."""

from __future__ import annotations

from rtsr_cli.core.graphs import Graph, GraphTensor, NetworkGraphs, OutsideStep
from rtsr_cli.core.vrs.rates import ShadingRate
from rtsr_cli.core.vrs.reprojection import SAME_SURFACE
from rtsr_cli.models.rt_percept.config import NetworkInputs, RtPerceptConfig
from rtsr_cli.models.rt_percept.loss import DECIBEL, STEEPNESS

NORMAL_Z = "z of the view-space normal, 0..1"

SEEN = {
    NetworkInputs.FOUR: (
        "red of the frame before as displayed, reprojected; 0 where not seen",
        "mask, 1 = seen in the frame before",
        "red of albedo (1 - metallic)",
        NORMAL_Z,
    ),
    NetworkInputs.LUMA: (
        "luma of the frame before as displayed, reprojected; 0 where not seen",
        "mask, 1 = seen in the frame before",
        "luma of albedo (1 - metallic)",
        NORMAL_Z,
    ),
}
"""Channels of the sets that are described one by one; of others, their number says enough."""

REPROJECT = OutsideStep(
    name="reproject",
    when="before",
    formula="picture = srgb(c / (1 + c)) of the frame before at the pixel nearest to p + motion(p)"
    ", at this frame's exposure; 0 where depth there differs by more than "
    f"{SAME_SURFACE.depth_relative:g} z and its slope, n.n' of the bilinear normal there is below "
    f"{SAME_SURFACE.normal_cosine:g}, object ids differ, or outside; luma = 0.299 R + 0.587 G + "
    "0.114 B",
)
RESTORE = OutsideStep(
    name="restore errors",
    when="after",
    formula="T = clamp(predicted + margin, 0, 1), margin that of facts, which stands in place of "
    "the config's; clamped: error = 2 mean T; logistic: error = max(logit(lerp(S(0), S(1), T)) / "
    f"{STEEPNESS:g} + mean, 0), S(y) = sigmoid({STEEPNESS:g} (y - mean)); psnr: (1 - T) / "
    f"{DECIBEL:g}",
)
CHOOSE = OutsideStep(
    name="choose rates",
    when="after",
    formula="of the rates whose error is below the threshold the cheapest, its code in the tile; "
    "not predicted: 2x2 = max(1x2, 2x1), 4x4 = max(2x4, 4x2)",
)


def describe(config: RtPerceptConfig) -> NetworkGraphs:
    """What is exported of a config."""
    tile = config.error.tile
    channels = SEEN.get(config.inputs, (f"the set '{config.inputs.value}' of network.inputs",))
    return NetworkGraphs(
        graphs=(
            Graph(
                method="estimate",
                summary="the frame before and the G-buffer -> error of each rate in each tile",
                inputs=(GraphTensor(name="seen", channels=channels),),
                outputs=(
                    GraphTensor(
                        name="predicted",
                        channels=tuple(f"T of the error of {name}" for name in config.channels),
                    ),
                ),
                multiple=tile,
                padding="fill up to whole tiles with 0",
            ),
        ),
        outside=(REPROJECT, RESTORE, CHOOSE),
        values=("mean",),
        facts=(
            ("tile", tile),
            ("metric", config.error.metric.value),
            ("transform", config.transform.value),
            ("threshold", config.limit),
            ("rates", {rate.label: rate.code for rate in ShadingRate}),
        ),
    )
