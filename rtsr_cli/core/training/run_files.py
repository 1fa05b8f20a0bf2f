"""The files of a training run, and whose they are: what rtsr did not write itself is in the way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rtsr_cli.core.cards.card import place_card
from rtsr_cli.core.files.ownership import is_own, is_own_tensors, list_foreign, refuse_foreign
from rtsr_cli.core.training.journal import (
    CURVES_FILE,
    LOG_FILE,
    PICTURE_FILES,
    PICTURES_FOLDER,
    is_log,
)
from rtsr_cli.core.training.request import TrainRequest
from rtsr_cli.core.training.run_settings import CONFIG_FILE
from rtsr_cli.core.training.saved_state import STATE_FILE, TENSOR_FILES
from rtsr_cli.core.training.trainer import BEST_FILE, LAST_FILE, STATE_FOLDER


def refuse_foreign_files(request: TrainRequest) -> None:
    """Raise before anything is read if a file is in the way that no training wrote.

    Raises:
        OutputError: names the first and counts them.
    """
    if request.overwrite:
        return
    if request.pack_file is not None:
        refuse_foreign(list_foreign([request.pack_file], is_own_tensors), "rtsr train --pack")
        return
    refuse_foreign(list_foreign(_list_files(request.output_folder), _is_of_run), "rtsr train")


def _list_files(folder: Path) -> Iterator[Path]:
    """Files that a run writes, and those that are there under names that it gives."""
    yield from (folder / name for name in (CONFIG_FILE, LOG_FILE, CURVES_FILE))
    for name in (BEST_FILE, LAST_FILE):
        yield from (folder / name, place_card(folder / name))
    yield folder / STATE_FOLDER / STATE_FILE
    yield from sorted((folder / STATE_FOLDER).glob(TENSOR_FILES))
    yield from sorted((folder / PICTURES_FOLDER).glob(PICTURE_FILES))


def _is_of_run(path: Path) -> bool:
    return is_log(path) if path.name == LOG_FILE else is_own(path)
