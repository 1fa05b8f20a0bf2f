"""What is exported of `cgts`: the classifier, and the composition that weighs pixel by pixel."""

from __future__ import annotations

from rtsr_cli.core.graphs import (
    CarriedTensor,
    Graph,
    GraphTensor,
    NetworkGraphs,
    OutsideStep,
)
from rtsr_cli.core.imaging.auxiliary_buffers import FRONT_REACH_PX, RANGE_RATE
from rtsr_cli.core.imaging.predicted_kernel import (
    FILTERED_WORTH,
    KERNEL_SIGMA_PX,
    PICTURE_SIGMA_PX,
    TAPS,
)
from rtsr_cli.core.imaging.sample_splats import MAX_ENCODED
from rtsr_cli.core.imaging.warping import SHARP_A
from rtsr_cli.core.lighting.graph_steps import require_own_preset
from rtsr_cli.models.cgts.config import CAUTION, CgtsConfig
from rtsr_cli.models.cgts.inputs import (
    CERTAIN,
    CLIPPED_DEVIATIONS,
    FASTEST_PX,
    INTERPOLATED_WORTH,
    INTERPOLATION_A,
    LEAST_FILTERED,
    LEAST_HISTORY,
    SAMPLE_SIGMA_PX,
    STILL_PX,
)
from rtsr_cli.models.cgts.network import (
    CORRECTIONS,
    MOST_FRAMES,
    MOST_LOGIT,
    MOST_MOTION,
    MOST_WORTH,
    MOTION_UNIT_PX,
)

MULTIPLE = 8
"""LR pixels: 16 of the output's."""

BLOCK = tuple(f"output pixel ({x}, {y}) of the LR pixel" for y in range(2) for x in range(2))
ADDED = ("weight", "clipping", "filtering", "finish")
GUIDES = (
    *(
        f"logit of the {what} at ({tap % 3 - 1:+d}, {tap // 3 - 1:+d}), {pixel}"
        for what in ("sample", "pixel")
        for tap in range(TAPS)
        for pixel in BLOCK
    ),
    *(f"added to given_{i}, {ADDED[i]}, {pixel}" for i in range(CORRECTIONS) for pixel in BLOCK),
)
"""Of 2x, the one scale."""

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

HIDDEN = f"the logit of visibility ghosting + {CAUTION:g} is at least the others of ghosting"

SEEN = (
    *COLOR,
    "D / (1 + D), D = 1 / z of the nearest sample, 1/m; 0 on sky",
    f"dx / {MOTION_UNIT_PX:g}, output pixels, -{MOST_MOTION:g}..{MOST_MOTION:g}; previous position "
    "= position + motion",
    f"dy / {MOTION_UNIT_PX:g}, output pixels, -{MOST_MOTION:g}..{MOST_MOTION:g}",
    f"carried counter of frames / {MOST_FRAMES:g}, at most 1",
    *(f"carried {channel}" for channel in RANGE),
    DIFFERENCE,
    *(f"carried {channel}" for channel in LOGITS),
    *(f"carried {c} - {c}" for c in "RGB"),
    "samples that the frame's colour is worth",
    "log(1 + samples that history is worth) / 4",
)
KNOWN = (
    *(f"{channel}, -{MOST_LOGIT:g}..{MOST_LOGIT:g}" for channel in LOGITS),
    f"counter of frames / {MOST_FRAMES:g}, at most 1: carried + 1, 0 without history and where "
    f"{HIDDEN}",
    DIFFERENCE,
    *COLOR,
    f"carried R, c / (1 + c), Keys' kernel, a = {SHARP_A:g}",
    "carried G",
    "carried B",
    "samples that the frame's colour is worth",
    "log(1 + samples that history is worth) / 4",
    "largest excess of history over the frame's range",
    f"largest |motion component| / {FASTEST_PX:g}, at most 1",
    "2 (fx (1 - fx) + fy (1 - fy)), f the fraction of the motion",
    "largest change of history by clipping",
    "deviation of Y of the samples around",
    "largest width of the frame's range",
    "largest width of the carried range",
)

ENLARGE = OutsideStep(
    name="splat samples",
    when="before",
    formula=f"color = (sum w c + {INTERPOLATED_WORTH:g} cubic(c)) / (sum w + "
    f"{INTERPOLATED_WORTH:g}), w = exp(-|p - q|^2 / (2 {SAMPLE_SIGMA_PX:g}^2)) of 3 x 3 samples, "
    "output pixels, c = radiance / (1 + radiance); cubic: Keys' kernel, a = "
    f"{INTERPOLATION_A:g}, within 0..{MAX_ENCODED:g}; worth = sum w + {INTERPOLATED_WORTH:g}",
)
CARRY = OutsideStep(
    name="carry history",
    when="before",
    formula="state at x + motion(x), motion of the nearest surface of the samples less than "
    f"{FRONT_REACH_PX:g} LR pixels from the output pixel along both axes, times S: colour by "
    f"Keys' kernel, a = {SHARP_A:g}, within 0..1, logits bilinearly, counter, worth, range and "
    "D of the nearest pixel; colours c become g c / (1 + (g - 1) c), g the ratio of pre-exposures",
)
ACCUMULATE = OutsideStep(
    name="accumulate",
    when="after",
    formula="g = given + guides' last 4, at the output's size; filtered = sum a_q c_q, a = "
    "softmax_q(guides_q - |p - q|^2 / (2 "
    f"{KERNEL_SIGMA_PX:g}^2)), 3 x 3 samples q around the LR pixel, output pixels; share = "
    f"1 - (1 - sigmoid(g_2)) (1 - {LEAST_FILTERED:g} (1 - exp(-|motion| / {STILL_PX:g}))); frame = "
    f"lerp(color, filtered, share), worth' = lerp(worth, {FILTERED_WORTH:g}, share); "
    f"weight = sigmoid(g_0 + log(worth') - log(max(history worth, {LEAST_HISTORY:g}))), at least "
    "reactive, 1 where there is no history; clip = "
    f"sigmoid(g_1) (1 - exp(-|motion| / {STILL_PX:g})); clipped: history within mean +- "
    f"{CLIPPED_DEVIATIONS:g} deviation, each channel of YCoCg, of the 3 x 3 samples around each "
    "sample, linear between; color' = lerp(lerp(history, clipped, clip), frame, weight), "
    "which goes on; shown = lerp(color', sum b_k color'_k, tanh(g_3)) within 0..1, b = "
    f"softmax_k(guides_k - |p - k|^2 / (2 {PICTURE_SIGMA_PX:g}^2)), 3 x 3 pixels k, output pixels; "
    "radiance = shown / (1 - shown)",
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
                outputs=(
                    GraphTensor(name="logits", channels=LOGITS),
                    GraphTensor(name="guides", channels=GUIDES),
                ),
                multiple=MULTIPLE,
                padding="repeat the last row and column; drop them from logits and guides",
            ),
            Graph(
                method="weigh",
                summary="classes and buffers of a pixel -> weight of the frame against history",
                inputs=(GraphTensor(name="known", channels=KNOWN, least=-1.0),),
                outputs=(
                    GraphTensor(
                        name="given",
                        channels=(
                            "added to the logit of the frame's weight",
                            "logit of clipping",
                            "logit of filtering",
                            "artanh of how far the picture is filtered",
                        ),
                    ),
                ),
            ),
        ),
        outside=(ENLARGE, CARRY, ACCUMULATE),
        carried=tuple(
            CarriedTensor(name=name, made=made, reset=reset, moved="carry history")
            for name, made, reset in (
                ("color", "color' of the frame before", "the frame's own"),
                ("counter", f"counter + 1, 0 where {HIDDEN}", "0"),
                ("worth", f"min(worth' / weight, {MOST_WORTH:g})", "0"),
                (
                    "range",
                    f"wider of own and lerp(carried, own, {RANGE_RATE:g}); own where counter is 0",
                    "the frame's own",
                ),
                ("D", "of the frame before", "none: difference 1"),
                (
                    "logits",
                    f"clamp(logits, -{MOST_LOGIT:g}, {MOST_LOGIT:g})",
                    f"{CERTAIN:g}, 0, 0, 0, 0, 0",
                ),
            )
        ),
    )
