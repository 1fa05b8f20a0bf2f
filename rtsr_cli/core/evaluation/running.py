"""Judging shots: frames stream through a few threads, results come out in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import torch
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.evaluation.comparing import Comparison
from rtsr_cli.core.evaluation.frames import JudgedFrame, read_judged
from rtsr_cli.core.evaluation.results import FrameScores
from rtsr_cli.core.evaluation.scoring import Rules, score_frame


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How to run.

    Attributes:
        rules: protocol and metrics.
        border: pixels left out at each side.
        skip_first: frames of each shot that take no part in means.
        jobs: frames at a time, each with one torch thread.
        device: of the tensors.
        keep: what to take of every frame beside its scores.
    """

    rules: Rules
    border: int = 0
    skip_first: int = 0
    jobs: int = 1
    device: str = "cpu"
    keep: Callable[[JudgedFrame], Any] | None = None


@dataclass(frozen=True, kw_only=True)
class ScoredFrame:
    """One frame's scores by method, and what `keep` took of it; or why it cannot be judged."""

    number: int
    scores: Mapping[str, FrameScores] = field(default_factory=dict)
    kept: Any = None
    failed: str = ""


def score_shot(comparison: Comparison, options: RunOptions) -> Iterator[ScoredFrame]:
    """Score every frame of a shot, in order; a few frames are in memory at a time.

    A frame is read once, for its own scores and for those of the next one. Reading waits in the
    same queue as scoring, ahead of it, so that any number of threads gets through. A frame that
    cannot be read fails, and is no history for the next one.
    """
    first = set(comparison.available[: options.skip_first])
    read: dict[int, Future[JudgedFrame]] = {}
    pending: deque[Future[ScoredFrame]] = deque()

    def frame_of(number: int) -> Future[JudgedFrame]:
        if number not in read:
            read[number] = pool.submit(
                read_judged, comparison, number, border=options.border, device=options.device
            )
        return read[number]

    def score(
        number: int, frame: Future[JudgedFrame], before: Future[JudgedFrame] | None
    ) -> ScoredFrame:
        error = frame.exception()
        if isinstance(error, RtsrError):
            return ScoredFrame(number=number, failed=str(error))
        current = frame.result()
        previous = None if before is None or before.exception() else before.result()
        scores = score_frame(current, previous, options.rules, counted=number not in first)
        kept = options.keep(current) if options.keep else None
        return ScoredFrame(number=number, scores=scores, kept=kept)

    with ThreadPoolExecutor(
        options.jobs, "rtsr-judge", initializer=torch.set_num_threads, initargs=(1,)
    ) as pool:
        try:
            for number in comparison.numbers:
                previous = comparison.previous(number)
                before = None if previous is None else frame_of(previous)
                pending.append(pool.submit(score, number, frame_of(number), before))
                for old in [n for n in read if n not in {number, number - comparison.step}]:
                    del read[old]
                if len(pending) > options.jobs:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
