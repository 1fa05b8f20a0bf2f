"""`demod-temporal`: lighting gathered from all frames so far, along surfaces; nothing trained.

Samples that came near to a pixel on its own surface, now or in a frame before, make its lighting;
that is multiplied by the HR material. Thin things and silhouettes, which few samples of a single
frame hit, are filled within some frames. How history is carried and weighed stands in
`core.lighting.lighting_history`; the first frame is `demod-guided`'s.

Conventions: those of `lighting.lighting`; motion of the HR G-buffer, else of the LR frame; whole
frames only, as the state has the target's size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

from torch import nn

from rtsr_cli.core.lighting import lighting, lighting_history
from rtsr_cli.core.lighting.filtered_lighting import (
    describe_filter,
    match_filter,
    part_filtered,
)
from rtsr_cli.core.lighting.lighting import (
    LOG_LIGHTING,
    compose_lighting,
    describe_picture,
    unalign_image,
)
from rtsr_cli.core.lighting.lighting_history import (
    HISTORY_FRAMES,
    HistoryWeights,
    LightingHistory,
    describe_window,
    gather_lighting,
)
from rtsr_cli.core.system import FrameWindow, Prediction, State, System, build_baseline

PREROLL_FRAMES = 32
"""Frames that a shard replays: what history is worth then is below a fifth."""


@dataclass(frozen=True, kw_only=True)
class DemodTemporalConfig(HistoryWeights):
    """Weights of history."""


def predict(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Gather lighting, multiply by HR material, add HR emission; sky from the LR sky alone."""
    config = cast(DemodTemporalConfig, network.config)
    inputs = describe_window(match_filter(window)) | describe_picture(window)
    inputs |= describe_filter(window)
    before = cast(LightingHistory | None, state)
    gathered = gather_lighting(inputs, before, config, finish=part_filtered)
    made = compose_lighting(LOG_LIGHTING, window, inputs, gathered.encoded)
    worth = unalign_image(window, gathered.worth)
    return replace(made, state=gathered.history, debug={**made.debug, "worth": worth})


DEMOD_TEMPORAL = System(
    name="demod-temporal",
    summary="lighting gathered over frames along HR surfaces, times HR material (baseline)",
    citation="Kopf et al. 2007; Dammertz et al. 2010; Yang et al. 2020; demodulation as NSRD",
    lr_inputs=(*lighting.LR_BUFFERS, *lighting_history.LR_BUFFERS),
    lr_optional=(*lighting.LR_OPTIONAL, *lighting_history.LR_OPTIONAL),
    hr_inputs=(*lighting.HR_BUFFERS, *lighting_history.HR_BUFFERS),
    hr_optional=(*lighting.HR_OPTIONAL, *lighting_history.HR_OPTIONAL),
    history_frames=HISTORY_FRAMES,
    recurrent=True,
    preroll_frames=PREROLL_FRAMES,
    halo_px=None,
    matches_filter=True,
    config=DemodTemporalConfig,
    build=build_baseline,
    predict=predict,
)

SYSTEMS = (DEMOD_TEMPORAL,)
