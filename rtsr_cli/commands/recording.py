"""Folders of DATA as clips; apart, because it needs the libraries that read EXR files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rtsr_cli.commands.basics import LOG
from rtsr_cli.core.choices import MissingPolicy, NonfinitePolicy
from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.io.opening import ReadOptions
from rtsr_cli.core.learning.clips import Clip
from rtsr_cli.core.learning.config import DataConfig
from rtsr_cli.core.learning.crops import Task
from rtsr_cli.core.learning.gathering import Gathering, chosen_shots, gather, recorded_clips
from rtsr_cli.core.learning.ranks import Ranks
from rtsr_cli.core.learning.recording import wanted_by

CACHE_FOLDER = "cache"


def recorded(
    folders: Sequence[Path],
    chosen: Mapping[str, Any],
    task: Task,
    data: DataConfig,
    ranks: Ranks,
) -> list[Clip]:
    """Record what was not recorded before, each process its share of shots, and open it all."""
    beside = chosen["out_folder"] or chosen["pack_file"].parent
    cache = chosen["cache_folder"] or beside / CACHE_FOLDER
    check_writable(cache)
    how = Gathering(
        wanted=wanted_by(task.system, task.config, task.scale),
        samples_per_pixel=task.samples_per_pixel,
        cache=cache,
        options=ReadOptions(
            layout=chosen["layout"],
            capture=chosen["capture_file"],
            on_missing=MissingPolicy(chosen["on_missing"]),
        ),
        policy=NonfinitePolicy(chosen["on_nonfinite"]),
        data=data,
        said=LOG.info,
    )
    if ranks.count > 1:
        for number, shot in enumerate(chosen_shots(folders, how)):
            if ranks.share(number):
                recorded_clips(shot, how)
        ranks.wait()
    return gather(folders, how)
