"""What `rtsr train` says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack

from tqdm import tqdm

from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.core.settings import to_toml
from rtsr_cli.core.training.events import (
    BaselineJudged,
    ClipsGathered,
    ClipsPacked,
    CropsShrunk,
    DataRemark,
    TrainEvent,
    TrainingDone,
    TrainingPlanned,
    TrainingStarted,
    TrainingStep,
)
from rtsr_cli.core.wording import say_count

UNITS = {"psnr": " dB"}


def show_training(events: Iterable[TrainEvent], *, dry_run: bool, as_json: bool) -> int:
    """Print what a training says; return the exit code.

    Args:
        events: of the training.
        dry_run: print every setting.
        as_json: print the events of steps in place of text.
    """
    bar = tqdm(disable=True)
    with ExitStack() as run:
        for event in events:
            match event:
                case TrainingPlanned():
                    if dry_run:
                        for line in to_toml(event.settings).split("\n"):
                            LOG.info("%s", line)
                case TrainingStarted():
                    run.enter_context(unwind_on_signals())
                    bar = run.enter_context(_begin(event))
                case TrainingStep():
                    show_step(event, bar, as_json=as_json)
                case TrainingDone():
                    bar.close()
                    LOG.info("%s: %d steps done", event.folder, event.steps)
                case _:
                    log_preparation(event)
    return 0


def _begin(started: TrainingStarted) -> tqdm:
    """Say where the loop begins, and show a bar of its steps; one process of several does."""
    if not started.reports:
        return tqdm(disable=True)
    if started.step:
        LOG.info("going on after step %d", started.step)
    return tqdm(total=started.steps, initial=started.step, unit="step", disable=None)


def log_preparation(
    event: DataRemark | ClipsGathered | ClipsPacked | CropsShrunk | BaselineJudged,
) -> None:
    """Say what is there to train on."""
    match event:
        case DataRemark():
            LOG.info("%s", event.text)
        case ClipsGathered():
            log_clips(event)
        case ClipsPacked():
            LOG.info("%s: %d clips packed", event.path, event.count)
        case CropsShrunk():
            LOG.warning("Warning: %s", event.message)
        case BaselineJudged():
            LOG.info("%s: %s", event.name, _format_scores(event.scores))


def log_clips(gathered: ClipsGathered) -> None:
    """Say how much is trained and judged on."""
    if not gathered.held_out:
        LOG.warning(
            "Warning: no shot is held out, so validation is on training frames and will look too "
            "good"
        )
    LOG.info(
        "%s of %s to train on, %d to validate",
        say_count(gathered.frames, "frame"),
        say_count(gathered.shots, "shot"),
        gathered.validation_frames,
    )


def show_step(event: TrainingStep, bar: tqdm, *, as_json: bool) -> None:
    """Say what is told after some steps; a person is told of validations only."""
    progress = event.progress
    bar.update(progress.step - bar.n)
    bar.set_postfix(loss=f"{progress.losses['loss']:.4f}")
    if as_json:
        known = {name: value for name, value in event.values.items() if value is not None}
        emit({"event": "step", "step": progress.step, **known, "best": progress.best})
    elif progress.scores:
        LOG.info(
            "step %d of %d: loss %.4f, %.2f steps/s, %s%s",
            progress.step,
            event.steps,
            progress.losses["loss"],
            progress.steps_per_second,
            _format_scores(progress.scores),
            ", best so far" if progress.best else "",
        )


def _format_scores(scores: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4f}{UNITS.get(name, '')}" for name, value in scores.items())
