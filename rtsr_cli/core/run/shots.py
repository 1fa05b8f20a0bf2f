"""Running checked shots, one after the other: the same events whatever is done with a frame."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

from rtsr_cli.core.errors import OutputBlockedError
from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, Status
from rtsr_cli.core.run.loop import Job, Outcome, Pace, run_job, until_stopped
from rtsr_cli.core.run.plan import ShotPlan
from rtsr_cli.core.run.request import FramesRequest

NONFINITE = "nonfinite"
"""Fact of a product: NaN and Inf that were repaired in its inputs."""


class ShotJob(Job[int, Any], Protocol):
    """What a run does to one planned shot."""

    @property
    def plan(self) -> ShotPlan:
        """Of the shot."""

    def pace(self, jobs: int) -> Pace:
        """Return how much is under way at a time with `jobs` readers and writers."""

    def event(self, outcome: Outcome[int]) -> FrameDone:
        """Return the event of a frame's end."""


def run_shots(
    jobs: Sequence[ShotJob], request: FramesRequest
) -> Iterator[RunStarted | FrameDone | RunDone]:
    """Go through checked shots.

    Raises:
        OutputBlockedError: after the last event: nothing more can be written.
        RtsrError: an output folder cannot be written to.
    """
    for job in jobs:
        check_writable(job.plan.outputs.folder)
    pending = sum(len(job.plan.pending) for job in jobs)
    yield RunStarted(pending=pending)
    counts = dict.fromkeys(Status, 0)
    repaired: dict[str, int] = {}
    stopped = ""
    started = time.perf_counter()
    for frame in until_stopped(shot_events(job, request.jobs) for job in jobs):
        counts[frame.status] += 1
        stopped = frame.message if frame.stops else ""
        if frame.nonfinite:
            repaired[frame.path.name] = frame.nonfinite
        yield frame
    yield RunDone(
        folder=request.out_folder,
        seconds=time.perf_counter() - started,
        counts=counts,
        repaired=repaired,
        stopped=stopped,
    )
    if stopped:
        raise OutputBlockedError(
            f"{stopped}. {counts[Status.WRITTEN]} of {pending} frames are done; the same command "
            "writes the rest then"
        )


def shot_events(job: ShotJob, jobs: int) -> Iterator[FrameDone]:
    """Run a shot; yield an event for every output that is asked for."""
    return (job.event(outcome) for outcome in run_job(job, job.pace(jobs)))


def frame_facts(plan: ShotPlan, outcome: Outcome[int]) -> dict[str, Any]:
    """Return what `FrameDone` says of an outcome."""
    failed = outcome.error is not None
    return {
        "shot": plan.inputs.name,
        "number": outcome.key,
        "status": outcome.status,
        "path": plan.path(outcome.key),
        "message": str(outcome.error) if failed else "",
        "seconds": 0.0 if failed else outcome.seconds,
        "nonfinite": 0 if failed else outcome.facts.get(NONFINITE, 0),
        "stops": outcome.stops,
    }
