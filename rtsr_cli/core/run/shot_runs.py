"""Running checked shots, one after the other: the same events whatever is done with a frame."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from rtsr_cli.core.errors import OutputBlockedError, RtsrError
from rtsr_cli.core.files.atomic_write import check_writable
from rtsr_cli.core.files.streaming import count_reads_ahead
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, Status
from rtsr_cli.core.run.loop import Outcome, Pace, Product, run_job, run_until_stopped
from rtsr_cli.core.run.outputs import DEBUG_FOLDER
from rtsr_cli.core.run.plan import ShotPlan
from rtsr_cli.core.run.request import FramesRequest

NONFINITE = "nonfinite"
"""Fact of a product: NaN and Inf that were repaired in its inputs."""


L = TypeVar("L")


class ShotJob(ABC, Generic[L]):
    """A planned shot and what is done with its frames, for the frame loop.

    Attributes:
        plan: of the shot.
    """

    def __init__(self, plan: ShotPlan, *, frame_bytes: int) -> None:
        """Remember the plan; `frame_bytes` is the memory that reading one frame takes."""
        self.plan = plan
        self._frame_bytes = frame_bytes

    @property
    def folders(self) -> Iterable[Path]:
        """Folders of the outputs, and of what was seen and decided."""
        folder = self.plan.outputs.folder
        return (folder, folder / DEBUG_FOLDER)

    @property
    def kept(self) -> Iterable[int]:
        """Numbers of outputs that are there."""
        return (number for number in self.plan.selected if number not in self.plan.pending)

    @property
    def order(self) -> Iterable[int]:
        """Numbers to go through."""
        return self.plan.order

    def pace(self, jobs: int) -> Pace:
        """Return how much is under way at a time with `jobs` readers and writers."""
        ahead = count_reads_ahead(jobs, self._frame_bytes)
        return Pace(ahead=ahead, writers=jobs, queued=jobs + 1)

    @abstractmethod
    def load(self, key: int) -> L:
        """Read what a frame needs, in any thread."""

    @abstractmethod
    def compute(self, key: int, loaded: L) -> Product | None:
        """Compute a frame in the loop's thread, in order; None where nothing is to be written."""

    def fail(self, key: int, error: RtsrError) -> None:
        """Hear that a frame failed; frames that do not depend on each other go on."""

    def event(self, outcome: Outcome[int]) -> FrameDone:
        """Return the event of a frame's end."""
        return FrameDone(**describe_outcome(self.plan, outcome))


def run_shots(
    jobs: Sequence[ShotJob[Any]], request: FramesRequest
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
    for frame in run_until_stopped(run_shot(job, request.jobs) for job in jobs):
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


def run_shot(job: ShotJob[Any], jobs: int) -> Iterator[FrameDone]:
    """Run a shot; yield an event for every output that is asked for."""
    return (job.event(outcome) for outcome in run_job(job, job.pace(jobs)))


def describe_outcome(plan: ShotPlan, outcome: Outcome[int]) -> dict[str, Any]:
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
