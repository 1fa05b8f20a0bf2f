"""Settings of `gather`."""

from __future__ import annotations

from dataclasses import dataclass, field

from rtsr_cli.core.lighting.lighting import LossWeights
from rtsr_cli.core.lighting.lighting_history import HistoryWeights

UNROLLED_FRAMES = 8
"""Successive frames of a training sample."""


def default_loss() -> LossWeights:
    """Mostly what PSNR measures."""
    return LossWeights(log=0.0, tonemapped=1.0, tonemapped_squared=20.0)


@dataclass(frozen=True, kw_only=True)
class GatherConfig(HistoryWeights):
    """Settings; those of history are `demod-temporal`'s, from which training starts.

    Attributes:
        kernel: whether the network weighs the terms of the kernel; else an ablation.
        history: whether it weighs history; else an ablation.
        residual: whether it adds to the lighting, too; an ablation.
        loss: weights of its terms.
    """

    kernel: bool = True
    history: bool = True
    residual: bool = False
    loss: LossWeights = field(default_factory=default_loss)
