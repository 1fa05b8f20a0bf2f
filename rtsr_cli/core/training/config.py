"""Settings of a training run; what users write under [training] and [data]."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.training.augmentation import AugmentationConfig


class Optimiser(StrEnum):
    """Update rule."""

    ADAM = "adam"
    ADAMW = "adamw"
    RMSPROP = "rmsprop"


class Schedule(StrEnum):
    """Learning rate over the steps, after the warm-up."""

    COSINE = "cosine"
    CONSTANT = "constant"
    HALVE = "halve"
    EXPONENTIAL = "exponential"


class SampleJitter(StrEnum):
    """Which sample of a block the LR frames of training keep; those of real pairs are as rendered.

    Whatever is not `none` is validated with `halton`.
    """

    NONE = "none"
    HALTON = "halton"
    """As `upscale --jitter halton` has it: by frame numbers."""
    MIXED = "mixed"
    """Half of the samples `none`, half `halton` from a random place of the sequence on."""


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """How a network is trained.

    Attributes:
        scale: S.
        samples_per_pixel: K, capture pixels per output pixel along an axis; LR frames are captures
            decimated by K S, and an output pixel is held against the mean of its K x K.
        jitter: which sample of a block LR frames keep.
        steps: optimiser steps of the whole run.
        batch: samples a forward pass, of each process.
        accumulate: passes a step.
        crop: side of a sample, LR pixels.
        optimiser: update rule.
        learning_rate: after the warm-up.
        weight_decay: of AdamW; of RMSprop the gradient of an L2 penalty.
        schedule: `halve` halves at half of the steps, `exponential` loses a share each step.
        decay: that share.
        warmup: steps of linear growth.
        final_rate: learning rate at the end of `cosine`, as a share.
        ema: decay of the moving average that is validated and kept; 0 = none.
        clip_norm: largest gradient norm; 0 = no bound.
        freeze_statistics: share of the steps after which batch norms keep their statistics, as
            small batches make them jump; 1 = never.
        precision: of the convolutions.
        channels_last: memory layout.
        compile: torch.compile the network.
        seed: of weights and samples.
        validate_every, save_every, log_every: steps between; the last step always does all.
        validation_frames: whole frames judged each time, spread over the validation clips.
        picture_side: side of the fixed validation crops, output pixels.
    """

    scale: int = 4
    samples_per_pixel: int = 1
    jitter: SampleJitter = SampleJitter.NONE
    steps: int = 20_000
    batch: int = 8
    accumulate: int = 1
    crop: int = 64
    optimiser: Optimiser = Optimiser.ADAM
    learning_rate: float = 5e-4
    weight_decay: float = 0.0
    schedule: Schedule = Schedule.COSINE
    decay: float = 1e-4
    warmup: int = 200
    final_rate: float = 0.01
    ema: float = 0.999
    clip_norm: float = 1.0
    freeze_statistics: float = 1.0
    precision: Precision = Precision.AUTO
    channels_last: bool = True
    compile: bool = False
    seed: int = 1
    validate_every: int = 1000
    save_every: int = 500
    log_every: int = 50
    validation_frames: int = 12
    picture_side: int = 192
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: one is too small, or none.
        """
        counts = (
            "scale", "samples_per_pixel", "steps", "batch", "accumulate", "crop", "validate_every",
            "save_every", "log_every", "picture_side",
        )  # fmt: skip
        largest = {
            "scale": 64, "samples_per_pixel": 16, "batch": 1 << 16, "accumulate": 1 << 16,
            "crop": 1 << 16, "picture_side": 1 << 14, "validation_frames": 1 << 20,
            "seed": 2**62, "ema": 1, "decay": 1,
        }  # fmt: skip
        shares = (
            "learning_rate", "weight_decay", "decay", "warmup", "final_rate", "ema", "clip_norm",
            "freeze_statistics", "validation_frames", "seed",
        )  # fmt: skip
        least = dict.fromkeys(counts, 1) | dict.fromkeys(shares, 0)
        check_numbers(self, "training", least, largest)


@dataclass(frozen=True, kw_only=True)
class DataConfig:
    """Which shots are trained and judged on; patterns match shot names (`scene/sequence`).

    Attributes:
        validation: patterns of shots held out; empty = a manifest's, else some shots.
        exclude: patterns of shots left out altogether.
        workers: threads that make samples; 0 = by the processor.
    """

    validation: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    workers: int = 0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: there are fewer threads than none.
        """
        check_numbers(self, "data", {"workers": 0}, {"workers": 1024})
