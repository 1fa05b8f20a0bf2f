"""Folders of DATA as clips; apart, because it needs the libraries that read frames."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path

from rtsr_cli.core.files.atomic_write import check_writable
from rtsr_cli.core.pairs.opening import ReadOptions
from rtsr_cli.core.training.clip_recording import list_recorded_inputs
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import DataConfig
from rtsr_cli.core.training.data_folders import (
    ClipSources,
    choose_shots,
    gather_clips,
    record_clips,
)
from rtsr_cli.core.training.events import DataRemark
from rtsr_cli.core.training.ranks import ProcessRanks
from rtsr_cli.core.training.request import TrainRequest
from rtsr_cli.core.training.samples import SampleTask

CACHE_FOLDER = "cache"


def record_folders(
    folders: Sequence[Path],
    request: TrainRequest,
    task: SampleTask,
    data: DataConfig,
    ranks: ProcessRanks,
) -> Generator[DataRemark, None, list[Clip]]:
    """Record what was not recorded before, each process its share of shots, and open it all.

    Raises:
        RtsrError: a folder, file or declaration is wrong, or nothing can be written.
    """
    cache = request.cache_folder or request.output_folder / CACHE_FOLDER
    check_writable(cache)
    how = ClipSources(
        wanted=list_recorded_inputs(task.system, task.config, task.scale),
        samples_per_pixel=task.samples_per_pixel,
        cache=cache,
        options=ReadOptions(
            layout=request.layout,
            layer=request.layer,
            view=request.view,
            capture=request.capture_file,
            on_missing=request.on_missing,
        ),
        policy=request.on_nonfinite,
        data=data,
        overwrite=request.overwrite,
    )
    if ranks.count > 1:
        for number, shot in enumerate(choose_shots(folders, how)):
            if ranks.share(number):
                for text in record_clips(shot, how):
                    yield DataRemark(text=text)
        ranks.wait()
    gathered = gather_clips(folders, how)
    while True:
        try:
            yield DataRemark(text=next(gathered))
        except StopIteration as end:
            clips: list[Clip] = end.value
            return clips
