"""The frame loop: when freed memory goes back to the system."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.run import loop
from rtsr_cli.core.run.loop import Pace, Product, run_job


class Counting:
    """A job of seven frames that write nothing."""

    folders: tuple[Path, ...] = ()
    kept: tuple[int, ...] = ()
    order = tuple(range(7))

    def load(self, key: int) -> int:
        return key

    def compute(self, key: int, loaded: int) -> Product | None:
        assert key == loaded
        return Product(write=lambda: None)

    def fail(self, key: int, error: RtsrError) -> None:
        raise AssertionError(key) from error


@pytest.mark.parametrize(
    ("every", "said"), [(1, ["share"] + 7 * ["release"]), (3, ["keep"] + 2 * ["release"])]
)
def test_freed_memory_goes_back_after_so_many_frames(
    monkeypatch: pytest.MonkeyPatch, every: int, said: list[str]
) -> None:
    heard: list[str] = []
    for name, function in (
        ("share", "share_one_pool"),
        ("keep", "keep_freed"),
        ("release", "release_freed"),
    ):
        monkeypatch.setattr(loop, function, lambda name=name: heard.append(name))
    done = list(run_job(Counting(), Pace(ahead=1, writers=1, queued=2, release_every=every)))
    assert sorted(outcome.key for outcome in done) == list(range(7))
    assert heard == said
