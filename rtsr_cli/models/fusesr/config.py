"""Settings of FuseSR's networks, and what they see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

from rtsr_cli.core.choices import DemodulationMode, LutConvention, Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting.lighting import EnlargementBase, LossWeights, Surroundings
from rtsr_cli.core.shapes import Color

HISTORY_FRAMES = 2

LR_CHANNELS = 7
"""Lighting 3, depth 1, normal 3, in this order."""

HR_CHANNELS = {Buffer.MATERIAL: 3, Buffer.DEPTH: 1, Buffer.NORMAL: 3, Buffer.ALBEDO: 3}


class Variant(StrEnum):
    """Which of the published networks."""

    HEAD = "head"
    FIRST_RELEASE = "first-release"
    DIRECT = "direct"
    FAST = "fast"


class Fusion(StrEnum):
    """How HR buffers reach LR features; all but `unshuffle` are ablations."""

    UNSHUFFLE = "unshuffle"
    POOL = "pool"
    UPSAMPLE = "upsample"
    NONE = "none"


HR_PARTS = {
    Variant.HEAD: (Buffer.MATERIAL, Buffer.DEPTH, Buffer.NORMAL, Buffer.ALBEDO),
    Variant.FIRST_RELEASE: (Buffer.MATERIAL,),
    Variant.DIRECT: (Buffer.ALBEDO, Buffer.DEPTH, Buffer.NORMAL),
    Variant.FAST: (Buffer.MATERIAL,),
}
"""HR buffers that each network sees, in the published order."""


@dataclass(frozen=True, kw_only=True)
class FuseSRSurroundings(Surroundings):
    """What surrounds the layers.

    Attributes:
        show_lighting: LR frame -> its lighting as the network sees it.
        loss: weights of the loss' terms whatever the config says; None = those of the config.
        brdf: what divides radiance where the config says `brdf`.
        warps_depth: whether depth of the history is fetched where each pixel was.
    """

    show_lighting: Callable[[Frame], Color]
    loss: LossWeights | None
    brdf: DemodulationMode
    warps_depth: bool


@dataclass(frozen=True, kw_only=True)
class FuseSRConfig:
    """Settings of the full network.

    Attributes:
        variant: published network.
        preset: what surrounds its layers.
        demodulation: divisor of the radiance; `paper` takes softplus.
        lut: convention of the split-sum table.
        fusion: how HR buffers come in.
        history: whether past frames do.
        base: what the output is added to; none in `paper`.
        loss: weights of its terms; `paper` has its own.
    """

    variants: ClassVar[tuple[Variant, ...]] = (Variant.HEAD, Variant.FIRST_RELEASE)

    variant: Variant = Variant.HEAD
    preset: Preset = Preset.RTSR
    demodulation: DemodulationMode = DemodulationMode.BRDF
    lut: LutConvention = LutConvention.KARIS
    fusion: Fusion = Fusion.UNSHUFFLE
    history: bool = True
    base: EnlargementBase = EnlargementBase.GUIDED
    loss: LossWeights = field(default_factory=LossWeights)

    def __post_init__(self) -> None:
        """Refuse the network of another system.

        Raises:
            ConfigError: it is named.
        """
        if self.variant not in self.variants:
            there = ", ".join(self.variants)
            raise ConfigError(
                f"network.variant = '{self.variant}' is another system's; this one has: {there}"
            )

    @property
    def hr_parts(self) -> tuple[Buffer, ...]:
        """HR buffers that the network sees."""
        return () if self.fusion is Fusion.NONE else HR_PARTS[self.variant]

    @property
    def hr_channels(self) -> int:
        """Their channels."""
        return sum(HR_CHANNELS[buffer] for buffer in self.hr_parts)


@dataclass(frozen=True, kw_only=True)
class FuseSRFastConfig(FuseSRConfig):
    """Settings of the fast network, which sees no history."""

    variants: ClassVar[tuple[Variant, ...]] = (Variant.FAST,)

    variant: Variant = Variant.FAST
    history: bool = False


@dataclass(frozen=True, kw_only=True)
class FuseSRDirectConfig(FuseSRConfig):
    """Settings of the network that predicts radiance itself."""

    variants: ClassVar[tuple[Variant, ...]] = (Variant.DIRECT,)

    variant: Variant = Variant.DIRECT
    demodulation: DemodulationMode = DemodulationMode.NONE
    base: EnlargementBase = EnlargementBase.CUBIC
