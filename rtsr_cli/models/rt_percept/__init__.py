"""`rt-percept`: the visual error of reduced shading rates, predicted before a frame is shaded.

Cardoso et al., "Training and Predicting Visual Error for Real-Time Applications", i3D 2022. A small
network sees the frame before, moved to this one, and the G-buffer, and gives the error of each
rate in each tile, transformed to 0..1.

Conventions: full resolution, scale 1; the frame's own radiance is only what training compares with.

Departs from the publication: the mask of what was seen also tests depth, normals and object ids;
frames whose size is no multiple of a tile are padded, so that none is lost; the mean error mu is a
running one, in which errors beyond `MAX_ERROR` count as that.
"""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.system import (
    FrameJudge,
    FrameWindow,
    Prediction,
    System,
    Tensors,
    TrainingRecipe,
    neural_predict,
)
from rtsr_cli.core.training.augmentation import NO_AUGMENTATION
from rtsr_cli.core.vrs.captured_rates import CAPTURED_NAMES
from rtsr_cli.core.vrs.predictor import TilePredictor
from rtsr_cli.models.rt_percept.config import RtPerceptConfig
from rtsr_cli.models.rt_percept.graphs import describe
from rtsr_cli.models.rt_percept.inputs import BUFFERS, OPTIONAL, prepare
from rtsr_cli.models.rt_percept.loss import (
    decode_errors,
    encode_errors,
    goal,
    loss,
    panels,
    restore_errors,
    scores,
)
from rtsr_cli.models.rt_percept.network import RtPerceptNetwork


def compose(
    config: RtPerceptConfig, window: FrameWindow, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Errors of the predicted rates, the margin of the config added before T^-1."""
    del window
    values = outputs["predicted"].float()
    tiles = restore_errors(values + config.margin, outputs["mean"], config)
    mean = outputs["mean"].expand_as(values[:, :1])
    debug = {"transformed": values, "mean": mean, "seen": inputs["mask"]}
    return Prediction(tiles=tiles, debug=debug)


RT_PERCEPT = System(
    name="rt-percept",
    summary="small network: visual error of reduced shading rates, tile by tile",
    citation="Cardoso et al., rt-percept, i3D 2022",
    task=SystemTask.PREDICT_VRS,
    lr_inputs=BUFFERS,
    lr_optional=OPTIONAL,
    scales=(1,),
    history_frames=1,
    halo_px=None,
    config=RtPerceptConfig,
    build=RtPerceptNetwork,
    predict=neural_predict(prepare, compose),
    learning=TrainingRecipe(
        prepare=prepare,
        reference=(Buffer.COLOR,),
        goal=goal,
        loss=loss,
        beside=CAPTURED_NAMES,
        measured=("mean",),
        keep_goals=True,
        defaults={
            "scale": 1,
            "crop": 4096,
            "optimiser": "rmsprop",
            "learning_rate": 1e-4,
            "schedule": "exponential",
            "augmentation": to_plain(NO_AUGMENTATION),
        },
        judge=FrameJudge(
            names=("r2", "mae", "under"),
            scores=scores,
            panels=panels,
            protocol="R^2, mean absolute error and mean underestimation of the tiles' errors, "
            "transformed as `network.transform` says",
        ),
    ),
    tiles=TilePredictor(
        configure=lambda error, reuse: RtPerceptConfig(error=error, reuse=reuse),
        error=lambda config: config.error,
        rates=lambda config: config.predicted,
        threshold=lambda config: config.limit,
        keeps_edges=lambda config: config.keep_edges,
        reuses=lambda config: config.reuse,
        with_margin=lambda config, margin: replace(config, margin=margin),
        encode=encode_errors,
        decode=decode_errors,
    ),
    graphs=describe,
    weights="rt-percept-{config.label}.safetensors",
    measured_by={"python benchmarks/vrs.py DATA": "docs/vrs.md"},
)

SYSTEMS = (RT_PERCEPT,)
