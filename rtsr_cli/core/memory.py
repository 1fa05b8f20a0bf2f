"""What glibc does with freed memory: give it back, or keep it for the next array."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache


@cache
def _trim() -> Callable[[int], int] | None:
    """glibc's `malloc_trim`, None where the C library has none."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        trim: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):
        return None
    return trim


M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
"""Parameters of glibc's `mallopt`."""

LARGE_BYTES = 6 * 2**20
"""Below a plane of a 1080p frame."""

MOST_MAPPED_BYTES = 2**25
"""The largest threshold that glibc takes for arrays that are mapped one by one."""

KEPT_BYTES = 2**30


def _set_option(option: int, value: int) -> None:
    """`mallopt`, where the C library has it."""
    if not sys.platform.startswith("linux"):
        return
    try:
        ctypes.CDLL(None).mallopt(option, value)
    except (OSError, AttributeError):
        return


def share_one_pool() -> None:
    """Let all threads take memory from one pool for the rest of the process.

    With pools of their own, threads that free each other's frames leave each pool as large as the
    most that it ever held: measured, 2.6 GiB in place of 2.1 where a network runs between threads
    that read and write 1080p frames.
    """
    _set_option(M_ARENA_MAX, 1)


def return_large_arrays() -> None:
    """Return arrays of `LARGE_BYTES` and more to the system as soon as each is freed.

    glibc 2.36 hardly uses the room again that aligned arrays, as torch's large ones are, leave:
    measured, 1.9 GiB in place of 1.5 where a network whose tensors take 0.9 runs on 1080p frames,
    at the same processor time within noise.
    """
    _set_option(M_MMAP_THRESHOLD, LARGE_BYTES)


def keep_freed() -> None:
    """Keep freed memory for the rest of the process, in one pool for all threads.

    For long work that makes the same arrays again and again in several threads: pages that go back
    to the system after every array come back as page faults, which stall the other threads, too.
    """
    share_one_pool()
    _set_option(M_MMAP_THRESHOLD, MOST_MAPPED_BYTES)
    _set_option(M_TRIM_THRESHOLD, KEPT_BYTES)


def release_freed() -> None:
    """Return what was freed: pieces of large arrays otherwise stay, and add up over a long run.

    Threads that free each other's arrays leave holes that glibc keeps: measured, 1.5 MiB a frame
    of 960 x 540 in an evaluation by two threads.
    """
    trim = _trim()
    if trim is not None:
        trim(0)
