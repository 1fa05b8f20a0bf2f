"""A reader, and what it rests on that measurement has shown."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.conventions import Conventions


@dataclass(frozen=True, kw_only=True)
class MeasuredReader:
    """A reader that knows how its files are to be read.

    Attributes:
        reader: with the settled conventions.
        measured: what they rest on.
        warnings: contradictions, for the user.
        notes: what was measured instead of presumed, for the user.
        by_measurement: names of conventions that neither the preset nor a declaration gave.
        undecided: why the frames cannot be read as anything, empty if they can.
        motion_undecided: why vectors cannot be read, empty if they can; the rest may be.
    """

    reader: FrameReader
    measured: StorageMeasurement
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    by_measurement: tuple[str, ...] = ()
    undecided: str = ""
    motion_undecided: str = ""


def add_warning(settled: MeasuredReader, text: str) -> MeasuredReader:
    """Return the same with one more contradiction to say."""
    return replace(settled, warnings=(*settled.warnings, text))


def take_measurement(
    settled: MeasuredReader, name: str, note: str, **changes: object
) -> MeasuredReader:
    """Read by what was measured in place of what was presumed.

    Args:
        settled: so far.
        name: of the convention.
        note: for the user.
        changes: fields of `Conventions`.
    """
    conventions: Conventions = replace(settled.reader.conventions, **changes)  # type: ignore[arg-type]
    return replace(
        settled,
        reader=replace(settled.reader, conventions=conventions),
        notes=(*settled.notes, note),
        by_measurement=(*settled.by_measurement, name),
    )
