"""`nsrd`: recurrent super-resolution of demodulated radiance.

Li et al., "Neural Super-Resolution for Real-time Rendering with Radiance Demodulation", CVPR 2024.
Lighting of the current frame and two past ones, moved to it and marked by dual motion vectors, the
last HR output and a convolutional LSTM's state make the HR lighting, which is multiplied by the HR
material.

Conventions: those of `lighting.lighting`. History that is missing is the current frame, marked
unreliable; the last output and the state are zeros then.

Departs from the publication in the preset `rtsr`: the network sees and predicts log(1 + L/k), k of
the current frame, past frames included; depth is 1 / (1 + metres); its output is added to an
enlargement of the lighting along HR surfaces; of the last output it sees the difference from that,
where reliable; warps are pixel-centred and scaled, motion to t-2 is chained, the LSTM's state moves
with the surfaces, a whole number of pixels a frame; emission is added and sky enlarged on its own.
`paper` keeps the published choices around the same layers, and replaces radiance by emission where
there is any.
"""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.lighting.lighting import (
    GUIDES,
    HR_BUFFERS,
    HR_OPTIONAL,
    LR_BUFFERS,
    LR_OPTIONAL,
    REFERENCE_BUFFERS,
    compose_lighting,
    unalign_image,
)
from rtsr_cli.core.system import (
    FrameWindow,
    Prediction,
    System,
    Tensors,
    TrainingRecipe,
    neural_predict,
)
from rtsr_cli.models.nsrd.config import HISTORY_FRAMES, UNROLLED_FRAMES, NSRDConfig
from rtsr_cli.models.nsrd.graphs import describe
from rtsr_cli.models.nsrd.inputs import derivation, prepare, surroundings_of
from rtsr_cli.models.nsrd.loss import goal, loss
from rtsr_cli.models.nsrd.network import NSRDNetwork

PREROLL_FRAMES = 8
"""What a shard replays. Its first frame was then 58 to 67 dB from the whole run's where that was
measured (`benchmarks/shards.py` and a moving scene), and each later one nearer."""


def compose(
    config: NSRDConfig, window: FrameWindow, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Radiance from predicted lighting; of what was decided, where the last output was used."""
    predicted = outputs["predicted"].clamp(min=0)
    prediction = compose_lighting(surroundings_of(config), window, inputs, predicted)
    unreliable = unalign_image(window, inputs["unreliable_hr"])
    return replace(prediction, debug={**prediction.debug, "unreliable": unreliable})


NSRD = System(
    name="nsrd",
    summary="recurrent network over lighting, dual motion vectors and its own last output",
    citation="Li et al., NSRD, CVPR 2024",
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
    lr_optional=(Buffer.FORWARD, *LR_OPTIONAL),
    hr_inputs=HR_BUFFERS,
    hr_optional=(*HR_OPTIONAL, *GUIDES),
    scales=(2, 4, 6),
    history_frames=HISTORY_FRAMES,
    recurrent=True,
    preroll_frames=PREROLL_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=NSRDConfig,
    build=NSRDNetwork,
    predict=neural_predict(prepare, compose),
    learning=TrainingRecipe(
        prepare=prepare,
        reference=REFERENCE_BUFFERS,
        goal=goal,
        loss=loss,
        unroll=UNROLLED_FRAMES,
        defaults={"batch": 4, "freeze_statistics": 0.8},
    ),
    graphs=describe,
    weights="nsrd-{scale}x.safetensors",
    measured_by={"python benchmarks/results.py DATA": "docs/results.md"},
)

SYSTEMS = (NSRD,)
