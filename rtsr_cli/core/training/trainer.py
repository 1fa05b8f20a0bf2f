"""The training loop: one, for every system that declares how it learns."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from rtsr_cli.core.errors import CheckpointError, TrainingError
from rtsr_cli.core.network.precision import DTYPES, resolve_precision
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import Optimiser, Schedule, TrainingConfig
from rtsr_cli.core.training.ranks import ALONE, ProcessRanks
from rtsr_cli.core.training.sample_steps import move_step, stack_samples
from rtsr_cli.core.training.sampler import SampleDrawer, TrainingSample
from rtsr_cli.core.training.samples import SampleTask
from rtsr_cli.core.training.saved_state import (
    copy_weights,
    list_optimiser_tensors,
    load_state,
    restore_optimiser,
    save_state,
    take_average,
    update_average,
)
from rtsr_cli.core.training.validation import (
    JudgedSample,
    average_scores,
    choose_judge,
    choose_validation_frames,
    judge_network,
)

STATE_FOLDER = "state"

BEST_FILE, LAST_FILE = "best.safetensors", "last.safetensors"
"""Weights: of the best validation, and of the last step that was saved."""

EMA_RAMP = 10.0
"""The moving average forgets the first steps: decay = min(decay, (1 + n) / (10 + n))."""


@dataclass(frozen=True, kw_only=True)
class TrainingProgress:
    """What is told after some steps.

    Attributes:
        step: steps done.
        losses: mean of each term since the last report, and their sum as `loss`.
        learning_rate: of the last step.
        steps_per_second: since the last report.
        scores: of the validation, if there was one.
        best: True if it was the best so far.
        frames: judged frames, if there was a validation.
    """

    step: int
    losses: Mapping[str, float]
    learning_rate: float
    steps_per_second: float
    scores: Mapping[str, float] = field(default_factory=dict)
    best: bool = False
    frames: Sequence[JudgedSample] = ()


@dataclass(frozen=True, kw_only=True)
class TrainingRun:
    """A training run.

    Attributes:
        folder: RUN.
        task: system, config, scale.
        config: how it is trained.
        clips: training and validation clips.
        device: torch device.
        workers: threads that make samples.
        keep: writes weights: (file name, tensors, step, scores).
        ranks: the processes that train together; the first alone writes and validates.
    """

    folder: Path
    task: SampleTask
    config: TrainingConfig
    clips: Sequence[Clip]
    device: torch.device
    workers: int
    keep: Callable[[str, Mapping[str, Tensor], int, Mapping[str, float]], None]
    ranks: ProcessRanks = ALONE


def scheduled_rate(config: TrainingConfig, step: int) -> float:
    """Rate of a step: a linear warm-up, then the schedule.

    cosine: r (f + (1 - f) (1 + cos(pi t)) / 2),   t = share of the steps after the warm-up
    exponential: r (1 - d)^n,   n = steps after the warm-up
    """
    if step < config.warmup:
        return config.learning_rate * (step + 1) / config.warmup
    share = (step - config.warmup) / max(1, config.steps - config.warmup)
    if config.schedule is Schedule.COSINE:
        wave = 0.5 * (1.0 + math.cos(math.pi * min(1.0, share)))
        return config.learning_rate * (config.final_rate + (1.0 - config.final_rate) * wave)
    if config.schedule is Schedule.EXPONENTIAL:
        return config.learning_rate * (1.0 - config.decay) ** (step - config.warmup)
    if config.schedule is Schedule.HALVE and step >= config.steps // 2:
        return config.learning_rate / 2.0
    return config.learning_rate


def make_optimiser(config: TrainingConfig, network: nn.Module) -> torch.optim.Optimizer:
    """Adam, AdamW or RMSprop with torch's defaults."""
    if config.optimiser is Optimiser.ADAMW:
        return torch.optim.AdamW(
            network.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
    if config.optimiser is Optimiser.RMSPROP:
        return torch.optim.RMSprop(
            network.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
    return torch.optim.Adam(network.parameters(), config.learning_rate)


def freeze_statistics(network: nn.Module) -> None:
    """Let batch norms use their running statistics, and keep them; their weights still learn."""
    for module in network.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):
            module.eval()


class Trainer:
    """Everything that changes from step to step."""

    def __init__(self, run: TrainingRun, network: nn.Module) -> None:
        """Take a network with its first weights."""
        config = run.config
        self.run = run
        self.layout = torch.channels_last if config.channels_last else torch.preserve_format
        # torch moves modules with four-dimensional parameters only; buffers of others stay
        self.network = network.to(run.device, memory_format=self.layout)  # type: ignore[call-overload]
        self.optimiser = make_optimiser(config, self.network)
        self.average = copy_weights(self.network) if config.ema else {}
        self.dtype = DTYPES.get(resolve_precision(config.precision, run.device))
        self.scaler = torch.amp.GradScaler(run.device.type, enabled=self.dtype is torch.float16)
        self.step = 0
        self.best = -math.inf
        self.compiled = torch.compile(self.network) if config.compile else self.network

    @property
    def kept(self) -> Mapping[str, Tensor]:
        """Weights that are validated and kept."""
        return self.average or self.network.state_dict()

    def save(self) -> None:
        """Write the state."""
        parts: dict[str, Mapping[str, Tensor]] = {
            "network": self.network.state_dict(),
            "optimiser": list_optimiser_tensors(self.optimiser),
            "random": {"torch": torch.get_rng_state()},
        }
        if self.average:
            parts["average"] = self.average
        facts: dict[str, Any] = {"best": self.best if math.isfinite(self.best) else None}
        if self.scaler.is_enabled():
            facts["scaler"] = self.scaler.state_dict()
        save_state(self.run.folder / STATE_FOLDER, self.step, parts, facts)

    def resume(self) -> bool:
        """Go on from a state on disk, if there is one.

        Raises:
            CheckpointError: the state is another network's.
        """
        state = load_state(self.run.folder / STATE_FOLDER)
        if state is None:
            return False
        parts, facts = state
        try:
            self._restore(parts, facts)
        except (RuntimeError, KeyError, TypeError, ValueError) as error:
            raise CheckpointError(
                f"{self.run.folder}: holds the state of another network, or a damaged one; choose "
                "another --out"
            ) from error
        return True

    def _restore(self, parts: Mapping[str, Mapping[str, Tensor]], facts: Mapping[str, Any]) -> None:
        """Take over a state; what does not fit ends in an error of torch's, or of Python's."""
        self.network.load_state_dict(dict(parts["network"]))
        restore_optimiser(self.optimiser, parts.get("optimiser", {}))
        if self.average:
            self.average = take_average(parts["average"], self.average, self.run.device)
        torch.set_rng_state(parts["random"]["torch"])
        if self.scaler.is_enabled() and "scaler" in facts:
            self.scaler.load_state_dict(facts["scaler"])
        self.step = int(facts["step"])
        self.best = -math.inf if facts["best"] is None else float(facts["best"])

    def cast(self) -> AbstractContextManager[Any]:
        """Autocast of the run's precision."""
        return torch.autocast(self.run.device.type, self.dtype, enabled=self.dtype is not None)

    def losses_of(self, samples: Sequence[TrainingSample]) -> dict[str, Tensor]:
        """Terms of a batch of unrolled samples: state is carried, each step's terms are summed."""
        task = self.run.task
        batch = stack_samples([sample.steps for sample in samples])
        steps = [move_step(step, self.run.device, self.layout) for step in batch]
        state, totals = None, dict[str, Tensor]()
        for step in steps:
            with self.cast():
                outputs, state = self.compiled(step.inputs, state)
            terms = task.learning.loss(task.config, step.inputs, outputs, step.goal)
            for name, value in terms.items():
                totals[name] = totals[name] + value if name in totals else value
        return totals

    def advance(self, batches: Sequence[Sequence[TrainingSample]]) -> dict[str, float]:
        """Take one optimiser step over the batches of an accumulation.

        Raises:
            TrainingError: a loss is not finite; names the samples, the state is saved.
        """
        run, config = self.run, self.run.config
        self.network.train()
        if self.step >= config.freeze_statistics * config.steps:
            freeze_statistics(self.network)
        for group in self.optimiser.param_groups:
            group["lr"] = scheduled_rate(config, self.step)
        self.optimiser.zero_grad(set_to_none=True)
        sums: dict[str, float] = {}
        for batch in batches:
            terms = self.losses_of(batch)
            total = torch.stack(list(terms.values())).sum()
            lost = not bool(torch.isfinite(total))
            if run.ranks.any(lost, run.device):
                raise self._not_finite(batch if lost else [])
            scaled = self.scaler.scale(total / len(batches))
            torch.autograd.backward(scaled)
            for name, value in (*terms.items(), ("loss", total)):
                sums[name] = sums.get(name, 0.0) + float(value.detach()) / len(batches)
        run.ranks.average_gradients(self.network)
        if config.clip_norm:
            self.scaler.unscale_(self.optimiser)
            nn.utils.clip_grad_norm_(self.network.parameters(), config.clip_norm)
        self.scaler.step(self.optimiser)
        self.scaler.update()
        run.ranks.average_buffers(self.network)
        self.step += 1
        if self.average:
            ramp = (1.0 + self.step) / (EMA_RAMP + self.step)
            update_average(self.average, self.network, min(config.ema, ramp))
        return dict(zip(sums, run.ranks.mean(sums.values(), run.device), strict=True))

    def _not_finite(self, batch: Sequence[TrainingSample]) -> TrainingError:
        """Save what there is, and find out which samples are to blame."""
        if self.run.ranks.first:
            self.save()
        guilty = [s.where for s in batch if not self._finite(s)] or [s.where for s in batch]
        if not guilty:
            return TrainingError(f"step {self.step + 1}: the loss of another process is not finite")
        return TrainingError(
            f"step {self.step + 1}: the loss is not finite. {'; '.join(guilty)}. The state before "
            "this step is saved: render the frame again or exclude its shot, or lower "
            "training.learning_rate, and run the same command"
        )

    def _finite(self, sample: TrainingSample) -> bool:
        with torch.no_grad():
            terms = self.losses_of([sample])
        return all(bool(torch.isfinite(value)) for value in terms.values())

    def validate(self) -> tuple[list[JudgedSample], dict[str, float]]:
        """Judge the kept weights on whole frames."""
        run, task = self.run, self.run.task
        frames = choose_validation_frames(run.clips, run.config.validation_frames)
        if not frames:
            return [], {}
        trained = copy_weights(self.network) if self.average else {}
        if trained:
            self.network.load_state_dict(dict(self.average))
        self.network.eval()
        judged_frames = list(judge_network(task.system, self.network, task, frames))
        if trained:
            self.network.load_state_dict(trained)
        return judged_frames, average_scores(judged_frames)


def train(run: TrainingRun, network: nn.Module) -> Iterator[TrainingProgress]:
    """Train, from the state in RUN if there is one; yields reports, the last one at the end.

    What a report tells is written before the state is: a run that is killed between the two makes
    the same steps and the same report again, and loses none.

    Raises:
        TrainingError: a loss is not finite.
        RtsrError: something cannot be read or written.
    """
    trainer = Trainer(run, network)
    trainer.resume()
    config = run.config
    sampler = SampleDrawer(run.clips, run.task, config, run.ranks)
    told = _ProgressMeans(trainer.step)
    passes: list[list[TrainingSample]] = []
    for batch in sampler.batches(trainer.step, run.workers, overlap=run.device.type != "cpu"):
        passes.append(batch)
        if len(passes) < config.accumulate:
            continue
        told.add(trainer.advance(passes))
        passes = []
        if not run.ranks.first:
            continue
        step, last = trainer.step, trainer.step == config.steps
        if last or step % config.validate_every == 0:
            frames, scores = trainer.validate()
            score = scores.get(choose_judge(run.task).names[0], -math.inf)
            best = score > trainer.best
            trainer.best = max(trainer.best, score)
            if best or not scores:
                run.keep(BEST_FILE, trainer.kept, step, scores)
            run.keep(LAST_FILE, trainer.kept, step, scores)
            yield replace(told.report(trainer), scores=scores, best=best, frames=frames)
            trainer.save()
        elif step % config.save_every == 0:
            run.keep(LAST_FILE, trainer.kept, step, {})
            yield told.report(trainer)
            trainer.save()
        elif step % config.log_every == 0:
            yield told.report(trainer)


class _ProgressMeans:
    """Means since the last report."""

    def __init__(self, step: int) -> None:
        self._sums: dict[str, float] = {}
        self._count, self._since, self._step = 0, time.perf_counter(), step

    def add(self, losses: Mapping[str, float]) -> None:
        for name, value in losses.items():
            self._sums[name] = self._sums.get(name, 0.0) + value
        self._count += 1

    def report(self, trainer: Trainer) -> TrainingProgress:
        now = time.perf_counter()
        progress = TrainingProgress(
            step=trainer.step,
            losses={name: total / max(1, self._count) for name, total in self._sums.items()},
            learning_rate=scheduled_rate(trainer.run.config, trainer.step - 1),
            steps_per_second=(trainer.step - self._step) / max(1e-9, now - self._since),
        )
        self._sums, self._count, self._since, self._step = {}, 0, now, trainer.step
        return progress
