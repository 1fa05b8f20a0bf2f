"""Which samples a run sees, in which order, made in threads ahead of use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.streaming import prefetch
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import Tensors, WholeFrames
from rtsr_cli.core.threads import worker_pool
from rtsr_cli.core.training.clips import Clip, hold_frame
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.ranks import ALONE, ProcessRanks
from rtsr_cli.core.training.sample_steps import SampleStep, build_steps
from rtsr_cli.core.training.samples import (
    SampleChoices,
    SampleRegion,
    SampleTask,
    choose_block,
    draw_choices,
    draw_jitter,
    draw_region,
    leave_out_starts,
)
from rtsr_cli.core.training.whole_frames import PreparedFrames, crop_prepared, draw_crop

UNCHANGED = SampleChoices()
"""A sample as it was captured."""

AHEAD_BATCHES = 2
"""Batches of samples that are made ahead."""


@dataclass(frozen=True)
class TrainingSample:
    """A training sample and where it comes from."""

    index: int
    clip: Clip
    region: SampleRegion
    choices: SampleChoices
    steps: list[SampleStep]

    @property
    def where(self) -> str:
        """Sequence, frame and crop, for messages."""
        facts, region = self.clip.facts, self.region
        x, y = facts.left + region.left, facts.top + region.top
        height, width = region.size
        return (
            f"sample {self.index}: {facts.name}, frame {facts.numbers[region.position]}, "
            f"crop of {width} x {height} LR pixels at HR ({x}, {y})"
        )


class SampleDrawer:
    """Draws samples: every group alike, within a group every frame alike."""

    def __init__(
        self,
        clips: Sequence[Clip],
        task: SampleTask,
        config: TrainingConfig,
        ranks: ProcessRanks = ALONE,
    ) -> None:
        """Sort clips into groups; those that are too short for a sample are left out.

        Raises:
            FrameFolderError: there is nothing to train on.
        """
        self._task, self._config, self._ranks = task, config, ranks
        unroll = task.learning.unroll
        groups: dict[int, list[Clip]] = {}
        for clip in leave_out_starts(clips, task):
            if not clip.facts.validation and len(clip.target_positions) >= unroll:
                groups.setdefault(clip.facts.group, []).append(clip)
        if not groups:
            raise FrameFolderError(
                f"no shots to train on are left that have {unroll} successive frames; give "
                "longer ones, or look at [data] exclude and validation"
            )
        self._groups = [groups[key] for key in sorted(groups)]
        frames = [np.array([len(c.target_positions) for c in g], float) for g in self._groups]
        self._crop = choose_crop(clips, task, config)
        self._goals: dict[tuple[int, SampleRegion, JitterMode], list[Tensors]] = {}
        self._held: dict[tuple[int, int], Clip] = {}
        self._prepared = PreparedFrames(task)
        self._shares = [counts / counts.sum() for counts in frames]

    def draw(self, rng: np.random.Generator) -> Clip:
        """Draw a clip."""
        group = int(rng.integers(len(self._groups)))
        shares = self._shares[group]
        return self._groups[group][int(rng.choice(len(shares), p=shares))]

    def make(self, index: int) -> TrainingSample:
        """Make a sample, a function of seed and index alone."""
        config, task = self._config, self._task
        rng = np.random.default_rng([config.seed, index])
        clip = self.draw(rng)
        choices = draw_choices(config.augmentation, rng)
        if task.learning.whole is not None:
            return self._crop_whole_frame(index, clip, choices, task.learning.whole, rng)
        region = draw_region(
            clip,
            self._crop,
            block=choose_block(clip, task),
            unroll=task.learning.unroll,
            rng=rng,
        )
        jitter, phase = draw_jitter(task.jitter, rng)
        choices = replace(choices, jitter=jitter, phase=phase)
        # drawn last: samples of runs without such are what they were
        if rng.random() < config.augmentation.still_share and not clip.facts.lr_scale:
            clip = self._hold(clip, region.position)
        key = (id(clip), region, jitter)
        comes_again = replace(choices, jitter=UNCHANGED.jitter) == UNCHANGED
        goals = self._goals.get(key) if comes_again else None
        steps = build_steps(clip, region, choices, task, goals)
        if task.learning.keep_goals and comes_again:
            self._goals[key] = [step.goal for step in steps]
        return TrainingSample(index, clip, region, choices, steps)

    def _hold(self, clip: Clip, position: int) -> Clip:
        """A clip of one frame, made once: what is measured of it is kept with it."""
        key = (id(clip), position)
        if key not in self._held:
            self._held[key] = hold_frame(clip, position)
        return self._held[key]

    def _crop_whole_frame(
        self,
        index: int,
        clip: Clip,
        choices: SampleChoices,
        whole: WholeFrames,
        rng: np.random.Generator,
    ) -> TrainingSample:
        """Make a sample of a frame that was prepared as a whole."""
        position = int(rng.choice(clip.target_positions))
        made = self._prepared.prepare(clip, position)
        sought = made.inputs[whole.sought]
        region = draw_crop(sought, position, self._crop, rng)
        step = crop_prepared(made, region, whole=whole, choices=choices, task=self._task, rng=rng)
        return TrainingSample(index, clip, region, choices, [step])

    def batches(
        self, first_step: int, workers: int, *, overlap: bool
    ) -> Iterator[list[TrainingSample]]:
        """Samples of one forward pass after the other, from an optimiser step on.

        Args:
            first_step: optimiser steps that are done.
            workers: threads.
            overlap: make samples while the caller computes; on a processor that computes itself,
                threads that wait for each other would stall both.
        """
        config = self._config
        passes = config.steps * config.accumulate
        starts = range(first_step * config.accumulate, passes)
        if overlap:
            indices = (i for p in starts for i in self._indices(p))
            made = prefetch(self.make, indices, workers, ahead=AHEAD_BATCHES * config.batch)
            for _ in starts:
                yield [future.result() for _, future in islice(made, config.batch)]
            return
        with worker_pool(workers, "rtsr-sample") as pool:
            for number in starts:
                yield list(pool.map(self.make, self._indices(number)))

    def _indices(self, number: int) -> range:
        """Samples of this process in a forward pass; those of all processes are successive."""
        first = (number * self._ranks.count + self._ranks.rank) * self._config.batch
        return range(first, first + self._config.batch)


def choose_crop(clips: Sequence[Clip], task: SampleTask, config: TrainingConfig) -> Size:
    """(height, width) of samples in LR pixels: what all clips hold, so that a batch is of one size.

    Quarter turns exchange height and width: samples that may be turned are square. A batch of one
    is of the size that its clip has.
    """
    sizes = [_lr_size(clip, task) for clip in clips if not clip.facts.validation]
    if config.batch == 1 or not sizes:
        return config.crop, config.crop
    height, width = (min(config.crop, *extents) for extents in zip(*sizes, strict=True))
    side = min(height, width)
    return (side, side) if config.augmentation.turns else (height, width)


def describe_crop(clips: Sequence[Clip], task: SampleTask, config: TrainingConfig) -> str:
    """Say that samples are smaller than a crop is asked to be; empty if none is."""
    chosen = choose_crop(clips, task, config)
    sizes = {
        tuple(min(pair) for pair in zip(chosen, _lr_size(clip, task), strict=True))
        for clip in clips
        if not clip.facts.validation
    }
    if sizes <= {(config.crop, config.crop)}:
        return ""
    listed = " or ".join(f"{w * task.scale} x {h * task.scale}" for h, w in sorted(sizes))
    return f"crops shrink to {listed} pixels, as the frames are smaller than training.crop"


def _lr_size(clip: Clip, task: SampleTask) -> Size:
    """(height, width) of a clip in LR pixels."""
    block = choose_block(clip, task)
    height, width = clip.size
    return height // block, width // block
