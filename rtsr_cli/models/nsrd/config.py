"""Settings of NSRD's network, and what it sees."""

from __future__ import annotations

from dataclasses import dataclass, field

from rtsr_cli.core.choices import DemodulationMode, LutConvention
from rtsr_cli.core.derive import DerivationConfig
from rtsr_cli.core.lighting import Base, LossWeights, Preset
from rtsr_cli.core.settings import check_numbers

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


PAPER_LOSS = NSRDLossWeights(
    log=0.0, tonemapped=0.0, tonemapped_squared=0.0, smooth=1.0, structure=1.0, temporal=1.0
)


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
    base: Base = Base.GUIDED
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

    @property
    def loss_weights(self) -> NSRDLossWeights:
        """Weights of the preset."""
        return PAPER_LOSS if self.preset is Preset.PAPER else self.loss

    @property
    def moves_state(self) -> bool:
        """Whether the state is warped."""
        return self.warp_state and self.preset is Preset.RTSR
