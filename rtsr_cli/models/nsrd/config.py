"""Settings of NSRD's network, and what it sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rtsr_cli.core.choices import DemodulationMode, LutConvention, Preset
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.imaging.frame_motion import DualMotion
from rtsr_cli.core.lighting.lighting import EnlargementBase, LossWeights, Surroundings
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx
from rtsr_cli.core.system import FrameWindow, Tensors

HISTORY_FRAMES = 2

LR_CHANNELS = 7
"""Lighting 3, normal 3, depth 1, in this order [NSRD, code]."""

UNROLLED_FRAMES = 4
"""Successive frames of a training sample [NSRD, code]."""


@dataclass(frozen=True, kw_only=True)
class NSRDLossWeights(LossWeights):
    """Weights of the loss' terms: those of `LossWeights`, and the published ones.

    Attributes:
        smooth: smooth absolute difference of lighting, beta 1 [NSRD, code].
        structure: 1 - SSIM of lighting, 11 x 11 Gaussian, zeros around [NSRD, code].
        temporal: smooth absolute difference to the prediction before, where it is reliable.
    """

    log: float = 0.05
    tonemapped: float = 0.5
    tonemapped_squared: float = 4.0
    smooth: float = 0.0
    structure: float = 0.0
    temporal: float = 0.05


Mark = Callable[[DualMotion], Mask]
"""1 where the frame before must not be trusted."""


@dataclass(frozen=True, kw_only=True)
class NSRDSurroundings(Surroundings):
    """What surrounds the layers.

    Attributes:
        show_lighting: (LR frame, current frame) -> its lighting as the network sees it.
        chain_motion: (motion of the newer step, of the older, what marks either) -> motion over
            both in pixels, and where it must not be trusted.
        move_frame: (features of a past frame, motion, current ones) -> them where each pixel was;
            the current ones where that is outside.
        enlarge_motion: (window, LR motion and other fields of vectors, n c h w) -> motion of HR
            pixels; the fields at HR; what a vector of one LR pixel counts in them.
        fetch_output: (last output's lighting, inputs) -> what was predicted where each pixel was,
            as this frame expresses lighting.
        show_output: (what `fetch_output` gave, inputs) -> what the network sees of it.
        moves_state: whether the LSTM's state may move with the surfaces.
        compared: name of the goal that predictions are compared with.
        loss: weights of the loss' terms whatever the config says; None = those of the config.
    """

    show_lighting: Callable[[Frame, Frame], Color]
    chain_motion: Callable[[DualMotion, DualMotion, Mark], tuple[MotionPx, Mask]]
    move_frame: Callable[[Image, MotionPx, Image], Image]
    enlarge_motion: Callable[[FrameWindow, Image], tuple[MotionPx, Image, int]]
    fetch_output: Callable[[Color, Tensors], Color]
    show_output: Callable[[Color, Tensors], Color]
    moves_state: bool
    compared: str
    loss: NSRDLossWeights | None


@dataclass(frozen=True, kw_only=True)
class NSRDConfig:
    """Settings; whatever is switched off is an ablation.

    Attributes:
        preset: what surrounds the layers.
        demodulation: divisor of the radiance.
        lut: convention of the split-sum table.
        dual_vectors: whether masks tell hidden surfaces; else only what was outside the frame.
        feedback: whether the last prediction comes in.
        lstm: whether the LSTM's state is kept.
        warp_state: whether it moves with the surfaces; in `paper` it stays where it is.
        base: what the output is added to; none in `paper`.
        gradient_frames: a gradient flows through so many successive frames, counted from a
            sample's first; then the next ones begin.
        loss: weights of its terms; `paper` has its own.
    """

    preset: Preset = Preset.RTSR
    demodulation: DemodulationMode = DemodulationMode.BRDF
    lut: LutConvention = LutConvention.KARIS
    dual_vectors: bool = True
    feedback: bool = True
    lstm: bool = True
    warp_state: bool = True
    gradient_frames: int = 1
    base: EnlargementBase = EnlargementBase.GUIDED
    loss: NSRDLossWeights = field(default_factory=NSRDLossWeights)

    def __post_init__(self) -> None:
        """Check the frames.

        Raises:
            ConfigError: a gradient flows through none.
        """
        check_numbers(self, "network", {"gradient_frames": 1})

    @property
    def derivation(self) -> DerivationConfig:
        """What divides the radiance."""
        return DerivationConfig(mode=self.demodulation, lut=self.lut)
