"""Settings of ExtraNet, and how many frames it sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from enum import StrEnum

from torch import Tensor

from rtsr_cli.core.choices import DemodulationMode, Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Image, Mask, Plane
from rtsr_cli.core.system import FrameWindow

CADENCE = 2
"""Every second frame is rendered."""

PLACES = (1, 3, 5)
"""Rendered frames that are seen: t-1, t-3, t-5."""

HISTORY_FRAMES = PLACES[-1]
"""Frames before the predicted one, as far as the oldest that is seen."""


@dataclass(frozen=True, kw_only=True)
class PastPictures:
    """Past frames brought to the predicted one.

    Attributes:
        base: e that the output is added to.
        second: e beside it.
        holes: 1 where the last rendered frame does not show the surface.
        second_known: 1 where `second` is of the surface.
        moved: of the frames at `PLACES`, as far as the window goes, e along the vectors and 1
            where it is of the surface; None of one that was not rendered.
    """

    base: Image
    second: Image
    holes: Mask
    second_known: Mask
    moved: tuple[tuple[Image, Mask] | None, ...]


@dataclass(frozen=True, kw_only=True)
class ExtraNetSurroundings:
    """What surrounds the layers.

    Attributes:
        look_back: (config, window) -> past frames as the network sees them.
        scale_of: the last rendered frame -> k.
        show_depth: depth in metres -> as the network sees it.
        demodulation: what divides radiance.
    """

    look_back: Callable[[ExtraNetConfig, FrameWindow], PastPictures]
    scale_of: Callable[[Frame], Tensor]
    show_depth: Callable[[Plane], Plane]
    demodulation: DemodulationMode


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
        preset: what surrounds the layers.
        base: what the output is added to; in `paper`, warped lighting.
        history: whether frames before the last rendered one are seen; else an ablation.
        occlusion: whether holes are shown what occlusion vectors fetch; else an ablation.
        loss: weights of its terms.
    """

    preset: Preset = Preset.RTSR
    base: PredictionBase = PredictionBase.GUIDED
    history: bool = True
    occlusion: bool = True
    loss: ExtraNetLoss = field(default_factory=ExtraNetLoss)
