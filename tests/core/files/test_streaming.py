from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from rtsr_cli.core.files.streaming import BackgroundWriter, prefetch


class InFlight:
    """Counts what is loaded and not yet given up."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.now = 0
        self.most = 0

    def enter(self) -> None:
        with self.lock:
            self.now += 1
            self.most = max(self.most, self.now)

    def leave(self) -> None:
        with self.lock:
            self.now -= 1


def test_items_come_in_order_however_long_each_takes() -> None:
    def load(item: int) -> int:
        time.sleep(0.01 if item % 3 == 0 else 0.0)
        return item * item

    loaded = [(item, future.result()) for item, future in prefetch(load, range(12), 4)]
    assert loaded == [(i, i * i) for i in range(12)]


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_no_more_than_the_jobs_and_the_one_in_use_are_in_memory(jobs: int) -> None:
    count = InFlight()

    def load(item: int) -> int:
        count.enter()
        return item

    for _, future in prefetch(load, range(20), jobs):
        future.result()
        time.sleep(0.002)
        count.leave()
    assert 1 < count.most <= jobs + 1
    assert count.now == 0


def test_items_are_taken_only_as_they_are_needed() -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for i in range(1000):
            taken.append(i)
            yield i

    stream = prefetch(lambda i: i, items(), 2)
    next(stream)
    assert len(taken) == 3
    stream.close()  # type: ignore[attr-defined]
    assert len(taken) == 3


def test_an_error_of_one_item_is_raised_for_that_item_alone() -> None:
    def load(item: int) -> int:
        if item == 2:
            raise ValueError("item 2")
        return item

    outcomes: list[object] = []
    for item, future in prefetch(load, range(5), 2):
        try:
            outcomes.append(future.result())
        except ValueError as error:
            outcomes.append((item, str(error)))
    assert outcomes == [0, 1, (2, "item 2"), 3, 4]


def test_nothing_to_load_yields_nothing() -> None:
    assert list(prefetch(lambda item: item, [], 2)) == []


def test_writes_are_reported_in_the_order_of_submission() -> None:
    with BackgroundWriter[int](3) as writer:
        for key in range(8):
            writer.submit(key, lambda key=key: time.sleep(0.004 * (8 - key)))
        assert [key for key, _ in writer.done(wait=True)] == list(range(8))


def test_a_failed_write_is_reported_with_its_key_and_the_others_go_on() -> None:
    def fail() -> None:
        raise OSError("disk full")

    with BackgroundWriter[str](2) as writer:
        for key, write in (("a", lambda: None), ("b", fail), ("c", lambda: None)):
            writer.submit(key, write)
        outcomes = dict(writer.done(wait=True))
    assert outcomes["a"] is None
    assert outcomes["c"] is None
    assert isinstance(outcomes["b"], OSError)


@pytest.mark.parametrize("jobs", [1, 3])
def test_asking_what_is_done_after_every_write_keeps_the_queue_short(jobs: int) -> None:
    count = InFlight()
    with BackgroundWriter[int](jobs) as writer:
        for key in range(20):
            count.enter()
            writer.submit(key, lambda: time.sleep(0.001))
            for _ in writer.done():
                count.leave()
        for _ in writer.done(wait=True):
            count.leave()
    assert count.most <= jobs + 1
    assert count.now == 0


def test_an_error_elsewhere_drops_what_is_only_queued() -> None:
    written: list[int] = []
    started, go_on = threading.Event(), threading.Event()

    def slow() -> None:
        started.set()
        go_on.wait(5)
        written.append(0)

    def interrupted() -> None:
        with BackgroundWriter[int](1) as writer:
            writer.submit(0, slow)
            for key in range(1, 5):
                writer.submit(key, lambda key=key: written.append(key))
            started.wait(5)
            threading.Timer(0.02, go_on.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert written == [0]


def test_dropping_forgets_what_is_queued_and_waits_for_what_runs() -> None:
    running, go_on = threading.Event(), threading.Event()

    def slow() -> None:
        running.set()
        go_on.wait(10)

    with BackgroundWriter[str](1) as writer:
        writer.submit("runs", slow)
        writer.submit("waits", lambda: None)
        assert running.wait(10)
        go_on.set()
        # the second may have begun as the first ended, but nothing is left behind
        ended = [key for key, _ in writer.drop()]
        assert ended[0] == "runs"
        assert list(writer.done(wait=True)) == []
