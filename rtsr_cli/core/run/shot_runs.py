"""Running checked shots, one after the other: the same events whatever is done with a frame."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from rtsr_cli.core.errors import NonfiniteError, OutputBlockedError, RtsrError
from rtsr_cli.core.files.atomic_write import check_writable
from rtsr_cli.core.files.streaming import count_reads_ahead
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, Status
from rtsr_cli.core.run.loop import Outcome, Pace, Product, run_job, run_until_stopped
from rtsr_cli.core.run.outputs import DEBUG_FOLDER
from rtsr_cli.core.run.plan import ShotPlan
from rtsr_cli.core.run.request import FramesRequest

NONFINITE, NEGATIVE, AS_FLOAT = "nonfinite", "negative", "as_float"
NO_MATERIAL, NO_MATERIAL_WHY, STAGES = "no_material", "no_material_why", "stages"
"""Facts of a product: NaN and Inf that were repaired in its inputs, values of radiance below 0
there, whether it is float since half cannot hold it, the share of its pixels without material, and
the seconds of a prediction's parts.
"""


L = TypeVar("L")


class ShotJob(ABC, Generic[L]):
    """A planned shot and what is done with its frames, for the frame loop.

    Attributes:
        plan: of the shot.
    """

    def __init__(self, plan: ShotPlan, *, frame_bytes: int, release_every: int = 1) -> None:
        """Remember the plan.

        Args:
            plan: of the shot.
            frame_bytes: memory that reading one frame takes.
            release_every: as `Pace` has it.
        """
        self.plan = plan
        self._frame_bytes, self._release_every = frame_bytes, release_every

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
        return Pace(ahead=ahead, writers=jobs, queued=jobs + 1, release_every=self._release_every)

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
    findings = _Findings(request.out_folder)
    stopped = ""
    started = time.perf_counter()
    for frame in run_until_stopped(run_shot(job, request.jobs) for job in jobs):
        counts[frame.status] += 1
        stopped = frame.message if frame.stops else ""
        findings.add(frame)
        yield frame
    yield RunDone(
        folder=request.out_folder,
        seconds=time.perf_counter() - started,
        counts=counts,
        repaired=findings.repaired,
        spoilt=findings.spoilt,
        negative=findings.negative,
        as_float=tuple(findings.as_float),
        no_material=findings.no_material,
        no_material_why=findings.no_material_why,
        stopped=stopped,
    )
    if stopped:
        raise OutputBlockedError(
            f"{stopped}. {counts[Status.WRITTEN]} of {pending} frames are done; the same command "
            "writes the rest then"
        )


class _Findings:
    """What is told of single frames, by output, while they come in."""

    def __init__(self, folder: Path) -> None:
        """Start with nothing; outputs are named below `folder`."""
        self.repaired: dict[str, int] = {}
        self.spoilt: dict[str, int] = {}
        self.negative: dict[str, int] = {}
        self.as_float: list[str] = []
        self.no_material: dict[str, dict[int, float]] = {}
        self.no_material_why: dict[str, dict[str, dict[int, str]]] = {}
        self._folder = folder

    def add(self, frame: FrameDone) -> None:
        """Take in a frame's end."""
        name = frame.path.relative_to(self._folder).as_posix()
        if frame.nonfinite:
            failed = frame.status is Status.FAILED
            (self.spoilt if failed else self.repaired)[name] = frame.nonfinite
        if frame.negative:
            self.negative[name] = frame.negative
        if frame.as_float:
            self.as_float.append(name)
        if frame.no_material:
            self.no_material.setdefault(frame.shot, {})[frame.number] = frame.no_material
        for cause, place in frame.no_material_why.items():
            causes = self.no_material_why.setdefault(frame.shot, {})
            causes.setdefault(cause, {})[frame.number] = place


def run_shot(job: ShotJob[Any], jobs: int) -> Iterator[FrameDone]:
    """Run a shot; yield an event for every output that is asked for."""
    return (job.event(outcome) for outcome in run_job(job, job.pace(jobs)))


def describe_outcome(plan: ShotPlan, outcome: Outcome[int]) -> dict[str, Any]:
    """Return what `FrameDone` says of an outcome."""
    error = outcome.error
    failed = error is not None
    found: dict[str, Any] = {
        NONFINITE: 0, NEGATIVE: 0, AS_FLOAT: False, NO_MATERIAL: 0.0,
        NO_MATERIAL_WHY: {}, STAGES: {},
    }  # fmt: skip
    if isinstance(error, NonfiniteError):
        found[NONFINITE] = error.count
    elif not failed:
        found |= {name: outcome.facts[name] for name in found if name in outcome.facts}
    return {
        "shot": plan.inputs.name,
        "number": outcome.key,
        "status": outcome.status,
        "path": plan.path(outcome.key),
        "message": str(error) if failed else "",
        "seconds": 0.0 if failed else outcome.seconds,
        **found,
        "stops": outcome.stops,
    }
