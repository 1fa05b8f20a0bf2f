"""Threads that compute beside each other, each with one torch thread.

Torch splits one operation over threads of its own, which wait for each other after each. Where
there is more than one thing to do, a thread a thing costs less; networks keep all of torch's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Lock, Thread, local
from typing import TypeVar

import torch

K = TypeVar("K")
V = TypeVar("V")

AT_ONCE = 2
"""Frames that are measured at a time."""

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


def share_among_threads(work: Callable[[K], None], items: Sequence[K]) -> None:
    """Work on every item, as many at a time as the caller has torch threads.

    `work` sees the caller's inference mode, which is a thread's own.
    """
    workers = min(torch.get_num_threads(), len(items))
    if workers <= 1:
        for item in items:
            work(item)
        return
    inference = torch.is_inference_mode_enabled()

    def work_alike(item: K) -> None:
        with torch.inference_mode(inference):
            work(item)

    with worker_pool(workers, "rtsr-share") as pool:
        for done in [pool.submit(work_alike, item) for item in items]:
            done.result()
