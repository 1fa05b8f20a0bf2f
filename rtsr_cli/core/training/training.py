"""Training a system's network: settings, clips, the loop, and what it leaves behind."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Sequence
from itertools import zip_longest
from typing import TypeVar

import torch
from torch import nn

from rtsr_cli.core.devices import resolve_device
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.files.atomic_write import (
    check_writable,
    remove_leftovers,
    write_text_atomically,
)
from rtsr_cli.core.marks import TOML_MARK_LINE
from rtsr_cli.core.memory import keep_freed
from rtsr_cli.core.settings import to_toml
from rtsr_cli.core.system import System
from rtsr_cli.core.training import trainer
from rtsr_cli.core.training.checkpoints import WeightsWriter, make_network
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.dataset import gather_clips
from rtsr_cli.core.training.events import (
    BaselineJudged,
    ClipsPacked,
    CropsShrunk,
    TrainEvent,
    TrainingDone,
    TrainingPlanned,
    TrainingStarted,
    TrainingStep,
)
from rtsr_cli.core.training.journal import PICTURES_FOLDER, Journal
from rtsr_cli.core.training.packs import pack_crops
from rtsr_cli.core.training.ranks import ProcessRanks, join_processes, resolve_local_device
from rtsr_cli.core.training.request import TrainRequest
from rtsr_cli.core.training.run_files import refuse_foreign_files
from rtsr_cli.core.training.run_settings import CONFIG_FILE, RunSettings, resolve_request
from rtsr_cli.core.training.sampler import describe_crop
from rtsr_cli.core.training.samples import SampleTask, make_task
from rtsr_cli.core.training.saved_state import read_saved_step
from rtsr_cli.core.training.trainer import STATE_FOLDER, TrainingProgress, TrainingRun
from rtsr_cli.core.training.validation import (
    JudgedSample,
    average_scores,
    choose_judge,
    choose_validation_frames,
    draw_panels,
    judge_network,
)

MOST_WORKERS = 8
"""Threads that make samples, unless data.workers says more."""

E = TypeVar("E")
R = TypeVar("R")


def train(
    request: TrainRequest, system: System, baseline: Callable[[], System]
) -> Iterator[TrainEvent]:
    """Train, or pack crops; the last event is `TrainingDone` or `ClipsPacked`.

    A dry run ends with the plan. Of several processes (torchrun) the first alone writes and
    reports.

    Args:
        request: what is asked for.
        system: the one that it names.
        baseline: loads what is shown beside the network.

    Raises:
        RtsrError: a setting, an input or the weights to start from are refused, a loss is not
            finite, or nothing can be written.
    """
    if system.learning is None:
        raise RequestError(f"system '{system.name}' has nothing to train")
    refuse_foreign_files(request)
    settings = resolve_request(system, request)
    training = settings.training
    task = make_task(system, settings.network, training)
    yield TrainingPlanned(settings=settings.plain)
    if request.dry_run:
        return
    # before frames are decoded: weights that do not fit are told at once
    network = make_network(task, training, request.init_file)
    device = torch.device(resolve_local_device(resolve_device(request.device)))
    with join_processes(device) as ranks:
        clips = yield from _collect_reports(
            gather_clips(request, task, settings.data, ranks), ranks
        )
        if request.pack_file is not None:
            count = pack_crops(request.pack_file, clips, task, training, crops=request.pack_crops)
            if ranks.first:
                yield ClipsPacked(path=request.pack_file, count=count)
            return
        run = _prepare_run(request, settings, task, clips, device=device, ranks=ranks)
        keep_freed()
        if ranks.first:
            yield from _lead_processes(run, network, baseline())
        else:
            yield from _follow_lead(run, network)


def _collect_reports(events: Generator[E, None, R], ranks: ProcessRanks) -> Generator[E, None, R]:
    """Let the first process' events through."""
    while True:
        try:
            event = next(events)
        except StopIteration as end:
            result: R = end.value
            return result
        if ranks.first:
            yield event


def _prepare_run(
    request: TrainRequest,
    settings: RunSettings,
    task: SampleTask,
    clips: Sequence[Clip],
    *,
    device: torch.device,
    ranks: ProcessRanks,
) -> TrainingRun:
    """Make the folder of a run, and put its settings there."""
    folder, plain = request.output_folder, settings.plain
    if ranks.first:
        check_writable(folder)
        for below in (STATE_FOLDER, PICTURES_FOLDER):
            remove_leftovers(folder / below)
        write_text_atomically(folder / CONFIG_FILE, TOML_MARK_LINE + to_toml(plain))
    return TrainingRun(
        folder=folder,
        task=task,
        config=settings.training,
        clips=clips,
        device=device,
        workers=settings.data.workers or max(1, min(MOST_WORKERS, os.cpu_count() or 1)),
        keep=WeightsWriter(folder, task.system, plain, clips).write,
        ranks=ranks,
    )


def _follow_lead(run: TrainingRun, network: nn.Module) -> Iterator[TrainEvent]:
    """Do the work of a process that is not the first, silently."""
    step = read_saved_step(run.folder / STATE_FOLDER)
    yield TrainingStarted(step=step, steps=run.config.steps, reports=False)
    for _ in trainer.train(run, network):
        pass


def _lead_processes(run: TrainingRun, network: nn.Module, baseline: System) -> Iterator[TrainEvent]:
    """Run the loop; log and draw what it reports."""
    config, task = run.config, run.task
    warning = describe_crop(run.clips, task, config)
    if warning:
        yield CropsShrunk(message=warning)
    frames = choose_validation_frames(run.clips, config.validation_frames)
    enlarged = judge_baseline(baseline, task, frames)
    if enlarged:
        yield BaselineJudged(name=baseline.name, scores=average_scores(enlarged))
    start = read_saved_step(run.folder / STATE_FOLDER)
    yield TrainingStarted(step=start, steps=config.steps)
    names = choose_judge(task).names
    journal = Journal(run.folder, resume_step=start or None, score=names[0])
    for progress in trainer.train(run, network):
        values = make_journal_row(progress, names)
        journal.log(progress.step, values)
        draw_pictures(journal, progress, enlarged, config.picture_side)
        yield TrainingStep(progress=progress, values=values, steps=config.steps)
    journal.close()
    yield TrainingDone(folder=run.folder, steps=config.steps)


def judge_baseline(
    system: System, task: SampleTask, frames: Sequence[tuple[Clip, int]]
) -> list[JudgedSample]:
    """Judge an untrained system on the frames that validation uses, if it can run on them."""
    if set(system.lr_inputs) - set(task.system.lr_inputs):
        return []
    if set(system.hr_inputs) - set(task.system.hr_inputs):
        return []
    network = system.build(system.config(), task.scale)
    return list(judge_network(system, network, task, frames))


def make_journal_row(progress: TrainingProgress, names: Sequence[str]) -> dict[str, float | None]:
    """What log.csv says of a step; scores are None where nothing was judged."""
    scores = {name: progress.scores.get(name) for name in names}
    rates = {"learning_rate": progress.learning_rate, "steps_per_s": progress.steps_per_second}
    return {"loss": progress.losses["loss"], **progress.losses, **scores, **rates}


def draw_pictures(
    journal: Journal, progress: TrainingProgress, enlarged: Sequence[JudgedSample], side: int
) -> None:
    """Draw the judged frames, each beside the baseline's."""
    for frame, other in zip_longest(progress.frames, enlarged[: len(progress.frames)]):
        name = f"{frame.clip.facts.name}-{frame.clip.facts.numbers[frame.position]}"
        journal.picture(progress.step, name.replace("/", "-"), draw_panels(frame, other, side))
