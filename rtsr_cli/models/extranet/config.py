"""Settings of ExtraNet, and how many frames it sees."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import StrEnum

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.settings import check_numbers

CADENCE = 2
"""Every second frame is rendered."""

PLACES = (1, 3, 5)
"""Rendered frames that are seen: t-1, t-3, t-5."""

HISTORY_FRAMES = PLACES[-1]
"""Frames before the predicted one, as far as the oldest that is seen."""


class PredictionBase(StrEnum):
    """What the output is added to."""

    GUIDED = "guided"
    """Lighting carried and filled along surfaces: `warp-guided`."""
    WARPED = "warped"
    """Lighting along the vectors, whatever surface it is of."""


@dataclass(frozen=True, kw_only=True)
class ExtraNetLoss:
    """Weights of the loss' terms; the first three on log lighting [ExtraNet, Section 3.4].

    Attributes:
        log: mean absolute difference.
        hole: the same over holes alone.
        shading: mean of the largest tenth, an image and channel: lights and shadows that moved.
        tonemapped: mean absolute difference of radiance after c / (1 + c).
        tonemapped_squared: mean squared one, which is what PSNR measures.
    """

    log: float = 1.0
    hole: float = 1.0
    shading: float = 1.0
    tonemapped: float = 0.0
    tonemapped_squared: float = 0.0

    def __post_init__(self) -> None:
        """Check the weights.

        Raises:
            ConfigError: one is below 0 or no number, or nothing weighs anything.
        """
        names = [term.name for term in fields(self)]
        check_numbers(self, "network.loss", dict.fromkeys(names, 0.0))
        if not any(getattr(self, name) for name in names):
            raise ConfigError(f"network.loss: one of {', '.join(names)} has to be above 0")


@dataclass(frozen=True, kw_only=True)
class ExtraNetConfig:
    """Settings.

    Attributes:
        base: what the output is added to.
        history: whether frames before the last rendered one are encoded; else an ablation.
        occlusion: whether holes are shown what occlusion vectors fetch; else an ablation.
        loss: weights of its terms.
    """

    base: PredictionBase = PredictionBase.GUIDED
    history: bool = True
    occlusion: bool = True
    loss: ExtraNetLoss = field(default_factory=ExtraNetLoss)
