"""Clips of everything that DATA names: packs as they are, folders recorded."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import is_file, is_folder
from rtsr_cli.core.training.clips import SUFFIX, Clip, count_frames, read_clips
from rtsr_cli.core.training.config import DataConfig
from rtsr_cli.core.training.events import ClipsGathered, DataEvent
from rtsr_cli.core.training.ranks import ProcessRanks
from rtsr_cli.core.training.request import TrainRequest
from rtsr_cli.core.training.samples import SampleTask, leave_out_starts


def gather_clips(
    request: TrainRequest, task: SampleTask, data: DataConfig, ranks: ProcessRanks
) -> Generator[DataEvent, None, list[Clip]]:
    """Return the clips of every DATA, some of them for validation.

    Raises:
        RtsrError: a folder, pack or declaration is wrong.
    """
    clips: list[Clip] = []
    folders = []
    for path in request.data:
        if path.suffix == SUFFIX or is_file(path):
            clips += read_clips(path)[0]
        elif not is_folder(path):
            raise FrameFolderError(f"{path}: no such folder")
        else:
            folders.append(path)
    if folders:
        # packs are trained on where no library that reads frames is installed
        from rtsr_cli.core.training.folders import record_folders

        clips += yield from record_folders(folders, request, task, data, ranks)
    clips = leave_out_starts(clips, task)
    held_out = count_frames(c for c in clips if c.facts.validation) > 0
    if not held_out:
        clips += validate_as_trained(clips)
    learnt = [clip for clip in clips if not clip.facts.validation]
    yield ClipsGathered(
        frames=count_frames(learnt),
        shots=len({clip.facts.name for clip in learnt}),
        validation_frames=count_frames(c for c in clips if c.facts.validation),
        held_out=held_out,
    )
    return clips


def validate_as_trained(clips: Sequence[Clip]) -> list[Clip]:
    """Frames to judge where none is held out: those that are trained on."""
    return [replace(clip, facts=replace(clip.facts, validation=True)) for clip in clips]
