"""What a run says of itself, one event after the other; the same for a terminal and a notebook."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.gaps import format_gaps, list_gaps
from rtsr_cli.core.frames.selection import format_ranges

BETTER = "better"
"""Detail of a plan: why no system that is preferred to the chosen one can run; may be empty."""

FILTER, FILTER_DOUBT = "filter", "filter_doubt"
"""Details of a plan: which pixel filter of LR radiance it reckons with, and that a declared one is
not what frames have, or that both sizes hardly show one picture; may be empty."""


class Status(StrEnum):
    """What became of a frame."""

    WRITTEN = "written"
    KEPT = "kept"
    FAILED = "failed"


@dataclass(frozen=True, kw_only=True)
class ShotPlanned:
    """A shot that was checked: what is going to be done to it.

    Attributes:
        shot: path relative to IN.
        reader: names and numbers the outputs.
        readers: every reader behind the shot.
        selected: numbers of the outputs that are asked for.
        pending: how many of them are not done.
        damaged: files that were cut or damaged after they were written, and are made again.
        empty: files that hold nothing, and are made.
        skipped: reason -> ranges of frames that are not written, or are not themselves.
        read_bytes: size of the files that the run will read.
        write_bytes_at_most: what it will write, without compression.
        details: what is known of this kind of run, plain values by name.
    """

    shot: str
    reader: FrameReader
    readers: tuple[FrameReader, ...]
    selected: tuple[int, ...]
    pending: int
    damaged: tuple[Path, ...] = ()
    empty: tuple[Path, ...] = ()
    skipped: Mapping[str, str]
    read_bytes: int
    write_bytes_at_most: int
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def facts(self) -> dict[str, Any]:
        """The plan as plain values."""
        return {
            "shot": self.shot,
            "layout": self.reader.layout.name,
            "layer": self.reader.layer or None,
            "frames": len(self.selected),
            "pending": self.pending,
            "damaged": [str(path) for path in self.damaged],
            "empty": [str(path) for path in self.empty],
            "skipped": dict(self.skipped),
            "warnings": [text for reader in self.readers for text in reader.warnings],
            "notes": [text for reader in self.readers for text in reader.notes],
            "read_bytes": self.read_bytes,
            "write_bytes_at_most": self.write_bytes_at_most,
            **self.details,
        }


@dataclass(frozen=True, kw_only=True)
class RunStarted:
    """Every shot is checked; from here on files are written.

    Attributes:
        pending: outputs that will be made.
    """

    pending: int


@dataclass(frozen=True, kw_only=True)
class FrameDone:
    """One output frame's end.

    Attributes:
        shot: path relative to IN.
        number: of the frame.
        status: written now, there already, or failed.
        path: of the output.
        message: why it failed.
        seconds: from reading's end to the writer's hands.
        nonfinite: NaN and Inf that were repaired in its inputs; of a frame that failed of them,
            those in its inputs, or that it would have held.
        negative: values of radiance below 0 in its inputs.
        as_float: True if it is written as float, since half cannot hold its radiance.
        no_material: share of its pixels whose material carries no radiance: theirs is enlarged.
        no_material_why: causes of that -> where in the picture.
        stages: seconds of a prediction's parts, by name; empty where nothing was predicted.
        stops: True if no other frame could be written either, so that the run ended.
    """

    shot: str
    number: int
    status: Status
    path: Path
    message: str = ""
    seconds: float = 0.0
    nonfinite: int = 0
    negative: int = 0
    as_float: bool = False
    no_material: float = 0.0
    no_material_why: Mapping[str, str] = field(default_factory=dict)
    stages: Mapping[str, float] = field(default_factory=dict)
    stops: bool = False

    @property
    def facts(self) -> dict[str, Any]:
        """The event as plain values."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class RunDone:
    """A run's end.

    Attributes:
        folder: OUT.
        seconds: from the first frame to the last; None where nobody is told.
        counts: frames by what became of them.
        repaired: output, below OUT -> NaN and Inf that were repaired in its inputs.
        spoilt: output -> NaN and Inf that it failed of, and is not written for.
        negative: output -> values of radiance below 0 in its inputs.
        as_float: outputs that are float, since half cannot hold their radiance.
        no_material: shot -> frame -> share of its pixels whose material carries no radiance.
        no_material_why: shot -> cause of that -> frame -> where in the picture.
        stopped: why nothing more could be written; empty if all went on.
    """

    folder: Path
    seconds: float | None
    counts: Mapping[Status, int]
    repaired: Mapping[str, int]
    spoilt: Mapping[str, int] = field(default_factory=dict)
    negative: Mapping[str, int] = field(default_factory=dict)
    as_float: tuple[str, ...] = ()
    no_material: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    no_material_why: Mapping[str, Mapping[str, Mapping[int, str]]] = field(default_factory=dict)
    stopped: str = ""

    @property
    def failed(self) -> bool:
        """Tell whether a frame failed."""
        return self.counts[Status.FAILED] > 0

    @property
    def facts(self) -> dict[str, Any]:
        """The summary as plain values."""
        return {
            **({} if self.seconds is None else {"seconds": round(self.seconds, 3)}),
            **{status.value: count for status, count in self.counts.items()},
            "nonfinite": sum(self.repaired.values()) + sum(self.spoilt.values()),
            "negative": sum(self.negative.values()),
            "as_float": len(self.as_float),
            "no_material": sum(len(frames) for frames in self.no_material.values()),
            "stopped": bool(self.stopped),
        }


def describe_skipped(
    reader: FrameReader, selected: Sequence[int], pending: Collection[int]
) -> dict[str, str]:
    """Say which frames of a shot are not written, or are not themselves, and why; as ranges."""
    there = set(reader.frames.numbers)
    reasons = {
        "done": format_ranges(set(selected) - set(pending)),
        "not_selected": format_ranges(set(reader.numbers) - set(selected)),
        "missing": format_gaps(list_gaps(reader.numbers, there, reader.step)),
        "held": format_ranges(set(reader.held) & set(selected)),
    }
    return {reason: numbers for reason, numbers in reasons.items() if numbers}
