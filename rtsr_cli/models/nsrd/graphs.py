"""What is exported of NSRD's network: all of it but the warps of frames, last output and state."""

from __future__ import annotations

from rtsr_cli.core.graphs import (
    CarriedTensor,
    Graph,
    GraphTensor,
    NetworkGraphs,
    OutsideStep,
)
from rtsr_cli.core.imaging.frame_motion import IN_FRONT
from rtsr_cli.core.imaging.splatting import UNRELIABLE_PX
from rtsr_cli.core.lighting.graph_steps import (
    BASE,
    COMPOSE,
    INVERSE_DEPTH,
    KEEP_UNSEEN,
    LIGHTING,
    MOST_LOG,
    NORMAL,
    PREDICTED,
    list_steps_before,
    require_own_preset,
)
from rtsr_cli.core.lighting.lighting import MAX_LIGHTING
from rtsr_cli.models.nsrd.config import NSRDConfig
from rtsr_cli.models.nsrd.inputs import ALL_KNOWN

MULTIPLE = 4
"""Two halvings."""

CHANNELS = (*LIGHTING, *NORMAL, INVERSE_DEPTH)

WARP_FRAMES = OutsideStep(
    name="warp",
    when="before",
    formula="past_n(p) = features of frame t-n, lighting at the current exposure and with the "
    "current k, bilinear at p + motion_n(p), motion_n from samples to samples, jitter included; "
    "the current frame's where that is outside; mask 1 where the dual vector, -forward(t-1) at the "
    "pixel nearest to p + motion_1(p), else by splatting -motion_1, nearest first, what lay "
    f"nearer than {IN_FRONT:g} z(p) moving on as it came, differs from motion_1 by "
    f"{UNRELIABLE_PX:g} LR pixels or more in x or y, where nothing was splatted there, and "
    "outside; of t-2 also where t-1's mask is 1 at p + motion_1(p)",
)
WARP_STATE = OutsideStep(
    name="warp state",
    when="before",
    formula="hidden(p), cell(p) = hidden_next, cell_next of the frame before at the pixel nearest "
    "to p + motion_1(p), 0 outside",
)
WARP_OUTPUT = OutsideStep(
    name="warp output",
    when="before",
    formula=f"last(p) = (log(1 + min(max(L, 0), {MAX_LIGHTING:g}) / k) - base(p)) "
    "(1 - unreliable(p)), L the predicted lighting of the frame before, bilinear at p + "
    "motion_HR(p), at the current exposure; motion_HR = S enlarged(motion) + shift(now) - "
    "shift(before), enlarged bilinearly at (p + 0.5) / S - 0.5 - (jitter - shift / S); unreliable "
    f"1 outside, where enlarged(known) <= {ALL_KNOWN:g}, and where S enlarged(dual - motion_1) is "
    f"{UNRELIABLE_PX:g} S or more in x or y",
)


def describe(config: NSRDConfig) -> NetworkGraphs:
    """What is exported of a config.

    Raises:
        ConfigError: it is of the publication's preset.
    """
    require_own_preset(config.preset)
    before = list_steps_before(config.demodulation, config.lut, config.base)
    frames = [GraphTensor(name="frame_0", channels=CHANNELS, least=-1.0, most=MOST_LOG)]
    frames += [
        GraphTensor(
            name=f"past_{age}",
            channels=(*CHANNELS, "mask, 1 = not to be trusted"),
            least=-1.0,
            most=MOST_LOG,
        )
        for age in (1, 2)
    ]
    last = GraphTensor(
        name="last",
        channels=("last output less base, red; 0 where there is none", "green", "blue"),
        least=-1.0,
    )
    state = ("64 channels",)
    return NetworkGraphs(
        graphs=(
            Graph(
                method="reconstruct",
                summary="LR frames, last output, base and state -> HR lighting and state",
                inputs=(
                    *frames,
                    BASE,
                    last,
                    GraphTensor(name="hidden", channels=state, least=-1.0),
                    GraphTensor(name="cell", channels=state, least=-2.0, most=2.0, single=True),
                ),
                outputs=(
                    PREDICTED,
                    GraphTensor(name="hidden_next", channels=state),
                    GraphTensor(name="cell_next", channels=state, single=True),
                ),
                multiple=MULTIPLE,
            ),
        ),
        outside=(*before, WARP_FRAMES, WARP_STATE, WARP_OUTPUT, KEEP_UNSEEN, COMPOSE),
        carried=(
            CarriedTensor(name="hidden", made="hidden_next", reset="zeros", moved="warp state"),
            CarriedTensor(name="cell", made="cell_next", reset="zeros", moved="warp state"),
            CarriedTensor(
                name="last",
                made="k (exp(max(predicted, 0)) - 1)",
                reset="zeros",
                moved="warp output",
            ),
        ),
    )
