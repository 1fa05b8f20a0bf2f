"""Crops of clips: what they are made for, where they lie, and what happens to their pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import System, TrainingRecipe
from rtsr_cli.core.training.augmentation import (
    AugmentationConfig,
    PictureTurn,
    draw_gain,
    draw_swap,
    draw_turn,
)
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import SampleJitter, TrainingConfig

FILTERS = ("blackman-harris", "box")
"""Pixel filters that LR radiance may have."""

PHASES = 4096
"""Places of the jitter's sequence that a sample may start from: more than a block has samples."""


@dataclass(frozen=True, kw_only=True)
class SampleRegion:
    """Where a sample lies in a clip, in LR pixels of the size that is cropped, and when.

    Attributes:
        position: of the first target frame in the clip.
        top, left: first HR pixel.
        size: (height, width) of the LR crop.
    """

    position: int
    top: int
    left: int
    size: Size


@dataclass(frozen=True, kw_only=True)
class SampleChoices:
    """What was drawn for a sample; the defaults leave it as it was captured.

    Attributes:
        turn: of the picture and the world.
        gain: of the light, a channel.
        swap: of materials, None for none.
        lr_filter: pixel filter of LR radiance, or "none".
        jitter: which sample of a block LR frames keep.
        phase: added to frame numbers for that.
    """

    turn: PictureTurn = field(default_factory=PictureTurn)
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    swap: Any = None
    lr_filter: str = "none"
    jitter: JitterMode = JitterMode.NONE
    phase: int = 0

    @property
    def mean_gain(self) -> float:
        """Geometric mean: what k grows by."""
        return float(np.exp(np.mean(np.log(self.gain))))


@dataclass(frozen=True, kw_only=True)
class SampleTask:
    """What samples are made for.

    Attributes:
        system: whose they are.
        config: its settings.
        scale: S.
        samples_per_pixel: K of captures that LR frames are made from.
        jitter: of those LR frames.
    """

    system: System
    config: Any
    scale: int
    samples_per_pixel: int = 1
    jitter: SampleJitter = SampleJitter.NONE

    @property
    def learning(self) -> TrainingRecipe:
        """How the system is trained."""
        if self.system.learning is None:
            raise FrameFolderError(f"system '{self.system.name}' has nothing to train")
        return self.system.learning


def make_task(system: System, config: object, training: TrainingConfig) -> SampleTask:
    """Say what samples of a run are made for."""
    return SampleTask(
        system=system,
        config=config,
        scale=training.scale,
        samples_per_pixel=training.samples_per_pixel,
        jitter=training.jitter,
    )


def leave_out_starts(clips: Sequence[Clip], task: SampleTask) -> list[Clip]:
    """Clips without the targets that a system cannot predict: one that extrapolates, from nothing.

    Those that have no other targets are left out.
    """
    if not task.system.rendered_every:
        return list(clips)
    later = [
        replace(clip, facts=replace(clip.facts, targets=max(1, clip.facts.targets)))
        for clip in clips
    ]
    return [clip for clip in later if clip.target_positions]


def choose_simulation(clip: Clip, task: SampleTask, choices: SampleChoices) -> Simulation:
    """How LR frames of a sample are made; of those that were rendered, what their pixels are."""
    if clip.facts.lr_scale:
        return Simulation(scale=task.scale)
    simulation = Simulation(
        scale=task.scale,
        samples_per_pixel=task.samples_per_pixel,
        jitter=choices.jitter,
        phase=choices.phase,
        lr_filter=choices.lr_filter,
    )
    # a block of one sample has no neighbours to be filtered with
    return simulation if simulation.block > 1 else replace(simulation, lr_filter="none")


def choose_block(clip: Clip, task: SampleTask) -> int:
    """Pixels of a clip's HR planes per LR pixel, along an axis."""
    return choose_simulation(clip, task, SampleChoices()).block


def draw_region(clip: Clip, size: Size, *, block: int, unroll: int, rng: Any) -> SampleRegion:
    """Draw a place and a moment; real LR frames are cropped at whole LR pixels.

    Args:
        clip: to crop.
        size: (height, width) in LR pixels; less where the clip is smaller.
        block: HR pixels per LR pixel; any of them may be a crop's first.
        unroll: successive targets.
        rng: NumPy's generator.
    """
    positions = clip.target_positions[: len(clip.target_positions) - unroll + 1]
    position = int(rng.choice(positions if len(positions) else clip.target_positions[:1]))
    height, width = (min(s, extent // block) for s, extent in zip(size, clip.size, strict=True))
    grid = clip.facts.lr_scale or 1
    top, left = (
        int(rng.integers(0, (extent - s * block) // grid + 1)) * grid
        for extent, s in zip(clip.size, (height, width), strict=True)
    )
    return SampleRegion(position=position, top=top, left=left, size=(height, width))


def cover_frame(clip: Clip, position: int, block: int) -> SampleRegion:
    """The whole of a frame."""
    height, width = clip.size
    return SampleRegion(position=position, top=0, left=0, size=(height // block, width // block))


def draw_choices(config: AugmentationConfig, rng: np.random.Generator) -> SampleChoices:
    """Draw what happens to a sample."""
    turn = draw_turn(rng) if config.turns else PictureTurn()
    gain = draw_gain(config, rng)
    swap = draw_swap(config, rng) if rng.random() < config.material_share else None
    filtered = rng.random() < config.filtered_share
    lr_filter = str(rng.choice(FILTERS)) if filtered else "none"
    return SampleChoices(turn=turn, gain=gain, swap=swap, lr_filter=lr_filter)


def draw_jitter(jitter: SampleJitter, rng: np.random.Generator) -> tuple[JitterMode, int]:
    """Draw a sample's jitter and its phase; only what is mixed is a matter of chance."""
    if jitter is not SampleJitter.MIXED:
        return JitterMode(jitter.value), 0
    phase = int(rng.integers(2 * PHASES))
    return (JitterMode.HALTON, phase) if phase < PHASES else (JitterMode.NONE, 0)
