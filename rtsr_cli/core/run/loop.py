"""The frame loop: read ahead, compute in order, write behind; the only one there is.

It goes through the keys of a job (a frame's number, say), and knows nothing of what is computed.
What fails fails alone, and a disk that takes no more ends the run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from rtsr_cli.core.errors import OutputBlockedError, RtsrError
from rtsr_cli.core.files.atomic_write import remove_leftovers
from rtsr_cli.core.files.streaming import BackgroundWriter, prefetch
from rtsr_cli.core.memory import (
    keep_freed,
    release_freed,
    return_large_arrays,
    share_one_pool,
)
from rtsr_cli.core.run.events import Status

K = TypeVar("K")
L = TypeVar("L")


class Stoppable(Protocol):
    """What became of a frame."""

    @property
    def stops(self) -> bool:
        """True if no other frame could be written either."""


S = TypeVar("S", bound=Stoppable)


@dataclass(frozen=True, kw_only=True)
class Product:
    """What was computed of a frame.

    Attributes:
        write: the call that writes its files, for any thread.
        facts: what is known of it, by name, for whoever hears of its end.
    """

    write: Callable[[], None]
    facts: Mapping[str, Any] = field(default_factory=dict)


class Job(Protocol[K, L]):
    """What a run does to one shot."""

    @property
    def folders(self) -> Iterable[Path]:
        """Folders of the outputs."""

    @property
    def kept(self) -> Iterable[K]:
        """Keys whose outputs are asked for, and there already."""

    @property
    def order(self) -> Iterable[K]:
        """Keys to go through, in order."""

    def load(self, key: K) -> L:
        """Read what a key needs, in any thread; up to `Pace.ahead` at a time."""

    def compute(self, key: K, loaded: L) -> Product | None:
        """Compute in the loop's thread, in order; None where nothing is to be written."""

    def fail(self, key: K, error: RtsrError) -> None:
        """Hear that loading or computing a key failed."""


@dataclass(frozen=True, kw_only=True)
class Pace:
    """How much is under way at a time.

    Attributes:
        ahead: keys that are loaded ahead, and threads that load them.
        writers: threads that write.
        queued: products that are written or wait for it before the loop waits for them.
        release_every: keys after which freed memory goes back to the system. More than 1 keeps it
            in between: arrays of which every key needs the same need not be cleared by the system
            again and again, for a third more memory.
    """

    ahead: int
    writers: int
    queued: int
    release_every: int = 1


@dataclass(frozen=True, kw_only=True)
class Outcome(Generic[K]):
    """What became of a key.

    Attributes:
        key: of the frame.
        status: written now, there already, or failed.
        facts: of the product.
        seconds: from loading's end to the writer's hands.
        error: why it failed, else None.
        stops: True if nothing else could be written either, so that the run ended.
    """

    key: K
    status: Status
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    error: RtsrError | None = None
    stops: bool = False


def run_job(job: Job[K, L], pace: Pace) -> Iterator[Outcome[K]]:
    """Go through a shot; yield an outcome for every output that is asked for."""
    for key in job.kept:
        yield Outcome(key=key, status=Status.KEPT)
    for folder in job.folders:
        remove_leftovers(folder)
    order = tuple(job.order)
    if not order:
        return
    if pace.release_every > 1:
        keep_freed()
    else:
        share_one_pool()
        return_large_arrays()
    with BackgroundWriter[Outcome[K]](pace.writers, queued=pace.queued) as writer:
        for outcome in _stream(job, order, pace, writer):
            yield outcome
            if outcome.stops:
                return


def _stream(
    job: Job[K, L], order: tuple[K, ...], pace: Pace, writer: BackgroundWriter[Outcome[K]]
) -> Iterator[Outcome[K]]:
    for place, (key, loaded) in enumerate(prefetch(job.load, order, pace.ahead), 1):
        started = time.perf_counter()
        try:
            product = job.compute(key, loaded.result())
        except RtsrError as error:
            job.fail(key, error)
            yield Outcome(key=key, status=Status.FAILED, error=error)
            continue
        if product is not None:
            seconds = time.perf_counter() - started
            done = Outcome(key=key, status=Status.WRITTEN, facts=product.facts, seconds=seconds)
            writer.submit(done, product.write)
        del loaded, product
        if place % pace.release_every == 0:
            release_freed()
        yield from _collect_written(writer, wait=False)
    yield from _collect_written(writer, wait=True)


def _collect_written(writer: BackgroundWriter[Outcome[K]], *, wait: bool) -> Iterator[Outcome[K]]:
    """Outcomes of finished writes; after one that blocks the others, only of those that succeed."""
    for done, error in writer.done(wait=wait):
        if error is None:
            yield done
            continue
        if not isinstance(error, RtsrError):
            raise error
        stops = isinstance(error, OutputBlockedError)
        if stops:
            yield from (late for late, worse in writer.drop() if worse is None)
        yield Outcome(
            key=done.key, status=Status.FAILED, facts=done.facts, error=error, stops=stops
        )
        if stops:
            return


def run_until_stopped(runs: Iterable[Iterator[S]]) -> Iterator[S]:
    """Go through the outcomes of one shot after the other, up to the one that stops them all."""
    for run in runs:
        for outcome in run:
            yield outcome
            if outcome.stops:
                return
