"""Settings of classifier guided temporal supersampling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from enum import StrEnum

from rtsr_cli.core.choices import Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.pixel_classes import ClassConfig
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Color, Image, MotionPx, Plane
from rtsr_cli.core.system import Tensors

CLASSES = 3
"""Of ghosting: visibility, shading, none; of aliasing: geometry, texture, none."""

CAUTION = 1.75
"""How much the logit of visibility ghosting is raised for what history is kept."""

LEANING = {"ghosting": (CAUTION, 1.0, 0.0), "aliasing": (0.75, 0.5, 0.0)}
"""Added to the logits for the loss, whose weights make rare classes likelier than they are.

Menon et al. 2021, Long-tail learning via logit adjustment; near where the macro-F1 of the captures
trained on is highest, geometry aliasing a little likelier, so that it is found within a pixel.
"""

UNROLLED_FRAMES = 8
"""Successive frames of a training sample."""


class Stage(StrEnum):
    """Which of the two networks is trained."""

    JOINT = "joint"
    CLASSIFIER = "classifier"
    COMPOSITION = "composition"
    """By the classes of a classifier that stays as it is."""


@dataclass(frozen=True, kw_only=True)
class CgtsSurroundings:
    """What surrounds the layers.

    Attributes:
        enlarge: (LR frame, scale) -> its colour at the output's size, tone-mapped, and how many
            samples every pixel of it is worth.
        move: (motion in LR pixels, depth, scale, jitter) -> motion at the output's size.
        signals: what the composition network sees beside the published 14 channels.
        see: (frame and carried history, by name) -> these channels, n signals h w.
        start: (worth of the frame's colour, of the history) -> logit of the frame's weight that the
            network corrects.
        shown: what the classifier sees beside the published 20 channels.
        show: (frame and carried history, by name) -> these channels, n shown h w.
        guides: whether the networks also tell how far moving history is held within the colours
            around, and how the frame's samples and the picture are filtered.
    """

    enlarge: Callable[[Frame, int], tuple[Color, Plane]]
    move: Callable[[MotionPx, Plane, int, Jitter], MotionPx]
    signals: int
    see: Callable[[Tensors], Image]
    start: Callable[[Plane, Plane], Plane]
    shown: int
    show: Callable[[Tensors], Image]
    guides: bool


@dataclass(frozen=True, kw_only=True)
class CgtsLoss:
    """Weights of the loss' terms, and of pixels by their class; none is published.

    Attributes:
        ghosting, aliasing: cross-entropy of either kind of classes, rare ones weighted.
        rarest: most that a class weighs more than by its share.
        color: root of the squared difference of c / (1 + c) and a little, a pixel.
        squared: mean squared difference of c / (1 + c), which is what PSNR measures.
        temporal: difference of the change along the motion, where nothing ghosts.
        visibility, shading: weight of such pixels in `color`; of all others 1.
    """

    ghosting: float = 0.1
    aliasing: float = 0.1
    rarest: float = 10.0
    color: float = 0.3
    squared: float = 30.0
    temporal: float = 0.2
    visibility: float = 2.0
    shading: float = 2.0

    def __post_init__(self) -> None:
        """Check the weights.

        Raises:
            ConfigError: one is below 0 or no number, or nothing weighs anything.
        """
        names = [term.name for term in fields(self)]
        check_numbers(self, "network.loss", dict.fromkeys(names, 0.0))
        terms = ("ghosting", "aliasing", "color", "squared", "temporal")
        if not any(getattr(self, name) for name in terms):
            raise ConfigError(f"network.loss: one of {', '.join(terms)} has to be above 0")


@dataclass(frozen=True, kw_only=True)
class CgtsConfig:
    """Settings.

    Attributes:
        preset: what surrounds the layers.
        stage: which network is trained.
        classes: whether the composition sees classes; else an ablation.
        gradient_frames: a gradient flows through so many successive frames, counted from a
            sample's first; then the next ones begin.
        labels: thresholds of the classes.
        loss: weights of its terms.
    """

    preset: Preset = Preset.RTSR
    stage: Stage = Stage.JOINT
    classes: bool = True
    gradient_frames: int = 4
    labels: ClassConfig = field(default_factory=ClassConfig)
    loss: CgtsLoss = field(default_factory=CgtsLoss)

    def __post_init__(self) -> None:
        """Check the frames.

        Raises:
            ConfigError: a gradient flows through none.
        """
        check_numbers(self, "network", {"gradient_frames": 1})
