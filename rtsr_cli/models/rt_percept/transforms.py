"""Errors to 0..1, where a network can learn them evenly, and back   [rt-percept, Section 3.3].

clamped:   T = min(1, Y / (2 mu))
logistic:  T = (S(Y) - S(0)) / (S(1) - S(0)),   S(Y) = 1 / (1 + exp(-k (Y - mu))),  k = 10
PSNR:      T = 1 - 0.015 dB                      [rt-percept, code]

mu is the mean error of the training set. The clamped one hides what lies above 2 mu; the logistic
one, whose ends are at 0 and 1, is made for errors of that range.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from rtsr_cli.core.choices import VrsMetric
from rtsr_cli.models.rt_percept.config import RtPerceptConfig, Transform

STEEPNESS = 10.0

DECIBEL = 0.015
"""What a decibel takes off."""


def _curve(errors: Tensor, mean: Tensor) -> Tensor:
    return torch.sigmoid(STEEPNESS * (errors - mean))


def transformed(errors: Tensor, mean: Tensor, config: RtPerceptConfig) -> Tensor:
    """T(Y), 0..1."""
    if config.error.metric is VrsMetric.PSNR:
        return (1.0 - DECIBEL * errors).clamp(0.0, 1.0)
    if config.transform is Transform.CLAMPED:
        return (errors / (2.0 * mean)).clamp(0.0, 1.0)
    low, high = _curve(torch.zeros_like(mean), mean), _curve(torch.ones_like(mean), mean)
    return ((_curve(errors, mean) - low) / (high - low)).clamp(0.0, 1.0)


def restored(values: Tensor, mean: Tensor, config: RtPerceptConfig) -> Tensor:
    """T^-1."""
    values = values.clamp(0.0, 1.0)
    if config.error.metric is VrsMetric.PSNR:
        return (1.0 - values) / DECIBEL
    if config.transform is Transform.CLAMPED:
        return values * (2.0 * mean)
    low, high = _curve(torch.zeros_like(mean), mean), _curve(torch.ones_like(mean), mean)
    # rounding may leave the range, beyond which there are errors below 0 or above 1
    share = (values * (high - low) + low).clamp(low, high)
    return (torch.logit(share) / STEEPNESS + mean).clamp(min=0.0)


def encode_errors(errors: Tensor, network: nn.Module) -> Tensor:
    """T by a network's config and mean error, on the processor."""
    assert isinstance(network.config, RtPerceptConfig)
    return transformed(errors, network.get_buffer("mean").cpu(), network.config)


def decode_errors(values: Tensor, network: nn.Module) -> Tensor:
    """T^-1 by a network's config and mean error, on the processor."""
    assert isinstance(network.config, RtPerceptConfig)
    return restored(values, network.get_buffer("mean").cpu(), network.config)
