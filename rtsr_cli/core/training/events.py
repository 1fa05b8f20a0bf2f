"""What a training says while it goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtsr_cli.core.training.trainer import TrainingProgress


@dataclass(frozen=True, kw_only=True)
class TrainingPlanned:
    """The settings are resolved.

    Attributes:
        settings: every one, as config.toml holds them.
    """

    settings: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class DataRemark:
    """Something about the data: what is being recorded, what measurement contradicts.

    Attributes:
        text: a line for a person.
    """

    text: str


@dataclass(frozen=True, kw_only=True)
class ClipsGathered:
    """Everything to train and judge on is there.

    Attributes:
        frames: how many are trained on.
        shots: of how many shots they are.
        validation_frames: how many are judged.
        held_out: False if those are frames that are trained on, as no shot is held out.
    """

    frames: int
    shots: int
    validation_frames: int
    held_out: bool


@dataclass(frozen=True, kw_only=True)
class ClipsPacked:
    """A file of packed crops is written; the last event of a packing.

    Attributes:
        path: of the file.
        count: clips in it.
    """

    path: Path
    count: int


@dataclass(frozen=True, kw_only=True)
class CropsShrunk:
    """Frames are smaller than a crop.

    Attributes:
        message: to what size crops shrink.
    """

    message: str


@dataclass(frozen=True, kw_only=True)
class BaselineJudged:
    """What the network has to beat.

    Attributes:
        name: of the untrained system.
        scores: its means over the frames of the validation.
    """

    name: str
    scores: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class TrainingStarted:
    """The loop begins; from here on files of the run are written.

    Attributes:
        step: steps that were done before.
        steps: of the whole run.
        reports: False in the processes of a distributed run that only compute; they yield nothing
            more.
    """

    step: int
    steps: int
    reports: bool = True


@dataclass(frozen=True, kw_only=True)
class TrainingStep:
    """What is told after some steps.

    Attributes:
        progress: of the loop.
        values: the row of log.csv; scores are None where nothing was judged.
        steps: of the whole run.
    """

    progress: TrainingProgress
    values: Mapping[str, float | None]
    steps: int


@dataclass(frozen=True, kw_only=True)
class TrainingDone:
    """The summary of a run.

    Attributes:
        folder: RUN.
        steps: steps that are done.
    """

    folder: Path
    steps: int


DataEvent = DataRemark | ClipsGathered

TrainEvent = (
    TrainingPlanned
    | DataEvent
    | ClipsPacked
    | CropsShrunk
    | BaselineJudged
    | TrainingStarted
    | TrainingStep
    | TrainingDone
)
