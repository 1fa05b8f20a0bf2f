"""What the visual-error network is held against: errors, where it can learn them evenly.

Errors are brought to 0..1, and back   [rt-percept, Section 3.3]:

clamped:   T = min(1, Y / (2 mu))
logistic:  T = (S(Y) - S(0)) / (S(1) - S(0)),   S(Y) = 1 / (1 + exp(-k (Y - mu))),  k = 10
PSNR:      T = 1 - 0.015 dB                      [rt-percept, code]

mu is the mean error of the training set. The clamped one hides what lies above 2 mu; the logistic
one, whose ends are at 0 and 1, is made for errors of that range.
"""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn

from rtsr_cli.core.choices import VrsMetric
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import decode_reinhard, decode_srgb
from rtsr_cli.core.metrics.heat_map import heat_map
from rtsr_cli.core.shapes import Color, TileMap
from rtsr_cli.core.system import FrameWindow, Prediction, Tensors
from rtsr_cli.core.vrs.accuracy import average_accuracy, tally_errors
from rtsr_cli.core.vrs.captured_rates import measure_true_errors
from rtsr_cli.core.vrs.reuse import reuse_errors
from rtsr_cli.core.vrs.tile_pooling import tile_mean
from rtsr_cli.models.rt_percept.config import ErrorTransform, RtPerceptConfig

STEEPNESS = 10.0

DECIBEL = 0.015
"""What a decibel takes off."""

MAX_ERROR = 10.0
"""In the dark, errors by Weber's law know no bound: beyond this, mu takes them for this."""

MEAN_MEMORY = 0.99
"""What the running mean keeps a step."""


def _curve(errors: Tensor, mean: Tensor) -> Tensor:
    return torch.sigmoid(STEEPNESS * (errors - mean))


def transform_errors(errors: Tensor, mean: Tensor, config: RtPerceptConfig) -> Tensor:
    """T(Y), 0..1."""
    if config.error.metric is VrsMetric.PSNR:
        return (1.0 - DECIBEL * errors).clamp(0.0, 1.0)
    if config.transform is ErrorTransform.CLAMPED:
        return (errors / (2.0 * mean)).clamp(0.0, 1.0)
    low, high = _curve(torch.zeros_like(mean), mean), _curve(torch.ones_like(mean), mean)
    return ((_curve(errors, mean) - low) / (high - low)).clamp(0.0, 1.0)


def restore_errors(values: Tensor, mean: Tensor, config: RtPerceptConfig) -> Tensor:
    """T^-1."""
    values = values.clamp(0.0, 1.0)
    if config.error.metric is VrsMetric.PSNR:
        return (1.0 - values) / DECIBEL
    if config.transform is ErrorTransform.CLAMPED:
        return values * (2.0 * mean)
    low, high = _curve(torch.zeros_like(mean), mean), _curve(torch.ones_like(mean), mean)
    # rounding may leave the range, beyond which there are errors below 0 or above 1
    share = (values * (high - low) + low).clamp(low, high)
    return (torch.logit(share) / STEEPNESS + mean).clamp(min=0.0)


def encode_errors(errors: Tensor, network: nn.Module) -> Tensor:
    """T by a network's config and mean error, on the processor."""
    config = cast(RtPerceptConfig, network.config)
    return transform_errors(errors, network.get_buffer("mean").cpu(), config)


def decode_errors(values: Tensor, network: nn.Module) -> Tensor:
    """T^-1 by a network's config and mean error, on the processor."""
    config = cast(RtPerceptConfig, network.config)
    return restore_errors(values, network.get_buffer("mean").cpu(), config)


def goal(config: RtPerceptConfig, window: FrameWindow, reference: Frame) -> Tensors:
    """`errors`: what is to be predicted, not transformed, a channel a rate; or of reuse."""
    color = reference.gbuffer[Buffer.COLOR]
    if config.reuse:
        return {"errors": reuse_errors(window, color, config.error)}
    ids = reference.gbuffer.buffers.get(Buffer.OBJECT_ID) if config.keep_edges else None
    errors = measure_true_errors(
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
    wanted = transform_errors(errors, mean, config)
    difference = (outputs["predicted"].float() - wanted).abs()
    difference = difference + config.squared * difference.square()
    weight = torch.ones_like(difference[:, :1])
    if config.unseen_weight != 1.0:
        unseen = tile_mean(1.0 - inputs["mask"], config.error.tile)
        weight = torch.lerp(weight, torch.full_like(weight, config.unseen_weight), unseen)
    return {"error": (difference * weight).mean() / weight.mean()}


def scores(
    config: RtPerceptConfig, window: FrameWindow, prediction: Prediction, reference: Frame
) -> dict[str, float]:
    """R^2, mean absolute error and mean underestimation, in transformed space."""
    wanted, predicted = _both(config, window, prediction, reference)
    each = enumerate(config.channels)
    return average_accuracy(
        {name: tally_errors(predicted[:, i : i + 1], wanted[:, i : i + 1]) for i, name in each}
    )


def panels(
    config: RtPerceptConfig, window: FrameWindow, prediction: Prediction, reference: Frame
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
    config: RtPerceptConfig, window: FrameWindow, prediction: Prediction, reference: Frame
) -> tuple[TileMap, TileMap]:
    """True and predicted values in transformed space."""
    mean = prediction.debug["mean"].cpu()
    target = goal(config, window, reference)["errors"]
    return transform_errors(target, mean, config), prediction.debug["transformed"].cpu()
