"""Overlapping reading, computing and writing with bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from types import TracebackType
from typing import Generic, Self, TypeVar

from rtsr_cli.core.threads import worker_pool

K = TypeVar("K")
V = TypeVar("V")

READ_AHEAD_BYTES = 1 << 30
"""Frames read ahead may take this much memory together; one is always read ahead."""

LoadedItem = tuple[K, Future[V]]
"""An item and its finished future; asking the future raises what loading raised."""


def count_reads_ahead(jobs: int, frame_bytes: int) -> int:
    """Frames to read at a time: `jobs`, or as many as the memory for it holds."""
    return max(1, min(jobs, READ_AHEAD_BYTES // max(1, frame_bytes)))


def prefetch(
    load: Callable[[K], V], items: Iterable[K], jobs: int, *, ahead: int | None = None
) -> Iterator[LoadedItem[K, V]]:
    """Load items ahead in `jobs` threads and yield them in order.

    At most `ahead` items (`jobs` if None) are loaded or being loaded beside the one in use. An
    error of one item is raised only when its future is asked, so that the others go on.
    """
    limit = jobs if ahead is None else ahead
    pending: deque[LoadedItem[K, V]] = deque()
    iterator = iter(items)
    with worker_pool(jobs, "rtsr-read") as pool:
        try:
            for item in iterator:
                pending.append((item, pool.submit(load, item)))
                if len(pending) > limit:
                    yield _take_finished(pending.popleft())
            while pending:
                yield _take_finished(pending.popleft())
        finally:
            for _, future in pending:
                future.cancel()


def _take_finished(loaded: LoadedItem[K, V]) -> LoadedItem[K, V]:
    loaded[1].exception()
    return loaded


class BackgroundWriter(Generic[K]):
    """Runs write calls in threads of its own, with a bound on those that wait.

    `done` yields each key with the error of its write, or None, in the order of submission.
    """

    def __init__(self, jobs: int, *, queued: int | None = None) -> None:
        """Start `jobs` threads; `done` waits from `queued` calls on, `jobs + 1` by default."""
        self._pool = worker_pool(jobs, "rtsr-write")
        self._pending: deque[tuple[K, Future[None]]] = deque()
        self._limit = jobs + 1 if queued is None else queued

    def submit(self, key: K, write: Callable[[], None]) -> None:
        """Queue a write."""
        self._pending.append((key, self._pool.submit(write)))

    def done(self, *, wait: bool = False) -> Iterator[tuple[K, BaseException | None]]:
        """Yield finished writes; block while too many are queued, or for all if `wait`."""
        while self._pending and (
            wait or len(self._pending) >= self._limit or self._pending[0][1].done()
        ):
            key, future = self._pending.popleft()
            yield key, future.exception()

    def drop(self) -> Iterator[tuple[K, BaseException | None]]:
        """Forget what is only queued, and yield the rest as it ends."""
        for _, future in self._pending:
            future.cancel()
        started = [(key, future) for key, future in self._pending if not future.cancelled()]
        self._pending.clear()
        for key, future in started:
            yield key, future.exception()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish what is being written; drop what is only queued if an error is under way."""
        self._pool.shutdown(wait=True, cancel_futures=error is not None)
