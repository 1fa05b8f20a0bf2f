"""Looking at a folder of frames: shot by shot, and what was found put down as capture.toml."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import count
from pathlib import Path

from rtsr_cli.core.captures.capture_file import CAPTURE_FILE
from rtsr_cli.core.captures.measuring.declaration_text import write_capture_text
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import OutputError, RtsrError
from rtsr_cli.core.files.atomic_write import write_atomically, write_text_atomically
from rtsr_cli.core.inspect.checked_commands import CheckedCommand
from rtsr_cli.core.inspect.events import (
    CaptureBlocked,
    CaptureWritten,
    FolderRefused,
    InspectEvent,
    InspectionDone,
    ShotInspected,
    ShotsListed,
)
from rtsr_cli.core.inspect.readiness import Severity
from rtsr_cli.core.inspect.request import InspectRequest
from rtsr_cli.core.inspect.shot_inspection import (
    ShotInspection,
    inspect_refused_folder,
    inspect_shot,
)
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of, open_declarations


def inspect(request: InspectRequest, commands: Sequence[CheckedCommand]) -> Iterator[InspectEvent]:
    """Inspect every shot of a folder; the last event is `InspectionDone`.

    Args:
        request: what is asked for.
        commands: whose systems and parts are told to be ready, or what they lack.

    Raises:
        RtsrError: no shots can be found. What is wrong with the frames of a shot is part of its
            inspection, and raises nothing.
    """
    options = ReadOptions(
        layout=request.layout,
        layer=request.layer,
        view=request.view,
        capture=request.capture_file,
        on_missing=MissingPolicy.SKIP,
    )
    try:
        files = open_declarations(request.in_folder, options)
        shots = find_shots_of(request.in_folder, options, files=files)
    except RtsrError as error:
        known = inspect_refused_folder(request.in_folder, str(error), commands)
        yield FolderRefused(inspection=known, message=str(error))
        raise
    yield ShotsListed(count=len(shots))
    worst = Severity.REMARK
    for shot in shots:
        inspection = inspect_shot(
            shot, request.in_folder, options, commands=commands, every=request.every, files=files
        )
        worst = max(worst, inspection.gravity)
        yield ShotInspected(inspection=inspection)
        if request.write:
            outcome = write_capture(inspection, overwrite=request.overwrite)
            if isinstance(outcome, CaptureBlocked):
                worst = Severity.REFUSED
            yield outcome
    yield InspectionDone(gravity=worst)


def write_capture(
    inspection: ShotInspection, *, overwrite: bool
) -> CaptureWritten | CaptureBlocked:
    """Write a shot's capture.toml, or say why it could not be written."""
    path = inspection.root / CAPTURE_FILE
    main = inspection.main
    known = {"filter_width_px": inspection.filter_width_px}
    capture = inspection.capture.model_copy(update=known if known["filter_width_px"] else {})
    text = write_capture_text(main.settled, capture, main.guessed, main.unknown, main.layers)
    try:
        kept = replace_capture(path, text, overwrite=overwrite)
    except OutputError as error:
        return CaptureBlocked(shot=inspection.name, message=str(error))
    return CaptureWritten(path=path, kept=kept)


def replace_capture(path: Path, text: str, *, overwrite: bool) -> Path | None:
    """Write the file; return what a former one is kept as, whose comments are not carried over."""
    if not os.path.lexists(path):
        write_text_atomically(path, text)
        return None
    if not overwrite:
        raise OutputError(f"{path} exists; give --overwrite to replace it")
    kept = _name_former(path)
    write_atomically(kept, partial(shutil.copyfile, path))
    write_text_atomically(path, text)
    return kept


def _name_former(path: Path) -> Path:
    """Name for a copy of what was there: one that is free, so that no former copy is lost."""
    names = (f"{path.name}.bak{number or ''}" for number in count())
    return next(kept for name in names if not os.path.lexists(kept := path.with_name(name)))
