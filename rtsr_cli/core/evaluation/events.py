"""What an evaluation says while it goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtsr_cli.core.shapes import Size


@dataclass(frozen=True, kw_only=True)
class MetricUnavailable:
    """A metric that is left out.

    Attributes:
        metric: its name.
        reason: what is not installed, and how to get it.
    """

    metric: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class ComparisonPlanned:
    """A shot that is going to be judged.

    Attributes:
        shot: its path below the test folders, "" for the folders themselves.
        tests: names of the methods that are judged.
        frames: numbers that are judged, in order.
        size: (height, width) of a judged frame.
        reference: folder of the true frames.
        gbuffer: folder of the buffers, None where there are none.
        counts: True if some frame takes part in means.
        remarks: what the search for frames left out.
        stamped: whether these are the frames that are stamped as predicted, and no others.
        notes: what is to be said of the buffers; the result has them as well.
    """

    shot: str
    tests: tuple[str, ...]
    frames: tuple[int, ...]
    size: Size
    reference: Path
    gbuffer: Path | None
    counts: bool
    remarks: tuple[str, ...] = ()
    stamped: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class JudgingStarted:
    """Everything is checked.

    Attributes:
        frames: how many there are to judge.
    """

    frames: int


@dataclass(frozen=True, kw_only=True)
class FrameJudged:
    """One frame of all methods.

    Attributes:
        shot: its shot.
        number: its number.
        failed: why it could not be judged, "" if it was.
    """

    shot: str
    number: int
    failed: str = ""


@dataclass(frozen=True, kw_only=True)
class ResultReady:
    """All figures are there; nothing is written yet.

    Attributes:
        result: plain values, as the JSON file has them (infinite numbers are numbers here).
    """

    result: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ResultWritten:
    """An output is written.

    Attributes:
        path: of the file.
    """

    path: Path


@dataclass(frozen=True, kw_only=True)
class EvaluationDone:
    """The summary.

    Attributes:
        result: plain values, as the JSON file has them (infinite numbers are numbers here).
        missed: demands that a test misses, each a sentence.
        failed: why frames could not be judged, each a sentence.
        lacking: metrics that were asked for by name and could not be had.
    """

    result: Mapping[str, Any]
    missed: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    lacking: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True if everything asked for is there and meets the demands."""
        return not (self.missed or self.failed or self.lacking)


EvaluationEvent = (
    MetricUnavailable
    | ComparisonPlanned
    | JudgingStarted
    | FrameJudged
    | ResultReady
    | ResultWritten
    | EvaluationDone
)
