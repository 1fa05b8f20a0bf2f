"""What glibc keeps of freed memory is given back, and one pool serves all threads."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

WORK = """
import threading
import numpy as np
from rtsr_cli.core.memory import {names}
{first}
def resident():
    pages = int(open("/proc/self/statm").read().split()[1])
    return pages * {page} / 2**20
turn, finished = threading.Lock(), threading.Barrier(4)
def work():
    with turn:
        [np.ones(200_000, np.uint8) for _ in range(400)]
    finished.wait()
before = resident()
threads = [threading.Thread(target=work) for _ in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
{last}
print(resident() - before)
"""


def grown_mib(names: str, first: str = "", last: str = "") -> float:
    """Memory that is kept after four threads in turn made and freed 80 MB."""
    page = os.sysconf("SC_PAGESIZE")
    code = WORK.format(names=names, first=first, last=last, page=page)
    # so that glibc takes arrays of this size from its pools, as it does those of frames later on
    kept = {"MALLOC_MMAP_THRESHOLD_": "1073741824", "MALLOC_TRIM_THRESHOLD_": "1073741824"}
    ran = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, **kept},
    )
    return float(ran.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's")
def test_what_was_freed_is_given_back() -> None:
    kept = grown_mib("release_freed")
    assert grown_mib("release_freed", last="release_freed()") < 0.8 * kept


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's")
def test_one_pool_keeps_less_than_one_a_thread() -> None:
    apart = grown_mib("share_one_pool")
    assert grown_mib("share_one_pool", first="share_one_pool()") < 0.5 * apart


LARGE = """
import numpy as np
from rtsr_cli.core.memory import return_large_arrays
{first}
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * {page} / 2**20
# of this size glibc takes arrays from its pool once one was freed
first = np.ones(30_000_000, np.uint8)
del first
before = resident()
arrays = [np.ones(8_000_000, np.uint8) for _ in range(20)]
del arrays[:-1]
print(resident() - before)
"""


def kept_below_the_last(first: str) -> float:
    """Memory that is kept after 19 of 20 arrays of 8 MB were freed, in MiB."""
    code = LARGE.format(first=first, page=os.sysconf("SC_PAGESIZE"))
    ran = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(ran.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's")
def test_large_arrays_are_given_back_at_once() -> None:
    assert kept_below_the_last("") > 100.0
    assert kept_below_the_last("return_large_arrays()") < 50.0
