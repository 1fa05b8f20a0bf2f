"""`cgts`: temporal accumulation whose weights follow classes of ghosting and aliasing.

Guo et al., "Classifier Guided Temporal Supersampling for Real-time Rendering", Computer Graphics
Forum 41(7), 2022. A classifier tells where history shows another surface or another light and where
one sample a pixel is too few; from that and the auxiliary buffers a small network gives the weight
of the frame against its history, pixel by pixel.

Conventions: LR buffers only (radiance, depth, motion); state and history are tone-mapped,
c / (1 + c), at the output's size; history moves along (x, y) + motion.

Departs from the publication in the preset `rtsr`: samples count where they lie, and what is
interpolated between them little; motion is that of the nearest surface of the few samples around a
pixel, not of 3 x 3; the composition network corrects the weight that a running mean of these
samples has, and sees what frame and history are worth, how far history lies out of the frame's
range, and how the surface moves. The classifier sees how far history is from the frame, and its
decoder also tells a kernel that the frame's samples are filtered by where history is of no use,
and one that what was accumulated is shown through; history itself is fetched sharper, and goes on
unfiltered.
`paper` keeps the published channels around the same layers. Losses are ours, as the published ones
are not known.
"""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.imaging.color import decode_reinhard
from rtsr_cli.core.system import (
    FrameWindow,
    Prediction,
    System,
    Tensors,
    TrainingRecipe,
    neural_predict,
)
from rtsr_cli.models.cgts.config import CLASSES, UNROLLED_FRAMES, CgtsConfig
from rtsr_cli.models.cgts.graphs import describe
from rtsr_cli.models.cgts.inputs import prepare
from rtsr_cli.models.cgts.loss import goal, loss
from rtsr_cli.models.cgts.network import CgtsNetwork

PREROLL_FRAMES = 16
"""What a shard replays: the counter is shown up to as many frames."""


def compose(
    config: CgtsConfig, window: FrameWindow, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Radiance of the accumulated colour."""
    del config, window, inputs
    logits, color = outputs["logits"].float(), outputs["color"]
    wide = color.dtype == torch.float64
    most = torch.finfo(torch.float32).max if wide else MAX_HALF
    return Prediction(
        image=decode_reinhard(color if wide else color.float(), most).float(),
        debug={
            "ghosting": logits[:, :CLASSES].softmax(1),
            "aliasing": logits[:, CLASSES:].softmax(1),
            "weight": outputs["weight"].float(),
            "counter": outputs["counter"].float(),
        },
    )


CGTS = System(
    name="cgts",
    summary="accumulation weighted by classes of ghosting and aliasing; colour, depth and motion",
    citation="Guo et al., Classifier Guided Temporal Supersampling, CGF 2022",
    lr_inputs=(Buffer.COLOR, Buffer.DEPTH, Buffer.MOTION),
    lr_optional=(Buffer.REACTIVE,),
    scales=(2,),
    recurrent=True,
    preroll_frames=PREROLL_FRAMES,
    halo_px=None,
    config=CgtsConfig,
    build=CgtsNetwork,
    predict=neural_predict(prepare, compose),
    learning=TrainingRecipe(
        prepare=prepare,
        reference=(Buffer.COLOR, Buffer.DEPTH, Buffer.MOTION),
        reference_optional=(Buffer.NORMAL, Buffer.GEONORMAL, Buffer.OBJECT_ID),
        goal=goal,
        loss=loss,
        unroll=UNROLLED_FRAMES,
        samples=True,
        defaults={
            "scale": 2,
            "samples_per_pixel": 2,
            "jitter": "halton",
            "crop": 72,
            "batch": 2,
            "learning_rate": 1e-3,
            "freeze_statistics": 0.5,
            # a still camera is where a history that is worth much shows
            "augmentation": {"still_share": 0.125},
        },
    ),
    graphs=describe,
    weights="cgts-{scale}x.safetensors",
    measured_by={"python benchmarks/supersampling.py DATA": "docs/supersampling.md"},
)

SYSTEMS = (CGTS,)
