"""Folders of DATA as clips; apart, because it needs the libraries that read frames."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from pathlib import Path

from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.io.opening import ReadOptions
from rtsr_cli.core.learning.clips import Clip
from rtsr_cli.core.learning.config import DataConfig
from rtsr_cli.core.learning.crops import Task
from rtsr_cli.core.learning.gathering import Gathering, chosen_shots, gather, recorded_clips
from rtsr_cli.core.learning.ranks import Ranks
from rtsr_cli.core.learning.recording import wanted_by
from rtsr_cli.core.training.events import DataRemark
from rtsr_cli.core.training.request import TrainRequest

CACHE_FOLDER = "cache"


def record_folders(
    folders: Sequence[Path], request: TrainRequest, task: Task, data: DataConfig, ranks: Ranks
) -> Generator[DataRemark, None, list[Clip]]:
    """Record what was not recorded before, each process its share of shots, and open it all.

    Raises:
        RtsrError: a folder, file or declaration is wrong, or nothing can be written.
    """
    cache = request.cache_folder or request.output_folder / CACHE_FOLDER
    check_writable(cache)
    how = Gathering(
        wanted=wanted_by(task.system, task.config, task.scale),
        samples_per_pixel=task.samples_per_pixel,
        cache=cache,
        options=ReadOptions(
            layout=request.layout, capture=request.capture_file, on_missing=request.on_missing
        ),
        policy=request.on_nonfinite,
        data=data,
    )
    if ranks.count > 1:
        for number, shot in enumerate(chosen_shots(folders, how)):
            if ranks.share(number):
                for text in recorded_clips(shot, how):
                    yield DataRemark(text=text)
        ranks.wait()
    gathered = gather(folders, how)
    while True:
        try:
            yield DataRemark(text=next(gathered))
        except StopIteration as end:
            clips: list[Clip] = end.value
            return clips
