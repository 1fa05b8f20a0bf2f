"""Overlapping reading, computing and writing with bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Barrier, Lock, Thread, local
from types import TracebackType
from typing import Generic, Self, TypeVar

import torch

K = TypeVar("K")
V = TypeVar("V")

READ_AHEAD_BYTES = 1 << 30
"""Frames read ahead may take this much memory together; one is always read ahead."""

AT_ONCE = 2
"""Frames that are measured at a time."""

LoadedItem = tuple[K, Future[V]]
"""An item and its finished future; asking the future raises what loading raised."""


_STARTING = Lock()
"""Held while the number that new threads compute with is another one."""

_OWNER = local()
"""Of a pool's thread: `count`, the torch threads of whoever started the pool."""


def _set_for_new_threads(count: int) -> None:
    """Set what threads get that never asked for their number; those that did keep theirs."""
    setting = Thread(target=torch.set_num_threads, args=(count,))
    setting.start()
    setting.join()


def worker_pool(workers: int, name: str) -> ThreadPoolExecutor:
    """Return a started pool whose threads compute with one torch thread each.

    More would fight the network's for the same cores, and stall on every small operation. The
    caller's number stays what it is: torch's number is that of a thread, and a thread that never
    asked for it takes the one that was set last, by whomever.
    """
    count: int = getattr(_OWNER, "count", None) or torch.get_num_threads()
    pool = ThreadPoolExecutor(workers, name)
    barrier = Barrier(workers + 1)

    def start() -> None:
        torch.get_num_threads()
        _OWNER.count = count
        barrier.wait()

    with _STARTING:
        _set_for_new_threads(1)
        for _ in range(workers):
            pool.submit(start)
        barrier.wait()
        _set_for_new_threads(count)
    return pool


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


def run_single_threaded(work: Callable[[], V]) -> V:
    """Run many small tensor operations with one torch thread, whatever the process uses.

    Threads that wait for each other after every small operation stall on busy cores.
    """
    with worker_pool(1, "rtsr-measure") as pool:
        return pool.submit(work).result()


def map_in_threads(work: Callable[[K], V], items: Iterable[K]) -> list[V]:
    """`map`, `AT_ONCE` items at a time, each with one torch thread; results in order."""
    with worker_pool(AT_ONCE, "rtsr-each") as pool:
        return list(pool.map(work, items))


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
