from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from rtsr_cli.core.threads import share_among_threads

NUMBERS = """
import threading, torch
from rtsr_cli.core.files.streaming import prefetch
from rtsr_cli.core.threads import map_in_threads, run_single_threaded, worker_pool

def nested(_):
    each = map_in_threads(lambda _: torch.get_num_threads(), [1])
    return run_single_threaded(torch.get_num_threads), each

with worker_pool(3, "test") as pool:
    print(set(pool.map(lambda _: torch.get_num_threads(), range(12))))
print([future.result() for _, future in prefetch(nested, range(2), 2)])
fresh = []
thread = threading.Thread(target=lambda: fresh.append(torch.get_num_threads()))
thread.start()
thread.join()
print(fresh, torch.get_num_threads())
"""


def printed(code: str) -> list[str]:
    """Lines of a process of its own: the first thread to ask for its number decides."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


def test_workers_compute_with_one_thread_and_whatever_computes_beside_them_with_all() -> None:
    cores = printed("import torch; print(torch.get_num_threads())")[0]
    assert printed(NUMBERS) == ["{1}", "[(1, [1]), (1, [1])]", f"[{cores}] {cores}"]


@pytest.mark.parametrize("inference", [True, False])
def test_work_is_shared_in_the_callers_mode(inference: bool) -> None:
    with torch.inference_mode(inference):
        rows = torch.zeros(7)

        def count(row: int) -> None:
            rows[row] += 1.0

        share_among_threads(count, range(7))
        assert rows.tolist() == [1.0] * 7


def test_what_fails_in_a_thread_fails_where_it_was_asked_for() -> None:
    def fail(row: int) -> None:
        raise LookupError(row)

    with pytest.raises(LookupError):
        share_among_threads(fail, range(7))
