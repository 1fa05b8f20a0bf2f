"""Settings of the visual-error network, and what it sees and predicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.vrs.rates import REDUCED, ShadingRate
from rtsr_cli.core.vrs.shading_error import JUST_NOTICED, ErrorConfig

WIDTH = 16
"""Channels; the least without evident loss [rt-percept]."""

MAX_TILE = 64


class NetworkInputs(StrEnum):
    """Which buffers the network sees, by the number of their channels."""

    FOUR = "4"
    """The published choice."""
    LUMA = "luma"
    """The same four, luma instead of red: what errors are measured on."""
    THREE = "3"
    SIXTEEN = "16"
    NINETEEN = "19"
    REUSE = "reuse"
    """4 channels: specular instead of the mask."""


class ConvolutionGroups(StrEnum):
    """Groups of the five convolutions."""

    CODE = "code"
    """1, 1, 2, 4, 1: the training code's, and the paper's 22 KiB."""
    TABLE_3 = "table-3"
    """1, 1, 4, 8, 1: as printed."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """Groups layer by layer."""
        return (1, 1, 2, 4, 1) if self is ConvolutionGroups.CODE else (1, 1, 4, 8, 1)


class ErrorTransform(StrEnum):
    """How errors are brought to 0..1."""

    CLAMPED = "clamped"
    LOGISTIC = "logistic"


@dataclass(frozen=True, kw_only=True)
class RtPerceptConfig:
    """Settings.

    Attributes:
        inputs: buffers.
        rates: predicted ones, in the order of the output channels; the others follow by eq. 10.
        groups: of the convolutions.
        transform: of errors to what is predicted.
        mean: mu, the mean error of the training set; 0 = a running mean of what was seen.
        margin: added to predictions before they are transformed back.
        threshold: error that a rate must stay below where users say nothing, in the metric's unit;
            0 = what is just not noticed by the metric.
        squared: weight of the squared difference beside the absolute one in the loss; brings
            predictions from the median of what is likely to its mean.
        unseen_weight: of tiles that the frame before does not show, in the loss.
        reuse: predict the error of keeping the frame before, not of rates: one output.
        keep_edges: reduced rates keep pixels of other objects than the sample's.
        error: what is predicted.
    """

    inputs: NetworkInputs = NetworkInputs.LUMA
    rates: tuple[str, ...] = ("1x2", "2x1", "2x4", "4x2")
    groups: ConvolutionGroups = ConvolutionGroups.CODE
    transform: ErrorTransform = ErrorTransform.CLAMPED
    mean: float = 0.0
    margin: float = 0.0
    threshold: float = 0.0
    squared: float = 0.0
    unseen_weight: float = 1.0
    reuse: bool = False
    keep_edges: bool = False
    error: ErrorConfig = field(default_factory=ErrorConfig)

    def __post_init__(self) -> None:
        """Check tile and rates.

        Raises:
            ConfigError: the tile is no power of two up to 64, a rate is unknown, missing or there
                twice, or a number is below 0.
        """
        tile = self.error.tile
        if not 1 <= tile <= MAX_TILE or tile & (tile - 1):
            raise ConfigError(f"network.error.tile = {tile}: a power of two from 1 to {MAX_TILE}")
        known = {rate.label for rate in REDUCED}
        wrong = [name for name in self.rates if name not in known]
        twice = len(set(self.rates)) < len(self.rates)
        if wrong or twice or not {"1x2", "2x1"} <= set(self.rates):
            raise ConfigError(
                f"network.rates = {list(self.rates)}: 1x2 and 2x1, and any of "
                f"{', '.join(sorted(known - {'1x2', '2x1'}))}, each once"
            )
        numbers = ("mean", "margin", "threshold", "squared", "unseen_weight")
        check_numbers(self, "network", dict.fromkeys(numbers, 0.0))

    @property
    def label(self) -> str:
        """What weights for metric and tile are called."""
        return f"{self.error.metric}-{self.error.tile}" + ("-reuse" if self.reuse else "")

    @property
    def limit(self) -> float:
        """Error that a rate must stay below where users say nothing."""
        return self.threshold or JUST_NOTICED[self.error.metric]

    @property
    def channels(self) -> tuple[str, ...]:
        """What each output channel is the error of."""
        return ("reuse",) if self.reuse else self.rates

    @property
    def predicted(self) -> tuple[ShadingRate, ...]:
        """Rates of the output channels."""
        return tuple(next(r for r in REDUCED if r.label == name) for name in self.rates)
