"""Conventions of shots pinned: what would be measured is declared, so that parts agree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.captures.capture_file import CAPTURE_FILE
from rtsr_cli.core.captures.declarations import DeclarationFiles
from rtsr_cli.core.captures.measuring.declaration_text import write_capture_text
from rtsr_cli.core.captures.shots import Shot
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.inspect.inspection import replace_capture
from rtsr_cli.core.inspect.readiness import match_resolutions
from rtsr_cli.core.pairs.opening import (
    ReadOptions,
    find_shots_of,
    measure_set,
    open_declarations,
    open_shot,
)

FILTER_WIDTH = "the width of LR radiance's pixel filter"
"""What is measured of a pair."""


@dataclass(frozen=True, kw_only=True)
class ShotPinned:
    """A shot whose parts will be read alike.

    Attributes:
        shot: path relative to IN.
        written: its capture.toml, None where nothing was left open.
        kept: file that a former one is kept as, None where there was none.
        measured: what was measured and is declared now.
    """

    shot: str
    written: Path | None = None
    kept: Path | None = None
    measured: tuple[str, ...] = ()


def pin_conventions(
    folder: Path, *, layout: str | None = None, layer: str | None = None, view: str | None = None
) -> Iterator[ShotPinned]:
    """Declare what measurement settles of every shot, in its capture.toml; run again, nothing.

    Args:
        folder: IN, a shot or a tree of shots.
        layout: preset or layout file; None = detected.
        layer: layer or stereo view that is read of files with several.
        view: stereo view that is read, of that layer if one is named.

    Raises:
        RtsrError: a file or declaration is wrong, or a capture.toml cannot be written.
    """
    options = ReadOptions(
        layout=layout, layer=layer, view=view, on_missing=MissingPolicy.SKIP, unrendered=True
    )
    files = open_declarations(folder, options)
    for shot in find_shots_of(folder, options, files=files):
        yield _pin_shot(shot, folder, options, files)


def _pin_shot(
    shot: Shot, folder: Path, options: ReadOptions, files: DeclarationFiles
) -> ShotPinned:
    opened = open_shot(shot, folder, options, files=files)
    capture = opened.declarations.capture
    main = measure_set(shot.frames, opened, jittered=True)
    measured = main.by_measurement
    if shot.hr is not None:
        hr = measure_set(shot.hr, opened, jittered=False, vectors=False)
        sources, _ = match_resolutions(main.reader, hr.reader, capture.scale)
        widths = [pairs.filter_width_px for _, pairs in sources if pairs.filter_measured]
        if widths:
            capture = capture.model_copy(update={"filter_width_px": widths[0]})
        of_pairs = (FILTER_WIDTH,) if widths else ()
        measured = tuple(dict.fromkeys((*measured, *hr.by_measurement, *of_pairs)))
    if not measured:
        return ShotPinned(shot=shot.name)
    path = shot.root / CAPTURE_FILE
    text = write_capture_text(main, capture, {}, {})
    kept = replace_capture(path, text, overwrite=True)
    return ShotPinned(shot=shot.name, written=path, kept=kept, measured=measured)
