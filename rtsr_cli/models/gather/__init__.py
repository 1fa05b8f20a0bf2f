"""`gather`: which samples to take for every pixel, of this frame and of all before.

Our own. `demod-temporal` gathers lighting along surfaces by weights made by hand; here a small
network raises and lowers them: the terms of the kernel over the frame's samples, what history is
worth, how far a change of the light is believed. It adds no lighting of its own. See
docs/gather.md.

Conventions: those of `lighting.lighting_history`; the same layers at every scale; whole frames
only, as the state has the target's size.
"""

from __future__ import annotations

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.lighting import lighting, lighting_history
from rtsr_cli.core.lighting.lighting import LOG_LIGHTING, compose_lighting, unalign_image
from rtsr_cli.core.system import (
    FrameWindow,
    Prediction,
    System,
    Tensors,
    TrainingRecipe,
    neural_predict,
)
from rtsr_cli.models.gather.config import UNROLLED_FRAMES, GatherConfig
from rtsr_cli.models.gather.graphs import describe
from rtsr_cli.models.gather.inputs import prepare
from rtsr_cli.models.gather.loss import goal, loss
from rtsr_cli.models.gather.network import GatherNetwork

PREROLL_FRAMES = 32
"""Frames that a shard replays."""


def compose(
    config: GatherConfig, window: FrameWindow, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Radiance of the gathered lighting."""
    del config
    made = compose_lighting(LOG_LIGHTING, window, inputs, outputs["encoded"])
    debug = {**made.debug, "worth": unalign_image(window, outputs["worth"])}
    return Prediction(image=made.image, debug=debug)


GATHER = System(
    name="gather",
    summary="lighting gathered over frames along HR surfaces, weighed by a small network",
    citation="this project; kernels as Kopf et al. 2007, weighed as Bako et al. 2017",
    lr_inputs=(*lighting.LR_BUFFERS, *lighting_history.LR_BUFFERS),
    lr_optional=(*lighting.LR_OPTIONAL, *lighting_history.LR_OPTIONAL),
    hr_inputs=(*lighting.HR_BUFFERS, *lighting_history.HR_BUFFERS),
    hr_optional=(*lighting.HR_OPTIONAL, *lighting_history.HR_OPTIONAL, Buffer.ROUGHNESS),
    scales=(2, 3, 4, 6, 8),
    history_frames=lighting_history.HISTORY_FRAMES,
    recurrent=True,
    preroll_frames=PREROLL_FRAMES,
    halo_px=None,
    matches_filter=True,
    config=GatherConfig,
    build=GatherNetwork,
    predict=neural_predict(prepare, compose),
    learning=TrainingRecipe(
        prepare=prepare,
        reference=lighting.REFERENCE_BUFFERS,
        goal=goal,
        loss=loss,
        unroll=UNROLLED_FRAMES,
        defaults={
            "crop": 48,
            "batch": 2,
            "jitter": "mixed",
            "learning_rate": 2e-3,
            # of radiance that a filter went over there is nothing to learn
            "augmentation": {"filtered_share": 0.0},
        },
    ),
    graphs=describe,
    weights="gather-{scale}x.safetensors",
    measured_by={"python benchmarks/gather.py DATA": "docs/gather.md"},
)

SYSTEMS = (GATHER,)
