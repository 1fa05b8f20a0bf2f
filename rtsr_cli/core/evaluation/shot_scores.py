"""Judging shots: frames stream through a few threads, results come out in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from typing import Any

from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.evaluation.comparisons import Comparison
from rtsr_cli.core.evaluation.frame_scores import score_frame
from rtsr_cli.core.evaluation.judged_frames import JudgedFrame, read_judged, read_surfaces
from rtsr_cli.core.evaluation.metric_table import MetricRules, keep_changes
from rtsr_cli.core.evaluation.score_summary import FrameScores
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.memory import release_freed
from rtsr_cli.core.threads import worker_pool


@dataclass(frozen=True, kw_only=True)
class ScoringOptions:
    """How to run.

    Attributes:
        rules: protocol and metrics.
        border: pixels left out at each side.
        skip_first: frames of each shot that take no part in means.
        jobs: frames at a time, each with one torch thread.
        device: of the tensors.
        keep: what to take of every frame beside its scores.
    """

    rules: MetricRules
    border: int = 0
    skip_first: int = 0
    jobs: int = 1
    device: str = "cpu"
    keep: Callable[[JudgedFrame], Any] | None = None


@dataclass(frozen=True, kw_only=True)
class ScoredFrame:
    """One frame's scores by method, and what `keep` took of it; or why it cannot be judged.

    Of a frame that lies between judged ones nothing is kept.
    """

    number: int
    scores: Mapping[str, FrameScores] = field(default_factory=dict)
    kept: Any = None
    failed: str = ""


class _Frames:
    """Frames of a shot on their way: each is read once, for its own scores and for the next's."""

    def __init__(self, comparison: Comparison, options: ScoringOptions, pool: Executor) -> None:
        """Start with none."""
        self._comparison = comparison
        self._options = options
        self._pool = pool
        self._read: dict[int, Future[JudgedFrame]] = {}
        self._first = frozenset(comparison.available[: options.skip_first])

    def submit(self, number: int, ahead: Sequence[int]) -> Future[ScoredFrame]:
        """Queue a frame's reading, that of those `ahead`, and its scoring; let go what is over.

        No thread then waits in a score for what nobody reads yet.
        """
        previous = self._comparison.previous(number)
        before = None if previous is None else self._begin_reading(previous)
        surfaces = None if before is not None else self._read_surfaces_before(number)
        current = self._begin_reading(number)
        for later in ahead:
            self._begin_reading(later)
        scored = self._pool.submit(self._score, number, current, before, surfaces)
        needed = {number, previous, *ahead}
        self._read = {n: f for n, f in self._read.items() if n in needed}
        return scored

    def _begin_reading(self, number: int) -> Future[JudgedFrame]:
        if number not in self._read:
            border, device = self._options.border, self._options.device
            self._read[number] = self._pool.submit(
                read_judged, self._comparison, number, border=border, device=device
            )
        return self._read[number]

    def _read_surfaces_before(self, number: int) -> Future[Frame | None] | None:
        """Read the buffers of the frame before one that not every folder has; None without."""
        before = self._comparison.surfaces_before(number)
        if before is None:
            return None
        border, device = self._options.border, self._options.device
        return self._pool.submit(
            read_surfaces, self._comparison, before, border=border, device=device
        )

    def _score(
        self,
        number: int,
        frame: Future[JudgedFrame],
        before: Future[JudgedFrame] | None,
        surfaces_before: Future[Frame | None] | None,
    ) -> ScoredFrame:
        error = frame.exception()
        if isinstance(error, RtsrError):
            return ScoredFrame(number=number, failed=str(error))
        current = frame.result()
        previous = None if before is None or before.exception() else before.result()
        counted, rules, keep = number not in self._first, self._options.rules, self._options.keep
        if current.between:
            changes = score_frame(current, previous, keep_changes(rules), counted=counted)
            return ScoredFrame(number=number, scores=changes)
        surfaces = None if surfaces_before is None else surfaces_before.result()
        scores = score_frame(current, previous, rules, counted=counted, surfaces_before=surfaces)
        return ScoredFrame(number=number, scores=scores, kept=keep(current) if keep else None)


RELEASE_EVERY = 8
"""Frames after which freed memory is given back."""


def score_shot(comparison: Comparison, options: ScoringOptions) -> Iterator[ScoredFrame]:
    """Score every frame of a shot, in order; a few frames are in memory at a time.

    Reading waits in the same queue as scoring, ahead of it, so that any number of threads gets
    through. A frame that cannot be read fails, and is no history for the next one.
    """
    pending: deque[Future[ScoredFrame]] = deque()
    with worker_pool(options.jobs, "rtsr-judge") as pool:
        frames = _Frames(comparison, options, pool)
        try:
            for place, number in enumerate(comparison.shown, start=1):
                ahead = comparison.shown[place : place + options.jobs - 1]
                pending.append(frames.submit(number, ahead))
                if len(pending) > options.jobs:
                    yield pending.popleft().result()
                if place % RELEASE_EVERY == 0:
                    release_freed()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
