"""Networks for inference: the same function, fewer and faster operations."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Protocol, cast, runtime_checkable

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


@runtime_checkable
class InferenceRearranging(Protocol):
    """A network that knows a faster order of its operations."""

    def for_inference(self) -> nn.Module:
        """The same function, without training."""
        ...


def accelerate_network(network: nn.Module) -> nn.Module:
    """Copy a network for inference: batch norms folded into convolutions, channels last, frozen.

    y = g (w x + b - m) / sqrt(v + eps) + h  is one convolution with weights w g / sqrt(v + eps)
    """
    known = network.for_inference() if isinstance(network, InferenceRearranging) else network
    frozen = fold_norms(known)
    # torch's annotation leaves out that a module takes a memory format alone
    return cast(nn.Module, frozen.to(memory_format=torch.channels_last))  # type: ignore[call-overload]


def fold_norms(network: nn.Module) -> nn.Module:
    """Copy a network, in eval mode and frozen, its batch norms folded into the convolutions."""
    frozen = copy.deepcopy(network).eval().requires_grad_(False)
    for module in list(frozen.modules()):
        if isinstance(module, nn.Sequential):
            _fold(module)
    return frozen


def _fold(layers: nn.Sequential) -> None:
    """Fold every batch norm that follows a convolution directly."""
    names = list(layers._modules)
    for first, second in pairwise(names):
        convolution, norm = layers._modules[first], layers._modules[second]
        if isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            layers._modules[first] = fuse_conv_bn_eval(convolution, norm)
            layers._modules[second] = nn.Identity()
