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

import torch

from rtsr_cli.core.captured_rates import CAPTURED_NAMES, true_errors
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import decode_reinhard, decode_srgb
from rtsr_cli.core.learning.augmentation import NO_AUGMENTATION
from rtsr_cli.core.metrics.heat import heat_map
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.shapes import Color, TileMap
from rtsr_cli.core.system import (
    Judge,
    Learning,
    Prediction,
    System,
    Task,
    Tensors,
    Window,
    neural_predict,
)
from rtsr_cli.core.vrs.accuracy import accuracy, tally
from rtsr_cli.core.vrs.predictor import TilePredictor
from rtsr_cli.core.vrs.reuse import reuse_errors
from rtsr_cli.core.vrs.tiles import tile_mean
from rtsr_cli.models.rt_percept.config import RtPerceptConfig
from rtsr_cli.models.rt_percept.inputs import BUFFERS, OPTIONAL, prepare
from rtsr_cli.models.rt_percept.network import RtPerceptNetwork
from rtsr_cli.models.rt_percept.transforms import (
    decode_errors,
    encode_errors,
    restored,
    transformed,
)

MAX_ERROR = 10.0
"""In the dark, errors by Weber's law know no bound: beyond this, mu takes them for this."""

MEAN_MEMORY = 0.99
"""What the running mean keeps a step."""


def goal(config: RtPerceptConfig, window: Window, reference: Frame) -> Tensors:
    """`errors`: what is to be predicted, not transformed, a channel a rate; or of reuse."""
    color = reference.gbuffer[Buffer.COLOR]
    if config.reuse:
        return {"errors": reuse_errors(window, color, config.error)}
    ids = reference.gbuffer.buffers.get(Buffer.OBJECT_ID) if config.keep_edges else None
    errors = true_errors(
        color,
        config.error,
        captured=reference.beside,
        object_id=ids,
        rates=config.predicted,
    )
    return {"errors": torch.cat(list(errors.values()), dim=1)}


def loss(config: RtPerceptConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """|d| + s d^2 of differences d in transformed space; keeps the running mean of the errors.

    Like the statistics of a batch norm, the mean belongs to the network and changes in training.
    """
    errors = target["errors"]
    mean = outputs["mean"]
    if not config.mean and torch.is_grad_enabled():
        with torch.no_grad():
            batch = errors.clamp(max=MAX_ERROR).mean()
            mean.copy_(torch.where(mean > 0, torch.lerp(batch, mean, MEAN_MEMORY), batch))
    wanted = transformed(errors, mean, config)
    difference = (outputs["predicted"].float() - wanted).abs()
    difference = difference + config.squared * difference.square()
    weight = torch.ones_like(difference[:, :1])
    if config.unseen_weight != 1.0:
        unseen = tile_mean(1.0 - inputs["mask"], config.error.tile)
        weight = torch.lerp(weight, torch.full_like(weight, config.unseen_weight), unseen)
    return {"error": (difference * weight).mean() / weight.mean()}


def compose(
    config: RtPerceptConfig, window: Window, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Errors of the predicted rates, the margin of the config added before T^-1."""
    del window
    values = outputs["predicted"].float()
    tiles = restored(values + config.margin, outputs["mean"], config)
    mean = outputs["mean"].expand_as(values[:, :1])
    debug = {"transformed": values, "mean": mean, "seen": inputs["mask"]}
    return Prediction(tiles=tiles, debug=debug)


def scores(
    config: RtPerceptConfig, window: Window, prediction: Prediction, reference: Frame
) -> dict[str, float]:
    """R^2, mean absolute error and mean underestimation, in transformed space."""
    wanted, predicted = _both(config, window, prediction, reference)
    each = enumerate(config.channels)
    return accuracy(
        {name: tally(predicted[:, i : i + 1], wanted[:, i : i + 1]) for i, name in each}
    )


def panels(
    config: RtPerceptConfig, window: Window, prediction: Prediction, reference: Frame
) -> dict[str, Color]:
    """Radiance, and the first rate's error, predicted and true, a pixel a pixel."""
    wanted, predicted = _both(config, window, prediction, reference)
    color = reference.gbuffer[Buffer.COLOR]
    tile = config.error.tile

    def shown(tiles: TileMap) -> Color:
        large = tiles[:, 0].repeat_interleave(tile, -2).repeat_interleave(tile, -1)
        colors = heat_map(large[..., : color.shape[-2], : color.shape[-1]])
        return decode_reinhard(decode_srgb(colors))

    return {"radiance": color, "predicted": shown(predicted), "true": shown(wanted)}


def _both(
    config: RtPerceptConfig, window: Window, prediction: Prediction, reference: Frame
) -> tuple[TileMap, TileMap]:
    """True and predicted values in transformed space."""
    mean = prediction.debug["mean"].cpu()
    target = goal(config, window, reference)["errors"]
    return transformed(target, mean, config), prediction.debug["transformed"].cpu()


RT_PERCEPT = System(
    name="rt-percept",
    summary="small network: visual error of reduced shading rates, tile by tile",
    citation="Cardoso et al., rt-percept, i3D 2022",
    task=Task.PREDICT_VRS,
    lr_inputs=BUFFERS,
    lr_optional=OPTIONAL,
    scales=(1,),
    history_frames=1,
    halo_px=None,
    config=RtPerceptConfig,
    build=RtPerceptNetwork,
    predict=neural_predict(prepare, compose),
    learning=Learning(
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
        judge=Judge(names=("r2", "mae", "under"), scores=scores, panels=panels),
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
    weights="rt-percept-{config.label}.safetensors",
)

SYSTEMS = (RT_PERCEPT,)
